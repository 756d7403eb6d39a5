"""What of a capture is asked for: a part of it, and which records of that are shown."""

from __future__ import annotations

import contextlib
from collections import Counter
from dataclasses import dataclass, replace
from typing import TYPE_CHECKING

import numpy as np

from sniffer.anomalies.found import CODES, SEVERITY, Anomalies
from sniffer.decoding.called import ServoNames
from sniffer.decoding.pipeline import Pipeline
from sniffer.decoding.sink import Narrowed
from sniffer.decoding.slicing import Narrowing, Slice
from sniffer.ground.gaps import Gaps
from sniffer.ground.model import DamagedInputError, InputError, SnifferError
from sniffer.ground.wording import Sentence
from sniffer.jobs.order import merged
from sniffer.jobs.telling import Teller
from sniffer.selection.places import END, FOUND, MOMENT, OF_DAY, CapturePlace, Window, ambiguous
from sniffer.sinks import BYTES

if TYPE_CHECKING:
    from collections.abc import Sequence

    from sniffer.decoding.options import Options
    from sniffer.ground.model import Batch, Chunk, Mask
    from sniffer.protocols.base import BusProtocol
    from sniffer.selection.selection import Selection
    from sniffer.sources import Source


@dataclass(frozen=True, slots=True)
class Extract:
    """What is asked for; without anything it is all of a capture."""

    selection: Selection | None = None
    start: CapturePlace | None = None
    stop: CapturePlace | None = None
    around_ns: int = 0

    @classmethod
    def of(cls, selection: Selection | None, window: Window | None) -> Extract | None:
        """Return what is asked for, None for all of a capture.

        Raises:
            InputError: an end of the window is no place.
        """
        start, stop = (window or Window()).places()
        if selection is None and start is None and stop is None:
            return None
        return cls(selection, start, stop, 0 if window is None else window.around_ns)

    @property
    def is_part(self) -> bool:
        """Whether it is a part of a capture."""
        return self.start is not None or self.stop is not None

    @property
    def of_places(self) -> Selection | None:
        """The anomalies that an end of it is one of, as ``@first-error``; None: of all."""
        counted = any(p is not None and p.is_counted for p in (self.start, self.stop))
        return self.selection.about("anomalies") if self.selection and counted else None

    @property
    def seeks(self) -> bool:
        """Whether it begins or ends where something is found: the capture is read twice."""
        return any(place is not None and place.kind == FOUND for place in (self.start, self.stop))

    @property
    def is_dated(self) -> bool:
        """Whether it begins or ends at a time of day, or on a day."""
        return any(p is not None and p.kind in (OF_DAY, MOMENT) for p in (self.start, self.stop))

    def __str__(self) -> str:
        start = "its beginning" if self.start is None else _words(self.start)
        stop = "its end" if self.stop is None else _words(self.stop)
        if self.around_ns and self.start == self.stop:
            return f"{self.around_ns / 1e9:g} s around {start}{self._told}"
        wider = f", {self.around_ns / 1e9:g} s wider" if self.around_ns else ""
        return f"from {start} to {stop}{wider}{self._told}"

    @property
    def _told(self) -> str:
        of = self.of_places
        return f" where {of.text}" if of is not None else ""

    def ends(self, first_ns: int | None) -> tuple[int | None, int | None]:
        """Return the first and the last time, None where the capture's own is meant.

        Raises:
            InputError: it ends before it begins, or the input has no clock for what was written.
        """
        start = None if self.start is None else self.start.at(first_ns) - self.around_ns
        stop = None if self.stop is None else self.stop.at(first_ns) + self.around_ns
        if start is not None and stop is not None and stop < start:
            raise InputError(Sentence("{stop} must lie behind {start}"))
        return start, stop

    def narrowing(self, sinks: Sequence[object], tell: Teller) -> Narrowing:
        """Return what does it in a pipeline; the sinks are told, and so is who reads along."""
        told = [sink for sink in sinks if isinstance(sink, Narrowed)]
        if self.selection is not None:
            for sink in told:
                sink.narrow({"where": self.selection.text, "tables": list(self.selection.tables)})
        choose = None if self.selection is None else self.selection.rows
        if not self.is_part:
            return Narrowing(None, choose)

        def ends(first_ns: int | None) -> tuple[int | None, int | None]:
            start, stop = self.ends(first_ns)
            begin = self.start
            dated = begin is not None and begin.kind in (OF_DAY, MOMENT) and not begin.sought
            early = dated and start is not None and first_ns is not None and start < first_ns
            behind = "; its first byte came after that: nothing in front is left out"
            tell.talk(f"a part of it: {self}{behind if early else ''}")
            for sink in told:
                sink.narrow({"part": str(self), "from_ns": start, "to_ns": stop})
            return start, stop

        return Narrowing(Slice(ends, str(self)), choose)

    def sought_in(self, opened: Source, options: Options) -> Extract:
        """Return it with all places found; the source is read once, as far as need be.

        Raises:
            InputError: something is not there, or several buses have the byte that is meant.
        """
        if self.selection is not None:
            self = replace(self, selection=self.selection.named(options.called))
        if not self.seeks:
            return self
        places = [p for p in (self.start, self.stop) if p is not None and p.kind == FOUND]
        finder = _Finder(places, self.of_places, options.called)
        _look(finder, opened, options)
        return replace(self, start=finder.found(self.start), stop=finder.found(self.stop))


