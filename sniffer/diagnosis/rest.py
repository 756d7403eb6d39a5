"""What is left when causes have taken what they explain: it is said, not kept quiet."""

from __future__ import annotations

import shlex
from collections import defaultdict
from dataclasses import dataclass, replace
from typing import TYPE_CHECKING, Final

import numpy as np

from sniffer.anomalies.catalogue import CATALOGUE
from sniffer.diagnosis.ledger.silences import MISSING
from sniffer.diagnosis.rules.symptoms import SILENT
from sniffer.ground.model import Severity
from sniffer.ground.wording import counted

if TYPE_CHECKING:
    from collections.abc import Iterable, Sequence
    from pathlib import Path

    from sniffer.decoding.called import ServoNames
    from sniffer.diagnosis.case import Case
    from sniffer.diagnosis.model import Incident

SHOWN: Final = 6
"""Servos that are named of one code."""


START: Final = "capture-start"
"""What stands before the first frame."""

FEW: Final = 0.01
"""Part of its answers that a sound servo's line may lose without a cause that could be told."""


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
    parts: tuple[tuple[str, str], ...] = ()
    """What it is told of, each with its bus."""

    @property
    def next(self) -> str:
        """What to do next, and the command that draws where it is."""
        if not self.told:
            return ""
        where = shlex.quote(f"{self.source}@{self.place}")
        return f"{self.doing} `sniffer explain {where}` draws the first of them."

    def named(self, names: ServoNames) -> Rest:
        """Return the same with the names of servos."""
        told = ", ".join(names.sentence(bus, words) for bus, words in self.parts)
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
    """Return the warnings and errors of codes that no incident of their bus has.

    What to do next is what its entry says of the code that came most often, and where to look.
    A few lost answers among many have no cause that could be told: a capture with them is not one
    in which nothing is wrong.
    """
    explained = {(i.bus, f.code) for i in incidents for f in i.findings}
    told: list[tuple[int, str, str, Case]] = []
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
        for code, by_servo in counts.items():
            if by_servo and (case.bus, code) not in explained:
                n = int(np.sum(list(by_servo.values())))
                words = f"{n} x {code}{_whose(sorted(by_servo))}{of_bus}"
                told.append((n, code, words, case))
        told[begun:] = sorted(told[begun:], key=lambda t: -t[0])  # bus by bus
        if len(told) == begun and _is_unread(case, incidents):
            # what lies before a first frame that never comes is no beginning
            words = f"{counted(case.ledger.bytes, 'byte')}, none of them in a frame{of_bus}"
            told.append((1, START, words, case))
    if not told:
        return Rest()
    n, most, _, case = max(told, key=lambda t: t[0])
    place = str(int(case.alarms["at"][case.alarm_rows(most)].min()))
    is_one_bus = len(cases) == 1
    parts = tuple((each.bus, words) for _, _, words, each in told)
    words = ", ".join(words for _, words in parts)
    return Rest(
        words,
        _doing(case, n, most),
        place if is_one_bus else f"{case.bus}:{place}",
        most if is_one_bus else "",
        parts=parts,
    )


def _is_unread(case: Case, incidents: Iterable[Incident]) -> bool:
    """Tell whether bytes were heard on a bus and not one frame, and no incident says so."""
    heard = case.ledger.bytes and not case.ledger.frames and not case.ledger.is_shared
    return bool(heard) and all(i.bus != case.bus for i in incidents)


def _doing(case: Case, n: int, code: str) -> str:
    """Return what to do about the code that came most often, on the bus where it did."""
    if code == START:
        return "Look whether this protocol is spoken there, and by which baud rate it was heard."
    asked = sum(case.total("asked", servo) for servo in case.answering)
    if code != MISSING or n > FEW * asked:
        return CATALOGUE[code].remedy
    # who answers all the rest is there, at this rate, and is set to answer
    lost = f"{n} of {asked} answers {'is' if n == 1 else 'are'} lost"
    return (
        f"{lost}, too few to tell why: record for longer, and move the cables by hand meanwhile; "
        "losses that follow the hand are a contact's."
    )


def _whose(servos: Sequence[int]) -> str:
    known = [str(s) for s in servos if s >= 0]
    if not known:
        return ""
    more = f" and {len(known) - SHOWN} more" if len(known) > SHOWN else ""
    return f" (servo{'' if len(known) == 1 else 's'} {', '.join(known[:SHOWN])}{more})"
