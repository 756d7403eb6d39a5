"""Simulated buses that are recorded: what the recording says of them, beside what really happened.

Every bus is a process of its own that writes down the truth; one recorder listens to all of them.
``python -m bench.truths --seconds 60``.
"""

from __future__ import annotations

import argparse
import contextlib
import itertools
import json
import signal
import subprocess
import sys
import tempfile
import time
from collections import Counter
from dataclasses import dataclass, field
from pathlib import Path
from typing import TYPE_CHECKING, Any, Final, NamedTuple

from bench.lines import NAMES, WAIT_S
from sniffer.decoding.decoder import Decoder
from sniffer.ground.codes import KINDS, REQUEST
from sniffer.mcapfile.source import groups, recorded, session
from sniffer.protocols import PROTOCOLS

if TYPE_CHECKING:
    from collections.abc import Iterator, Sequence

    from sniffer.ground.model import Chunk

FAULTS: Final = ("drop-reply", "flip", "cut", "late", "noise", "duplicate-id:1%", "brownout")
"""Every kind, as often as the simulation has it where nobody says; two servos of one id, that
answer both every time, are seldom instead."""

CHECKED: Final = ("mightyzap", "rs30x")
"""Protocols with a checksum in every frame: what is damaged there is no frame."""


MARGIN_NS: Final = 20_000_000
"""How much earlier than a request is closed its answer must begin, at a stamp's uncertainty."""

Place = tuple[int, int]
"""Where bytes begin and end in the stream."""


class Row(NamedTuple):
    """A frame; ``offset`` counts from the first byte that the recorder heard."""

    offset: int
    data: bytes
    kind: str
    servo_id: int | None
    op: str


@dataclass(frozen=True, slots=True)
class Bus:
    """What is to be played."""

    name: str
    protocol: str
    faults: tuple[str, ...] = ()


@dataclass(slots=True)
class Compared:
    """One bus: what was said, what was recorded, and how they differ.

    ``whole`` are the frames that were said undamaged, in order; ``damaged`` the places of all other
    ones and of noise; ``unasked`` those of answers to nothing that was heard: second ones, and the
    first one where its request came before the recorder, and those that came too late. Some
    protocols know no such frame.
    """

    bus: Bus
    said: bytes
    heard: bytes
    whole: list[Row]
    damaged: list[Place]
    unasked: list[Place]
    recorded: list[Row]
    decoded: list[Row]
    faults: Counter[str] = field(default_factory=Counter)

    @property
    def missed(self) -> list[Row]:
        """Frames that were said undamaged and are not recorded."""
        there = set(self.recorded)
        return [row for row in self.whole if row not in there]

    @property
    def invented(self) -> list[Row]:
        """Frames that are recorded and were not said, or not so."""
        there = set(self.whole)
        return [row for row in self.recorded if row not in there]

    def touches_damage(self, row: Row) -> bool:
        """Tell whether a frame's bytes are among those that were damaged, or beside them."""
        end = row.offset + len(row.data)
        return any(a <= end and row.offset <= z for a, z in self.damaged + self.unasked)

    def __str__(self) -> str:
        """Say it in a line."""
        struck = ", ".join(f"{n} {kind}" for kind, n in sorted(self.faults.items()))
        return (
            f"{self.bus.protocol}: {len(self.said)} bytes, {len(self.whole)} undamaged frames, "
            f"{len(self.recorded)} recorded; missed {len(self.missed)}, "
            f"otherwise {len(self.invented)} ({struck or 'no faults'})"
        )


def play(folder: Path, buses: Sequence[Bus], seconds: float) -> list[Compared]:
    """Play and record so long; return what is to be compared.

    Raises:
        RuntimeError: a process does not do what it should.
    """
    run = folder / "run.mcap"
    with contextlib.ExitStack() as stack:
        players = [stack.enter_context(_played(folder, bus)) for bus in buses]
        ports = [_port(player) for player in players]
        listen = [f"{b.name}={p}={b.protocol}" for b, p in zip(buses, ports, strict=True)]
        recorder = stack.enter_context(_process("record", *listen, "-o", str(run), "--quiet"))
        deadline = time.monotonic() + WAIT_S
        while not run.exists():
            if recorder.poll() is not None or time.monotonic() > deadline:
                raise RuntimeError("the recorder does not record")
            time.sleep(0.02)
        time.sleep(seconds)
        for player in players:
            player.send_signal(signal.SIGINT)
        for player in players:
            player.communicate(timeout=WAIT_S)
        recorder.send_signal(signal.SIGINT)
        recorder.communicate(timeout=WAIT_S)
        if recorder.returncode:
            raise RuntimeError(f"the recorder ends with status {recorder.returncode}")
    return list(compared(run, folder, buses))


def _port(player: subprocess.Popen[str]) -> str:
    assert player.stdout is not None
    return player.stdout.readline().strip()


def _played(folder: Path, bus: Bus) -> contextlib.AbstractContextManager[subprocess.Popen[str]]:
    faults = [f"--fault={fault}" for fault in bus.faults]
    truth = str(folder / f"{bus.name}.jsonl")
    return _process("simulate", bus.protocol, "--truth", truth, *faults)


@contextlib.contextmanager
def _process(*arguments: str) -> Iterator[subprocess.Popen[str]]:
    """Run a command of the program; it does not outlive the block."""
    with subprocess.Popen(
        [sys.executable, "-m", "sniffer", *arguments],
        stdin=subprocess.DEVNULL,
        stdout=subprocess.PIPE,
        stderr=subprocess.DEVNULL,
        text=True,
    ) as process:
        try:
            yield process
        finally:
            process.kill()


