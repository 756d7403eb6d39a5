"""Incidents of several buses that are likely one fault: of what these buses share."""

from __future__ import annotations

from dataclasses import dataclass, replace
from types import MappingProxyType
from typing import TYPE_CHECKING, Final

from sniffer.ground.model import NS
from sniffer.ground.wording import and_

if TYPE_CHECKING:
    from collections.abc import Mapping, Sequence

    from sniffer.diagnosis.model import Incident

SUPPLY: Final = "their supply, its switch and fuse, cables in each other's port"
PROGRAM: Final = "the program that speaks on them, its host, the hub of their adapters"
GROUND: Final = "ground, and what starts beside them"

SHARES: Final[Mapping[str, str]] = MappingProxyType(
    dict.fromkeys(("brownout", "servo-reset-loop", "torque-off", "servo-dead"), SUPPLY)
    | dict.fromkeys(("controller-stall", "controller-jitter", "tap-loss"), PROGRAM)
    | dict.fromkeys(("bus-noise", "emi-load", "signal-integrity", "line-stuck"), GROUND)
)
"""What buses share that strikes them all at once, by cause; others are of one bus, whatever began
on another one then."""

NOBODY: Final = "nobody-answers"
"""The finding of a bus on which no servo answered, from its first request on."""

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


@dataclass(frozen=True, slots=True)
class Shared:
    """Incidents, by their numbers, that are likely one fault: of what buses share.

    ``apart_ns`` lie between the beginnings of the first and the last, None where each was there
    from the begin on; ``what`` is shared.
    """

    numbers: tuple[int, ...]
    buses: tuple[str, ...]
    apart_ns: int | None
    what: str

    @property
    def told(self) -> str:
        """It as a sentence, with what to look at first."""
        mine, on = numbered(self.numbers), and_([*self.buses])
        if self.apart_ns is None:
            what = f"Nobody answers on {on} from the first request on (incidents {mine})"
        else:
            tenths = max(-(-self.apart_ns * 10 // NS), 1)
            what = f"Incidents {mine} begin within {tenths / 10:g} s on {on}"
        return (
            f"{what}: one fault is likelier than {len(self.buses)}; look first at what these "
            f"buses share ({self.what})."
        )


def shared(incidents: Sequence[Incident], began: Mapping[str, int]) -> tuple[Shared, ...]:
    """Return which incidents begin together on several buses, and may be one fault.

    ``began`` is when what was heard of each bus that has a clock began.
    """
    silent = [i for i in incidents if any(f.code == NOBODY for f in i.findings)]
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
    told = [_told(group, SHARES[group[0].cause]) for group in groups if _are_several(group)]
    if _are_several(silent):
        told.append(replace(_told(silent, UNANSWERED), apart_ns=None))
    return tuple(told)


def _are_several(group: Sequence[Incident]) -> bool:
    return len({i.bus for i in group}) > 1


def _was_seen_to_begin(incident: Incident, began: Mapping[str, int]) -> bool:
    first = began.get(incident.bus)
    return first is not None and incident.first_ns - first > FROM_THE_BEGIN_NS


def _told(group: Sequence[Incident], what: str) -> Shared:
    return Shared(
        tuple(sorted(i.number for i in group)),
        tuple(dict.fromkeys(i.bus for i in sorted(group, key=lambda i: i.number))),
        max(i.first_ns for i in group) - min(i.first_ns for i in group),
        what,
    )


def numbered(numbers: Sequence[int]) -> str:
    """Return numbers of incidents as people write them: ``1 to 4``, or ``1, 3 and 4``."""
    is_row = len(numbers) > 2 and numbers[-1] - numbers[0] == len(numbers) - 1
    return f"{numbers[0]} to {numbers[-1]}" if is_row else and_([str(n) for n in numbers])
