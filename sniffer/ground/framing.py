"""Block framing in columns.

One rule for every protocol: left to right, the first candidate that holds wins, on failure advance
ONE byte. A block's end is open (more bytes may come) unless it is final; barriers inside it are
silences that no frame crosses.
"""

from __future__ import annotations

from dataclasses import dataclass, field
from typing import TYPE_CHECKING, Any

import numpy as np

from sniffer.ground.codes import REQUEST
from sniffer.ground.model import I64, U8, Mask, Spans

if TYPE_CHECKING:
    from collections.abc import Sequence

    from sniffer.ground.plan import Plan


@dataclass(frozen=True, slots=True)
class Block:
    """Bytes of one pass. ``barriers`` are sorted offsets inside it; ``final`` makes its end one.

    ``notes`` is where a protocol's framing may leave what describing would work out once more.
    ``foreign`` are sorted offsets at which frames of another protocol on the wire begin; None where
    there is but one.
    """

    data: U8
    barriers: I64
    final: bool
    notes: dict[str, Any] = field(default_factory=dict, compare=False, repr=False)
    foreign: I64 | None = None

    @property
    def n(self) -> int:
        """Length in bytes."""
        return len(self.data)

    def limit(self, start: I64) -> Any:
        """Return for each offset the first barrier behind it, or the block's end."""
        if not len(self.barriers):
            return np.int64(self.n)
        ends = np.append(self.barriers, self.n)
        return ends[np.searchsorted(self.barriers, start, "right")]

    def open(self, limit: Any) -> Any:
        """Tell for which limits more bytes may still come."""
        return (limit == self.n) & (not self.final)

    def decided_but(self, tail: int) -> int:
        """Return how far bytes can be judged if the last ``tail`` of an open end cannot."""
        if self.final:
            return self.n
        closed = int(self.barriers[-1]) if len(self.barriers) else 0
        return max(closed, self.n - tail)

    def segment(self, start: I64) -> I64:
        """Return the number of the silence-bounded stretch each offset lies in."""
        return np.searchsorted(self.barriers, start, "right").astype(np.int64)


def greedy(start: I64, end: I64) -> I64 | None:
    """Return the rows a left-to-right parser keeps (None: all); walks only where rows overlap.

    ``start`` is sorted. For example::

        row      0   1   2   3   4
        start    0   4   9  20  22      row 1 begins inside row 0, row 4 inside row 3
        end      9  13  18  26  30
        kept     x       x   x          row 2 begins where row 0 ends, not where row 1 does

    Row 1 would drop row 2 if all overlaps were dropped at once: whether a row stands is known only
    when all rows before it are settled. So this is a loop, but over overlaps, which sound traffic
    has none of.
    """
    overlaps = np.flatnonzero(start[1:] < end[:-1])
    if not len(overlaps):
        return None
    keep = np.ones(len(start), bool)
    done = 0
    for j in overlaps.tolist():
        if j + 1 < done or not keep[j]:
            continue
        # j is kept: all that begin inside it are none. ``done``: rows before it are settled.
        stop, q = end[j], j + 1
        while q < len(start) and start[q] < stop:
            keep[q] = False
            q += 1
        done = q
    return np.flatnonzero(keep)


def settle(start: I64, end: I64, waiting: I64, limit: int) -> tuple[I64, int]:
    """Keep rows greedily, but never past a candidate that still waits for bytes.

    A waiting candidate inside a frame that was kept waits for nothing. Returns the rows kept and
    the offset up to which every byte's fate is decided. For example, with a block of 40 bytes::

        start    0  10  22              waiting  13  30
        end     10  20  28

    The candidate at 13 lies inside row 1 (10..20), which is kept: it waits for nothing. The one at
    30 may turn out to be a frame: rows 0 to 2 are kept, and bytes are decided up to 30. Were a row
    kept that begins at 31, more bytes could make it never have been: live and offline would differ.
    """
    while True:
        # Invariant: every waiting candidate that was dropped lies inside a frame that stands.
        stop = int(waiting[0]) if len(waiting) else limit
        n = int(np.searchsorted(start, stop))
        kept = greedy(start[:n], end[:n])
        rows = np.arange(n) if kept is None else kept
        last = int(end[rows[-1]]) if len(rows) else 0
        if not len(waiting) or last <= stop:
            return rows, max(stop, last)
        waiting = waiting[waiting >= last]


