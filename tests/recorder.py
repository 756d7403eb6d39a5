"""``sniffer record`` as a user runs it, on pseudo terminals, and what it leaves behind."""

from __future__ import annotations

import contextlib
import os
import select
import signal
import subprocess
import sys
import time
from pathlib import Path
from typing import TYPE_CHECKING, Any, Self

from sniffer.decoding.pipeline import Options, Pipeline
from sniffer.ground.model import Batch, Chunk, DamagedInputError, InputError, MarkKind
from sniffer.jobs.compare import compare
from sniffer.mcapfile.ends import ends
from sniffer.mcapfile.source import chunks, session, tables
from tests.commands import COMMAND, Ran, environment
from tests.forked import can_fork, server
from tests.recordings import messages, talk
from tests.terminals import PATIENCE_S, Terminal, wait

if TYPE_CHECKING:
    from collections.abc import Callable, Iterator, Mapping, Sequence

    from sniffer.protocols.base import BusProtocol
    from tests.forked import Process

FrameRow = tuple[int, int, int, int, int]
"""Offset, length, end, uncertainty, direction."""


class Recorder:
    """A recorder in a process of its own. Use it with ``with``; it is killed if it still runs.

    Args:
        folder: where it runs; its recording is ``run.mcap`` in there unless ``arguments`` say -o.
        arguments: of the command; each line's path is put where they say ``{}``.
        lines: what it listens to.
        before: stands in front of the command line.
        into: where standard error goes, instead of a file.
        env: what its environment has beside ours.
    """

    def __init__(
        self,
        folder: Path,
        *arguments: str | Path,
        lines: Sequence[Terminal] = (),
        before: Sequence[str] = (),
        into: int | None = None,
        env: Mapping[str, str] | None = None,
        **options: Any,
    ) -> None:
        self.folder = folder
        self.path = folder / "run.mcap"
        self.lines = lines
        paths = [line.path for line in lines]
        told = [str(a) for a in arguments]
        if not any("{}" in a for a in told):
            told = ["{}"] * len(lines) + told
        told = [a.replace("{}", paths.pop(0)) if "{}" in a else a for a in told]
        if "-o" not in told:
            told += ["-o", str(self.path)]
        behind = [Path(told[at + 1]) for at, word in enumerate(told) if word == "-o"]
        self._recordings = [folder / path for path in behind if path.suffix == ".mcap"]
        self._out, self._err = folder / "stdout.txt", folder / "stderr.txt"
        with self._out.open("wb") as out, self._err.open("wb") as err:
            streams = out.fileno(), err.fileno() if into is None else into
            self.process: Process | subprocess.Popen[bytes]
            if can_fork(env or ()) and not (before or options):
                self.process = self._forked(told, streams, environment(**(env or {})))
                return
            self.process = subprocess.Popen(
                [*before, *COMMAND, "record", *told],
                cwd=folder,
                env=environment(**(env or {})),
                stdin=subprocess.DEVNULL,
                stdout=streams[0],
                stderr=streams[1],
                **options,
            )

    def _forked(
        self, told: Sequence[str], streams: tuple[int, int], env: Mapping[str, str]
    ) -> Process:
        with Path(os.devnull).open("rb") as nothing:
            return server().start(["record", *told], (nothing.fileno(), *streams), env, self.folder)

    def __enter__(self) -> Self:
        try:
            for line in self.lines:
                line.wait_for_tap()
            wait(self._has_begun, "no recording is begun")
        except AssertionError:
            self.process.kill()
            self.process.wait()
            raise AssertionError(self.said) from None
        return self

    def __exit__(self, *_: object) -> None:
        self.process.kill()
        self.process.wait()

    def _has_begun(self) -> bool:
        """Tell whether its file is there: its ports hear by then, for they are opened before."""
        if self.process.poll() is not None or not self._recordings:
            return True
        return any(any(path.parent.glob(f"{path.stem}*")) for path in self._recordings)

    @property
    def said(self) -> str:
        """What it said on standard error so far."""
        return self._err.read_text(encoding="utf-8")

    @property
    def printed(self) -> str:
        """What it printed on standard output so far."""
        return self._out.read_text(encoding="utf-8")

    def tell(self, number: signal.Signals) -> None:
        self.process.send_signal(number)

    def stop(self, number: signal.Signals = signal.SIGTERM) -> Ran:
        """End it with a signal."""
        self.tell(number)
        return self.ended()

    def ended(self) -> Ran:
        """Wait until it has ended by itself."""
        status = self.process.wait(timeout=PATIENCE_S)
        assert "Traceback" not in self.said, self.said
        return Ran(status, self.printed, self.said)

    def wait_for(self, size: int, bus: str = "bus0", path: Path | None = None) -> None:
        """Wait until so many bytes of a bus are in the file."""
        wait(lambda: len(so_far(path or self.path).get(bus, b"")) >= size, f"{size} bytes: no")

    def wait_until(self, until: Callable[[], bool], why: str) -> None:
        wait(until, f"{why}: {self.said}")


class Patient(Terminal):
    """A line that can be spoken to without waiting for a tap that may be gone."""

    def __enter__(self) -> Self:
        return self

    def takes_more(self) -> bool:
        """Tell whether ``say`` would not wait, for a few bytes."""
        return bool(select.select([], [self._master], [], 0)[1])


def heard(path: Path) -> Iterator[Chunk]:
    """Yield the chunks that are in a file, which may be being written."""
    with contextlib.suppress(DamagedInputError, InputError):
        yield from chunks(path)


