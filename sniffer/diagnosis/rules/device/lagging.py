"""Joints that lag behind their goals more and more, while the goals go on as they did."""

from __future__ import annotations

from typing import TYPE_CHECKING, Final, NamedTuple

import numpy as np

from sniffer.diagnosis.catalogue import FindingCode
from sniffer.diagnosis.evidence.parts import grows, part_of
from sniffer.diagnosis.evidence.tracks import in_force, track
from sniffer.diagnosis.model import Finding, Place
from sniffer.ground.medians import quantile

if TYPE_CHECKING:
    from collections.abc import Iterator

    from sniffer.diagnosis.case import Case
    from sniffer.diagnosis.evidence.tracks import JointTrack
    from sniffer.diagnosis.rules import Rule
    from sniffer.ground.model import F64

FINDINGS: Final = (
    FindingCode(
        "lags-more",
        "A joint lags behind its goals more and more, and those beside it do not.",
        "Of five parts of the time the distances from the goal (that nine tenths stay below) grow from one to the next, to three times what they were and more than what counts as far, while the goals move as much as before.",
        remedy="Look at what the joint moves and at its bearings and gear: something rubs, binds or has become heavier. Then at its temperature and its supply.",
        settle="Move it by hand with torque off, beside one of its peers: what rubs, rubs then, too.",
    ),
)

PARTS: Final = 5
ROWS: Final = 20
"""Parts of the time, and quarters of a second with positions that each must have."""

MOST: Final = 0.9
"""Part of the distances that are below the one which counts: single ones are starts of moves."""

TIMES: Final = 3.0
"""How many times what it was the lag must become: what a joint carries makes it lag a little."""

RISE: Final = 0.1
"""By which part of what it was the lag rises from one part to the next."""

NEARLY: Final = 1 / 8
"""Part of what counts as far that is as good as no lag."""

EVENLY: Final = 1.5
"""How many times as fast the goals of one part may move as those of another."""


class _Lag(NamedTuple):
    """How far a joint is behind its goals, part by part, and the row at which it is farthest.

    ``far_ns`` is when the first part begins in which it is far behind.
    """

    joint: JointTrack
    parts: F64
    worst: int
    far_ns: int


def lags_more(case: Case) -> Iterator[Finding]:
    """Find joints that lag behind more and more."""
    tracks = [joint for servo in case.servos if (joint := track(case, servo)) is not None]
    lags = [lag for joint in tracks if (lag := _lag(joint)) is not None]
    rising = [lag for lag in lags if _rises(lag)]
    if len(tracks) > 1 and 2 * len(rising) > len(tracks):
        return  # what all of them have is the loop's
    for joint, parts, worst, far_ns in rising:
        p, servo = joint.position, joint.servo_id
        t_ns = int(p.t[worst])
        yield Finding(
            "lags-more",
            servo,
            far_ns,
            int(p.t[-1]),
            1,
            f"servo {servo} lags {p.told(parts[0])} behind its goals in the first fifth of the time, and "
            f"{p.told(parts[-1])} in the last one, while these move as much",
            (Place(int(p.at[worst]), 1, t_ns, "far behind its goal"),),
            brief=f"servo {servo} lags behind its goals more and more",
        )


def _lag(joint: JointTrack) -> _Lag | None:
    """Return how far a joint is behind; None where that cannot be told or its goals change.

    Who ceases to follow at all has something else, from a moment on.
    """
    p, g = joint.position, joint.goal
    if joint.away or len(p) < PARTS * ROWS:
        return None
    low, high = in_force(g, p.t, p.t)
    away = np.nan_to_num(np.maximum(np.maximum(low - p.last, p.last - high), 0.0))
    first, last = int(p.t[0]), int(p.t[-1])
    row, told = (part_of(t, first, last, PARTS) for t in (p.t, g.t))
    if np.bincount(row, minlength=PARTS).min() < ROWS:
        return None
    pace = np.array([g.step[told == k].sum() for k in range(PARTS)])
    if pace.min() <= 0 or pace.max() > EVENLY * pace.min():
        return None
    parts = np.array([quantile(away[row == k], MOST) for k in range(PARTS)])
    far_ns = int(p.t_first[np.argmax(row == np.argmax(parts > joint.far))])
    return _Lag(joint, parts, int(np.argmax(np.where(row == PARTS - 1, away, -1.0))), far_ns)


def _rises(lag: _Lag) -> bool:
    far, last = lag.joint.far, float(lag.parts[-1])
    rises = grows(lag.parts, RISE, NEARLY * far)
    return rises and last > far and last >= TIMES * float(lag.parts[0])


RULES: Final[tuple[Rule, ...]] = (lags_more,)
"""The rules of this file."""
