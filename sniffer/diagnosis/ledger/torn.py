"""Runs of bytes that no frame claims, as columns."""

from __future__ import annotations

from dataclasses import dataclass
from typing import TYPE_CHECKING, Final

import numpy as np

from sniffer.ground.columnar import Columns
from sniffer.ground.gaps import BLANK, Gaps

if TYPE_CHECKING:
    from sniffer.ground.model import I64, Batch, Mask

STEADY: Final = 6
"""So many bytes of one value are of no frame: the line is held. Headers have three at most."""


@dataclass(frozen=True, slots=True)
class TornRuns(Columns):
    """Runs of unclaimed bytes; places are absolute, ``value`` is their only one or -1."""

    start: I64
    length: I64
    begins_ns: I64
    t_ns: I64
    kind: I64
    servo_id: I64
    value: I64


def only_value(data: bytes, start: I64, length: I64) -> I64:
    """Return the value that each run of bytes consists of, -1 where there are several."""
    if not len(start):
        return np.empty(0, np.int64)
    edges = np.stack([start, start + length], 1).reshape(-1)
    whole = np.append(np.frombuffer(data, np.uint8), 0)
    low = np.minimum.reduceat(whole, edges)[::2].astype(np.int64)
    high = np.maximum.reduceat(whole, edges)[::2]
    return np.where(low == high, low, -1)


def torn_ends(batch: Batch) -> I64:
    """Return where bytes of a batch end that are no frame and no mere blanks, absolute."""
    gaps = Gaps.of(batch.gaps)
    rows = np.flatnonzero(gaps.kind != BLANK)
    return gaps.start[rows] + gaps.length[rows] + batch.base


def is_held(runs: TornRuns) -> Mask:
    """Tell which runs are one value for so long that the line is held."""
    return (runs.value >= 0) & (runs.length >= STEADY)
