"""Two servos of one id: their answers meet on the line, and no two collisions are alike."""

from __future__ import annotations

from collections import Counter
from typing import TYPE_CHECKING, Final

import numpy as np

from sniffer.diagnosis.catalogue import FindingCode
from sniffer.diagnosis.damage import AT_TURN, IN_REPLY
from sniffer.diagnosis.model import Finding, Place

if TYPE_CHECKING:
    from collections.abc import Iterator, Sequence

    from sniffer.diagnosis.case import Case
    from sniffer.diagnosis.damage import Damage
    from sniffer.diagnosis.rules import Rule
    from sniffer.ground.model import I64

FINDINGS: Final = (
    FindingCode(
        "answers-in-shreds",
        "line",
        "A servo's answers to one and the same request are torn each time in another way, as answers are that meet another one.",
        "A fifth of its answers or more are torn, and those to one request have four lengths or more where sound ones have one (in text: many different beginnings); other servos' answers are sound.",
    ),
    FindingCode(
        "answers-have-tails",
        "line",
        "Behind a servo's answers stand bytes of what may be a second one, behind no other servo's.",
        "Stray bytes at a tenth of its exchanges or more, and at ten times fewer of any other servo's.",
    ),
)

LEAST: Final = 8
"""Torn answers to one request that are compared."""

SHARE: Final = 0.2
"""Part of a servo's answers: what comes and goes in a cable tears fewer, two servos most of them."""

LENGTHS: Final = 4
"""Different lengths: a clock that is off, or a bit that falls, gives one or two."""

HEADS: Final = 0.1
"""Different beginnings among torn lines of text: such lines have lengths of their own."""

TAILS: Final = 0.1

ALONE: Final = 10.0
"""How many times its share another servo would have to be the only one."""


def shreds(case: Case) -> Iterator[Finding]:
    """Servos whose answers are torn each time in another way."""
    counts = case.damage
    torn = {s: _count(counts, s, IN_REPLY) for s in case.servos}
    share = {s: n / max(n + case.total("ok", s), 1) for s, n in torn.items()}
    for servo, n in torn.items():
        others = [part for s, part in share.items() if s != servo]
        if n < LEAST or share[servo] < SHARE or (others and min(others) > share[servo] / ALONE):
            continue
        groups: dict[bytes, list[Damage]] = {}
        for place in case.damages:
            if place.servo_id == servo and place.turn == IN_REPLY:
                groups.setdefault(place.asked, []).append(place)
        alike = max(groups.values(), key=len, default=[])
        if len(alike) < LEAST:
            continue
        lengths, heads = {d.length for d in alike}, {d.got[:3] for d in alike}
        is_text = alike[0].asked.endswith(b"\r")
        if len(heads) < HEADS * len(alike) if is_text else len(lengths) < LENGTHS:
            continue
        usual = Counter(d.length for d in alike).most_common(1)[0][0]
        yield Finding(
            "answers-in-shreds",
            servo,
            alike[0].t_ns,
            alike[-1].t_ns,
            n,
            f"{n} of {n + case.total('ok', servo)} answers of servo {servo} are torn; those to one "
            f"request are {min(lengths)} to {max(lengths)} bytes long, {usual} most often, and "
            f"begin in {len(heads)} ways",
            _places(alike),
            strength=min(0.6 + share[servo], 1.0),
            brief=f"answers of servo {servo} run into each other",
        )


def tails(case: Case) -> Iterator[Finding]:
    """Servos behind whose answers stray bytes stand, where behind others' there are none."""
    counts = case.damage
    rates = {s: _count(counts, s, AT_TURN) / max(case.total("ok", s), 1) for s in case.answering}
    if len(rates) < 2:
        return
    for servo, rate in rates.items():
        n = _count(counts, servo, AT_TURN)
        most = max(r for s, r in rates.items() if s != servo)
        if n < LEAST or rate < TAILS or most * ALONE > rate:
            continue
        stray = [d for d in case.damages if d.servo_id == servo and d.turn == AT_TURN]
        rows = np.flatnonzero((counts["servo_id"] == servo) & (counts["turn"] == AT_TURN))
        yield Finding(
            "answers-have-tails",
            servo,
            int(counts["t_first"][rows].min()),
            int(counts["t_last"][rows].max()),
            n,
            f"stray bytes stand at {n} of {case.total('ok', servo)} answers of servo {servo}, and "
            f"at {100 * most:.1f} % of any other servo's",
            _places(stray),
            strength=min(0.6 + rate, 1.0),
            brief=f"bytes of another answer behind those of servo {servo}",
        )


def _count(counts: dict[str, I64], servo: int, turn: int) -> int:
    return int(counts["n"][(counts["servo_id"] == servo) & (counts["turn"] == turn)].sum())


def _places(damages: Sequence[Damage]) -> tuple[Place, ...]:
    return tuple(
        Place(d.at, d.length, d.t_ns, f"torn: {d.got.hex(' ').upper()}") for d in damages[:3]
    )


RULES: Final[tuple[Rule, ...]] = (shreds, tails)
"""The rules of this file."""
