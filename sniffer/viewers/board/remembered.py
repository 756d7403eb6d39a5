"""What the board remembers of all buses."""

from __future__ import annotations

import copy
from dataclasses import replace
from typing import TYPE_CHECKING, Final, Self

from sniffer.decoding.called import ServoNames
from sniffer.decoding.sink import bus_of
from sniffer.ground.model import NS
from sniffer.viewers.board.cells import ServoCells
from sniffer.viewers.board.state import LOAD_NS, BusTally, Sliding, stamps
from sniffer.viewers.board.troubles import Troubles
from sniffer.viewers.board.watched import Watched

if TYPE_CHECKING:
    from collections.abc import Sequence

    from sniffer.diagnosis.tracking import Tracked
    from sniffer.ground.model import Batch, Chunk
    from sniffer.protocols.base import BusProtocol
    from sniffer.selection.selection import Selection
    from sniffer.tap.status import BusStatus, Status

BITS: Final = 10
"""Bits of a byte on the line: start, eight, stop."""


class Remembered:
    """A sink that remembers what is now.

    Not to be called from two threads. ``left_out`` is how many frames whoever calls it did not hand
    on; the bytes left out are known from the batches themselves.
    """

    def __init__(self) -> None:
        self.buses: dict[str, BusTally] = {}
        self.troubles = Troubles()
        self.watched: Watched | None = None
        """The filter, and what it has shown."""
        self.incidents: tuple[Tracked, ...] = ()
        """Incidents as they were judged last; whoever judges them sets this."""
        self.names = ServoNames()
        """What servos are called."""
        self.left_out = 0
        self.newest_ns = 0
        self._bytes: dict[str, Sliding] = {}
        self._lanes: dict[str, dict[str, str]] = {}  # bus -> the names and protocols that share it
        self._wires: dict[str, str] = {}

    def call(self, names: ServoNames) -> None:
        """Take what servos are called."""
        self.names = names

    def raw(self, bus: str, chunks: Sequence[Chunk]) -> None:
        """Count bytes for the load of the bus."""
        t_ns, lengths = stamps(chunks)
        if len(t_ns):
            if bus not in self._bytes:
                self._bytes[bus] = Sliding(NS // 10, LOAD_NS)
            self._bytes[bus].add(t_ns, 0, lengths)
            self.newest_ns = max(self.newest_ns, int(t_ns[-1]))

    def write(self, bus: str, protocol: BusProtocol, batch: Batch) -> None:
        """Remember what one pass decided."""
        wire, bus = bus, bus_of(bus, protocol, batch)
        if bus != wire:
            self._lanes.setdefault(wire, {})[bus] = protocol.name
            self._wires[bus] = wire
        tally = self.buses.get(bus)
        if tally is None or tally.protocol is not protocol:
            tally = self.buses[bus] = BusTally(protocol)
        tally.add(batch)
        self.troubles.add(bus, batch.anomalies)
        if self.watched is not None:
            self.watched.add(bus, wire, protocol, batch)
        if len(batch.frames):
            self.newest_ns = max(self.newest_ns, int(batch.frames.t_end[-1]))

    def watch(self, selection: Selection | None) -> None:
        """Show what a selection shows from now on; None: everything."""
        self.watched = None if selection is None else Watched(selection)

    def still(self) -> Self:
        """Return all that is remembered now; what comes does not change it."""
        shared = [self.incidents, self.names, *(t.protocol for t in self.buses.values())]
        if self.watched is not None:
            shared.append(self.watched.selection)
        return copy.deepcopy(self, {id(one): one for one in shared})

    def close(self) -> None:
        """Do nothing: what was is still shown."""

    def end_ns(self, status: Status) -> int:
        """Return until when the bytes have come here: what is on its way is not silence."""
        return max(min(self.newest_ns, status.now_ns), status.now_ns - NS)

    def load(self, bus: BusStatus, end_ns: int) -> float:
        """Return how much of its time a line was busy lately, in percent.

        More than 100 % is no load: bytes of a longer time came at once (a pseudo-terminal, a reader
        that was held up), or the line is faster than the rate says.
        """
        heard = self._bytes.get(self._wires.get(bus.bus, bus.bus))
        if heard is None or bus.state != "listening" or not bus.baud:
            return 0.0
        sums, seconds = heard.until(end_ns)
        return 100 * BITS * int(sums[0]) / bus.baud / seconds

    def apart(self, status: Status) -> Status:
        """Return the state by bus (``by_bus``), with one a protocol where several share it."""
        status = by_bus(status)
        if not self._lanes:
            return status
        buses: list[BusStatus] = []
        for b in status.buses:
            lanes = self._lanes.get(b.bus, {b.bus: b.protocol})
            buses += (replace(b, bus=name, protocol=spoken) for name, spoken in lanes.items())
        return replace(status, buses=tuple(buses))

    def rows(self, bus: str, status: Status) -> ServoCells | None:
        """Return the servos of a bus as cells; None before anything is decoded."""
        tally = self.buses.get(bus)
        return None if tally is None else ServoCells(tally, status.now_ns, self.end_ns(status))


def by_bus(status: Status) -> Status:
    """Return the state with one entry a bus, also where two ports hear it: its two directions."""
    ports: dict[str, list[BusStatus]] = {}
    for b in status.buses:
        ports.setdefault(b.bus, []).append(b)
    return replace(status, buses=tuple(map(_joined, ports.values())))


def _joined(ports: Sequence[BusStatus]) -> BusStatus:
    first, *others = ports
    if not others:
        return first
    states = [b.state for b in ports]
    errors = [b.line_errors for b in ports if b.line_errors is not None]
    return replace(
        first,
        port="+".join([first.port, *(b.port.rpartition("/")[2] for b in others)]),
        # a cable that is out is told; a direction in which nobody speaks is no silent bus
        state=next((s for s in ("away", "listening") if s in states), first.state),
        bytes=sum(b.bytes for b in ports),
        lost=sum(b.lost for b in ports),
        line_errors=sum(errors) if errors else None,
    )
