"""Whether damage comes while motors work: the share of torn frames when joints move and when not."""

from __future__ import annotations

import math
from collections import Counter
from typing import TYPE_CHECKING, Final

import numpy as np

from sniffer.diagnosis.catalogue import FindingCode
from sniffer.diagnosis.evidence.chances import at_least, sureness
from sniffer.diagnosis.evidence.goal_steps import BEHIND_NS, goal_steps
from sniffer.diagnosis.evidence.twins import of_twins
from sniffer.diagnosis.ledger.buckets import FINE
from sniffer.diagnosis.ledger.damage import AT_TURN, HELD, IN_REPLY
from sniffer.diagnosis.model import Finding, Place
from sniffer.diagnosis.rules.line.damaged import singled_out
from sniffer.ground.distinct import within
from sniffer.ground.medians import median, quantile

if TYPE_CHECKING:
    from collections.abc import Iterator

    from sniffer.diagnosis.case import Case, Series
    from sniffer.diagnosis.rules import Rule
    from sniffer.ground.model import F64, Mask

FINDINGS: Final = (
    FindingCode(
        "damage-while-moving",
        "Damage comes while motors work, and less while they rest.",
        "In quarters of a second: how much is damaged, apart from the answers of a servo that alone is hit and from what second answers tear, goes with how hard the motors work (load or current, speed, way, jumps of goals), more than two standard deviations over chance in three ways: as a correlation, by the count, and against the same motion shifted in time.",
        is_manner=True,
    ),
    FindingCode(
        "damage-whatever-moves",
        "Damage comes as often while motors hardly work as while they work hard.",
        "As above, twenty places or more, and less than one standard deviation over chance, where the motors work now more and now less: how hard (by load or current, where they are told) varies by a seventh of the most at least.",
        is_manner=True,
    ),
    FindingCode(
        "damage-behind-steps",
        "Damage begins when goals jump: it stands behind the steps, and not before them.",
        "Steps of goals behind a rest of the others: in three quarters of a second behind them more is damaged than in as long before, oftener than chance has it by step, and three times as much in all.",
        is_manner=True,
    ),
)

LEAST: Final = 8
"""Damaged places that tell."""

BUCKETS: Final = 16
"""Quarters of a second that are enough to compare."""

LONGEST: Final = 2 * FINE
"""So many are compared at most, the last ones: those before are joined, and a clock that was not set
yet when it all began is years behind."""

CORRELATED: Final = 2.0
COUNTED: Final = 3.5
SHIFTED: Final = 1.2
"""How far beyond chance it must be, in standard deviations: as a correlation; by the count, as if
each place came by itself; against the same motion at other times, for both come in episodes."""

SURELY: Final = 1e-4
"""How likely chance is to bring so much where it counts in full: with a quantity or two to look at, and
dozens of captures with noise, two or three standard deviations are met now and then."""

UNMOVED: Final = 1.0
DOUBTFUL: Final = 1.5
"""Below the one, damage does not go with the motors; it counts in full at none at all, and would not
at all at the other. Of 90 captures with interference 6 are below one, nearly all of whose frames are torn,
and 11 below 1.5; of 191 with noise 157 are, and 175."""

VARIED: Final = 0.15
"""By how much of the most the work must vary to tell: what works evenly disturbs evenly."""

BY_MOTION: Final = 0.7
"""How much it counts where motion alone is told: what a motor takes to hold its place is not known."""

KNOWN: Final = 0.5
"""Part of the buckets in which a quantity must be stated to tell; that it goes with nothing counts in
full where each has it: what tears half of all frames hides how hard the motors work meanwhile."""

CLIPPED: Final = 0.95
"""Levels beyond this share of the buckets are taken for it: one spike is no motion."""

JUMPS: Final = 5
"""Steps of goals that tell."""

TIMES: Final = 3
PLENTY: Final = 20
CHANCE: Final = 0.01
"""How many times as much is damaged behind them as before, how much at the least, and how likely chance is to have it so by step."""

MOSTLY: Final = 0.9
"""Part of what is torn of a sender that second answers must have torn for all of it to be theirs."""

PULLS: Final = ("current", "load")
EFFORTS: Final = (*PULLS, "speed")
WAYS: Final = ("position", "goal_position")
"""What tells how hard motors work: by its amount, or by how far it goes."""