def evidence_at(place: CapturePlace, opened: Source, options: Options) -> tuple[str, int, str]:
    """Return the bus and the byte at which an anomaly is told, and what it says.

    Raises:
        InputError: it is not there.
    """
    finder = _Finder([place], names=options.called)
    _look(finder, opened, options)
    finder.found(place)
    return finder.evidence[place]


def record_at(place: CapturePlace, opened: Source, options: Options) -> tuple[str, int]:
    """Return the bus and the first byte of what was said first from a time on.

    Raises:
        InputError: nothing was, or the input has no clock for what was written.
    """
    asked = Extract(start=place).sought_in(opened, options)
    first, quiet = _First(), Teller(lambda line: None, quiet=True)
    pipeline = Pipeline(options, [first])
    pipeline.narrowing = asked.narrowing([], quiet)
    with contextlib.suppress(DamagedInputError):
        for group in merged(opened, opened, options, quiet):
            pipeline.feed(group)
            if first.found is not None:
                break
    if first.found is None:
        pipeline.close()
    if first.found is None:
        raise InputError(f"{place.text}: nothing was said from there on")
    return first.found[1:]


def _look(finder: _Finder, opened: Source, options: Options) -> None:
    """Read a source as far as need be."""
    pipeline = Pipeline(options, [finder])
    quiet = Teller(lambda line: None, quiet=True)
    with contextlib.suppress(DamagedInputError):
        for group in merged(opened, opened, options, quiet):
            finder.hear(group)
            if not finder.is_done:
                pipeline.feed(group)
            elif finder.knows_buses:
                break
    if not finder.is_done:
        pipeline.close()
        finder.close()


def _words(place: CapturePlace) -> str:
    if place.sought == END:
        return f"{place.number / 1e9:g} s before its end"
    return f"second {place.text}" if place.text.replace(".", "").isdigit() else place.text


class _First:
    """A sink that keeps where what came first stands: its time, its bus, its first byte."""

    found: tuple[int, str, int] | None = None

    def raw(self, bus: str, chunks: Sequence[Chunk]) -> None:
        """Take nothing."""

    def write(self, bus: str, protocol: BusProtocol, batch: Batch) -> None:
        """Look at the first frame and the first gap."""
        f, gaps = batch.frames, Gaps.of(batch.gaps)
        for start, t_ns in ((f.start, f.t_end), (gaps.start, gaps.t_ns)):
            if len(start):
                one = int(t_ns[0]), bus, int(start[0]) + batch.base
                self.found = one if self.found is None else min(self.found, one)

    def close(self) -> None:
        """Do nothing."""


