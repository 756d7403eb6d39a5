"""Incidents as they come and go: what has opened, whose first cause is another one, what is over.

A diagnosis says each time anew what is wrong, from all that it knows. Here what it says now is held
against what it said before: an incident that shares findings with a known one is that one, and
keeps its number.
"""

from __future__ import annotations

import enum
from dataclasses import dataclass, field, replace
from typing import TYPE_CHECKING, Final

from sniffer.ground.model import NS
from sniffer.ground.wording import counted

if TYPE_CHECKING:
    from collections.abc import Sequence

    from sniffer.diagnosis.model import Incident

OVER_NS: Final = 10 * NS
"""An incident is over when it has not gone on for so long."""

SURE: Final = 2
"""So many times in a row another cause must be the first one, or an incident be missing, until it
is told: with little evidence the causes of one fault change places."""

KNOWN: Final = 256
"""Incidents of a bus that are remembered; of more the oldest that are over are forgotten."""


class Stage(enum.Enum):
    """What became of an incident."""

    OPENED = "opened"
    CHANGED = "changed"
    OVER = "over"
    WITHDRAWN = "withdrawn"
    ENDED = "ended"


@dataclass(frozen=True, slots=True)
class IncidentChange:
    """Something that became of an incident.

    ``t_ns`` is when it was found, on the clock of the bus; ``before`` the first cause that was told
    before it changed: the same one where it is of more servos since.
    """

    stage: Stage
    t_ns: int
    incident: Incident
    before: str = ""

    def __str__(self) -> str:
        i = self.incident
        who = f"incident {i.number} on {i.bus}"
        sure = f"{i.cause} ({i.causes[0].percent} %)"
        match self.stage:
            case Stage.OPENED:
                return f"{who}: {sure}: {i.story}"
            case Stage.CHANGED if self.before == i.cause:
                return f"{who} is of {counted(len(i.servo_ids), 'servo')} now: {sure}: {i.story}"
            case Stage.CHANGED:
                return f"{who} is {sure}, not {self.before}: {i.story}"
            case Stage.OVER:
                long_s = (i.last_ns - i.first_ns) / NS
                return f"{who} is over: {i.cause}, ×{i.count} in {long_s:.1f} s"
            case Stage.WITHDRAWN:
                return f"{who} is none by itself: {i.cause}; another one explains it"
            case Stage.ENDED:
                return f"{who} goes on at the end: {sure}, ×{i.count}"


@dataclass(slots=True)
class Tracked:
    """An incident that is known, as it is now; its number stays.

    ``told`` is the first cause that was told, ``is_over`` that it has not gone on for a while.
    ``servos`` are how many it was told of, ``wider`` how many times in a row it was of more.
    """

    incident: Incident
    told: str
    is_over: bool = False
    missing: int = 0
    doubts: int = 0
    servos: int = 0
    wider: int = 0


@dataclass(slots=True)
class Tracker:
    """Holds what a diagnosis says of each bus against what it said before."""

    _known: dict[str, list[Tracked]] = field(default_factory=dict)
    _number: int = 0

    def update(self, bus: str, found: Sequence[Incident], now_ns: int) -> list[IncidentChange]:
        """Take the incidents of a bus as of now; return what has become of them since."""
        known = self._known.setdefault(bus, [])
        changes: list[IncidentChange] = []
        pairs = _matched(known, found)
        there = {one.incident.number for one in pairs.values()}
        for one in [one for one in known if one.incident.number not in there]:
            one.missing += 1
            if one.missing != SURE or one.is_over:
                continue
            stage = Stage.OVER
            if any(_meet(one.incident, other) for other in found):
                stage = Stage.WITHDRAWN
                known.remove(one)
            one.is_over = True
            changes.append(IncidentChange(stage, now_ns, one.incident))
        for nth, incident in enumerate(found):
            if nth in pairs:
                changes += _go_on(pairs[nth], incident, now_ns)
                continue
            self._number += 1
            numbered = replace(incident, number=self._number)
            new = Tracked(numbered, incident.cause, servos=len(incident.servo_ids))
            known.append(new)
            changes.append(IncidentChange(Stage.OPENED, now_ns, new.incident))
        for one in known:
            if not one.is_over and now_ns - one.incident.last_ns > OVER_NS:
                one.is_over = True
                changes.append(IncidentChange(Stage.OVER, now_ns, one.incident))
        over = [one for one in known if one.is_over]
        for one in over[: max(0, len(known) - KNOWN)]:
            known.remove(one)
        return changes

    def end(self, now_ns: int) -> list[IncidentChange]:
        """Return what is open at the end of a recording."""
        return [
            IncidentChange(Stage.ENDED, now_ns, one.incident)
            for one in self.now()
            if not one.is_over
        ]

    def now(self) -> list[Tracked]:
        """Return all that are known, in the order in which they were found."""
        every = [one for known in self._known.values() for one in known]
        return sorted(every, key=lambda one: one.incident.number)