def damage_and_motors(case: Case) -> Iterator[Finding]:
    """Compare the damage while motors work with that while they rest."""
    d = case.damage
    mine = np.flatnonzero((d["turn"] != HELD) & (d["turn"] != AT_TURN) & ~_of_one_servo(case))
    if not case.has_clock or int(d["n"][mine].sum()) < LEAST:
        return
    bucket, n = d["bucket"][mine], d["n"][mine]
    first = max(int(bucket.min()), int(bucket.max()) - LONGEST + 1)
    count = int(bucket.max()) - first + 1
    if count < BUCKETS:
        return
    hits, said = np.zeros(count), np.zeros(count)
    np.add.at(hits, bucket[bucket >= first] - first, n[bucket >= first])
    line = case.line
    within = (line["bucket"] >= first) & (line["bucket"] < first + count)
    np.add.at(said, line["bucket"][within] - first, line["bytes"][within])
    told_of = {q: _level(case, q, first, count) for q in (*EFFORTS, *WAYS)}
    levels = {q: level if known >= KNOWN else None for q, (level, known) in told_of.items()}
    shares = {q: level for q, level in levels.items() if level is not None and level.std() > 0}
    if not shares:
        return
    known = {q: (level - level.mean()) / level.std() for q, level in shares.items()}
    ways = [(np.mean(list(known.values()), axis=0), "how hard the motors work")]
    if "goal_position" in known:
        ways.append((known["goal_position"], "how far goals jump"))
    told = [(beyond_chance(level, hits, said), level, what) for level, what in ways]
    (correlated, counted, shifted), level, what = max(told, key=lambda one: one[0])
    is_moved = correlated >= CORRELATED and counted >= COUNTED and shifted >= SHIFTED
    # a motor that holds works as well: where that is measured, motion alone does not tell
    pulls = [q for q in PULLS if levels[q] is not None]
    work = pulls or list(shares)
    varied = max((float(shares[q].std()) for q in work if q in shares), default=0.0)
    heard = max((known for q, (_, known) in told_of.items() if q in work), default=0.0)
    is_unmoved = correlated < UNMOVED and n.sum() >= PLENTY and varied >= VARIED
    if not is_moved and not is_unmoved:
        return
    hard = level > quantile(level, 0.75)
    rest = level < median(level)
    yield Finding(
        "damage-while-moving" if is_moved else "damage-whatever-moves",
        None,
        int(d["t_first"][mine].min()),
        int(d["t_last"][mine].max()),
        int(n.sum()),
        f"damage {'goes' if is_moved else 'does not go'} with {what} ({correlated:.1f} standard "
        f"deviations over chance): {_per_kb(hits[hard], said[hard]):.2f} places in 1000 bytes in the "
        f"hardest quarter of the time, {_per_kb(hits[rest], said[rest]):.2f} in the quieter half",
        tuple(
            Place(at, length, t, f"damaged {'while motors work' if is_moved else 'whatever moves'}")
            for at, length, t in zip(
                d["at"][mine[:3]].tolist(),
                d["length"][mine[:3]].tolist(),
                d["t_first"][mine[:3]].tolist(),
                strict=True,
            )
        ),
        strength=strength_of(correlated, len(ways))
        if is_moved
        else min((DOUBTFUL - correlated) / DOUBTFUL, 1.0)
        * (1.0 if pulls else BY_MOTION)
        * (heard - KNOWN)
        / (1 - KNOWN),
        brief="damage comes while motors work" if is_moved else "damage comes whatever moves",
    )


def _of_one_servo(case: Case) -> Mask:
    """Tell which damage is that of one servo's answers alone, or is done by second answers.

    That chooses its servo, and goes with how often it is asked.
    """
    d = case.damage
    out: Mask = (d["turn"] == IN_REPLY) & within(d["servo_id"], list(singled_out(case)))
    places = Counter((x.turn, x.servo_id) for x in case.damages)
    theirs = Counter((x.turn, x.servo_id) for x in case.damages if of_twins(case, x))
    for (turn, servo), n in theirs.items():
        if n >= MOSTLY * places[turn, servo]:
            out |= (d["turn"] == turn) & (d["servo_id"] == servo)
    return out


