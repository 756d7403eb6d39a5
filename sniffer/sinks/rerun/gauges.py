"""What a recording shows beside the values that were stated: errors, loads, marks on the curves.

Used by ``sniffer.sinks.rerun.sink``.
"""

from __future__ import annotations

import itertools
from dataclasses import replace
from typing import TYPE_CHECKING, Final

import numpy as np

from sniffer.ground.model import NS, Clock, Severity
from sniffer.sinks.rerun.derived import Following, Rows, SecondFold, line_use, unanswered
from sniffer.sinks.rerun.entities import WHITE, Curve, Marks, PerSecond
from sniffer.sinks.rerun.longrun import Overview
from sniffer.sinks.rerun.plots import (
    BUS_LOAD,
    EVERYONE,
    FOLLOWING_ERROR,
    MISSING,
    PEAK_ERROR,
    PEAK_OVERVIEW,
    PEAK_TIME,
    Track,
)

if TYPE_CHECKING:
    from collections.abc import Callable, Iterator, Mapping

    from sniffer.ground.colours import Rgb
    from sniffer.ground.model import F64, I64, Batch
    from sniffer.protocols.base import BusProtocol
    from sniffer.sinks.rerun.entities import Shape

    Whose = tuple[int, str, Rgb]
    Who = Callable[[str, BusProtocol, int], Whose]
    Path = Callable[[str, int, str], str]

MARKS: Final[Mapping[str, tuple[Rgb, Shape, float]]] = {
    "error": ((255, 70, 70), "Cross", 5.0),
    "warning": ((255, 196, 64), "Cross", 4.0),
    "incident": (WHITE, "Down", 6.0),
}
"""Colour, shape and size of what stands on the curves, by its name in the legend."""

STANDS_OUT: Final = 2.0
FEW_NAMED: Final = 3
"""Who is off the goal by more than so many times what the next one is, is named; so many at most.
"""


