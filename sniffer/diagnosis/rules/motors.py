"""Damage that comes with what motors do: more of it while they work."""

from __future__ import annotations

from typing import TYPE_CHECKING, Final

import numpy as np

from sniffer.diagnosis.catalogue import FindingCode
from sniffer.diagnosis.model import Finding, Place

if TYPE_CHECKING:
    from collections.abc import Iterator

    from sniffer.diagnosis.case import Case, Series
    from sniffer.diagnosis.rules import Rule
    from sniffer.ground.model import F64, I64

FINDINGS: Final = (
    FindingCode(
        "damage-with-motion",
        "line",
        "Bytes are damaged while motors work, and hardly ever while they rest.",
        "Damaged places a frame are three times as many in the busier half of the time, by load, current or speed, and that is no accident (four standard deviations).",
    ),
)

LEAST: Final = 12
"""Damaged places of which a share can be told."""

TIMES: Final = 3.0
SIGMAS: Final = 4.0

WORK: Final = ("load", "current", "speed", "goal_position", "position")
"""What tells how hard a motor works, what tells it best first; of positions their change."""


def with_motion(case: Case) -> Iterator[Finding]:
    """Hold the damage in each moment against how hard motors worked in it."""
    if not case.has_clock or int(case.damage["n"].sum()) < LEAST:
        return
    buckets, which = np.unique(case.traffic["bucket"], return_inverse=True)
    frames = np.zeros(len(buckets), np.int64)
    np.add.at(frames, which, case.traffic["frames"])
    work = _work(case, buckets)
    if work is None or len(buckets) < 8:
        return
    place = np.searchsorted(buckets, case.damage["bucket"])
    place = np.minimum(place, len(buckets) - 1)
    torn = np.zeros(len(buckets), np.int64)
    np.add.at(torn, place, case.damage["n"])
    # half of what was said, not half of the time: rests may be longer than moves
    order = np.argsort(work, kind="stable")
    half = np.searchsorted(np.cumsum(frames[order]), frames.sum() / 2)
    rest, busy = order[: half + 1], order[half + 1 :]
    if not len(busy) or work[busy].min() <= work[rest].max() * 1.05:
        return
    n_rest, n_busy = int(torn[rest].sum()), int(torn[busy].sum())
    f_rest, f_busy = int(frames[rest].sum()), int(frames[busy].sum())
    share = f_busy / max(f_rest + f_busy, 1)
    total = n_rest + n_busy
    expected, spread = total * share, (total * share * (1 - share)) ** 0.5
    ratio = (n_busy / max(f_busy, 1)) / ((n_rest + 0.5) / max(f_rest, 1))
    # damage comes in bursts: what tears three frames at once is one event, not three
    lumps = max(1.0, float(torn[torn > 0].mean()) ** 0.5) if (torn > 0).any() else 1.0
    sigmas = (n_busy - expected) / max(spread * lumps, 1e-9)
    if ratio < TIMES or sigmas < SIGMAS:
        return
    d = case.damage
    yield Finding(
        "damage-with-motion",
        None,
        int(d["t_first"].min()),
        int(d["t_last"].max()),
        n_busy,
        f"{n_busy} damaged places in {f_busy} frames while motors work hard, {n_rest} in {f_rest} "
        f"while they rest: {ratio:.1f} times as often",
        tuple(
            Place(int(d["at"][r]), int(d["length"][r]), int(d["t_first"][r]), "damaged")
            for r in range(min(3, len(d["at"])))
        ),
        strength=min(0.5 + sigmas / 16, 1.0),
        brief="damage while motors work",
    )


def _work(case: Case, buckets: I64) -> F64 | None:
    """Return how hard the motors work in each bucket, 0 to 1; None where nothing tells."""
    for quantity in WORK:
        told = [s for servo in case.servos if (s := case.series(servo, quantity)) and len(s) >= 8]
        if not told:
            continue
        total = np.zeros(len(buckets))
        for series in told:
            total += _of_one(series, buckets, is_place="position" in quantity)
        if total.max() > 0:
            share: F64 = total / total.max()
            return share
    return None


def _of_one(series: Series, buckets: I64, *, is_place: bool) -> F64:
    """Return how hard one motor works: its measure between its least and its greatest."""
    if is_place:
        own = np.maximum(series.high - series.low, np.abs(series.step))
    else:
        own = np.maximum(np.abs(series.high), np.abs(series.low))
    low, high = np.quantile(own, 0.05), np.quantile(own, 0.98)
    if high <= low:
        return np.zeros(len(buckets))
    part = np.clip((own - low) / (high - low), 0, 1)
    place = np.searchsorted(series.bucket, buckets, "right") - 1
    return np.where(place >= 0, part[np.maximum(place, 0)], 0.0)


RULES: Final[tuple[Rule, ...]] = (with_motion,)
"""The rules of this file."""