def damage_behind_steps(case: Case) -> Iterator[Finding]:
    """Compare the damage behind jumps of goals with that before them.

    What is not heard tells no goals: behind a line that was held goals seem to jump, and the damage
    stands before.
    """
    d = case.damage
    mine = np.flatnonzero(d["turn"] != HELD)
    jumps = goal_steps(case)
    if not case.has_clock or len(jumps) < JUMPS or int(d["n"][mine].sum()) < LEAST:
        return
    order = mine[np.argsort(d["t_first"][mine], kind="stable")]
    t, n = d["t_first"][order], np.concatenate([[0], np.cumsum(d["n"][order])])
    at, since, until = (np.searchsorted(t, jumps + k * BEHIND_NS) for k in (0, -1, 1))
    before, behind = n[at] - n[since], n[until] - n[at]
    more, less = int((behind > before).sum()), int((behind < before).sum())
    chance = at_least(more, more + less, 0.5)
    if chance > CHANCE or behind.sum() < max(TIMES * before.sum(), PLENTY):
        return
    yield Finding(
        "damage-behind-steps",
        None,
        int(t[0]),
        int(t[-1]),
        int(behind.sum()),
        f"{int(behind.sum())} torn places stand within {BEHIND_NS / 1e9:.2f} s behind {len(jumps)} steps "
        f"of goals, {int(before.sum())} as long before; more behind {more} steps, more before {less}",
        tuple(
            Place(
                int(d["at"][r]), int(d["length"][r]), int(d["t_first"][r]), "damaged behind a step"
            )
            for r in order[at[behind > before][:3]].tolist()
        ),
        strength=0.4 + 0.6 * sureness(chance, CHANCE**2),
        brief="damage begins when goals jump",
    )


def beyond_chance(level: F64, hits: F64, said: F64) -> tuple[float, float, float]:
    """Return how far damage goes with a level beyond chance, in standard deviations, three ways."""
    usual = hits.sum() * said / max(said.sum(), 1.0)
    more = hits - usual
    together = float((level * more).sum())
    clipped = np.minimum(more, quantile(more, CLIPPED + 0.02))
    if not clipped.std() or not level.std():
        return 0.0, 0.0, 0.0
    correlated = float(np.corrcoef(level, clipped)[0, 1]) * math.sqrt(_apart(level, clipped) - 1)
    counted = together / math.sqrt(max(float((usual * level**2).sum()), 1e-9))
    around = np.fft.irfft(np.fft.rfft(more) * np.fft.rfft(level).conj(), len(level))
    shifts = around[2:-1]  # at k, the level k buckets later; the next ones are no other time
    shifted = (together - float(shifts.mean())) / max(float(shifts.std()), 1e-9)
    return correlated, counted, shifted


def _apart(one: F64, other: F64) -> float:
    """Return how many buckets two rows are worth: what comes in episodes is as often alike by chance.

    Bartlett's formula for rows whose buckets are like the ones before.
    """
    lasts = max(_persistence(one) * _persistence(other), 0.0)
    return max(len(one) * (1 - lasts) / (1 + lasts), 1.0)


def _persistence(row: F64) -> float:
    """Return how much each of a row is like the one before, -1 to 1."""
    around = row - row.mean()
    return float((around[1:] * around[:-1]).sum() / (around**2).sum())


def strength_of(deviations: float, ways: int) -> float:
    """Return how much it counts to be so far beyond chance in one of some ways that were tried."""
    return sureness(ways * 0.5 * math.erfc(deviations / math.sqrt(2)), SURELY)


def _level(case: Case, quantity: str, first: int, count: int) -> tuple[F64 | None, float]:
    """Return how hard all motors work by a quantity, by bucket, 1 at most, or None if they never do.

    And the part of the buckets in which it is stated.
    """
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
    if not known.any():
        return None, 0.0
    level = total / np.maximum(stated, 1)
    level[~known] = median(level[known])
    if quantity == "goal_position":  # the motor works behind the step
        level = np.maximum(level, np.concatenate([[0.0], level[:-1]]))
    most = float(quantile(level, CLIPPED))
    return np.minimum(level, most) / most if most > 0 else None, float(known.mean())


def _way(series: Series) -> F64:
    """Return how far a value went since the bucket before; a spike between does not count."""
    before = np.concatenate([series.first[:1], series.last[:-1]])
    way: F64 = np.abs(series.last - before)
    return way


def _per_kb(hits: F64, said: F64) -> float:
    return 1000 * float(hits.sum()) / max(float(said.sum()), 1.0)


RULES: Final[tuple[Rule, ...]] = (damage_and_motors, damage_behind_steps)
"""The rules of this area."""