def _go_on(one: Tracked, incident: Incident, now_ns: int) -> list[IncidentChange]:
    """Take what is now said of a known incident."""
    went_on = incident.last_ns > one.incident.last_ns
    one.incident = replace(incident, number=one.incident.number)
    one.missing = 0
    changes: list[IncidentChange] = []
    if one.is_over and went_on and now_ns - incident.last_ns <= OVER_NS:
        one.is_over = False
        _tell(one)
        return [IncidentChange(Stage.OPENED, now_ns, one.incident)]
    one.doubts = one.doubts + 1 if incident.cause != one.told else 0
    if one.doubts >= SURE and not one.is_over:
        changes.append(IncidentChange(Stage.CHANGED, now_ns, one.incident, one.told))
        _tell(one)
    is_of_servos = incident.cause == one.told and one.servos
    one.wider = one.wider + 1 if is_of_servos and len(incident.servo_ids) > one.servos else 0
    if one.wider >= SURE and not one.is_over:  # what befell one servo befell others, too
        changes.append(IncidentChange(Stage.CHANGED, now_ns, one.incident, one.told))
        _tell(one)
    return changes


def _tell(one: Tracked) -> None:
    """Note that an incident was told as it is now."""
    one.told, one.doubts = one.incident.cause, 0
    one.servos, one.wider = len(one.incident.servo_ids), 0


def _matched(known: Sequence[Tracked], found: Sequence[Incident]) -> dict[int, Tracked]:
    """Return for incidents the known one that each of them is, the most alike first."""
    ranked = sorted(
        (
            (score, k, n)
            for k, one in enumerate(known)
            for n, incident in enumerate(found)
            if (score := _likeness(one.incident, incident)) > 0
        ),
        key=lambda each: (-each[0], each[1], each[2]),
    )
    pairs: dict[int, Tracked] = {}
    taken: set[int] = set()
    for _, k, n in ranked:
        if n not in pairs and k not in taken:
            pairs[n] = known[k]
            taken.add(k)
    return pairs


def _meet(one: Incident, other: Incident) -> bool:
    """Tell whether two are at one time about the same servos, or about all."""
    alike = not (one.servo_ids and other.servo_ids) or set(one.servo_ids) & set(other.servo_ids)
    return bool(alike) and one.first_ns <= other.last_ns and other.first_ns <= one.last_ns


def _likeness(one: Incident, other: Incident) -> float:
    """Return how much two have in common: 0 where they are about different things."""
    mine = {(f.code, f.servo_id) for f in one.findings}
    theirs = {(f.code, f.servo_id) for f in other.findings}
    shared = len(mine & theirs) / max(len(mine | theirs), 1)
    meets = one.first_ns <= other.last_ns and other.first_ns <= one.last_ns
    if not shared or not meets:
        return 0.0
    return shared + (one.cause == other.cause) + (one.servo_ids == other.servo_ids) / 2
