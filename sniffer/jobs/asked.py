"""What of a capture is asked for: a part of it, and which records of that are shown."""

from __future__ import annotations

import contextlib
import functools
from dataclasses import dataclass, replace
from typing import TYPE_CHECKING

from sniffer.decoding.partends import PartEnds
from sniffer.decoding.pipeline import Pipeline
from sniffer.decoding.sink import Narrowed
from sniffer.decoding.slicing import Narrowing, Slice
from sniffer.decoding.summary import UNTIMED
from sniffer.ground.gaps import Gaps
from sniffer.ground.model import DamagedInputError, InputError, SnifferError
from sniffer.ground.wording import Sentence
from sniffer.jobs.order import merged
from sniffer.jobs.sought import Finder
from sniffer.jobs.telling import Teller
from sniffer.selection.places import END, FOUND, SINCE, CapturePlace, Window
from sniffer.sinks import BYTES

if TYPE_CHECKING:
    from collections.abc import Sequence

    from sniffer.decoding.options import Options
    from sniffer.decoding.partends import EndsSince
    from sniffer.ground.model import Batch, Chunk
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
    context: int = 0
    """How many lines are shown before and behind each that is selected."""

    @classmethod
    def of(
        cls, selection: Selection | None, window: Window | None, context: int = 0
    ) -> Extract | None:
        """Return what is asked for, None for all of a capture.

        Raises:
            InputError: an end of the window is no place.
            SnifferError: one of both is given as something else.
        """
        if not isinstance(window, Window | None):
            raise SnifferError(f"a window is made like Window({window!r})")
        if isinstance(selection, str):
            raise SnifferError(f"a selection is made like Selection.parse({selection!r})")
        start, stop = (window or Window()).places()
        if selection is None and start is None and stop is None:
            return None
        return cls(selection, start, stop, 0 if window is None else window.around_ns, context)

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
        return any(p is not None and p.is_stamp for p in (self.start, self.stop))

    @property
    def _is_placed(self) -> bool:
        """Whether an end of it is told otherwise than by its second, or is moved."""
        ends = [place for place in (self.start, self.stop) if place is not None]
        return bool(self.around_ns) or any(place.kind != SINCE for place in ends)

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

    def ends(self, first_ns: int | None) -> EndsSince:
        """Return the first and the last time; ``first_ns`` is when the capture begins.

        Raises:
            InputError: it ends before it begins, or the input has no clock for what was written.
        """
        begun = self._ends_since(first_ns, None)
        if begun.start is not None and begun.stop is not None and begun.stop < begun.start:
            raise InputError(Sentence("{stop} must lie behind {start}"))
        return functools.partial(self._ends_since, first_ns)

    def _ends_since(self, first_ns: int | None, told_ns: int | None) -> PartEnds:
        """Return them as they are meant by a clock that was set to ``told_ns``, None: not yet."""

        def of(place: CapturePlace | None, wider_ns: int) -> tuple[int | None, bool]:
            if place is None:
                return None, False
            known_ns = told_ns if place.is_stamp and told_ns is not None else first_ns
            return place.at(known_ns) + wider_ns, place.is_stamp

        start, starts_by_stamp = of(self.start, -self.around_ns)
        stop, stops_by_stamp = of(self.stop, self.around_ns)
        return PartEnds(start, stop, starts_by_stamp, stops_by_stamp)

    def narrowing(self, sinks: Sequence[object], tell: Teller) -> Narrowing:
        """Return what does it in a pipeline; the sinks are told, and so is who reads along."""
        told = [sink for sink in sinks if isinstance(sink, Narrowed)]
        if self.selection is not None:
            rows = {"where": self.selection.text, "tables": list(self.selection.tables)}
            beside = {"context": self.context} if self.context else {}
            for sink in told:
                sink.narrow({**rows, **beside})
        choose = None if self.selection is None else self.selection.rows
        if not self.is_part:
            return Narrowing(None, choose, self.context)

        def ends(first_ns: int | None) -> EndsSince:
            since = self.ends(first_ns)
            start, stop, by_stamp, ends_by_stamp = since(None)
            early = by_stamp and start is not None and first_ns is not None and start < first_ns
            behind = "; its first byte came after that: nothing in front is left out"
            told_of = _in_seconds(first_ns or 0, start, stop) if self._is_placed else ""
            # stamps that are all before the first one: a clock that is set back may come to them
            nowhere = ends_by_stamp and stop is not None and stop < (first_ns or 0)
            known = "" if nowhere else f"{told_of}{behind if early else ''}"
            untimed = f"; {UNTIMED}: seconds count its bytes" if first_ns is None else ""
            tell.talk(f"a part of it: {self}{known}{untimed}")
            of_whole = {"first_ns": first_ns, "from_ns": start, "to_ns": stop}
            for sink in told:
                sink.narrow({"part": str(self), **of_whole})
            return since

        return Narrowing(Slice(ends, str(self)), choose, self.context)

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
        finder = Finder(places, self.of_places, options.called)
        _look(finder, opened, options)
        return replace(self, start=finder.found(self.start), stop=finder.found(self.stop))


def evidence_at(place: CapturePlace, opened: Source, options: Options) -> tuple[str, int, str]:
    """Return the bus and the byte at which an anomaly is told, and what it says.

    Raises:
        InputError: it is not there.
    """
    finder = Finder([place], names=options.called)
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


def _look(finder: Finder, opened: Source, options: Options) -> None:
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


def _in_seconds(first_ns: int, start: int | None, stop: int | None) -> str:
    """Return in which seconds of the capture a part of it lies, such that they have all of it."""
    least = "" if start is None else _second(max(start - first_ns, 0) // 1000)
    most = "" if stop is None else _second(max(-((first_ns - stop) // 1000), 0))
    if least and most:
        return f", second {least} to {most}"
    return f", from second {least} on" if least else f", up to second {most}"


def _second(microseconds: int) -> str:
    return f"{microseconds / 1e6:.6f}".rstrip("0").rstrip(".")


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