class Gauges:
    """Reckons the curves, one set a bus.

    ``who`` tells whose a curve is, its name and its colour, ``line`` the same of those of the bus
    itself; ``path`` names an entity.
    """

    def __init__(self, who: Who, line: Callable[[], Whose], path: Path) -> None:
        self._who, self._line, self._path = who, line, path
        self._curves: dict[tuple[str, int, str], Curve] = {}
        self._seconds: dict[tuple[str, int, str], SecondFold] = {}
        self._following: dict[tuple[str, int], tuple[str, Following]] = {}
        self._astray: dict[str, dict[str, float]] = {}
        self._overview = Overview()
        self.loads: dict[str, float] = {}
        """The largest load by bus, in percent."""

    def curves(self) -> Iterator[Curve]:
        """Yield all curves."""
        yield from self._curves.values()

    def tracks(self) -> list[Track]:
        """Return what of it has anything to show."""
        return [curve.track for curve in self._curves.values() if curve.total]

    def write(self, bus: str, protocol: BusProtocol, batch: Batch) -> None:
        """Take what one pass decided, its positions aside."""
        if batch.clock != Clock.NONE and len(batch.frames):
            # of a selection, too, the load is that of the line
            self._count(bus, protocol, -1, BUS_LOAD, line_use(batch), "%")
            for servo, times, missing in unanswered(batch):
                self._count(bus, protocol, servo, MISSING, (times, missing), "1/s")
        shown = batch.shows("anomalies", len(batch.anomalies)).tolist()
        for anomaly in itertools.compress(batch.anomalies, shown):
            if anomaly.severity >= Severity.WARN:
                name = "error" if anomaly.severity >= Severity.ERROR else "warning"
                self.mark(bus, anomaly.servo_id, anomaly.t_ns, name)

    def aim(self, bus: str, servo: int, unit: str, times: I64, goals: F64) -> None:
        """Take the goals of a servo, or of all (negative)."""
        stated = ~np.isnan(goals)
        for (of, who), (_, following) in self._following.items():
            if servo < 0 and of == bus and who != servo:
                following.aim(times[stated], goals[stated])
        self._followed(bus, servo, unit).aim(times[stated], goals[stated])

    def measure(self, bus: str, protocol: BusProtocol, servo: int, unit: str, rows: Rows) -> None:
        """Take the positions of a servo."""
        if self._followed(bus, servo, unit) is not self._following[bus, servo][1]:
            return
        times, errors = self._following[bus, servo][1].measure(*rows)
        if len(times):
            who, name, colour = self._who(bus, protocol, servo)
            key = bus, servo, FOLLOWING_ERROR
            if key not in self._curves:
                track = Track(self._entity(*key), bus, who, FOLLOWING_ERROR, unit, who=name)
                self._curves[key] = Curve(track, name, colour)
            self._curves[key].add(times, errors)
            self._count(bus, protocol, servo, PEAK_ERROR, (times, np.abs(errors)), unit)

    def time(self, bus: str, protocol: BusProtocol, servo: int, rows: Rows) -> None:
        """Take how long the answers of a servo took, in ms."""
        self._count(bus, protocol, servo, PEAK_TIME, rows, "ms")

    def astray(self) -> dict[str, str]:
        """Return by bus the few who were off the goal by far the most, summed over the seconds.

        What a step costs everybody for a moment counts little so; a joint that hangs limp, much.
        """
        out = {}
        for bus, sums in self._astray.items():
            names = sorted(sums, key=lambda name: -sums[name])
            for n in range(min(FEW_NAMED, len(names) // 2), 0, -1):
                if sums[names[n - 1]] > STANDS_OUT * sums[names[n]]:
                    out[bus] = ", ".join(names[:n])
                    break
        return out

    def mark(self, bus: str, servo: int | None, t_ns: int, name: str) -> None:
        """Mark on a servo's curves that something happened; on the bus's where it has none."""
        unit, following = self._following.get((bus, -1 if servo is None else servo), ("", None))
        places = {} if following is None else following.at(t_ns)
        if servo is None or not places:
            servo, unit, places = -1, "%", {BUS_LOAD: 0.0}
        for quantity, value in places.items():
            key = bus, servo, f"marks/{quantity}/{name}"
            if key not in self._curves:
                colour, shape, size = MARKS[name]
                who = servo if servo >= 0 else EVERYONE
                track = Track(self._entity(*key), bus, who, quantity, unit, is_mark=True)
                self._curves[key] = Marks(track, name, colour, shape, size)
            marks = self._curves[key]
            assert isinstance(marks, Marks)
            marks.set(t_ns, value)

    @property
    def step_s(self) -> int:
        """Of how many seconds the overview has the largest error."""
        return self._overview.step_s

    def close(self, *, is_whole: bool) -> None:
        """Finish the seconds that are open; of what is whole, add how it is overlooked."""
        for key, seconds in self._seconds.items():
            rest = seconds.rest()
            self._curves[key].add(*rest)
            if key[2] == PEAK_ERROR:
                self._overview.add(key, (rest[0][:1], rest[1][:1]))
        for (bus, servo, _), rows in self._overview.curves() if is_whole else ():
            of = self._curves[bus, servo, PEAK_ERROR]
            path = self._entity(bus, servo, PEAK_OVERVIEW)
            track = replace(of.track, path=path, quantity=PEAK_OVERVIEW)
            curve = self._curves[bus, servo, PEAK_OVERVIEW] = PerSecond(track, of.name, of.colour)
            curve.add(*rows)

    def _entity(self, bus: str, servo: int, name: str) -> str:
        """Return the path of a servo's entity, or of the bus's own (negative)."""
        import rerun as rr

        if servo < 0:
            return rr.new_entity_path([bus, *name.split("/")])
        return self._path(bus, servo, name)

    def _followed(self, bus: str, servo: int, unit: str) -> Following:
        """Return what tracks a servo; its first unit counts, another one is taken by nobody."""
        if (bus, servo) not in self._following:
            self._following[bus, servo] = unit, Following()
        known, following = self._following[bus, servo]
        return following if known == unit else Following()

    def _count(
        self, bus: str, protocol: BusProtocol, servo: int, quantity: str, rows: Rows, unit: str
    ) -> None:
        key = bus, servo, quantity
        if key not in self._seconds:
            who, name, colour = self._line() if servo < 0 else self._who(bus, protocol, servo)
            track = Track(self._entity(*key), bus, who, quantity, unit)
            self._curves[key] = PerSecond(track, name, colour)
            fold = np.maximum if quantity in (PEAK_ERROR, PEAK_TIME) else np.add
            self._seconds[key] = SecondFold(fold, 0.0 if quantity == BUS_LOAD else np.nan)
            if quantity == BUS_LOAD:  # before the first byte there was none: the axis shows its 0
                start = int(rows[0].min()) // NS * NS
                self._curves[key].add(np.array([start - 1], np.int64), np.zeros(1))
        over = self._seconds[key].add(*rows)
        self._curves[key].add(*over)
        if quantity == BUS_LOAD:
            self.loads[bus] = max(self.loads.get(bus, 0.0), float(over[1].max(initial=0.0)))
        if quantity == PEAK_ERROR:
            sums = self._astray.setdefault(bus, {})
            self._overview.add(key, over)
            name = self._curves[key].name
            sums[name] = sums.get(name, 0.0) + float(np.nansum(over[1]))
