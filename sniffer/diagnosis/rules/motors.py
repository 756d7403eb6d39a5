"""Whether damage comes while motors work: the share of torn frames when joints move and when not."""

from __future__ import annotations

import math
from typing import TYPE_CHECKING, Final

import numpy as np

from sniffer.diagnosis.catalogue import FindingCode
from sniffer.diagnosis.damage import AT_TURN, HELD
from sniffer.diagnosis.model import Finding, Place

if TYPE_CHECKING:
    from collections.abc import Iterator

    from sniffer.diagnosis.case import Case, Series
    from sniffer.diagnosis.rules import Rule
    from sniffer.ground.model import F64

FINDINGS: Final = (
    FindingCode(
        "damage-while-moving",
        "line",
        "Damage comes while motors work, and less while they rest.",
        "In quarters of a second: how much is damaged goes with how hard the motors work (load or current, speed, way, jumps of goals), more than two standard deviations over chance in three ways: as a correlation, by the count, and against the same motion shifted in time.",
    ),
)

LEAST: Final = 8
"""Damaged places that tell."""

BUCKETS: Final = 16
"""Quarters of a second that are enough to compare."""

CORRELATED: Final = 2.0
COUNTED: Final = 3.5
SHIFTED: Final = 1.2
"""How far beyond chance it must be, in standard deviations: as a correlation; by the count, as if
each place came by itself; against the same motion at other times, for both come in episodes."""

KNOWN: Final = 0.5
"""Part of the buckets in which a quantity must be stated to tell."""

CLIPPED: Final = 0.95
"""Levels beyond this share of the buckets are taken for it: one spike is no motion."""

EFFORTS: Final = ("current", "load", "speed")
WAYS: Final = ("position", "goal_position")
"""What tells how hard motors work: by its amount, or by how far it goes."""


def damage_while_moving(case: Case) -> Iterator[Finding]:
    """Compare the damage while motors work with that while they rest."""
    d = case.damage
    mine = np.flatnonzero((d["turn"] != HELD) & (d["turn"] != AT_TURN))
    if not case.has_clock or int(d["n"][mine].sum()) < LEAST:
        return
    bucket, n = d["bucket"][mine], d["n"][mine]
    first, count = int(bucket.min()), int(bucket.max() - bucket.min()) + 1
    if count < BUCKETS:
        return
    hits, said = np.zeros(count), np.zeros(count)
    np.add.at(hits, bucket - first, n)
    line = case.line
    within = (line["bucket"] >= first) & (line["bucket"] < first + count)
    np.add.at(said, line["bucket"][within] - first, line["bytes"][within])
    levels = {q: _level(case, q, first, count) for q in (*EFFORTS, *WAYS)}
    known = {q: level for q, level in levels.items() if level is not None}
    if not known:
        return
    ways = [(np.mean(list(known.values()), axis=0), "how hard the motors work")]
    if "goal_position" in known:
        ways.append((known["goal_position"], "how far goals jump"))
    told = [(_beyond(level, hits, said), level, what) for level, what in ways]
    (correlated, counted, shifted), level, what = max(told, key=lambda one: one[0])
    if correlated < CORRELATED or counted < COUNTED or shifted < SHIFTED:
        return
    hard = level > np.quantile(level, 0.75)
    rest = level < np.median(level)
    yield Finding(
        "damage-while-moving",
        None,
        int(d["t_first"][mine].min()),
        int(d["t_last"][mine].max()),
        int(n.sum()),
        f"damage goes with {what} ({correlated:.1f} standard deviations over chance): "
        f"{_per_kb(hits[hard], said[hard]):.2f} places in 1000 bytes in the hardest quarter of the "
        f"time, {_per_kb(hits[rest], said[rest]):.2f} in the quieter half",
        tuple(
            Place(at, length, t, "damaged while motors work")
            for at, length, t in zip(
                d["at"][mine[:3]].tolist(),
                d["length"][mine[:3]].tolist(),
                d["t_first"][mine[:3]].tolist(),
                strict=True,
            )
        ),
        strength=min(0.4 + 0.15 * correlated, 1.0),
        brief="damage comes while motors work",
    )


def _beyond(level: F64, hits: F64, said: F64) -> tuple[float, float, float]:
    """Return how far damage goes with a level beyond chance, in standard deviations, three ways."""
    usual = hits.sum() * said / max(said.sum(), 1.0)
    more = hits - usual
    together = float((level * more).sum())
    clipped = np.minimum(more, np.quantile(more, CLIPPED + 0.02))
    if not clipped.std():
        return 0.0, 0.0, 0.0
    correlated = float(np.corrcoef(level, clipped)[0, 1]) * math.sqrt(len(level) - 1)
    counted = together / math.sqrt(max(float((usual * level**2).sum()), 1e-9))
    shifts = np.array([(np.roll(level, k) * more).sum() for k in range(2, len(level) - 1)])
    shifted = (together - float(shifts.mean())) / max(float(shifts.std()), 1e-9)
    return correlated, counted, shifted


def _level(case: Case, quantity: str, first: int, count: int) -> F64 | None:
    """Return how hard all motors work by a quantity, bucket by bucket; None where nothing tells."""
    total, stated = np.zeros(count), np.zeros(count)
    for servo in case.measured_by(quantity):
        series = case.series(servo, quantity)
        if series is None:
            continue
        own = _way(series) if quantity in WAYS else (abs(series.first) + abs(series.last)) / 2
        within = (series.bucket >= first) & (series.bucket < first + count)
        np.add.at(total, series.bucket[within] - first, own[within])
        np.add.at(stated, series.bucket[within] - first, 1)
    known = stated > 0
    if known.mean() < KNOWN:
        return None
    level = total / np.maximum(stated, 1)
    level[~known] = np.median(level[known])
    if quantity == "goal_position":  # the motor works behind the step
        level = np.maximum(level, np.concatenate([[0.0], level[:-1]]))
    level = np.minimum(level, np.quantile(level, CLIPPED))
    return (level - level.mean()) / level.std() if level.std() > 0 else None


def _way(series: Series) -> F64:
    """Return how far a value went since the bucket before; a spike between does not count."""
    before = np.concatenate([series.first[:1], series.last[:-1]])
    way: F64 = np.abs(series.last - before)
    return way


def _per_kb(hits: F64, said: F64) -> float:
    return 1000 * float(hits.sum()) / max(float(said.sum()), 1.0)


RULES: Final[tuple[Rule, ...]] = (damage_while_moving,)
"""The rules of this area."""
