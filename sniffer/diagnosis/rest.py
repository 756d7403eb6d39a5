"""What is left when causes have taken what they explain: it is said, not kept quiet."""

from __future__ import annotations

import shlex
from collections import defaultdict
from dataclasses import dataclass, replace
from typing import TYPE_CHECKING, Any, Final

import numpy as np

from sniffer.anomalies.catalogue import CATALOGUE
from sniffer.diagnosis.ledger.silences import MISSING
from sniffer.diagnosis.rules.symptoms import SILENT
from sniffer.ground.distinct import within
from sniffer.ground.model import Severity
from sniffer.ground.wording import counted

if TYPE_CHECKING:
    from collections.abc import Iterable, Sequence, Set
    from pathlib import Path

    from sniffer.decoding.called import ServoNames
    from sniffer.diagnosis.case import Case
    from sniffer.diagnosis.model import Incident

SHOWN: Final = 6
"""Servos that are named of one code."""


EVERYBODY: Final = None
"""Whose it is that is nobody's in particular, as findings have it."""

START: Final = "capture-start"
"""What stands before the first frame."""

RARE: Final = 0.2
"""Part of its answers beyond which a servo that answers the rest is looked at by itself."""

FEW: Final = 0.01
"""Part of its answers that a sound servo's line may lose without a cause that could be told."""


@dataclass(frozen=True, slots=True)
class Unexplained:
    """Anomalies of one code and one bus, in numbers and in words; -1 is nobody in particular."""

    bus: str
    code: str
    count: int
    servo_ids: tuple[int, ...]
    words: str

    def as_dict(self) -> dict[str, Any]:
        """Return it as a document has it."""
        servo_ids = [servo for servo in self.servo_ids if servo >= 0]
        return {"bus": self.bus, "code": self.code, "count": self.count, "servo_ids": servo_ids}


@dataclass(frozen=True, slots=True)
class Rest:
    """Anomalies of which no cause can be told, in words, and what to do about them.

    All are empty where there are none. ``place`` is the first of what came most often, behind the
    ``@`` of a command line; ``source`` is the capture as the command line names it.
    """

    told: str = ""
    doing: str = ""
    place: str = ""
    code: str = ""
    """Its code, where it is the only bus's."""
    source: str = "FILE"
    parts: tuple[Unexplained, ...] = ()
    """What it is told of."""

    @property
    def next(self) -> str:
        """What to do next, and the command that draws where it is."""
        if not self.told:
            return ""
        where = shlex.quote(f"{self.source}@{self.place}")
        return f"{self.doing} `sniffer explain {where}` draws the first of them."

    def named(self, names: ServoNames) -> Rest:
        """Return the same with the names of servos."""
        told = ", ".join(names.sentence(part.bus, part.words) for part in self.parts)
        return replace(self, told=told) if names else self

    def of(self, inputs: Sequence[str | Path], *, is_part: bool) -> Rest:
        """Return the same of a capture; several files, or standard input, cannot be named.

        Of a whole capture of one bus the first is named by its code: in front of a part, and on
        another bus, there may be one, too.
        """
        names = [*map(str, inputs)]
        told = self if is_part or not self.code else replace(self, place=self.code)
        return told if names == ["-"] or len(names) > 1 else replace(told, source=names[0])


