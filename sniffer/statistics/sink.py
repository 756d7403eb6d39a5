"""A sink that counts and measures a capture: what ``sniffer stats`` tells."""

from __future__ import annotations

from collections import Counter
from dataclasses import dataclass, field
from typing import TYPE_CHECKING

import numpy as np

from sniffer.anomalies.alarms import on_bus
from sniffer.decoding.called import ServoNames
from sniffer.decoding.narrowing import selected
from sniffer.decoding.sink import bus_of
from sniffer.ground.distinct import distinct
from sniffer.ground.gaps import REASONS, Gaps
from sniffer.ground.heard import HeardSpan
from sniffer.ground.timing import byte_time_ns
from sniffer.statistics.collector import Collector
from sniffer.statistics.commands import CommandBook
from sniffer.statistics.exceeding import Exceedings
from sniffer.statistics.figures import AnswerColumns, BusSilence
from sniffer.statistics.slices import SliceBook
from sniffer.statistics.troubles import TroubleBook

if TYPE_CHECKING:
    from collections.abc import Sequence

    from sniffer.anomalies.alarms import Alarm
    from sniffer.decoding.pacing import Pace
    from sniffer.ground.model import Batch, Chunk
    from sniffer.protocols.base import BusProtocol


@dataclass(slots=True)
class LaneNumbers:
    """What one protocol says on one bus, beside what the collector keeps."""

    protocol: BusProtocol
    commands: CommandBook
    troubles: TroubleBook
    exceedings: Exceedings


@dataclass(slots=True)
class WireBytes:
    """Where the bytes of a bus went, and from when to when it was heard."""

    frames: int = 0
    in_frames: int = 0
    in_gaps: int = 0
    gaps: Counter[str] = field(default_factory=Counter)
    """By reason, how many."""
    baud: int = 0
    heard: HeardSpan = field(default_factory=HeardSpan)
    silence: BusSilence = field(default_factory=BusSilence)

    @property
    def bytes(self) -> int:
        """How many there were: each is in a frame or in a gap."""
        return self.in_frames + self.in_gaps

    @property
    def span_ns(self) -> int:
        """How long the bus was heard, by the times of its frames."""
        return self.heard.ns

    @property
    def byte_ns(self) -> int:
        """How long a byte takes."""
        return byte_time_ns(self.baud)

    def hear(self, protocol: BusProtocol, batch: Batch) -> None:
        """Take in from when to when frames of any kind were heard, and when nothing was."""
        f, gaps = batch.frames, Gaps.of(batch.gaps)
        if len(f):
            self.heard.take(protocol.name, f)
        columns = (
            (f.t_start, gaps.t_ns - gaps.length * self.byte_ns),
            (f.t_end, gaps.t_ns),
            (f.uncertainty, np.full(len(gaps), -1)),
            (f.start + batch.base, gaps.start + batch.base),
        )
        begun, *said = (np.concatenate(both) for both in columns)
        order = np.argsort(said[-1], kind="stable")
        ends = AnswerColumns(*(column[order] for column in said))
        self.silence.hear(begun[order], ends, order < len(f))

    def add(self, batch: Batch) -> None:
        """Count a batch in."""
        f = batch.frames
        if len(batch.gaps):
            gaps = Gaps.of(batch.gaps)
            self.in_gaps += int(gaps.length.sum())
            kinds, _, counts = distinct(gaps.kind)
            for kind, n in zip(kinds.tolist(), counts.tolist(), strict=True):
                self.gaps[REASONS[kind]] += n
        if len(f):
            self.frames += len(f)
            self.in_frames += int(f.length.sum())


class Statistics:
    """A sink that keeps what ``sniffer stats`` tells, in memory that does not grow with the time.

    Of a selection what is selected is counted; rates are over all the time that was heard.
    How long rules of the user's own were met is told, too. With ``every_ns`` what was said is
    counted in slices of that time, too. ``by_answer``: it is selected by what came of requests, so
    shares of missing answers would say of the selection only, and are left out.
    """

    def __init__(
        self,
        *,
        every_ns: int | None = None,
        by_answer: bool = False,
    ) -> None:
        self.collector = Collector()
        self.lanes: dict[str, LaneNumbers] = {}
        self.wires: dict[str, WireBytes] = {}
        self.slices: dict[str, SliceBook] = {}
        self.names = ServoNames()
        self.by_answer = by_answer
        self._alarms: Sequence[Alarm] = ()
        self._every_ns = every_ns

    def raw(self, bus: str, chunks: Sequence[Chunk]) -> None:
        """Take nothing: batches hold every byte."""

    def pace(self, bus: str, told: Pace) -> None:
        """Take what a bus is timed by."""
        self.collector.pace(bus, told)
        self._wire(bus).baud = told.baud

    def call(self, names: ServoNames) -> None:
        """Take what servos are called."""
        self.names = names

    def rule(self, alarms: Sequence[Alarm]) -> None:
        """Take the user's own rules."""
        self._alarms = alarms

    def unjudged(self) -> list[Alarm]:
        """Return the rules that a servo which was heard might meet, and none told a value for."""
        judged = {f.rule for lane in self.lanes.values() for f in lane.exceedings.figures()}
        asked = {rule for lane in self.lanes.values() for rule in lane.exceedings.asked()}
        return [a for a in self._alarms if str(a) in asked - judged]

    def write(self, bus: str, protocol: BusProtocol, batch: Batch) -> None:
        """Count a batch in."""
        self.collector.write(bus, protocol, batch)
        wire = self._wire(bus)
        wire.baud = wire.baud or protocol.baud
        wire.hear(protocol, batch)
        mine = selected(batch)
        wire.add(mine)
        if self._every_ns is not None:
            self.slices.setdefault(bus, SliceBook(self._every_ns)).add(batch, mine)
        name = bus_of(bus, protocol, batch)
        lane = self.lanes.get(name)
        if lane is None:
            exceedings = Exceedings(protocol, on_bus(self._alarms, bus, self.names.ids))
            lane = LaneNumbers(protocol, CommandBook(protocol), TroubleBook(), exceedings)
            self.lanes[name] = lane
        lane.commands.add(batch, mine)
        lane.troubles.add(mine, self.collector.grid)
        lane.exceedings.add(mine)

    def close(self) -> None:
        """Do nothing: what was counted is asked for afterwards."""

    def _wire(self, bus: str) -> WireBytes:
        return self.wires.setdefault(bus, WireBytes())