def compared(run: Path, folder: Path, buses: Sequence[Bus]) -> Iterator[Compared]:
    """Yield each bus of a recording, beside its truth."""
    facts = session(run)
    chunks: dict[str, list[Chunk]] = {bus.name: [] for bus in buses}
    for group in groups(run):
        for chunk in group:
            chunks[chunk.bus].append(chunk)
    heard = {name: b"".join(c.data for c in mine) for name, mine in chunks.items()}
    rows: dict[str, list[Row]] = {bus.name: [] for bus in buses}
    for f in recorded(run):
        data = heard[f.bus][f.offset : f.offset + f.length]
        rows[f.bus].append(Row(f.offset, data, f.kind, f.servo_id, f.op))
    for bus in buses:
        # what came between opening a port and setting it up was thrown away, and is told of
        begin = int(facts.get(f"port.{bus.name}.dropped_at_open", "0"))
        told = [json.loads(x) for x in (folder / f"{bus.name}.jsonl").read_text().splitlines()]
        open_ns = PROTOCOLS[bus.protocol].tail_ns - MARGIN_NS
        said, whole, damaged, unasked = _truth(told, begin, open_ns, chunks[bus.name])
        faults = Counter(
            row["fault"] for row in told if row["type"] == "frame" and row["fault"] is not None
        )
        again = list(_decoded(bus.protocol, chunks[bus.name], int(facts[f"baud.{bus.name}"])))
        yield Compared(
            bus,
            said=said,
            heard=heard[bus.name],
            whole=whole,
            damaged=damaged,
            unasked=unasked,
            recorded=rows[bus.name],
            decoded=again,
            faults=faults,
        )


def _truth(
    told: Sequence[dict[str, Any]], begin: int, open_ns: int, chunks: Sequence[Chunk]
) -> tuple[bytes, list[Row], list[Place], list[Place]]:
    """Return what was said from ``begin`` on: the bytes, whole frames, places of all else.

    An answer that began later than a request stays open, because a busy machine kept the servos
    waiting, is an answer to nothing. So it is where the bus alone was kept waiting: its own clock
    stood still meanwhile, and the stamps tell.
    """
    ends = list(itertools.accumulate(len(c.data) for c in chunks))
    late = {
        end
        for end, c, behind in zip(ends, chunks, chunks[1:], strict=False)
        if (behind.t_ns or 0) - (c.t_ns or 0) > open_ns
    }
    said = b""
    whole, damaged, unasked = [], [], []
    has_asked, open_until = False, 0
    for row in told:
        if row["type"] != "frame" or row["offset"] is None:
            continue
        wire, at = bytes.fromhex(row["wire"]), row["offset"] - begin
        said += wire
        has_asked |= row["kind"] == KINDS[REQUEST] and at >= 0
        belated = row["kind"] != KINDS[REQUEST] and (row["t_start_ns"] > open_until or at in late)
        open_until = row["t_end_ns"] + open_ns
        if row["wire"] != row["hex"]:
            damaged.append((at, at + len(wire)))
        elif not has_asked or belated or row["fault"] == "duplicate":
            unasked.append((at, at + len(wire)))
        else:
            whole.append(Row(at, wire, row["kind"], row["servo_id"], row["op"]))
    return said[begin:], whole, damaged, unasked


def _decoded(protocol: str, chunks: Sequence[Chunk], baud: int) -> Iterator[Row]:
    """Decode the raw bytes again."""
    decoder = Decoder(protocol, baud=baud)
    for batch in (decoder.feed(*chunks), decoder.close()):
        f = batch.frames
        for i in range(len(f)):
            a, z = int(f.start[i]), int(f.end[i])
            who = int(f.servo_id[i])
            op = PROTOCOLS[protocol].op_name(int(f.op[i]))
            kind = KINDS[int(f.kind[i])]
            yield Row(batch.base + a, batch.data[a:z], kind, who if who >= 0 else None, op)


def complaints(it: Compared) -> list[str]:
    """Return what differs from the truth, and must not."""
    wrong = []
    if it.heard != it.said:
        wrong.append(f"{len(it.heard)} bytes are recorded, {len(it.said)} were said")
    if it.recorded != it.decoded:
        wrong.append("the raw bytes decode to something else than what was recorded")
    unasked = {a for a, _ in it.unasked}
    if not it.bus.faults and [r for r in it.recorded if r.offset not in unasked] != it.whole:
        wrong.append(f"missed {it.missed[:3]}, otherwise {it.invented[:3]}")
    if missed := [row for row in it.missed if not it.touches_damage(row)]:
        wrong.append(f"missed {missed[:3]}, which nothing had damaged or touched")
    if invented := [row for row in it.invented if not it.touches_damage(row)]:
        wrong.append(f"{invented[:3]} were not said")
    if it.bus.protocol in CHECKED:
        places = set(it.damaged)
        if any((row.offset, row.offset + len(row.data)) in places for row in it.invented):
            wrong.append("a damaged frame is recorded as one that holds")
    return wrong


def buses() -> list[Bus]:
    """Return every protocol, without faults and with all of them."""
    clean = [Bus(name, name) for name in NAMES]
    return clean + [Bus(f"{name}-faults", name, FAULTS) for name in NAMES]


def main() -> None:
    """Play as long as the arguments say."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--seconds", type=float, default=60)
    given = parser.parse_args()
    is_wrong = False
    with tempfile.TemporaryDirectory() as folder:
        for it in play(Path(folder), buses(), given.seconds):
            wrong = complaints(it)
            is_wrong |= bool(wrong)
            sys.stderr.write(f"{it}{''.join(f'; {what}' for what in wrong)}\n")
    raise SystemExit(is_wrong)


if __name__ == "__main__":
    main()
