"""Outages that come where a joint stands in one part of its way: a cable that breaks as the arm bends."""

from __future__ import annotations

from typing import TYPE_CHECKING, Final

import numpy as np

from sniffer.diagnosis.catalogue import FindingCode
from sniffer.diagnosis.evidence.chances import at_least
from sniffer.diagnosis.evidence.placed import silent
from sniffer.ground.medians import quantile
from sniffer.ground.model import MS

if TYPE_CHECKING:
    from collections.abc import Iterator

    from sniffer.diagnosis.case import Case, Series
    from sniffer.diagnosis.model import Finding
    from sniffer.diagnosis.rules import Rule
    from sniffer.ground.model import F64, I64

FINDINGS: Final = (
    FindingCode(
        "outages-by-place",
        "A servo is away where a joint stands beyond some place, and hardly ever else.",
        "Eight outages and more, nine in ten of which begin while a joint, of whichever servo, is in the upper or "
        "the lower part of its way, in which it is for half of the time at most: one in a million by chance.",
        settle="Move that joint to and fro by hand while recording: faults that come at one place of its way are of the cable there.",
    ),
)

LEAST: Final = 8
NEARLY: Final = 0.9
"""Outages, and which part of them must be in that part of the way."""

PARTS: Final = (0.5, 0.6, 0.7, 0.8)
"""Parts of the time up to which it is on the other side."""

CHANCE: Final = 1e-6
"""How likely they are there by chance, of all joints and parts that are tried."""

EVERY_NS: Final = 50 * MS


def outages_by_place(case: Case) -> Iterator[Finding]:
    """Find servos that are away by where a joint stands."""
    tracks = {s: p for s in case.servos if (p := case.series(s, "position")) is not None}
    for servo in case.answering if case.has_clock else ():
        runs = case.ledger.silences.runs(servo)
        if len(runs) < LEAST:
            continue
        begun = np.array([run.first_ns for run in runs], np.int64)
        found = [
            (chance, who, p, side, place)
            for who, p in tracks.items()
            for chance, side, place in _beyond(case, p, begun)
        ]
        chance, who, p, side, place = min(
            found, key=lambda one: one[0], default=(1.0, 0, None, "", 0.0)
        )
        if p is None or chance * len(tracks) > CHANCE:
            continue
        whose = "it" if who == servo else f"servo {who}"
        yield silent(
            "outages-by-place",
            servo,
            runs,
            f"the {len(runs)} outages of servo {servo} come where {whose} stands {side} {p.told(place)}, "
            "and hardly ever else",
            1.0,
        )


def _beyond(case: Case, p: Series, begun: I64) -> Iterator[tuple[float, str, float]]:
    """Yield how likely it is by chance that so many outages are beyond places of a joint's way."""
    then = np.interp(begun, p.t, p.mean)
    usual = np.interp(np.arange(case.first_ns, case.last_ns, EVERY_NS), p.t, p.mean)
    for part in PARTS:
        for side, way in (("above", 1), ("below", -1)):
            yield _side(way * then, way * usual, part, side, way)


def _side(then: F64, usual: F64, part: float, side: str, way: int) -> tuple[float, str, float]:
    place = float(quantile(usual, part))
    there, share = int((then > place).sum()), float((usual > place).mean())
    chance = at_least(there, len(then), share) if there >= NEARLY * len(then) else 1.0
    return chance, side, way * place


RULES: Final[tuple[Rule, ...]] = (outages_by_place,)
"""The rules of this file."""
