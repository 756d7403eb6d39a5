"""The bytes behind the incidents, drawn when the capture is decoded once more.

What is evidence is known only when everything was heard, and a capture is not kept in memory. So it
is read again, and frames are drawn where an incident points.
"""

from __future__ import annotations

from typing import TYPE_CHECKING, Final, NamedTuple

import numpy as np

from sniffer.decoding.called import ServoNames
from sniffer.decoding.drawing import draw_frame, draw_gap
from sniffer.decoding.sink import bus_of
from sniffer.ground.gaps import Gaps

if TYPE_CHECKING:
    from collections.abc import Iterable, Mapping, Sequence

    from sniffer.decoding.drawing import Drawn
    from sniffer.diagnosis.model import Incident, Place
    from sniffer.ground.model import I64, Batch, Chunk
    from sniffer.protocols.base import BusProtocol

PLACES: Final = 6
"""Places that are drawn of an incident: those of different findings first."""

DRAWN_MOST: Final = 120
"""Places that are drawn of all incidents, the first ones; a drawing takes some 2 kB of a page."""

PIECES: Final = 4
"""Frames and gaps of one place that are drawn, the first ones."""


BEFORE, BEHIND = 2, 1
"""Frames beside a place that are told in a line each: what was asked, who answered too."""


class Exhibit(NamedTuple):
    """One place with what stands there, in wire order, and the frames right beside it."""

    place: Place
    pieces: tuple[Drawn, ...]
    before: tuple[Drawn, ...] = ()
    behind: tuple[Drawn, ...] = ()


def chosen(incident: Incident) -> list[Place]:
    """Return the places of an incident that are shown, in the order of time.

    One of each finding, then the second ones, and so on: what is alike is shown once.
    """
    out: dict[int, Place] = {}
    columns = [f.places for f in incident.findings]
    for nth in range(max(map(len, columns), default=0)):
        for places in columns:
            if nth < len(places) and len(out) < PLACES:
                out.setdefault(places[nth].offset, places[nth])
    return sorted(out.values(), key=lambda place: (place.t_ns, place.offset))


class Exhibits:
    """A sink that draws what stands at the places of incidents."""

    def __init__(self, incidents: Iterable[Incident]) -> None:
        self._wanted: dict[str, list[tuple[int, int, int]]] = {}
        self._places: list[tuple[int, str, Place]] = []
        self._names = ServoNames()
        self._pieces: dict[int, list[Drawn]] = {}
        self._before: dict[int, list[Drawn]] = {}
        self._behind: dict[int, list[Drawn]] = {}
        self._last: dict[str, list[Drawn]] = {}
        """By bus the last frames of the pass before: a place may stand at the begin of the next."""
        self._open: dict[str, list[tuple[int, int]]] = {}
        """By bus the places, with their ends, behind which a pass had no frame any more."""
        for incident in incidents:
            for place in chosen(incident):
                if len(self._places) < DRAWN_MOST:
                    wanted = self._wanted.setdefault(incident.bus, [])
                    wanted.append((place.offset, place.offset + place.length, len(self._places)))
                    self._places.append((incident.number, incident.bus, place))
        self._left = {bus: max(e[1] for e in wanted) for bus, wanted in self._wanted.items()}

    @property
    def is_done(self) -> bool:
        """Whether nothing more is looked for."""
        return not self._left

    def raw(self, bus: str, chunks: Sequence[Chunk]) -> None:
        """Take nothing: a batch has the bytes."""

    def call(self, names: ServoNames) -> None:
        """Take what servos are called."""
        self._names = names

    def write(self, bus: str, protocol: BusProtocol, batch: Batch) -> None:
        """Draw what of the batch is evidence."""
        for name in dict.fromkeys((bus, bus_of(bus, protocol, batch))):
            end = batch.base + len(batch.data)
            for nth, high in self._open.pop(name, ()):
                self._follow(name, nth, high, batch, protocol)
            for low, high, nth in self._wanted.get(name, ()):
                if low < end and high > batch.base:
                    pieces = self._pieces.setdefault(nth, [])
                    pieces += _pieces(batch, protocol, low, high, PIECES - len(pieces))
                    if nth not in self._before:
                        before = [*self._last.get(name, ()), *_before(batch, protocol, low)]
                        self._before[nth] = before[-BEFORE:]
                        self._follow(name, nth, high, batch, protocol)
            if self._left.get(name, end + 1) <= end and name not in self._open:
                del self._left[name]
            if name in self._left:
                self._last[name] = _before(batch, protocol, end) or self._last.get(name, [])

    def _follow(self, name: str, nth: int, high: int, batch: Batch, protocol: BusProtocol) -> None:
        """Take the frames of a batch that are right behind a place, which ends at ``high``."""
        behind = self._behind.setdefault(nth, [])
        first = int(np.searchsorted(batch.frames.start, high - batch.base, "left"))
        for row in range(first, min(first + BEHIND - len(behind), len(batch.frames))):
            behind.append(draw_frame(batch, protocol, row))
        if len(behind) < BEHIND:
            self._open.setdefault(name, []).append((nth, high))

    def close(self) -> None:
        """Do nothing: what was drawn is asked for afterwards."""

    def exhibits(self) -> Mapping[int, Sequence[Exhibit]]:
        """Return what is shown of each incident, by its number."""
        out: dict[int, list[Exhibit]] = {}
        for nth, (number, bus, place) in enumerate(self._places):
            pieces, *beside = (
                tuple(piece.named(self._names, bus) for piece in told.get(nth, ()))
                for told in (self._pieces, self._before, self._behind)
            )
            pieces = tuple(sorted(pieces, key=lambda piece: piece.offset))
            out.setdefault(number, []).append(Exhibit(place, pieces, *beside))
        return out


def _pieces(batch: Batch, protocol: BusProtocol, low: int, high: int, most: int) -> list[Drawn]:
    """Return the frames and gaps of a batch within two absolute offsets, the first ones."""
    f, gaps = batch.frames, Gaps.of(batch.gaps)
    low, high = low - batch.base, high - batch.base
    at: list[tuple[int, bool, int]] = []
    for is_frame, start, length in ((True, f.start, f.length), (False, gaps.start, gaps.length)):
        at += ((s, is_frame, i) for i, s in _within(start, length, low, high))
    return [
        draw_frame(batch, protocol, i) if is_frame else draw_gap(batch, protocol, gaps[i])
        for _, is_frame, i in sorted(at)[: max(most, 0)]
    ]


def _before(batch: Batch, protocol: BusProtocol, low: int) -> list[Drawn]:
    """Return the frames of a batch right before an absolute offset."""
    last = int(np.searchsorted(batch.frames.end, low - batch.base, "right"))
    return [draw_frame(batch, protocol, i) for i in range(max(last - BEFORE, 0), last)]


def _within(start: I64, length: I64, low: int, high: int) -> list[tuple[int, int]]:
    """Return which pieces lie between two offsets, wholly or in part: row and start."""
    rows = np.flatnonzero((start < high) & (start + length > low))
    return list(zip(rows.tolist(), start[rows].tolist(), strict=True))