def candidates(plan: Plan, block: Block) -> tuple[I64, I64, I64]:
    """Return starts and ends of frames whose checksum holds, and starts that wait for bytes.

    All candidates at once, overlapping ones too: which of them stand, ``settle`` says. Step by step
    in docs/columns.md, 2 to 4. A candidate passes the guards before its end is believed: a header
    in noise, with a length of 250, must not keep a live bus waiting longer than it has to.
    """
    data, n = block.data, block.n
    head = plan.header
    m = n - plan.prefix + 1
    none = np.empty(0, np.int64)
    if m <= 0:
        return none, none, none
    # Without a header every byte may begin a packet: then the guards are all that tells.
    same = data == head[0] if head else np.ones(n, bool)
    mask = same[:m]
    # A byte that occurs twice in the header is compared once: FF FF FF costs one comparison.
    for k in range(1, len(head)):
        other = same if head[k] == head[0] else data == head[k]
        mask = mask & other[k : k + m]
    start = np.flatnonzero(mask)
    limit = block.limit(start)
    columns = plan.columns(data, start)
    ok = np.asarray(start + plan.prefix <= limit)
    for check in plan.checks:
        ok = ok & check(columns)
    end = start + plan.size_with(plan.tail(columns))
    whole = ok & (end <= limit)
    waiting = start[ok & (end > limit) & block.open(limit)]
    start, end = start[whole], end[whole]
    good = plan.holds(data, start, end)
    return start[good], end[good], waiting


def in_order(answers: Mask) -> I64:
    """Return each answer's request: m answers in a row are those of the last m rows before them.

    For example, Q a request and A an answer that names nobody::

        row        0  1  2  3  4  5  6
        kind       Q  Q  Q  A  A  Q  A
        before     -  -  -  2  2  -  5      the last request before the answers
        behind     -  -  -  5  5  -  7      the first row behind the answers
        asked      -  -  -  1  2  -  5

    Three asked and two answered: these are of the last two, and the first one went without. The run
    of answers is ``behind - 1 - before`` rows long, and each one's request is as many rows before
    it: no run is counted by itself. Rows of requests hold nothing that means something.
    """
    n = len(answers)
    rows = np.arange(n)
    if not (answers[1:] & answers[:-1]).any():
        return rows - 1
    before = np.maximum.accumulate(np.where(answers, -1, rows))
    behind = np.minimum.accumulate(np.where(answers, n, rows)[::-1])[::-1]
    asked: I64 = rows - (behind - 1 - before)
    return asked


def undecided_from(plan: Plan, block: Block) -> int:
    """Return the offset from which a header may begin that cannot be judged yet."""
    return block.decided_but(plan.prefix - 1)


def frame_by_plan(plan: Plan, block: Block) -> tuple[Spans, int]:
    """Frame a block by one plan; every frame is marked a request, the protocol knows better."""
    start, end, waiting = candidates(plan, block)
    rows, decided = settle(start, end, waiting, undecided_from(plan, block))
    start, end = start[rows], end[rows]
    return Spans(start, end, np.full(len(start), REQUEST, np.uint8)), decided


def frame_by_plans(plans: Sequence[tuple[Plan, int]], block: Block) -> tuple[Spans, int]:
    """Frame a block whose packets have several forms: the plan of each, and who speaks so.

    Without a header several may hold at one byte: a CRC's last byte of 0 makes what is before it
    hold as well. Then the longest is it.

    Args:
        plans: of each form, with REQUEST or RESPONSE.
        block: to frame.
    """
    found = [candidates(plan, block) for plan, _ in plans]
    start, end, waiting = (np.concatenate(columns) for columns in zip(*found, strict=True))
    speaks = np.array([kind for _, kind in plans], np.uint8)
    kind = np.repeat(speaks, [len(f[0]) for f in found])
    order = np.argsort(start, kind="stable")
    if (start[order[1:]] == start[order[:-1]]).any():
        order = np.lexsort((-end, start))
    start, end, kind = start[order], end[order], kind[order]
    undecided = min(undecided_from(plan, block) for plan, _ in plans)
    rows, decided = settle(start, end, np.sort(waiting), undecided)
    return Spans(start[rows], end[rows], kind[rows]), decided
