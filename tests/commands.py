"""The command line as a user meets it: a process of its own, or the same within this one."""

from __future__ import annotations

import json
import os
import random
import re
import subprocess
import sys
from dataclasses import dataclass
from pathlib import Path
from tempfile import TemporaryFile
from typing import TYPE_CHECKING, Any, Final

import pytest

from sniffer.cli import run
from sniffer.decoding.decoder import Decoder
from sniffer.ground.codes import RESPONSE
from sniffer.ground.model import Chunk
from tests.forked import can_fork, server
from tests.streams.mightyzap import packet

if TYPE_CHECKING:
    from collections.abc import Iterator, Mapping

    from tests.forked import Process


COMMAND: Final = (sys.executable, "-m", "sniffer")
_FOUND: Final = re.compile(r"sniffer: [^:]+: \w+ \((sure|likely|not sure): explains .*\)")


@dataclass(frozen=True, slots=True)
class Ran:
    """What a command left behind."""

    status: int
    out: str
    err: str

    @property
    def complaint(self) -> str:
        """The one line on standard error, the line about the protocol found aside."""
        assert "Traceback" not in self.err
        lines = [line for line in self.err.splitlines() if not _FOUND.fullmatch(line)]
        assert len(lines) == 1, self.err
        assert lines[0].startswith("sniffer: ")
        return lines[0].removeprefix("sniffer: ")

    @property
    def content(self) -> bool:
        """Whether nothing but the protocol found was said."""
        return all(_FOUND.fullmatch(line) for line in self.err.splitlines())


def environment(**more: str) -> dict[str, str]:
    """Return this process's environment without what a terminal adds to it."""
    out = {k: v for k, v in os.environ.items() if k not in ("COLUMNS", "LINES", "NO_COLOR")}
    return {**out, **more}


def sniffer(
    *arguments: str | Path,
    data: bytes | None = None,
    env: Mapping[str, str] | None = None,
    before: tuple[str, ...] = (),
) -> Ran:
    """Run a command in a process of its own; ``before`` stands in front of its command line."""
    if can_fork(env or ()) and not before:
        return _forked([str(a) for a in arguments], data, environment(**(env or {})))
    done = subprocess.run(
        [*before, *COMMAND, *map(str, arguments)],
        input=data,
        stdin=subprocess.DEVNULL if data is None else None,
        capture_output=True,
        env=environment(**(env or {})),
        timeout=600,
        check=False,
    )
    return Ran(done.returncode, done.stdout.decode(), done.stderr.decode())


def _forked(arguments: list[str], data: bytes | None, env: Mapping[str, str]) -> Ran:
    with TemporaryFile() as given, TemporaryFile() as out, TemporaryFile() as err:
        given.write(data or b"")
        given.seek(0)
        streams = given.fileno(), out.fileno(), err.fileno()
        status = server().start(arguments, streams, env).wait(600)
        out.seek(0)
        err.seek(0)
        return Ran(status, out.read().decode(), err.read().decode())


def started(
    *arguments: str | Path, out: int, err: int, env: Mapping[str, str] | None = None
) -> Process | subprocess.Popen[bytes]:
    """Start a command that finds nothing on standard input; the others are descriptors."""
    told, variables = [str(a) for a in arguments], environment(**(env or {}))
    if not can_fork(env or ()):
        return subprocess.Popen(
            [*COMMAND, *told], stdin=subprocess.DEVNULL, stdout=out, stderr=err, env=variables
        )
    with Path(os.devnull).open("rb") as nothing:
        return server().start(told, (nothing.fileno(), out, err), variables)


def begin_anew(path: Path) -> None:
    """Write a program that begins the command as a shell does."""
    path.write_text(f'#!/bin/sh\nexec "{sys.executable}" -m sniffer "$@"\n', encoding="utf-8")
    path.chmod(0o755)


def install(path: Path) -> None:
    """Write a program that is the command, forked where that does the same."""
    if can_fork():
        server().install(path)
    else:
        begin_anew(path)


def within(capsys: pytest.CaptureFixture[str], *arguments: str | Path) -> Ran:
    """Run a command within this process: the same, but ten times faster."""
    capsys.readouterr()
    status = run([str(a) for a in arguments])
    out, err = capsys.readouterr()
    return Ran(status, out, err)


