"""Joints that do what others are told, or the opposite of what they are told."""

from __future__ import annotations

import itertools
from typing import TYPE_CHECKING, Final

import numpy as np

from sniffer.diagnosis.catalogue import FindingCode
from sniffer.diagnosis.evidence.tracks import in_force, track
from sniffer.diagnosis.model import Finding, Place
from sniffer.ground.model import MS

if TYPE_CHECKING:
    from collections.abc import Iterator, Sequence

    from sniffer.diagnosis.case import Case
    from sniffer.diagnosis.evidence.tracks import JointTrack
    from sniffer.diagnosis.rules import Rule
    from sniffer.ground.model import F64

FINDINGS: Final = (
    FindingCode(
        "joints-exchanged",
        "Two joints go where the other one is told to go.",
        "Each is near the other's goals most of the time, goes with these (a correlation of 0.95), and less with its own (0.8 at most); ten seconds of motion by both.",
        remedy="Exchange their ids or their plugs back, or what the controller sends to whom.",
        settle="Send one of the two somewhere, and look which of them moves.",
    ),
    FindingCode(
        "joint-mirrored",
        "A joint goes the opposite way of its goals.",
        "Its positions are its goals turned around (a correlation of -0.95), however late it may be by up to 0.2 s; ten seconds of motion.",
        remedy="Turn its direction around: by its register, if it has one, or by the sign in the controller; or it is mounted the wrong way.",
        settle="Send it somewhere near, and look which way it goes.",
    ),
)

ROWS: Final = 40
"""Quarters of a second with positions: chance makes few alike, and two alike motions differ by then."""

LIKE: Final = 0.95
UNLIKE: Final = 0.8
AGAINST: Final = -0.5
"""Correlations of what is the same motion, of what is another one, and, however late, of one against it."""

NEAR: Final = 0.8
"""Part of the time for which a joint must be near the goals that are another's."""

LATE_NS: Final = (0, 100 * MS, 200 * MS)
"""How late a joint may be behind its goals: half a swing late it seems to go the other way."""


def exchanged(case: Case) -> Iterator[Finding]:
    """Find pairs of joints that do what the other one is told."""
    strays = [joint for joint in _moving(case) if _goes_with(joint, joint) <= UNLIKE]
    for one, other in itertools.combinations(strays, 2):
        if min(_goes_with(one, other), _goes_with(other, one)) < LIKE:
            continue
        if not (_is_at(one, other) and _is_at(other, one)):
            continue
        for joint, its in ((one, other), (other, one)):
            p = joint.position
            yield Finding(
                "joints-exchanged",
                joint.servo_id,
                int(p.t_first[0]),
                int(p.t[-1]),
                1,
                f"servo {joint.servo_id} goes where servo {its.servo_id} is told to go, and the other way "
                "round",
                _places(joint),
                brief=f"servo {joint.servo_id} does what servo {its.servo_id} is told",
            )


def mirrored(case: Case) -> Iterator[Finding]:
    """Find joints that go the opposite way of their goals."""
    for joint in _moving(case):
        if max(_goes_with(joint, joint, late) for late in LATE_NS) > AGAINST:
            continue
        if min(_goes_with(joint, joint, late) for late in LATE_NS) > -LIKE:
            continue
        p = joint.position
        yield Finding(
            "joint-mirrored",
            joint.servo_id,
            int(p.t_first[0]),
            int(p.t[-1]),
            1,
            f"servo {joint.servo_id} goes the opposite way of its goals: when these grow, its position "
            "falls by as much",
            _places(joint),
            brief=f"servo {joint.servo_id} goes the opposite way",
        )


def _moving(case: Case) -> Sequence[JointTrack]:
    """Return the joints that are told to move, and do, for long enough."""
    tracks = [joint for servo in case.servos if (joint := track(case, servo)) is not None]
    return [
        joint
        for joint in tracks
        if len(joint.position) >= ROWS
        and joint.span > 2 * joint.far
        and float(np.ptp(joint.position.last)) > 2 * joint.far
    ]


def _goals(joint: JointTrack, at: JointTrack, late_ns: int = 0) -> F64:
    """Return what a joint was told, at the moments at which another one was looked at."""
    t = at.position.t - late_ns
    low, high = in_force(joint.goal, t, t)
    return (low + high) / 2


def _goes_with(joint: JointTrack, whose: JointTrack, late_ns: int = 0) -> float:
    """Return how a joint's positions go with the goals of one: from -1 to 1."""
    told = _goals(whose, joint, late_ns)
    known = np.isfinite(told)
    told, place = told[known], joint.position.last[known]
    if len(told) < ROWS or not told.std() or not place.std():
        return 0.0
    return float(np.corrcoef(told, place)[0, 1])


def _is_at(joint: JointTrack, whose: JointTrack) -> bool:
    """Tell whether a joint is mostly near the goals of another one."""
    away = np.abs(_goals(whose, joint) - joint.position.last)
    return float((away <= 2 * joint.far).mean()) >= NEAR


def _places(joint: JointTrack) -> tuple[Place, ...]:
    p = joint.position
    row = int(np.argmax(np.nan_to_num(np.abs(_goals(joint, joint) - p.last))))
    return (Place(int(p.at[row]), 1, int(p.t_first[row]), "far from its goal"),)


RULES: Final[tuple[Rule, ...]] = (exchanged, mirrored)
"""The rules of this file."""