class _Finder:
    """A sink that looks for places, and counts anomalies in the order of the output."""

    def __init__(
        self,
        places: Sequence[CapturePlace],
        among: Selection | None = None,
        names: ServoNames | None = None,
    ) -> None:
        self._names = names or ServoNames()
        for place in places:
            place.known_by(self._names)
        self._places = tuple(dict.fromkeys(places))
        self._among = among
        self._times: dict[CapturePlace, int] = {}
        self.evidence: dict[CapturePlace, tuple[str, int, str]] = {}
        """Of anomalies that are found the bus, the first byte, and what they say."""
        self._anomalies = 0
        self._last_ns: int | None = None
        self._met = dict.fromkeys(self._places, 0)
        """How many anomalies of the kind that a place names were there so far."""
        self._of_any = [p for p in self._places if p.sought == "byte" and not p.bus]
        self._heard: Counter[str] = Counter()
        """How many bytes of each bus there were so far."""

    @property
    def is_done(self) -> bool:
        """Whether all of them are found."""
        return len(self._times) == len(self._places)

    @property
    def knows_buses(self) -> bool:
        """Whether what is still to come cannot make a byte that is found one of several buses."""
        return all(len(self._having(place)) > 1 for place in self._of_any)

    def hear(self, group: Sequence[Chunk]) -> None:
        """Count bytes: which buses have one is known before they are decoded."""
        for chunk in group:
            self._heard[chunk.bus] += len(chunk.data)

    def _having(self, place: CapturePlace) -> list[str]:
        """Return the buses that have the byte of a place."""
        return [bus for bus, length in self._heard.items() if length > place.number]

    def found(self, place: CapturePlace | None) -> CapturePlace | None:
        """Return a place with its time.

        Raises:
            InputError: it is not there.
        """
        if place is None or place.kind != FOUND:
            return place
        if place in self._of_any and len(having := self._having(place)) > 1:
            raise InputError(ambiguous(place, having))
        if place not in self._times:
            raise InputError(f"{place.text}: {self._missing(place)}")
        return place.found(self._times[place])

    def _missing(self, place: CapturePlace) -> str:
        if place.sought == END:
            return "the capture has no record"
        if place.sought == "byte":
            return (
                f"no record of {f'bus {place.bus}' if place.bus else 'the capture'} has this byte"
            )
        if place.sought == "anomaly":
            return f"the capture has {self._anomalies} anomalies"
        there = self._met[place]
        told = f"the capture has {there} of them" if there else "there is none in the capture"
        return told if self._among is None else f"{told} where {self._among.text}"

    def raw(self, bus: str, chunks: Sequence[Chunk]) -> None:
        """Take nothing."""

    def write(self, bus: str, protocol: BusProtocol, batch: Batch) -> None:
        """Look through a batch."""
        found = Anomalies.of(batch.anomalies)
        mine = np.ones(len(found), bool)
        if self._among is not None:
            mine = self._among.rows(bus, protocol, batch)("anomalies")
        ends = [int(t.max()) for t in (batch.frames.t_end, Gaps.of(batch.gaps).t_ns) if len(t)]
        self._last_ns = max((t for t in (self._last_ns, *ends) if t is not None), default=None)
        for place in self._places:
            if place not in self._times:
                t_ns = self._in(place, bus, batch, found, mine)
                if t_ns is not None:
                    self._times[place] = t_ns
        self._anomalies += len(found)

    def _in(
        self, place: CapturePlace, bus: str, batch: Batch, found: Anomalies, mine: Mask
    ) -> int | None:
        if place.sought == "byte":
            return time_at(batch, place.number) if place.bus in ("", bus) else None
        if place.sought == END:  # known when there is no more
            return None
        if place.sought == "anomaly":
            nth = place.number - 1 - self._anomalies
            return self._take(place, bus, found, nth) if nth < len(found) else None
        if place.servo is not None:
            mine = mine & np.isin(found.servo_id, place.about(bus, self._names))
        code = found.code.tolist()
        for nth in mine.nonzero()[0].tolist():
            if place.sought in (CODES[code[nth]], SEVERITY[code[nth]].name.lower()):
                self._met[place] += 1
                if self._met[place] == place.number:
                    return self._take(place, bus, found, nth)
        return None

    def _take(self, place: CapturePlace, bus: str, found: Anomalies, nth: int) -> int:
        one = found[nth]
        self.evidence[place] = bus, int(found.at[nth]), f"{one.code}: {one.detail}"
        return int(found.t_ns[nth])

    def close(self) -> None:
        """Count back from the last record; a longer time than there is begins with the capture."""
        if self._last_ns is not None:
            for place in (place for place in self._places if place.sought == END):
                self._times[place] = self._last_ns - place.number


def time_at(batch: Batch, offset: int) -> int | None:
    """Return the time of the frame or gap that has a byte of the stream; None: none here has."""
    at = offset - batch.base
    gaps = Gaps.of(batch.gaps)
    f = batch.frames
    for start, length, t_ns in ((f.start, f.length, f.t_end), (gaps.start, gaps.length, gaps.t_ns)):
        rows = ((start <= at) & (at < start + length)).nonzero()[0]
        if len(rows):
            return int(t_ns[rows[0]])
    return None


def buses_of(source: str, found: Sequence[str], wanted: Sequence[str]) -> list[str]:
    """Return those of a capture's buses that are wanted; all of them where none is named.

    Raises:
        InputError: it has none, or not what is wanted.
    """
    if not found:
        raise InputError(f"{source} is empty: nothing to play")
    for bus in wanted:
        if bus not in found:
            told = "{buses}: there is no bus {bus}, only {found}"
            raise InputError(Sentence(told, bus=bus, found=", ".join(found)))
    return [bus for bus in found if not wanted or bus in wanted]


def only_bus(source: str, found: Sequence[str], wanted: Sequence[str]) -> str:
    """Return the one bus of a capture that is wanted.

    Raises:
        InputError: it has none, or not what is wanted.
        SnifferError: there is more than one.
    """
    buses = buses_of(source, found, wanted)
    if len(buses) > 1:
        told = "it has {n} buses ({names}): choose one with {buses}"
        raise SnifferError(Sentence(told, n=len(buses), names=", ".join(buses)))
    return buses[0]


def refuse_part_of(asked: Extract | None, suffixes: Sequence[str]) -> None:
    """Refuse a recording of what is not all of a capture, or the bytes of a part of it.

    A file of bytes may have the frames of a selection.

    Raises:
        SnifferError: there is one among these suffixes.
    """
    if asked is None:
        return
    if ".mcap" in suffixes:
        told = "a recording has every byte of its buses: `sniffer cut` makes one of a part"
        if asked.selection is not None:
            told = "a recording has every byte of its buses: frames alone go into a .log"
        raise SnifferError(told)
    if asked.selection is not None:
        return
    if suffix := next((s for s in suffixes if s in BYTES), None):
        raise SnifferError(f"a {suffix} has every byte: `sniffer cut` makes one of a part")