def rest_of(cases: Sequence[Case], incidents: Sequence[Incident]) -> Rest:
    """Return the warnings and errors that no incident of their bus has.

    What a servo's incident explains of it, it does not explain of another.

    What to do next is what its entry says of the code that came most often, and where to look.
    A few lost answers among many have no cause that could be told: a capture with them is not one
    in which nothing is wrong.
    """
    told: list[Unexplained] = []
    for case in cases:
        begun = len(told)
        counts: dict[str, dict[int, int]] = defaultdict(lambda: defaultdict(int))
        alarms = case.alarms
        for row in range(len(alarms["n"])):
            code, servo = case.code(int(alarms["code"][row])), int(alarms["servo_id"][row])
            if code == MISSING and servo not in case.answering:
                continue  # who looks for servos asks ids that there are not
            if CATALOGUE[code].severity >= Severity.WARN and code not in SILENT:
                counts[code][servo] += int(alarms["n"][row])
        for servo in case.answering:  # who was not there yet did not lose an answer
            late = case.ledger.silences.late(servo)
            if late is not None and servo in counts[MISSING]:
                counts[MISSING][servo] -= late.missed
                if counts[MISSING][servo] <= 0:
                    del counts[MISSING][servo]
        of_bus = f" on {case.bus}" if len(cases) > 1 else ""
        theirs = [i for i in incidents if i.bus == case.bus]
        for code, by_servo in counts.items():
            explained = _explained(code, theirs)
            left = {s: n for s, n in by_servo.items() if not explained & {s, EVERYBODY}}
            if left:
                n, servos = int(np.sum(list(left.values()))), tuple(sorted(left))
                words = f"{n} x {code}{_whose(servos)}{of_bus}"
                told.append(Unexplained(case.bus, code, n, servos, words))
        told[begun:] = sorted(told[begun:], key=lambda part: -part.count)  # bus by bus
        if len(told) == begun and _is_unread(case, incidents):
            # what lies before a first frame that never comes is no beginning
            words = f"{counted(case.ledger.bytes, 'byte')}, none of them in a frame{of_bus}"
            told.append(Unexplained(case.bus, START, 1, (), words))
    if not told:
        return Rest()
    most = max(told, key=lambda part: part.count)
    case = next(case for case in cases if case.bus == most.bus)
    place = str(_first_of(case, most))
    is_one_bus = len(cases) == 1
    return Rest(
        ", ".join(part.words for part in told),
        _doing(case, most),
        place if is_one_bus else f"{case.bus}:{place}",
        most.code if is_one_bus and not _explained(most.code, incidents) else "",
        parts=tuple(told),
    )


def _explained(code: str, incidents: Iterable[Incident]) -> Set[int | None]:
    """Return whose anomalies of a code incidents explain: `EVERYBODY` of what is the line's."""
    return {
        f.servo_id if i.servo_ids else EVERYBODY
        for i in incidents
        for f in i.findings
        if f.code == code
    }


def _first_of(case: Case, part: Unexplained) -> int:
    """Return the place of the first of them."""
    rows = case.alarm_rows(part.code)
    theirs = within(case.alarms["servo_id"][rows], part.servo_ids) | (not part.servo_ids)
    return int(case.alarms["at"][rows[theirs]].min())


def _is_unread(case: Case, incidents: Iterable[Incident]) -> bool:
    """Tell whether bytes were heard on a bus and not one frame, and no incident says so."""
    heard = case.ledger.bytes and not case.ledger.frames and not case.ledger.is_shared
    return bool(heard) and all(i.bus != case.bus for i in incidents)


def _doing(case: Case, part: Unexplained) -> str:
    """Return what to do about the code that came most often, on the bus where it did."""
    if part.code == START:
        return "Look whether this protocol is spoken there, and by which baud rate it was heard."
    theirs = sum(case.total("asked", servo) for servo in set(case.answering) & {*part.servo_ids})
    if part.code != MISSING or part.count > RARE * theirs:
        return CATALOGUE[part.code].remedy
    # who answers all the rest is there, at this rate, and is set to answer
    asked = sum(case.total("asked", servo) for servo in case.answering)
    lost = f"{part.count} of {asked} answers {'is' if part.count == 1 else 'are'} lost"
    why = "too few to tell why" if part.count <= FEW * asked else "and nothing tells why"
    return (
        f"{lost}, {why}: record for longer, and move the cables by hand meanwhile; "
        "losses that follow the hand are a contact's."
    )


def _whose(servos: Sequence[int]) -> str:
    known = [str(s) for s in servos if s >= 0]
    if not known:
        return ""
    more = f" and {len(known) - SHOWN} more" if len(known) > SHOWN else ""
    return f" (servo{'' if len(known) == 1 else 's'} {', '.join(known[:SHOWN])}{more})"
