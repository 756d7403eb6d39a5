"""A loop that waits as long each time, now and then, before any of its requests."""

from __future__ import annotations

from typing import TYPE_CHECKING, Final

import numpy as np

from sniffer.diagnosis.catalogue import FindingCode
from sniffer.diagnosis.evidence.chances import at_least
from sniffer.diagnosis.evidence.cycles import ALIKE, LONGER, STALL_NS, is_by_hand
from sniffer.diagnosis.evidence.order import Order
from sniffer.diagnosis.evidence.paces import rests_of
from sniffer.diagnosis.model import Finding, Place
from sniffer.diagnosis.rules.timing.pace import damaged_at, is_explained
from sniffer.ground.medians import median
from sniffer.ground.model import MS

if TYPE_CHECKING:
    from collections.abc import Iterator, Sequence

    from sniffer.diagnosis.case import Case
    from sniffer.diagnosis.ledger.exchanges import Pause
    from sniffer.diagnosis.rules import Rule

WHAT_BLOCKS_IT: Final = (
    "Look for what blocks the loop for as long each time: a sleep, a lock, or a time-out for what gets lost "
    "before this wire (a radio link, a bridge)."
)

FINDINGS: Final = (
    FindingCode(
        "waits-alike",
        "The loop waits as long each time, now and then, before any of its requests: a time-out, or what blocks it.",
        "Sixteen pauses and more, behind one request in seven at most, nine in ten of which are of one length to a "
        "tenth, and no other one is so much longer than what four in five rests of the loop are at most; they stand behind and "
        "before each kind of request as often as that is said, and no answer is missing. How often they come does not matter; those that come evenly, at any number of bytes, are the program's steps.",
        remedy=WHAT_BLOCKS_IT,
        settle=WHAT_BLOCKS_IT,
    ),
)

LEAST: Final = 16
SELDOM: Final = 0.15
"""How many pauses, and behind which part of the requests at most: what stands behind more is the
program's own way."""

PACE: Final = 0.8
"""Part of the rests that tells what is usual."""

NEARLY: Final = 0.9
"""Part of the pauses that are alike."""

CHANCE: Final = 1e-3
"""How likely by chance pauses may stand at one kind of request so often: what a program does by plan it
does at one of them."""

EVEN: Final = 0.25
"""Part of their mean by which distances vary, in bytes, of what comes by plan; by chance it is one."""

IN_ORDER: Final = 0.8
"""Part of the requests behind which the one comes that mostly does, in a loop of one order."""

MOSTLY: Final = 0.5
"""Part of them at which a request of the loop is missing where they are time-outs."""


def waits_alike(case: Case) -> Iterator[Finding]:
    """Find pauses of one length, at any place of the loop."""
    exchanges = case.ledger.exchanges
    rest = exchanges.idle.at(0, PACE) if case.has_clock else None
    if rest is None or is_by_hand(case):
        return
    usual = rest.high
    least = LONGER * usual + STALL_NS + 2 * case.latency_ns
    damaged = damaged_at(case)
    longer = (p for p in rests_of(case) if p.sure_ns >= least)
    # who is not understood, or not heard, is waited for in vain
    long = [p for p in sorted(longer, key=lambda p: p.t_ns) if not is_explained(p, damaged, usual)]
    if not LEAST <= len(long) <= SELDOM * case.total("asked"):
        return
    middle = float(median([p.sure_ns for p in long]))
    alike = [p for p in long if abs(p.sure_ns - middle) <= ALIKE * middle + 2 * case.latency_ns]
    if len(alike) < NEARLY * len(long) or not _is_anywhere(case, alike):
        return
    left_out = _out_of_order(case, alike)
    why = (
        f"; at {left_out} of them the request is missing that is due: it is lost before this wire, and "
        "the controller waits for its answer"
        if left_out >= MOSTLY * len(alike)
        else ""
    )
    yield Finding(
        "waits-alike",
        None,
        alike[0].t_ns,
        alike[-1].t_ns + alike[-1].sure_ns,
        len(alike),
        f"{len(alike)} pauses of {middle / MS:.0f} ms (± {case.latency_ns / MS:g}), before any of the requests "
        f"of a loop that rests for {usual / MS:.0f} ms else{why}",
        tuple(
            Place(p.at, 1, p.t_ns, f"then {p.sure_ns / MS:.0f} ms of nothing") for p in alike[:3]
        ),
        brief=f"the loop waits for {middle / MS:.0f} ms, {len(alike)} times",
        episodes=tuple((p.t_ns, p.t_ns + p.sure_ns) for p in alike),
    )


def _out_of_order(case: Case, pauses: Sequence[Pause]) -> int:
    """Return at how many pauses another request follows than mostly does, in a loop of one order."""
    if case.once(Order).strictness < IN_ORDER:
        return 0
    f = case.ledger.exchanges.followers()
    most = np.lexsort(
        (f["n"], f["kind"])
    )  # of each kind the last one is what follows it most often
    follows = dict(zip(f["kind"][most].tolist(), f["next"][most].tolist(), strict=True))
    return sum(p.next_kind != follows.get(p.kind) for p in pauses)


def _is_anywhere(case: Case, pauses: Sequence[Pause]) -> bool:
    """Tell whether pauses stand at each kind of request as often as it is said."""
    n = case.ledger.exchanges.kinds.n
    sides = [p.kind for p in pauses], [p.next_kind for p in pauses]
    apart = np.diff([p.at for p in pauses])
    if len(n) < 2 or min(map(min, sides)) < 0 or apart.std() < EVEN * apart.mean():
        return False
    share = (n / n.sum()).tolist()
    return all(
        at_least(held, len(pauses), part) > CHANCE
        for side in sides
        for held, part in zip(np.bincount(side, minlength=len(n)).tolist(), share, strict=True)
    )


RULES: Final[tuple[Rule, ...]] = (waits_alike,)
"""The rules of this file."""
