"""Input that is meant to do harm: how it is made, and a program under a limit that reads it.

``python -m tests.hostile`` is that program: it reads a command line of the tool from each line of
standard input, runs it, and answers with what came of it. One process runs many, so a thousand
inputs take seconds.
"""

from __future__ import annotations

import contextlib
import io
import json
import struct
import subprocess
import sys
from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING, Any, Final, Self

import zstandard
from mcap.opcode import Opcode

from sniffer.cli import run
from sniffer.ground.model import Chunk, Clock
from tests.commands import conserved, environment
from tests.recordings import START_NS, keep

if TYPE_CHECKING:
    from collections.abc import Iterator, Mapping

SPACE: Final = 4 << 30
"""Address space of the program, in bytes: libraries reserve more than they use."""

MEMORY: Final = 700 << 20
"""Memory that it may really use, in bytes: 200 MB by the worst input that is known, and what the
libraries of all outputs take."""

PATIENCE_S: Final = 300
"""An input that takes longer hangs."""

ASK: Final = bytes.fromhex("FFFFFF0104F28C027A")
ANSWER: Final = bytes.fromhex("FFFFFF010400FF07F4")
PAIR: Final = (ASK + ANSWER).hex()


@dataclass(frozen=True, slots=True)
class Answer:
    """What came of a command: its status, its output, and the most memory ever used, in bytes."""

    status: int
    out: str
    err: str
    memory: int


class Victim:
    """The program under a limit. Use it with ``with``."""

    def __init__(self) -> None:
        self._process = subprocess.Popen(
            [sys.executable, "-m", "tests.hostile"],
            stdin=subprocess.PIPE,
            stdout=subprocess.PIPE,
            cwd=Path(__file__).parents[1],
            env=environment(OPENBLAS_NUM_THREADS="1"),
            text=True,
        )

    def __enter__(self) -> Self:
        return self

    def __exit__(self, *_: object) -> None:
        self._process.kill()
        self._process.communicate()

    def run(self, *arguments: str | Path) -> Answer:
        """Run a command; an input at which the program dies or hangs fails here."""
        assert self._process.stdin is not None
        assert self._process.stdout is not None
        self._process.stdin.write(json.dumps([str(a) for a in arguments]) + "\n")
        self._process.stdin.flush()
        line = self._process.stdout.readline()
        assert line, f"it died of {arguments}"
        return Answer(**json.loads(line))


def _most_memory() -> int:
    """Return the most memory that this program ever had, in bytes.

    The system's account of resources counts in what the process had before it became this program,
    which is all that the tests' own process has.
    """
    import resource

    status = Path("/proc/self/status")
    if status.exists():
        told = next(x for x in status.read_text(encoding="ascii").splitlines() if "VmHWM" in x)
        return int(told.split()[1]) * 1024
    unit = 1 if sys.platform == "darwin" else 1024
    return resource.getrusage(resource.RUSAGE_SELF).ru_maxrss * unit


def _serve() -> None:
    import resource
    import signal

    resource.setrlimit(resource.RLIMIT_AS, (SPACE, SPACE))
    answers = sys.stdout
    for line in sys.stdin:
        out, err = io.StringIO(), io.StringIO()
        signal.alarm(PATIENCE_S)
        with contextlib.redirect_stdout(out), contextlib.redirect_stderr(err):
            status = run(json.loads(line))
        signal.alarm(0)
        told = {"out": out.getvalue(), "err": err.getvalue(), "memory": _most_memory()}
        answer = {"status": status, **told}
        answers.write(json.dumps(answer) + "\n")
        answers.flush()


def sound(answer: Answer) -> list[str]:
    """Hold what is true of every answer; return what was said but for the protocols found."""
    assert answer.status in (0, 1, 2, 3)
    assert "Traceback" not in answer.err
    assert "fault of this program" not in answer.err, answer.err
    assert "failed (" not in answer.err
    assert answer.memory < MEMORY
    lines = answer.err.splitlines()
    assert all(line.startswith("sniffer: ") and len(line) < 5000 for line in lines)
    if answer.out:
        conserved(answer.out)
    told = [line.removeprefix("sniffer: ") for line in lines]
    told = [line for line in told if "explains" not in line]
    assert len(told) <= 4  # the end, or notes about the input
    return told


def decoded(victim: Victim, path: Path, data: bytes, *arguments: str) -> tuple[Answer, list[str]]:
    path.write_bytes(data)
    answer = victim.run("decode", path, "--format", "jsonl", *arguments)
    return answer, sound(answer)


def frame(**more: object) -> str:
    return json.dumps({"type": "frame", "hex": PAIR, "offset": 0, **more}) + "\n"


# --- recordings ----------------------------------------------------------------------------------


def conversation(count: int = 20) -> list[Chunk]:
    """Return a request and its answer, as often as asked for, with times."""
    return [Chunk(ASK + ANSWER, START_NS + n * 10**7, Clock.READ) for n in range(count)]


def recording(path: Path, **options: Any) -> bytes:
    """Return a small recording."""
    keep(path, [conversation()], **options)
    return path.read_bytes()


def with_facts(path: Path, facts: Mapping[str, str], end: Mapping[str, str] | None = None) -> bytes:
    """Return the recording with other facts, and an end mark that says ``end``."""
    from sniffer.mcapfile.sink import McapSink

    sink = McapSink(path, {"tool": "test", **facts})
    sink.raw("bus0", conversation())
    list(sink.closing(end or {}))
    return path.read_bytes()


def places(data: bytes, opcode: int) -> Iterator[int]:
    """Yield where the records of a kind begin."""
    at = 8
    while at < len(data) - 8:
        if data[at] == opcode:
            yield at
        at += 9 + struct.unpack_from("<Q", data, at + 1)[0]


def unpacked(data: bytes) -> bytes:
    """Return what the first chunk of a recording holds."""
    at = next(places(data, Opcode.CHUNK))
    length, _, _, size, _, name = struct.unpack_from("<QQQQII", data, at + 1)
    packed = data[at + 9 + 32 + name + 8 : at + 9 + length]
    return zstandard.ZstdDecompressor().decompress(packed, max_output_size=size)


def with_chunk(
    data: bytes, content: bytes, *, size: int, packing: str = "", missing: int = 0
) -> bytes:
    """Return a recording that ends with a chunk of this content instead of its own.

    ``size`` is what it says to unpack to; ``missing`` bytes of it the file has no more.
    """
    at = next(places(data, Opcode.CHUNK))
    name = packing.encode()
    body = struct.pack("<QQQII", 0, 0, size, 0, len(name)) + name
    body += struct.pack("<Q", len(content) + missing)
    return (
        data[:at]
        + struct.pack("<BQ", Opcode.CHUNK, len(body) + len(content) + missing)
        + (body + content)
    )


def bomb(count: int, piece: bytes = bytes(1 << 20)) -> bytes:
    """Return ``count`` pieces packed with zstd, as small as it goes."""
    out = io.BytesIO()
    with zstandard.ZstdCompressor(level=3).stream_writer(out, closefd=False) as stream:
        for _ in range(count):
            stream.write(piece)
    return out.getvalue()


if __name__ == "__main__":
    _serve()
