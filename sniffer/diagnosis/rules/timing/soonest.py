"""Whether who answers soonest loses most: then the line was not free yet when the answer began.

A driver that is switched off too late swallows the beginning of whatever comes meanwhile. Who takes
longer than it holds the line loses nothing, wherever he hangs; a contact takes from the servos behind
it, however soon they answer, and the end of an answer as often as its beginning.
"""

from __future__ import annotations

import itertools
import math
from typing import TYPE_CHECKING, Final

import numpy as np

from sniffer.diagnosis.catalogue import FindingCode
from sniffer.diagnosis.evidence.chances import at_least, sureness
from sniffer.diagnosis.evidence.delays import delays
from sniffer.diagnosis.evidence.fronts import EITHER, PROMPT, torn_in_front
from sniffer.diagnosis.evidence.lost import LostAnswers
from sniffer.diagnosis.ledger.damage import IN_REPLY, IN_REQUEST
from sniffer.diagnosis.model import Finding, Place

if TYPE_CHECKING:
    from collections.abc import Iterator, Sequence

    from sniffer.diagnosis.case import Case
    from sniffer.diagnosis.rules import Rule
    from sniffer.ground.model import F64

FINDINGS: Final = (
    FindingCode(
        "soonest-lost",
        "The sooner a servo answers, the more of its answers are lost, and what is left of torn ones "
        "lacks the beginning.",
        "At least six lost answers of three servos or more that are timed. Their shares of lost answers are "
        "in the order of their times to answer, as one draw in six at most has them; two torn ones at "
        "least, three in four, and more than chance leaves so, lack their first byte or it is wrong; hardly any request "
        "is torn. Both at once are to be rarer than one in twenty by chance.",
        is_manner=True,
        settle="Raise the return delay of the servo that answers first: if its answers are whole then, the "
        "driver in front of it was on for too long.",
    ),
)

LEAST: Final = 6
"""Lost answers."""

SERVOS: Final = 3
"""Two are in order half of the time."""

ORDERED: Final = 1 / 6
"""How likely the order may be by chance alone: three servos have six orders."""

FRONT: Final = 0.75
"""Part of the torn answers that must be torn at their beginning."""

TORN: Final = 2
"""Answers that must be torn so: what takes many whole, and tears none, is open for longer than a turn."""

CHANCE: Final = 0.05

ENOUGH: Final = 1e-3
"""How likely both may be by chance where they count, and where they count in full."""

REQUESTS: Final = 0.2
"""Torn requests for each lost answer: what tears these as well looks at no answer's time."""

ABOUT: Final = 1.25
"""How many times the share of who answers sooner a servo may lose, and be in order."""

ALL_ORDERS: Final = 7
"""Servos up to which all their orders are tried: 5040; with more they are as good as normal."""

NOTHING: Final = 1e-12
"""Shares that differ by no more are equal, but for rounding."""


def soonest(case: Case) -> Iterator[Finding]:
    """Tell whether losses follow how soon servos answer."""
    timed = delays(case)
    lost = [one for s in timed if (one := LostAnswers(case, s)).ok + one.bad > LEAST]
    bad = sum(one.bad for one in lost)
    if len(lost) < SERVOS or bad < LEAST:
        return
    if sum(d.turn == IN_REQUEST for d in case.damages) > REQUESTS * bad:
        return
    torn = [m for m in case.misreads if m.damage.turn == IN_REPLY and m.servo_id in timed]
    front = [m for m in case.once(torn_in_front) if m.servo_id in timed]
    lost.sort(key=lambda one: timed[one.servo].mean_ns)
    bit_ns = PROMPT * case.ledger.byte_ns
    soon = [round(timed[one.servo].mean_ns / bit_ns) for one in lost]
    ordered = by_chance(soon, [one.share for one in lost])
    chance = ordered * at_least(len(front), len(torn), EITHER)
    if ordered > ORDERED or chance > CHANCE or len(front) < max(TORN, FRONT * len(torn)):
        return
    told = [
        f"{one.bad} of {one.bad + one.ok} of servo {one.servo} "
        f"({timed[one.servo].mean_ns / 1e3:.0f} us)"
        for one in (lost[0], lost[-1])
    ]
    times = np.concatenate([one.times for one in lost])
    places = [
        Place(at, 1, t, "a request without a sound answer")
        for at, t in zip(lost[0].at[:3].tolist(), lost[0].times[:3].tolist(), strict=True)
    ]
    hit = {m.servo_id for m in front}
    for servo in sorted(hit & in_order(lost)):
        yield Finding(
            "soonest-lost",
            servo,
            int(times.min()),
            int(times.max()),
            bad,
            f"the sooner a servo answers, the more of its answers are lost: {told[0]}, {told[1]}, and of "
            f"{len(torn)} torn ones {len(front)} lack their beginning",
            tuple(places),
            strength=sureness(chance, ENOUGH),
            brief="who answers soonest loses most",
        )


def in_order(lost: Sequence[LostAnswers]) -> set[int]:
    """Return the servos, in the order of their delays, that lose no more than who answers sooner.

    Who loses more than those has another reason.
    """
    out, least = set(), math.inf
    for one in lost:
        if one.share <= ABOUT * least:
            out.add(one.servo)
        least = min(least, one.share)
    return out


def by_chance(delay: Sequence[float], share: Sequence[float]) -> float:
    """Return how likely shares are so much in the order of delays, the greatest first, by chance.

    Delays that are alike have no order: a host that merges all bytes makes them all nothing.
    """
    _, row, count = np.unique(delay, return_inverse=True, return_counts=True)
    ranks: F64 = (np.cumsum(count) - (count - 1) / 2)[row]
    shares = np.asarray(share, np.float64)
    apart = shares - shares.mean()
    measured = float(ranks @ apart)
    if len(shares) <= ALL_ORDERS:
        orders: F64 = np.array(list(itertools.permutations(apart)))
        return float((orders @ ranks <= measured + NOTHING).mean())
    spread = math.sqrt(float(apart @ apart) * float(ranks.var()) * len(ranks) / (len(ranks) - 1))
    return 0.5 * math.erfc(-measured / spread / math.sqrt(2)) if spread > NOTHING else 1.0


RULES: Final[tuple[Rule, ...]] = (soonest,)
"""The rules of this area."""
