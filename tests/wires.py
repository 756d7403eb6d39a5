"""Simulated buses as the sinks of a recording meet them, and boards that were told of them."""

from __future__ import annotations

import dataclasses
import io
import itertools
from functools import cache
from typing import TYPE_CHECKING, Final

from rich.console import Console

from sniffer.decoding.decoder import Decoder
from sniffer.ground.model import NS, Batch, Chunk, Clock
from sniffer.protocols import PROTOCOLS
from sniffer.simulation import BUSES, Fault, simulate
from sniffer.simulation.render import usb_reads
from sniffer.tap.status import BusStatus, Status
from sniffer.viewers.board.board import Board

if TYPE_CHECKING:
    from collections.abc import Sequence

    from sniffer.viewers.screen import Screen

START_NS: Final = 1_795_215_306 * NS
PASS_NS: Final = NS // 20
"""A recorder decodes as often."""


@dataclasses.dataclass(frozen=True)
class Wire:
    """A bus of a simulation: what its sinks were handed."""

    name: str
    protocol: str
    groups: Sequence[Sequence[Chunk]]
    batches: Sequence[Batch]

    @property
    def bytes(self) -> int:
        return sum(len(batch.data) for batch in self.batches)

    def status(self, state: str = "listening") -> BusStatus:
        baud = BUSES[self.protocol].baud
        port = f"/dev/serial/by-id/{self.name}"
        return BusStatus(self.name, port, baud, self.protocol, state, self.bytes, 0, None)


FAULTS: Final = (Fault("drop", 0.05, 1), Fault("flip", 0.01), Fault("noise", 0.02))


@cache
def wire(name: str, protocol: str, servos: int = 3, seconds: float = 6, seed: int = 1) -> Wire:
    frames = simulate(
        protocol,
        seed=seed,
        servo_ids=range(1, servos + 1),
        faults=FAULTS,
        start_ns=START_NS,
        duration_s=seconds,
    )
    reads = usb_reads(frames, BUSES[protocol].baud)
    decoder = Decoder(protocol)
    groups, batches = [], []
    for _, group in itertools.groupby(reads, lambda read: read[0] // PASS_NS):
        chunks = [Chunk(data, t_ns, Clock.READ, name) for t_ns, data in group]
        groups.append(chunks)
        batches.append(decoder.feed(*chunks))
    return Wire(name, protocol, groups, [*batches, decoder.close()])


def shown_by(*wires: Wire) -> Board:
    """Return a board that was told all of it."""
    board = Board()
    for w in wires:
        for chunks in w.groups:
            board.raw(w.name, chunks)
        for batch in w.batches:
            board.write(w.name, PROTOCOLS[w.protocol], batch)
    return board


def status_of(*buses: BusStatus, late_ns: int = 0, **more: object) -> Status:
    now_ns = START_NS + 6 * NS + late_ns
    known = Status(6.0, now_ns, "/data/run.mcap", 12_345_678, 0, buses)
    return dataclasses.replace(known, **more)  # type: ignore[arg-type]


def lines_of(
    board: Board, status: Status, width: int, height: int, *, style: bool = False
) -> list[str]:
    console = Console(
        file=io.StringIO(),
        width=width + 40,  # the board keeps to its own width
        force_terminal=style,
        color_system="standard" if style else None,
        legacy_windows=False,
    )
    console.print(board.render(status, width, height), end="", soft_wrap=True)
    assert isinstance(console.file, io.StringIO)
    return console.file.getvalue().split("\n")[:-1]


def feed(screen: Screen, w: Wire) -> None:
    """Hand everything over at once."""
    for chunks, batch in zip(w.groups, w.batches, strict=False):
        screen.raw(w.name, chunks)
        screen.write(w.name, PROTOCOLS[w.protocol], batch)
