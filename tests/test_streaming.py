"""Files larger than memory stream through, and nothing heavy is loaded before it is needed."""

from __future__ import annotations

import os
import subprocess
import sys
from typing import TYPE_CHECKING, Final

import pytest

from tests.commands import COMMAND, environment, talk

if TYPE_CHECKING:
    from pathlib import Path

HEAVY: Final = ("rerun", "mcap", "pyarrow", "serial", "pandas", "polars", "google.protobuf")
MB: Final = 1_000_000


def peak(path: Path, *arguments: str) -> int:
    """Return the most memory that decoding a file took, in the system's unit."""
    resource = pytest.importorskip("resource")
    measured = (
        "import os, resource, subprocess, sys\n"
        "assert subprocess.call(sys.argv[1:]) == 0\n"
        "print(resource.getrusage(resource.RUSAGE_CHILDREN).ru_maxrss)"
    )
    assert resource
    done = subprocess.run(
        [sys.executable, "-c", measured, *COMMAND, "decode", str(path), "--quiet", *arguments],
        env=environment(),
        capture_output=True,
        text=True,
        check=True,
    )
    return int(done.stdout)


def file_of(path: Path, size: int) -> Path:
    """Write as much talk."""
    part = talk(1000)
    with path.open("wb") as file:
        for _ in range(size // len(part)):
            file.write(part)
    return path


def test_memory_does_not_grow_with_the_file(tmp_path: Path) -> None:
    output = ("-o", str(tmp_path / "x.parquet"), "--force")
    small = peak(file_of(tmp_path / "4.bin", 4 * MB), *output)
    large = peak(file_of(tmp_path / "20.bin", 20 * MB), *output)
    assert large < 1.25 * small


@pytest.mark.parametrize("module", ["sniffer", "sniffer.cli", "sniffer.sources", "sniffer.sinks"])
def test_nothing_heavy_is_imported_before_it_is_needed(module: str) -> None:
    asked = f"import sys, {module}; print(*(m for m in {HEAVY} if m in sys.modules))"
    done = subprocess.run(
        [sys.executable, "-c", asked],
        env=dict(os.environ),
        capture_output=True,
        text=True,
        check=True,
    )
    assert done.stdout.split() == []
