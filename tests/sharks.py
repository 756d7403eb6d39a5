"""tshark, as tests call it: with the dissector, and the fields of packets as lists."""

from __future__ import annotations

import shutil
import subprocess
from typing import TYPE_CHECKING, Final

import pytest

from tests.commands import environment

if TYPE_CHECKING:
    from collections.abc import Sequence
    from pathlib import Path

_BETWEEN: Final = "\x1f"


def tshark(script: Path, *arguments: str, fields: Sequence[str]) -> list[dict[str, list[str]]]:
    """Return all values of fields for each packet, with a dissector; skips without tshark."""
    if shutil.which("tshark") is None:
        pytest.skip("needs tshark")
    asked = [argument for name in fields for argument in ("-e", name)]
    format_ = ["-T", "fields", "-E", "occurrence=a", "-E", f"aggregator={_BETWEEN}"]
    ran = subprocess.run(
        ["tshark", "-X", f"lua_script:{script}", *arguments, *format_, *asked],
        capture_output=True,
        text=True,
        check=False,
        timeout=120,
        env=environment(),
    )
    assert ran.returncode == 0, ran.stderr
    assert "Lua" not in ran.stderr, ran.stderr
    lines = ran.stdout.split("\n")[:-1]
    return [
        {
            name: value.split(_BETWEEN) if value else []
            for name, value in zip(fields, line.split("\t"), strict=True)
        }
        for line in lines
    ]


def join(target: Path, captures: Sequence[str]) -> None:
    """Write captures behind each other, each with its own interface; skips without mergecap."""
    if shutil.which("mergecap") is None:
        pytest.skip("needs mergecap, which comes with tshark")
    # sections behind each other would do, but tshark 4.0 shows all with the last one's interface
    command = ["mergecap", "-a", "-I", "none", "-w", str(target), *captures]
    subprocess.run(command, check=True, capture_output=True, timeout=60)


def summed_up(script: Path, capture: Path, *arguments: str) -> str:
    """Return what tshark says of all packets with such options; skips without tshark."""
    if shutil.which("tshark") is None:
        pytest.skip("needs tshark")
    command = ["tshark", "-X", f"lua_script:{script}", "-r", str(capture), "-q", *arguments]
    ran = subprocess.run(command, capture_output=True, text=True, timeout=120, check=False)
    assert ran.returncode == 0, ran.stderr
    return ran.stdout


def counted(script: Path, capture: Path, filters: Sequence[str]) -> list[int]:
    """Return how many packets each filter shows, all in one go; skips without tshark."""
    if shutil.which("tshark") is None:
        pytest.skip("needs tshark")
    command = ["tshark", "-2", "-X", f"lua_script:{script}", "-r", str(capture), "-q"]
    told = ",".join(["io,stat,0", *filters])
    ran = subprocess.run(
        [*command, "-z", told], capture_output=True, text=True, timeout=120, check=False
    )
    assert ran.returncode == 0, ran.stderr
    rows = [line for line in ran.stdout.splitlines() if "<>" in line]
    assert len(rows) == 1, ran.stdout
    cells = [cell.strip() for cell in rows[0].strip("|").split("|")]
    numbers = [int(cell) for cell in cells[1:] if cell]
    assert len(numbers) == 2 * len(filters), ran.stdout  # frames and bytes of each
    return numbers[::2]
