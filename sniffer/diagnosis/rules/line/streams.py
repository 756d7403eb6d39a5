"""Two controllers on one line, by their rhythms: streams of requests that know nothing of each other."""

from __future__ import annotations

from typing import TYPE_CHECKING, Final

import numpy as np

from sniffer.diagnosis.catalogue import FindingCode
from sniffer.diagnosis.model import Finding
from sniffer.diagnosis.physics.misread import BITS_FEW
from sniffer.diagnosis.rules.line.crossings import KINDS
from sniffer.ground.medians import median
from sniffer.ground.model import MS, NS

if TYPE_CHECKING:
    from collections.abc import Iterator

    from sniffer.diagnosis.case import Case
    from sniffer.diagnosis.rules import Rule
    from sniffer.ground.model import F64, I64

FINDINGS: Final = (
    FindingCode(
        "streams-apart",
        "Requests come in two rhythms that know nothing of each other.",
        "A kind of request that comes at regular times, and another one that stands at any place between them: by no multiple of the rhythm up to the sixth do they go together; stamps are late by three tenths of the rhythm at most. It counts little where less is torn than by two who do not listen.",
    ),
)

LEAST: Final = 24
"""Requests of a kind that show a rhythm."""

STEADY: Final = 0.15
REGULAR: Final = 0.5
"""A kind is regular if so many of its periods are that near to the middle one: some are torn."""

HARMONICS: Final = 6
"""A loop may ask something several times a cycle, at steady places of it."""

APART: Final = 0.36
"""What goes together less than that is apart: of 24 at any place the greatest of six is below."""

OFTENER: Final = 2.5
"""What comes so many times as often as the rhythm has wandered too far when that comes again."""

BLUR: Final = 0.3
"""Part of a period by which stamps may be late: of what comes twice in it they leave half together."""

PART: Final = 400
PARTS: Final = 4
"""Requests that are looked at together at least, and parts of a stretch: one may join later."""

MEET: Final = 0.1
"""Part of the meetings that chance would have of two who do not listen: fewer, and one of them does
or there is only one."""

MET: Final = 3
"""Torn places that are no accident."""

SINGLE: Final = 0.9
"""Part of the places torn by a weak signal or by noise in which it is one bit; the rest are theirs, too."""

TIMERS: Final = 0.3
"""How much two rhythms count that never meet: one program may have two timers, and does not run into
itself."""


def streams_apart(case: Case) -> Iterator[Finding]:
    """Find two kinds of requests whose rhythms do not go together."""
    best = case.once(least_together) if case.has_clock else None
    if best is None:
        return
    together, one, other, period, first, last = best
    times = int(case.ledger.exchanges.kinds.n[other])
    kinds, protocol = case.ledger.exchanges.kinds, case.protocol
    names = [f"{protocol.op_name(kinds.op[k])} of servo {kinds.servo_id[k]}" for k in (one, other)]
    yield Finding(
        "streams-apart",
        None,
        first,
        last,
        1,
        f"{names[0]} comes every {period / MS:.1f} ms, {names[1]} at any time between (they go "
        f"together by {together:.2f}, 1 is always, 0 never)",
        strength=(1.0 if together < APART / 2 else 0.8) if do_meet(case, times) else TIMERS,
        brief="requests come in two rhythms",
    )


def do_meet(case: Case, times: float, least: int = MET, torn: int | None = None) -> bool:
    """Tell whether so much is torn as two must tear who do not listen; ``times`` one of them speaks.

    ``torn`` counts the places that are torn while both speak, where that is known. Where one bit is
    misread nobody spoke: a request that is begun within another one alters many.
    """
    busy = case.ledger.bytes * case.ledger.byte_ns / max(case.seconds * NS, 1.0)
    torn = int(case.damage["n"].sum()) if torn is None else torn
    single = sum(m.shape == BITS_FEW and len(m.flips) == 1 for m in case.misreads)
    spoken = torn * (1 - single / (SINGLE * max(len(case.misreads), 1)))
    return spoken >= max(least, MEET * busy * times)


def least_together(case: Case) -> tuple[float, int, int, float, int, int] | None:
    """Return the two kinds of requests that go together least, with the rhythm of one; None: all do."""
    found = []
    for t, kind in case.ledger.exchanges.moments.stretches():
        parts = max(min(len(t) // PART, PARTS), 1)
        for part in range(parts):
            rows = slice(len(t) * part // parts, len(t) * (part + 1) // parts)
            found.append(_apart(t[rows], kind[rows], case.latency_ns))
    return min((one for one in found if one is not None), default=None)


def _apart(t: I64, kind: I64, latency_ns: int) -> tuple[float, int, int, float, int, int] | None:
    """Return the two kinds that go together least, if they do not, with the rhythm of one."""
    count = np.bincount(kind[kind >= 0])  # what came when there were too many kinds has none
    often = [k for k in np.argsort(-count, kind="stable")[:KINDS].tolist() if count[k] >= LEAST]
    times = {k: t[kind == k] for k in often}
    best: tuple[float, int, int, float, int, int] | None = None
    for one in often:
        between = np.diff(times[one])
        period = float(median(between))
        if latency_ns > BLUR * period or (np.abs(between / period - 1) < STEADY).mean() < REGULAR:
            continue
        for other in often:
            # of what comes oftener than the rhythm nobody knows how far it has wandered meanwhile
            if other == one or count[other] > OFTENER * count[one]:
                continue
            row = np.searchsorted(times[one], times[other], "right") - 1
            since = (times[other] - times[one][np.maximum(row, 0)])[row >= 0] / period
            since = since[since < 1 + STEADY]
            if len(since) < LEAST:
                continue
            together = _together(since)
            if together < APART and (best is None or together < best[0]):
                ends = int(times[other][0]), int(times[other][-1])
                best = together, one, other, period, *ends
    return best


def _together(since: F64) -> float:
    """Return how much places in a period are alike, or in a part of it: 1 all, 0 not at all.

    Of places that go together it is not looked how much the rest of the parts has of that.
    """
    turn = np.exp(2j * np.pi * since)
    power, most = turn, 0.0
    for _ in range(HARMONICS):  # a product takes a twentieth of what an exponential does
        most = max(most, float(abs(power.mean())))
        if most >= APART:
            break
        power = power * turn
    return most


RULES: Final[tuple[Rule, ...]] = (streams_apart,)
"""The rules of this area."""