def talk(cycles: int, seed: int = 1) -> bytes:
    """Return what a controller and three servos say: a sync write, then each one is read."""
    rng = random.Random(seed)
    out = bytearray()
    position = {1: 2000, 2: 500, 3: 900}
    for _ in range(cycles):
        goals = (bytes([who]) + at.to_bytes(2, "little") for who, at in position.items())
        out += packet(254, 0x73, b"\x86\x02" + b"".join(goals))
        for who in position:
            position[who] = min(max(position[who] + rng.randint(-30, 60), 0), 4095)
            measured = (position[who], rng.randint(0, 1000), 0)
            data = b"".join(v.to_bytes(2, "little") for v in measured)
            overloaded = 0x20 if rng.random() < 0.05 else 0
            out += packet(who, 0xF2, b"\x8c\x08")
            out += packet(who, overloaded, data + bytes([120, rng.randint(28, 40)]))
    return bytes(out)


def damaged(data: bytes) -> bytes:
    """Alter a byte, lose four, and add two of nobody."""
    out = bytearray(data)
    out[100] ^= 0x55
    del out[300:304]
    out[500:500] = b"\x01\x02"
    return bytes(out)


def log(data: bytes, *, start_ns: int = 1_700_000_000_000_000_000) -> str:
    """Write mightyZAP talk down as a log with times, a line a frame."""
    t, lines = start_ns, list[str]()
    for frame, kind in frames_of(data):
        t += len(frame) * 173_611 + (600_000 if kind == RESPONSE else 900_000)
        lines.append(f"({t // 10**9}.{t % 10**9 // 1000:06d}) bus0 #{frame.hex().upper()}\n")
    return "".join(lines)


def frames_of(data: bytes) -> Iterator[tuple[bytes, int]]:
    """Yield the frames of mightyZAP talk, and what kind each is of."""
    decoder = Decoder("mightyzap")
    for batch in (decoder.feed(Chunk(data)), decoder.close()):
        f = batch.frames
        for start, length, kind in zip(f.start, f.length, f.kind, strict=True):
            yield batch.data[start : start + length], int(kind)


def two_buses(path: Path, capture: Path) -> Path:
    """Write a capture as the bus arm, and a stretch in the middle of it as the bus leg, too."""
    arm = capture.read_text().replace(" bus0 ", " arm ").splitlines()
    leg = [line.replace(" arm ", " leg ") for line in arm[400:450]]
    path.write_text("\n".join(sorted([*arm, *leg])))
    return path


def records(text: str) -> list[dict[str, Any]]:
    """Return the records of JSON lines."""
    return [json.loads(line) for line in text.splitlines()]


def conserved(text: str) -> bytes:
    """Return the bytes that the records of JSON lines account for; the summary agrees."""
    rows = records(text)
    assert rows[-1]["type"] == "summary"
    data = b"".join(bytes.fromhex(r["hex"]) for r in rows if r["type"] in ("frame", "gap"))
    assert rows[-1]["bytes"] == len(data)
    return data


CANNOT = 77
UNPRIVILEGED = f"""
import ctypes, os, sys
if os.geteuid() == 0:  # PR_CAPBSET_DROP of CAP_DAC_OVERRIDE and CAP_DAC_READ_SEARCH
    drop = ctypes.CDLL(None).prctl
    if any(drop(24, capability, 0, 0, 0) for capability in (1, 2)):
        sys.exit({CANNOT})
os.execv(sys.argv[1], sys.argv[1:])
"""
"""Root may read and write everything: this takes that privilege away before the command runs."""


def forbidden(path: Path, *arguments: str | Path) -> Ran:
    """Run a command to which the permissions of ``path`` matter."""
    if not sys.platform.startswith("linux") and os.geteuid() == 0:
        pytest.skip("root may do everything, and only Linux lets it give that up")
    ran = sniffer(*arguments, before=(sys.executable, "-c", UNPRIVILEGED))
    path.chmod(0o755)
    if ran.status == CANNOT:
        pytest.skip("root may do everything, and cannot give that up here")
    return ran
