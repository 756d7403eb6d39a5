"""Bytes without a stop bit, as the tap's UART told them: in whose frames they were.

Many adapters tell that there was an error in a packet, not in which byte: what is told to a few
bytes is counted by frame; of wider regions it is only known whose answers were in them.
"""

from __future__ import annotations

from typing import TYPE_CHECKING, Final

import numpy as np

from sniffer.diagnosis.ledger.buckets import TimedBuckets
from sniffer.ground.codes import REQUEST
from sniffer.ground.distinct import numbers
from sniffer.ground.model import MarkKind

if TYPE_CHECKING:
    from sniffer.ground.model import I64, Batch, Remark

IN_REQUESTS, IN_ANSWERS, OUTSIDE = range(3)
"""In a sound request; in a sound answer; in bytes that no frame claims."""

PLACES: Final = 3

SHARP: Final = 2
"""Bytes of doubt about where an error was, at most."""

KINDS: Final = (MarkKind.FRAMING, MarkKind.BREAK)

_COUNTS: Final = {"n": "sum", "breaks": "sum", "at": "first", "t_first": "first", "t_last": "last"}


class LineErrors:
    """Counts them by bucket, servo and place."""

    def __init__(self) -> None:
        self._counts = TimedBuckets(_COUNTS, place=PLACES)
        self.wide = 0
        """Regions of doubt that are wider."""
        self.within: dict[int, tuple[int, int, int]] = {}
        """By servo: in how many of them its answers were, the first time and the last, in ns."""

    def add(self, batch: Batch) -> None:
        """Take the remarks of a batch."""
        told = [r for r in batch.remarks if r.kind in KINDS]
        for remark in told:
            if remark.length > SHARP:
                self._wide(batch, remark)
        told = [r for r in told if r.length <= SHARP]
        if not told:
            return
        at = np.array([r.start for r in told], np.int64) - batch.base
        t_ns = np.array([r.t_ns for r in told], np.int64)
        f = batch.frames
        row = np.searchsorted(f.start, at, "right") - 1
        inside = (row >= 0) & (np.append(f.end, -1)[row] > at)
        kind = np.append(f.kind.astype(np.int64), -1)[row]
        # an answer is the asked servo's, whatever it bears
        asked = inside & (kind != REQUEST) & (row > 0)
        asked &= np.append(f.kind.astype(np.int64), -1)[np.maximum(row - 1, -1)] == REQUEST
        whose = np.where(asked, row - 1, row)
        servo = np.where(inside, np.append(f.servo_id.astype(np.int64), -1)[whose], -1)
        place = np.where(inside, np.where(kind == REQUEST, IN_REQUESTS, IN_ANSWERS), OUTSIDE)
        self._counts.add(
            t_ns,
            servo,
            place,
            n=1,
            breaks=np.array([r.kind == MarkKind.BREAK for r in told], bool),
            at=at + batch.base,
            t_first=t_ns,
            t_last=t_ns,
        )

    def _wide(self, batch: Batch, remark: Remark) -> None:
        """Note whose answers, sound or torn, are in a region."""
        f, at = batch.frames, remark.start - batch.base
        first = max(int(np.searchsorted(f.end, at, "right")) - 1, 0)
        behind = int(np.searchsorted(f.start, at + remark.length))
        asked = f.kind[first:behind] == REQUEST
        self.wide += 1
        for servo in numbers(f.servo_id[first:behind][asked]).tolist():
            n, begun, _ = self.within.get(servo, (0, remark.t_ns, 0))
            self.within[servo] = n + 1, begun, remark.t_ns

    def counted(self) -> dict[str, I64]:
        """Return the counts as columns, with ``bucket``, ``servo_id`` and ``place``."""
        return self._counts.table()
