"""What can be counted of the lines that are shown: by servo, and findings by code and servo."""

from __future__ import annotations

from dataclasses import dataclass
from typing import TYPE_CHECKING

import numpy as np

from sniffer.anomalies.found import CODES
from sniffer.ground.codes import NO_RESPONSE, REQUEST, RESPONSE
from sniffer.ground.model import NS
from sniffer.inside.columns import GAP
from sniffer.sinks.words import took_in_words

if TYPE_CHECKING:
    from sniffer.ground.model import I64
    from sniffer.inside.columns import Table
    from sniffer.inside.index import CaptureIndex


@dataclass(frozen=True, slots=True)
class ShownServo:
    """A servo of a bus (-1: nobody's), with its name; times are those of its answers."""

    bus: str
    servo: int
    who: str
    requests: int
    answers: int
    missing: int
    median: str
    worst: str


@dataclass(frozen=True, slots=True)
class ShownCode:
    """How often a code was found of a servo (-1: nobody's), and in which line first."""

    code: str
    severity: int
    bus: str
    servo: int
    who: str
    count: int
    line: int


@dataclass(frozen=True, slots=True)
class ShownFigures:
    """Counts of lines, and of bytes; the span in seconds; servos, and findings, the worst first."""

    frames: int
    gaps: int
    bytes: int
    bytes_in_gaps: int
    span_s: float
    servos: tuple[ShownServo, ...]
    codes: tuple[ShownCode, ...]


def figures_of(index: CaptureIndex, numbers: I64) -> ShownFigures:
    """Count lines."""
    every = index.lines
    # where nothing is left out, nothing is copied
    is_run = len(numbers) > 0 and int(numbers[-1]) == len(numbers) - 1
    lines = every[: len(numbers)] if is_run else every[numbers]
    gaps = lines["kind"] == GAP
    length = lines["length"].astype(np.int64)
    span = int(lines["t"].max() - lines["t"].min()) / NS if len(lines) else 0.0
    return ShownFigures(
        int((~gaps).sum()),
        int(gaps.sum()),
        int(length.sum()),
        int(length[gaps].sum()),
        span,
        tuple(_servos(index, lines)),
        tuple(_codes(index, numbers)),
    )


def _servos(index: CaptureIndex, lines: Table) -> list[ShownServo]:
    kind, servo = lines["kind"].copy(), lines["servo"].astype(np.int64) + 1
    width = int(servo.max(initial=0)) + 1
    key = lines["bus"].astype(np.int64) * width + servo
    timed = np.flatnonzero((kind == RESPONSE) & (lines["took"] >= 0))
    took, spread, whose = lines["took"][timed], lines["spread"][timed], key[timed]
    at_most = took + np.maximum(spread, 0)
    least = int(key.max(initial=-1)) + 1
    frames, asked, said, missing = (
        np.bincount(key[some], minlength=least)
        for some in (
            kind != GAP,
            kind == REQUEST,
            kind == RESPONSE,
            (kind == REQUEST) & (lines["outcome"] == NO_RESPONSE),
        )
    )
    out = []
    for k in np.flatnonzero(frames).tolist():
        mine = np.flatnonzero(whose == k)
        middle = worst = "-"
        if n := len(mine):
            order = mine[np.argpartition(at_most[mine], (n // 2, n - 1))]
            middle, worst = (_took(took, spread, int(order[i])) for i in (n // 2, n - 1))
        counts = int(asked[k]), int(said[k]), int(missing[k])
        bus, servo = index.buses[k // width], k % width - 1
        out.append(ShownServo(bus, servo, _who(index, bus, servo), *counts, middle, worst))
    return sorted(out, key=lambda s: -s.missing)


def _who(index: CaptureIndex, bus: str, servo: int) -> str:
    return index.names.label(bus, servo) if servo >= 0 else "-"


def _took(took: I64, spread: I64, row: int) -> str:
    """Return a response time as the list has it: what the stamps cannot tell is a bound."""
    return took_in_words(int(took[row]), int(spread[row]), "")


def _codes(index: CaptureIndex, numbers: I64) -> list[ShownCode]:
    found = index.found
    if len(numbers) != len(index.lines):
        found = found[np.isin(found["line"], numbers)]
    bus = index.lines["bus"][found["line"]].astype(np.int64)
    key = found["code"].astype(np.int64) << 32 | bus << 16 | (found["servo"].astype(np.int64) + 1)
    every, first, count = np.unique(key, return_index=True, return_counts=True)
    out = []
    for k, at, n in zip(every.tolist(), first.tolist(), count.tolist(), strict=True):
        name, servo = index.buses[k >> 16 & 0xFFFF], (k & 0xFFFF) - 1
        severity, line = int(found["severity"][at]), int(found["line"][at])
        who = _who(index, name, servo)
        out.append(ShownCode(CODES[k >> 32], severity, name, servo, who, n, line))
    return sorted(out, key=lambda c: (-c.severity, -c.count))