def so_far(path: Path) -> dict[str, bytes]:
    """Return the raw bytes of each bus that are in a file, which may be being written."""
    out: dict[str, bytes] = {}
    for chunk in heard(path):
        out[chunk.bus] = out.get(chunk.bus, b"") + chunk.data
    return out


def raw(*paths: Path) -> dict[str, bytes]:
    """Return the raw bytes of each bus; the files must be whole."""
    out: dict[str, bytes] = {}
    for path in paths:
        messages(path)  # by the library's own reader, every checksum
        for chunk in chunks(path):
            out[chunk.bus] = out.get(chunk.bus, b"") + chunk.data
    return out


def marks(path: Path, bus: str = "bus0") -> list[MarkKind]:
    """Return the kinds of all marks of a bus, in order, as far as the file goes.

    Those of reads that were late are left out (on a busy machine some are), and the one of the end.
    """
    found = (mark.kind for chunk in heard(path) if chunk.bus == bus for mark in chunk.marks)
    return [kind for kind in found if kind not in (MarkKind.HELD, MarkKind.ENDED)]


def frames_recorded(path: Path) -> dict[str, list[FrameRow]]:
    """Return the frames that were recorded live, by bus; offsets count from the file's begin."""
    told = session(path)
    out: dict[str, list[FrameRow]] = {}
    for topic, rows in messages(path).items():
        if topic.endswith("/frames"):
            bus = topic.split("/")[1]
            begin = int(told.get(f"offset.{bus}", 0))
            out[bus] = [
                (f.offset - begin, f.length, f.t_end_ns, f.uncertainty_ns, f.direction)
                for f in rows
            ]
    return out


def frames_again(*paths: Path) -> dict[str, list[FrameRow]]:
    """Return the frames of the recorded bytes, decoded now by what the recording knows."""
    collected = Collected()
    pipeline = Pipeline(
        Options().with_facts(session(paths[0]), lambda: tables(paths[0])), [collected]
    )
    pipeline.feed([chunk for path in paths for chunk in chunks(path)])
    pipeline.close()
    out = {bus: list(collected.frames(bus)) for bus in collected.batches}
    return {bus: rows for bus, rows in out.items() if rows}


def assert_true_to_itself(path: Path, *, alone: bool = True) -> None:
    """Decoding a recording again says what was recorded: frames, times, uncertainties.

    Not ``alone``: a file came before it. What its first read has behind it is not in this one, so
    decoded again that read is as uncertain as a first one can be. Where a file ends within a read,
    the frames of that read are as uncertain as the part of it that is left.
    """
    then, now = frames_recorded(path), frames_again(path)
    cut = _last_reads(path)
    for bus, frames in (*then.items(), *now.items()):
        sure = cut.get(bus, sys.maxsize) if alone else 0
        frames[:] = [f if f[0] + f[1] <= sure else (*f[:3], 0, f[4]) for f in frames]
    assert then == now
    told: list[str] = []
    report = compare(path, Options(), say=told.append)
    assert report.equal, str(report)
    assert told == []


def _last_reads(path: Path) -> dict[str, int]:
    """Return where the last read of a bus begins, of those that the file ends within."""
    with path.open("rb") as stream:
        buses = [bus for bus, end in ends(stream).items() if end.t_ns is not None]
    begin: dict[str, int] = {}
    size: dict[str, int] = {}
    for chunk in chunks(path):
        begin[chunk.bus] = size.get(chunk.bus, 0)
        size[chunk.bus] = begin[chunk.bus] + len(chunk.data)
    return {bus: begin[bus] for bus in buses if bus in begin}


class Collected:
    """A sink that keeps all."""

    def __init__(self) -> None:
        self.batches: dict[str, list[Batch]] = {}
        self.chunks: dict[str, list[Chunk]] = {}

    def raw(self, bus: str, given: Sequence[Chunk]) -> None:
        self.chunks.setdefault(bus, []).extend(given)

    def write(self, bus: str, protocol: BusProtocol, batch: Batch) -> None:
        self.batches.setdefault(bus, []).append(batch)

    def close(self) -> None:
        pass

    def heard(self, bus: str = "bus0") -> bytes:
        return b"".join(chunk.data for chunk in self.chunks.get(bus, []))

    def frames(self, bus: str = "bus0") -> Iterator[FrameRow]:
        for batch in self.batches[bus]:
            f = batch.frames
            columns = f.start + batch.base, f.length, f.t_end, f.uncertainty, f.direction
            yield from zip(*(c.tolist() for c in columns), strict=True)

    def anomalies(self, bus: str = "bus0") -> list[str]:
        return [a.code for batch in self.batches.get(bus, []) for a in batch.anomalies]


def codes(path: Path, bus: str = "bus0") -> list[str]:
    """Return the codes of a bus's anomalies, as recorded live."""
    return [a.code for a in messages(path).get(f"/{bus}/anomalies", [])]


def facts(path: Path) -> Mapping[str, str]:
    """Return what a recording says about itself."""
    return session(path)


def pieces(data: bytes, *sizes: int) -> Iterator[bytes]:
    """Cut bytes into pieces of these sizes, again and again."""
    at = turn = 0
    while at < len(data):
        size = sizes[turn % len(sizes)]
        yield data[at : at + size]
        at, turn = at + size, turn + 1


def say_slowly(line: Terminal, data: bytes, *sizes: int, pause_s: float = 0.001) -> None:
    """Say bytes so that the reads of a tap cut them anywhere."""
    for piece in pieces(data, *sizes):
        line.say(piece)
        time.sleep(pause_s)


def said_by(protocol: str, seed: int = 1, seconds: float = 1.0) -> bytes:
    """Return what a bus with every kind of fault says."""
    return b"".join(chunk.data for chunk in talk(protocol, seconds, seed))
