"""What a report tells, whatever it is written as."""

from __future__ import annotations

from collections import Counter
from dataclasses import dataclass, replace
from typing import TYPE_CHECKING, Final

from sniffer.diagnosis.causes import CAUSES
from sniffer.diagnosis.gathering import gathered, likewise
from sniffer.ground.heard import span_of
from sniffer.ground.model import Clock
from sniffer.ground.wording import servos

if TYPE_CHECKING:
    from collections.abc import Mapping, Sequence

    from sniffer.decoding.called import ServoNames
    from sniffer.decoding.summary import BusTotals, Summary
    from sniffer.diagnosis.model import Finding, Incident
    from sniffer.diagnosis.rest import Rest
    from sniffer.diagnosis.shared import Shared
    from sniffer.reports.evidence import Exhibit
    from sniffer.statistics.collector import Collector

FINDINGS: Final = 40
"""Findings of an incident that are told."""

ALIKE: Final = 6
"""Findings of one kind that are told: of a hundred servos each may have one."""

SOUND: Final = "Nothing was found that needs a cause."
"""The verdict where nothing is wrong."""


@dataclass(frozen=True, slots=True)
class Content:
    """A capture after it was heard to its end.

    ``described`` is what kind of input it is, ``facts`` what a recording knows of itself, ``notes``
    what a person should know of it, ``damage`` what broke it off (empty: nothing did). ``judged``
    is the sentence on what it was judged, ``rest`` what no cause could be told of, ``shared`` which
    incidents of several buses are likely one fault.
    ``tool`` and ``made`` say by what and when it was told.
    """

    name: str
    described: str
    size: int | None
    facts: Mapping[str, str]
    notes: Sequence[str]
    damage: str
    summary: Summary
    collector: Collector
    incidents: Sequence[Incident]
    exhibits: Mapping[int, Sequence[Exhibit]]
    judged: str
    rest: Rest
    shared: Sequence[Shared]
    tool: str
    made: str

    @property
    def names(self) -> ServoNames:
        """What servos are called."""
        return self.summary.names

    @property
    def worst(self) -> Incident | None:
        """The incident that is told first; None: there is none."""
        return self.incidents[0] if self.incidents else None

    @property
    def clock(self) -> Clock:
        """The best clock that a bus has."""
        return max((w.clock for w in self.collector.wires.values()), default=Clock.NONE)

    def clock_of(self, bus: str) -> Clock:
        """Return the clock of a bus or a lane."""
        lane = self.collector.lanes.get(bus)
        wire = self.collector.wires.get(lane.bus if lane is not None else bus)
        return self.clock if wire is None else wire.clock

    @property
    def span_ns(self) -> tuple[int, int] | None:
        """When the first byte began and the last one ended; None: there was no frame."""
        firsts = [
            b.heard.first_ns for b in self.summary.buses.values() if b.heard.first_ns is not None
        ]
        lasts = [
            b.heard.last_ns for b in self.summary.buses.values() if b.heard.last_ns is not None
        ]
        return (min(firsts), max(lasts)) if firsts else None

    @property
    def lasted_ns(self) -> int:
        """How long it was listened to."""
        return span_of(b.heard for b in self.summary.buses.values())

    def totals_of(self, lane: str) -> BusTotals:
        """Return the totals of what one protocol says on a bus."""
        known = self.collector.lanes[lane]
        totals = self.summary.buses[known.bus]
        return totals.parts.get(known.protocol.name, totals)

    def incidents_of(self, lane: str, servo: int) -> list[Incident]:
        """Return the incidents that concern a servo: its own, and those of its whole bus."""
        bus = self.collector.lanes[lane].bus
        return [
            i
            for i in self.incidents
            if i.bus in (lane, bus) and (servo in i.servo_ids or not i.servo_ids)
        ]

    def titled(self, incident: Incident) -> str:
        """Return what an incident is, in words: its likeliest cause, where and whom."""
        title = CAUSES[incident.cause].title
        title = title[:1].upper() + title[1:]
        who = self.names.sentence(incident.bus, servos(incident.servo_ids))
        on = f" on {incident.bus}" if len(self.summary.buses) > 1 else ""
        return f"{title}{on} ({who})" if who else f"{title}{on}"


def happened(incident: Incident) -> str:
    """Return what happened, without the cause before it: who tells it has said that already."""
    _, colon, rest = incident.story.partition(": ")
    is_title = colon and incident.story.startswith(CAUSES[incident.cause].title)
    return rest if is_title else incident.story


def tale(incident: Incident) -> str:
    """Return what happened as a sentence."""
    story = happened(incident)
    return story[:1].upper() + story[1:]


def found_of(incident: Incident, names: ServoNames) -> tuple[list[Finding], int]:
    """Return the findings of an incident that are told, and how many more there are.

    Of each kind the first ones; what several servos have alike is told once.
    """
    met: Counter[str] = Counter()
    each = gathered(incident.findings)
    out = []
    for f, others in each:
        met[f.code] += 1
        if met[f.code] <= ALIKE:
            out.append(replace(f, what=likewise(f.what, others, names, incident.bus)))
    return out[:FINDINGS], len(each) - len(out[:FINDINGS])
