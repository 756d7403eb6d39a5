"""Incidents of several buses that are likely one fault: of what these buses share.

Or the buses are none, but the two wires of one line: each was tapped, and called a bus.
"""

from __future__ import annotations

import shlex
from types import MappingProxyType
from typing import TYPE_CHECKING, Final, NamedTuple

from sniffer.ground.model import NS
from sniffer.ground.wording import and_, in_file_name

if TYPE_CHECKING:
    from collections.abc import Iterator, Mapping, Sequence

    from sniffer.diagnosis.case import Case
    from sniffer.diagnosis.model import Incident

SUPPLY: Final = "their supply, its switch and fuse, cables in each other's port"
PROGRAM: Final = "the program that speaks on them, its host, the hub of their adapters"
GROUND: Final = "ground, and what starts beside them"

SHARES: Final[Mapping[str, str]] = MappingProxyType(
    dict.fromkeys(
        ("brownout", "servo-reset-loop", "torque-off", "servo-dead", "servo-outage"), SUPPLY
    )
    | dict.fromkeys(
        ("controller-stall", "controller-jitter", "controller-slows", "tap-loss"), PROGRAM
    )
    | dict.fromkeys(("bus-noise", "emi-load", "signal-integrity", "line-stuck"), GROUND)
)
"""What buses share that strikes them all at once, by cause; others are of one bus, whatever began
on another one then."""

NOBODY: Final = "nobody-answers"
"""The finding of a bus on which no servo answered, from its first request on."""

NO_REQUESTS: Final = "nobody-asks"
"""The finding of a bus on which servos answer, and nobody ever asked."""

UNANSWERED: Final = (
    "cables in each other's port, their supply, the rate their program sets, "
    "taps that hear one wire of two"
)
"""What several buses share on which nobody ever answered, whatever cause each of them is told."""

NEAR_NS: Final = NS
"""So far apart at most its first signs are seen: a servo that is asked once a second shows them
when it is asked."""

FROM_THE_BEGIN_NS: Final = 2 * NS
"""What is there so soon may have been there before: its beginning was not seen."""


_LOOK: Final = (
    "one fault is likelier than {several}; look first at what these buses share ({what})."
)
_BEGUN: Final = f"Incidents {{mine}} begin within {{apart_s:g}} s on {{on}}: {_LOOK}"
_SILENT: Final = f"Nobody answers on {{on}} from the first request on (incidents {{mine}}): {_LOOK}"
_WIRES: Final = (
    "What is asked on {asked} is answered on {answering}, by the same servos at one time "
    "(incidents {mine}): they are likely the two wires of one line; "
    "`sniffer cut FILE --split bus -o wire.mcap` and "
    "`sniffer merge wire-{first}.mcap wire-{second}.mcap --pair -o bus.mcap` "
    "make them one bus, `sniffer record --pair` does while it records."
)

_FILES: Final = (
    "What is asked in {asked} is answered in {answering}, by the same servos at one time: they are "
    "likely the two wires of one line; `sniffer merge {first} {second} --pair -o bus.mcap` makes "
    "them one bus."
)


class OneWay(NamedTuple):
    """What is heard of a bus on which servos are asked or answer, and not both: its ``incident``.

    ``is_asked``: these are the requests.
    """

    incident: Incident
    is_asked: bool
    servos: frozenset[int]
    first_ns: int
    last_ns: int
    has_clock: bool

    def may_answer(self, controller: OneWay) -> bool:
        """Tell whether it may be what answers a controller."""
        is_meanwhile = self.first_ns <= controller.last_ns and controller.first_ns <= self.last_ns
        is_answer = controller.is_asked and not self.is_asked
        return is_answer and is_meanwhile and bool(self.servos & controller.servos)


class Shared(NamedTuple):
    """Incidents, by their numbers, that are likely one fault of their buses.

    ``told`` is how that shows, and what to do first.
    """

    numbers: tuple[int, ...]
    buses: tuple[str, ...]
    told: str


