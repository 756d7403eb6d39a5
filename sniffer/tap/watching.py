"""What somebody waits for on the buses: a code, a cause, a rule of their own, or any incident.

``--until`` ends a recording by it, ``--trigger`` has a flight recorder write a file, ``--on`` runs
a command. What repeats itself is one incident: it is new once, and again after a silence.
"""

from __future__ import annotations

import difflib
from dataclasses import dataclass
from typing import TYPE_CHECKING, Final

import numpy as np

from sniffer.anomalies.alarms import Alarm, alarm_in, is_alarm
from sniffer.anomalies.catalogue import CATALOGUE
from sniffer.anomalies.found import CODES, NUMBER, Anomalies
from sniffer.diagnosis.causes import CAUSES
from sniffer.diagnosis.tracking import Stage
from sniffer.ground.distinct import distinct
from sniffer.ground.model import NS, InputError, Severity

if TYPE_CHECKING:
    from collections.abc import Iterable, Sequence

    from sniffer.diagnosis import Incident
    from sniffer.diagnosis.tracking import IncidentChange
    from sniffer.ground.model import Batch, Chunk
    from sniffer.protocols.base import BusProtocol

ANY: Final = "any"
"""Stands for every incident that is worse than a note, and for every rule of the user's own."""

QUIET_NS: Final = 10 * NS
"""What comes again after so long without one more is another incident."""

RULE: Final = "alarm"
"""The code that a rule of the user's own is told by."""


@dataclass(frozen=True, slots=True)
class Awaited:
    """One thing that is waited for: a code, a cause, ``any``, or a rule as it is told."""

    name: str
    alarm: Alarm | None = None

    def __str__(self) -> str:
        return self.name


def awaited_in(text: str) -> Awaited:
    """Read what is waited for.

    Raises:
        InputError: it is nothing that can be; the message says what is near.
    """
    if text in CATALOGUE or text in CAUSES or text == ANY:
        return Awaited(text)
    if is_alarm(text):
        alarm = alarm_in(text)
        return Awaited(str(alarm), alarm)
    near = difflib.get_close_matches(text, [*CATALOGUE, *CAUSES, ANY], 1)
    pages = "docs/anomalies.md and docs/causes.md list them"
    advice = f"did you mean {near[0]}?" if near else pages
    raise InputError(f"no code or cause {text[:60]!r}: {advice}")


@dataclass(frozen=True, slots=True)
class Sighting:
    """Something that was waited for.

    ``name`` is the code or the cause; ``t_ns`` when it was, on the clock of the bus (an incident:
    when it began), ``last_ns`` when it was seen last so far. ``is_new``: it has not been going on
    already.
    """

    wanted: Awaited
    name: str
    bus: str
    t_ns: int
    servo_ids: tuple[int, ...]
    what: str
    last_ns: int
    is_new: bool


class Watch:
    """A sink that looks out for what is waited for; ``take`` tells what was seen since."""

    def __init__(self, wanted: Iterable[Awaited]) -> None:
        every = tuple(dict.fromkeys(wanted))
        self._any = next((w for w in every if w.name == ANY), None)
        self._by_cause = {w.name: w for w in every if w.name in CAUSES}
        self._by_code: dict[int, list[Awaited]] = {}
        self._rules = [w for w in every if w.alarm is not None]
        for one in every:
            if one.name in NUMBER:
                self._by_code.setdefault(NUMBER[one.name], []).append(one)
        self._looks_at = np.zeros(len(CODES), bool)
        self._looks_at[list(self._by_code)] = True
        if self._rules or self._any is not None:
            self._looks_at[NUMBER[RULE]] = True
        self._seen: list[Sighting] = []
        self._last: dict[tuple[Awaited, str, str, int], int] = {}

    def raw(self, bus: str, chunks: Sequence[Chunk]) -> None:
        """Take nothing."""

    def write(self, bus: str, protocol: BusProtocol, batch: Batch) -> None:
        """Look at what is wrong."""
        if not len(batch.anomalies):
            return
        found = Anomalies.of(batch.anomalies)
        rows = np.flatnonzero(self._looks_at[found.code])
        if not len(rows):
            return
        # a bad line has thousands of them: one of each kind and servo is looked at, but for rules,
        # which differ in what they say
        rule = found.code[rows] == NUMBER[RULE]
        key = found.code[rows] << 32 | found.servo_id[rows] + 1
        for one in distinct(key[~rule])[0].tolist():
            mine = rows[~rule][key[~rule] == one]
            self._see(bus, found, int(mine[0]), int(found.t_ns[mine[-1]]))
        for row in rows[rule].tolist():
            self._see(bus, found, row, int(found.t_ns[row]))

    def close(self) -> None:
        """Do nothing."""

    def take(self) -> list[Sighting]:
        """Return what was seen since the last call, in order."""
        seen, self._seen = self._seen, []
        return seen

    def incidents(self, changes: Iterable[IncidentChange]) -> None:
        """Look at what has become of incidents: what has opened, and what has another cause."""
        for change in changes:
            i = change.incident
            if change.stage not in (Stage.OPENED, Stage.CHANGED):
                continue
            if (one := self._by_cause.get(i.cause)) is not None:
                self._take(one, i)
            is_any = change.stage is Stage.OPENED and i.severity > Severity.NOTE
            if self._any is not None and is_any:
                self._take(self._any, i)

    def _take(self, one: Awaited, i: Incident) -> None:
        keys = [(one, i.bus, i.cause, servo) for servo in i.servo_ids or (-1,)]
        before = max((self._last.get(key, -QUIET_NS - 1) for key in keys), default=0)
        for key in keys:
            self._last[key] = i.last_ns
        is_new = i.last_ns - before > QUIET_NS
        seen = Sighting(one, i.cause, i.bus, i.first_ns, i.servo_ids, i.story, i.last_ns, is_new)
        self._seen.append(seen)

    def _see(self, bus: str, found: Anomalies, row: int, last_ns: int) -> None:
        """Take an anomaly; others like it go on until ``last_ns``."""
        code = CODES[int(found.code[row])]
        servo, t_ns = int(found.servo_id[row]), int(found.t_ns[row])
        wanted = list(self._by_code.get(NUMBER[code], ()))
        detail = found[row].detail
        if code == RULE:
            wanted += [w for w in self._rules if detail.startswith(f"{w.name}: ")]
            wanted += [self._any] if self._any is not None else []
        for one in wanted:
            name = one.name if one.alarm is not None else code
            before = self._last.get((one, bus, name, servo))
            is_new = before is None or t_ns - before > QUIET_NS
            self._last[one, bus, name, servo] = max(last_ns, before or last_ns)
            ids = () if servo < 0 else (servo,)
            self._seen.append(Sighting(one, code, bus, t_ns, ids, detail, last_ns, is_new))
