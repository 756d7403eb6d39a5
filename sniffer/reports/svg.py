"""Curves as paths of an SVG whose width and height are stretched to where it stands.

Lines keep their thickness (``non-scaling-stroke``); texts stand beside the drawing, in HTML, so
that they keep their size on a phone. x counts buckets, y goes from 0 (top) to ``HEIGHT``; whole
numbers and relative steps keep a curve of a thousand buckets below 20 kB.
"""

from __future__ import annotations

import itertools
import math
from dataclasses import replace
from typing import TYPE_CHECKING, Final, NamedTuple

import numpy as np

from sniffer.statistics.grid import BUCKETS

if TYPE_CHECKING:
    from sniffer.ground.model import F64, I64
    from sniffer.statistics.grid import Trace

HEIGHT: Final = 240
"""Steps of a value axis: finer than the pixels of a chart."""

FAR: Final = 4.0
"""A line is broken where values are so many times further apart than usual for it."""


FEW, WIDE = 4, BUCKETS / 8
"""Of fewer steps none is usual; then a line goes on over an eighth of the time at most."""


class Axis(NamedTuple):
    """A value axis: its ends, and where its labels stand."""

    low: float
    high: float
    ticks: tuple[float, ...]

    def y(self, value: F64) -> I64:
        """Return where values stand; those beyond an end stand at it."""
        share = (self.high - value) / (self.high - self.low)
        return np.rint(np.clip(share, 0, 1) * HEIGHT).astype(np.int64)


def axis(low: float, high: float, *, least: float = 0.0, labels: int = 3) -> Axis:
    """Return an axis with round ends around a range, which is widened to ``least`` at least."""
    if not (math.isfinite(low) and math.isfinite(high)):
        low, high = 0.0, 1.0
    room = max(least, abs(low) * 1e-6, abs(high) * 1e-6, 1e-9)
    if high - low < room:
        middle = (low + high) / 2
        low, high = middle - room / 2, middle + room / 2
    step = round_up((high - low) / max(labels - 1, 1))
    first, last = math.floor(low / step + 1e-9), math.ceil(high / step - 1e-9)
    ticks = tuple(k * step for k in range(first, last + 1))
    return Axis(ticks[0], ticks[-1], ticks)


def round_up(value: float) -> float:
    """Return the next number that is 1, 2, 2.5 or 5 times a power of ten."""
    power = 10.0 ** math.floor(math.log10(value))
    return next(k * power for k in (1, 2, 2.5, 5, 10) if k * power >= value * (1 - 1e-9))


def coarser(curve: Trace, factor: int) -> Trace:
    """Return a curve whose buckets are joined, so many to one."""
    if factor == 1 or not len(curve):
        return curve
    at = curve.at // factor
    begins = np.flatnonzero(np.diff(at, prepend=at[0] - 1))
    ends = np.append(begins[1:], len(at)) - 1
    n = np.add.reduceat(curve.n, begins)
    return replace(
        curve,
        at=at[begins],
        n=n,
        low=np.minimum.reduceat(curve.low, begins),
        high=np.maximum.reduceat(curve.high, begins),
        mean=np.add.reduceat(curve.mean * curve.n, begins) / n,
        last=curve.last[ends],
    )


def runs(at: I64) -> list[slice]:
    """Return the stretches of a curve within which it is drawn as one line."""
    steps = np.diff(at)
    if not len(steps):
        return [slice(0, len(at))] if len(at) else []
    far = max(FAR * float(np.median(steps)), 2.0)
    if len(steps) < FEW:  # nobody knows what is usual
        far = min(far, WIDE)
    edges = [0, *(np.flatnonzero(steps > far) + 1).tolist(), len(at)]
    return [slice(a, b) for a, b in itertools.pairwise(edges)]


def line(x: I64, y: I64) -> str:
    """Return a line through points, broken where they are far apart; a single one is a dot."""
    return "".join(
        f"M{x[run.start]} {y[run.start]}{_steps(x[run], y[run]) or 'h0'}" for run in runs(x)
    )


def stairs(x: I64, y: I64, end: int) -> str:
    """Return a line that keeps each value until the next one, and the last until ``end``."""
    if not len(x):
        return ""
    change = np.flatnonzero(np.diff(y, prepend=y[0] - 1))
    out, at, level = [f"M{x[0]} {y[0]}"], int(x[0]), int(y[0])
    for column, value in zip(x[change[1:]].tolist(), y[change[1:]].tolist(), strict=True):
        out.append(f"h{column - at}v{value - level}")
        at, level = column, value
    return "".join([*out, f"h{max(end - at, 0)}"])


def band(x: I64, top: I64, bottom: I64) -> str:
    """Return the area between two lines; empty where they are one."""
    out = []
    for run in runs(x):
        if run.stop - run.start < 2 or not (bottom[run] > top[run]).any():
            continue
        forth, turn = _steps(x[run], top[run]), bottom[run][-1] - top[run][-1]
        back = _steps(x[run][::-1], bottom[run][::-1])
        out.append(f"M{x[run.start]} {top[run.start]}{forth}v{turn}{back}z")
    return "".join(out)


def bars(x: I64, y: I64, width: int = 1) -> str:
    """Return bars that stand on the ground and reach up to ``y``; those without height are none."""
    out = []
    for column, top in zip(x.tolist(), y.tolist(), strict=True):
        if top < HEIGHT:
            out.append(f"M{column} {HEIGHT}V{top}h{width}V{HEIGHT}z")
    return "".join(out)


def intervals(x: I64, top: I64, bottom: I64, width: int) -> str:
    """Return boxes from one value to another; where both are one, a line of its thickness."""
    rows = zip(x.tolist(), top.tolist(), bottom.tolist(), strict=True)
    return "".join(f"M{at} {y}h{width}V{low}h{-width}z" for at, y, low in rows)


def outline(counts: I64, most: int) -> str:
    """Return the outline of a histogram, a column a bin, whose highest may be ``most``."""
    level = np.rint(HEIGHT - counts * (HEIGHT / max(most, 1))).astype(np.int64)
    out, before = [f"M0 {HEIGHT}"], HEIGHT
    for value in level.tolist():
        out.append((f"v{value - before}" if value != before else "") + "h1")
        before = value
    return "".join([*out, f"V{HEIGHT}"])


def _steps(x: I64, y: I64) -> str:
    """Return the relative steps from the first point to the last; level ones are joined."""
    if len(x) < 2:
        return ""
    dx, dy = np.diff(x).tolist(), np.diff(y).tolist()
    out = ["l"]
    level = 0
    for right, down in zip(dx, dy, strict=True):
        if down == 0 and right * level >= 0 and (level or right):
            level += right
            continue
        if level:
            out.append(_pair(level, 0))
            level = 0
        out.append(_pair(right, down))
    if level:
        out.append(_pair(level, 0))
    return "".join(out)


def _pair(dx: int, dy: int) -> str:
    """Return a step; a sign parts numbers as well as a blank."""
    return f"{'' if dx < 0 else ' '}{dx}{'' if dy < 0 else ' '}{dy}"
