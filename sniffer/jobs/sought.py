"""Where in a capture what is sought stands: a byte, an anomaly, what is so long before the end."""

from __future__ import annotations

import math
from collections import Counter
from operator import itemgetter
from typing import TYPE_CHECKING, Final

import numpy as np

from sniffer.anomalies.found import CODES, SEVERITY, Anomalies
from sniffer.decoding.called import ServoNames
from sniffer.ground.gaps import Gaps
from sniffer.ground.heard import SteadyTime
from sniffer.ground.model import InputError
from sniffer.selection.places import END, FOUND, CapturePlace, ambiguous

if TYPE_CHECKING:
    from collections.abc import Mapping, Sequence

    from sniffer.decoding.sink import Part
    from sniffer.ground.heard import SteadyPass
    from sniffer.ground.model import Batch, Chunk, Mask
    from sniffer.protocols.base import BusProtocol
    from sniffer.selection.selection import Selection

_KINDS: Final = tuple(zip(CODES, SEVERITY, strict=True))


class CountedKind:
    """Anomalies of the kind that a place names: which is the nth of them in time.

    Each bus has its own in order, and tells them in pieces: the nth is known when all other buses
    were told beyond it.
    """

    def __init__(self, number: int) -> None:
        self._number = number
        self._first: list[tuple[int, str, Anomalies, int]] = []
        self.count = 0

    def take(self, bus: str, found: Anomalies, rows: Sequence[int]) -> None:
        """Take those of a batch; of more than are asked for the first ones are kept."""
        self.count += len(rows)
        some = rows[: self._number]
        self._first += [(int(found.t_ns[row]), bus, found, row) for row in some]
        if len({each[1] for each in self._first}) > 1:
            self._first.sort(key=itemgetter(0))
        del self._first[self._number :]

    def nth(self, told: Mapping[str, float]) -> tuple[str, Anomalies, int] | None:
        """Return the bus of it, its batch and its row; ``told`` is how far each bus was."""
        if len(self._first) < self._number:
            return None
        t_ns, bus, found, row = self._first[-1]
        if any(until <= t_ns for other, until in told.items() if other != bus):
            return None
        return bus, found, row


class Finder:
    """A sink that looks for places.

    The nth anomaly of all is counted in the order of the output, the nth of a kind in that of time.
    Times are those of a clock that was never set.
    """

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
        self._steady: dict[str, SteadyTime] = {}
        self._told: dict[str, float] = {}
        """How far each bus was told, in ns."""
        self._met = {place: CountedKind(place.number) for place in self._places if place.is_counted}
        self._kinds = {
            place: np.array([place.sought in (code, level.name.lower()) for code, level in _KINDS])
            for place in self._met
        }
        """Which codes are of the kind that a place names."""
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
            self._told.setdefault(chunk.bus, -math.inf)

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
        there = self._met[place].count
        told = f"the capture has {there} of them" if there else "there is none in the capture"
        return told if self._among is None else f"{told} where {self._among.text}"

    def raw(self, bus: str, chunks: Sequence[Chunk]) -> None:
        """Take nothing."""

    def write(self, bus: str, protocol: BusProtocol, batch: Batch) -> None:
        """Look through a batch."""
        self.write_together(bus, [(protocol, batch)])

    def write_together(self, bus: str, parts: Sequence[Part]) -> None:
        """Look through what several protocols said in one pass."""
        records = self._steady.setdefault(bus, SteadyTime()).records([b for _, b in parts])
        ended = int((records.t_ns + records.moved).max(initial=-1))
        self._told[bus] = max(self._told.get(bus, -math.inf), ended if ended >= 0 else -math.inf)
        for protocol, batch in parts:
            self._look_through(bus, protocol, batch, records)
        self._settle(self._told)

    def _look_through(
        self, bus: str, protocol: BusProtocol, batch: Batch, records: SteadyPass
    ) -> None:
        found = Anomalies.of(batch.anomalies)
        found = found.timed(records.of(found.t_ns, found.known_at - batch.base))
        mine = np.ones(len(found), bool)
        if self._among is not None:
            mine = self._among.rows(bus, protocol, batch)("anomalies")
        for place in self._places:
            if place in self._times:
                continue
            if place.is_counted:
                self._met[place].take(bus, found, self._meant(place, bus, found, mine))
            elif place.sought == "byte" and place.bus in ("", bus):
                if (t_ns := time_at(batch, place.number, records)) is not None:
                    self._times[place] = t_ns
            elif place.sought == "anomaly" and place.number <= self._anomalies + len(found):
                self._take(place, bus, found, place.number - 1 - self._anomalies)
        self._anomalies += len(found)

    def _meant(self, place: CapturePlace, bus: str, found: Anomalies, mine: Mask) -> Sequence[int]:
        """Return the rows of the anomalies that a place may be one of."""
        if place.servo is not None:
            mine = mine & np.isin(found.servo_id, place.about(bus, self._names))
        rows: list[int] = np.flatnonzero(mine & self._kinds[place][found.code]).tolist()
        return rows

    def _settle(self, told: Mapping[str, float]) -> None:
        """Take what is known by now of the kinds that are counted."""
        for place, met in self._met.items():
            if place not in self._times and (one := met.nth(told)) is not None:
                self._take(place, *one)

    def _take(self, place: CapturePlace, bus: str, found: Anomalies, row: int) -> None:
        one = found[row]
        self.evidence[place] = bus, int(found.at[row]), f"{one.code}: {one.detail}"
        self._times[place] = int(found.t_ns[row])

    def close(self) -> None:
        """Count back from the last record; a longer time than there is begins with the capture."""
        self._settle({})
        last_ns = max(self._told.values(), default=-math.inf)
        if last_ns > -math.inf:
            for place in (place for place in self._places if place.sought == END):
                self._times[place] = int(last_ns) - place.number


def time_at(batch: Batch, offset: int, records: SteadyPass) -> int | None:
    """Return the time of the frame or gap that has a byte of the stream; None: none here has.

    ``records`` tells by how much the clock was set back in the pass.
    """
    at = offset - batch.base
    gaps = Gaps.of(batch.gaps)
    f = batch.frames
    for start, length, t_ns in ((f.start, f.length, f.t_end), (gaps.start, gaps.length, gaps.t_ns)):
        rows = ((start <= at) & (at < start + length)).nonzero()[0]
        if len(rows):
            return int(records.of(t_ns, start)[rows[0]])
    return None