def shared(incidents: Sequence[Incident], cases: Sequence[Case]) -> tuple[Shared, ...]:
    """Return which incidents are likely one fault: of what several buses share, or of the taps.

    ``cases`` are what was heard of each bus.
    """
    out = list(_wires(incidents, cases))
    paired = {number for one in out for number in one.numbers}
    began = {case.bus: case.first_ns for case in cases if case.has_clock}
    groups: list[list[Incident]] = []
    for what in (SUPPLY, PROGRAM, GROUND):
        mine = [
            i for i in incidents if SHARES.get(i.cause) == what and _was_seen_to_begin(i, began)
        ]
        last = None
        for i in sorted(mine, key=lambda i: i.first_ns):
            if last is None or i.first_ns - last > NEAR_NS:
                groups.append([])
                last = i.first_ns
            groups[-1].append(i)
    for group in filter(_are_several, groups):
        apart_ns = max(i.first_ns for i in group) - min(i.first_ns for i in group)
        tenths = max(-(-apart_ns * 10 // NS), 1)
        what = SHARES[group[0].cause]
        out.append(_shared(group, _BEGUN, what=what, apart_s=tenths / 10))
    silent = [i for i in _with(incidents, NOBODY) if i.number not in paired]
    if _are_several(silent):
        out.append(_shared(silent, _SILENT, what=UNANSWERED))
    return tuple(out)


def one_way(incidents: Sequence[Incident], cases: Sequence[Case]) -> tuple[OneWay, ...]:
    """Return the buses of which one direction is heard."""
    by_bus = {case.bus: case for case in cases}
    return tuple(
        OneWay(i, asked, frozenset(case.servos), case.first_ns, case.last_ns, case.has_clock)
        for code, asked in ((NOBODY, True), (NO_REQUESTS, False))
        for i in _with(incidents, code)
        for case in (by_bus[i.bus],)
    )


def wires_of(files: Mapping[str, OneWay]) -> Iterator[str]:
    """Yield which captures of one bus each are likely the two wires of one line, and what to do."""
    clocked = {name: heard for name, heard in files.items() if heard.has_clock}
    for name, asked in clocked.items():
        may = [other for other, heard in clocked.items() if heard.may_answer(asked)]
        if len(may) == 1:
            first, second = shlex.quote(name), shlex.quote(may[0])
            yield _FILES.format(asked=name, answering=may[0], first=first, second=second)


def _wires(incidents: Sequence[Incident], cases: Sequence[Case]) -> Iterator[Shared]:
    """Yield pairs of buses on one of which servos are asked that answer on the other alone."""
    heard = one_way(incidents, cases)
    for asked in heard:
        may = [other for other in heard if other.may_answer(asked)]
        # of the arms of a robot, each with servos 1 to 6, nobody knows whose it is
        if len(may) == 1:
            first, second = asked.incident.bus, may[0].incident.bus
            yield _shared(
                (asked.incident, may[0].incident),
                _WIRES,
                asked=first,
                answering=second,
                first=in_file_name(first),
                second=in_file_name(second),
            )


def _with(incidents: Sequence[Incident], code: str) -> list[Incident]:
    """Return the incidents that have a finding of a code."""
    return [i for i in incidents if any(f.code == code for f in i.findings)]


def _are_several(group: Sequence[Incident]) -> bool:
    return len({i.bus for i in group}) > 1


def _was_seen_to_begin(incident: Incident, began: Mapping[str, int]) -> bool:
    first = began.get(incident.bus)
    return first is not None and incident.first_ns - first > FROM_THE_BEGIN_NS


def _shared(group: Sequence[Incident], sentence: str, **words: str | float) -> Shared:
    ordered = sorted(group, key=lambda i: i.number)
    numbers, buses = [i.number for i in ordered], [*dict.fromkeys(i.bus for i in ordered)]
    told = sentence.format(mine=numbered(numbers), on=and_(buses), several=len(buses), **words)
    return Shared(tuple(numbers), tuple(buses), told)


def numbered(numbers: Sequence[int]) -> str:
    """Return numbers of incidents as people write them: ``1 to 4``, or ``1, 3 and 4``."""
    is_row = len(numbers) > 2 and numbers[-1] - numbers[0] == len(numbers) - 1
    return f"{numbers[0]} to {numbers[-1]}" if is_row else and_([str(n) for n in numbers])
