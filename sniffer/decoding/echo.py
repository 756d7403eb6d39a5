"""Requests that an adapter's echo doubles: every one twice, byte for byte, nothing between.

Some adapters hear what they send, and some programs log both. The second of the two is no request:
nobody answers it. A mere retry looks the same once, so it takes ``CONFIRMED`` doubled requests
with one answer each, and no single one among them. Doubled requests with two answers, or with none
(a program that sends its broadcasts twice), prove nothing, and neither does a single one right
beside bytes of no frame: one of the two may have been torn. Bytes decide alone: a doubled request
is an echo if the proof is complete no more than ``SPAN`` bytes behind it, before the next silence.
"""

from __future__ import annotations

from typing import TYPE_CHECKING, Any, Final

import numpy as np

from sniffer.ground.codes import MANY, NEVER, REQUEST, RESPONSE
from sniffer.ground.memory import Remembering

if TYPE_CHECKING:
    from collections.abc import Mapping, Sequence

    from sniffer.ground.framing import Block
    from sniffer.ground.model import Frames, Mask
    from sniffer.protocols.base import SlowFrame

CONFIRMED: Final = 8
"""So many requests in a row that each needed one retry, and only one, are not met by chance."""

SPAN: Final = 1024
"""Bytes in which eight exchanges of every protocol have room; so long is held back what looks like
an echo before it is known to be one."""


class Echoes(Remembering):
    """Finds echoes block after block."""

    PASSING = ("_count", "_last", "_torn", "_last_torn")

    def __init__(self) -> None:
        self._count = 0  # doubled requests with one answer since the last single one
        self._last = b""  # the last request, if the next frame may be its echo
        self._torn = False  # bytes of no frame stand right before the next block
        self._last_torn = False  # ... and right before that last request
        self._seconds = self._proofs = np.empty(0, bool)
        self._singles = self._before = self._seconds

    def matters(self, at: int) -> Mapping[str, Any]:
        """Return what has been seen: more proofs than are asked for prove no more."""
        return {**super().matters(at), "_count": min(self._count, CONFIRMED)}

    def find(
        self, frames: Frames, block: Block, decided: int, *, silent: bool
    ) -> tuple[Mask, int | None]:
        """Return which rows are echoes, and from which row on that is not decided.

        ``silent``: a silence stands before the block.
        """
        # The end of a real, open block: seven exchanges that are echoed, a silence (row 21), an
        # eighth, a request that is not doubled, a ninth. Rows 0 to 17 look as 18 to 20 do.
        #
        #     row       18  19  20  21  22  23  24  25  26  27  28
        #     frame     Q   Q   A   Q   Q   A   Q   A   Q   Q   A
        #     second    0   1   0   0   1   0   0   0   0   1   0
        #     _proofs   0   1   0   0   1   0   0   0   0   0   0    of 27 nobody can say yet
        #     single    0   0   0   0   0   0   1   0   0   0   0    neither first nor second
        #     run       0   0   0   0   0   0   1   1   1   1   1    single ones so far
        #     total     6   7   7   7   8   8   8   8   8   8   8    proofs so far
        #     total     6   7   7   7   8   8   0   0   0   0   0    ... since the last single one
        #     stretch   0   0   0   1   1   1   3   3   3   3   3    run and segment in one number
        #     until         20          23                  28       the last row that may prove it
        #     proved        0           1                   0        total[until] >= CONFIRMED
        #     open_end      0           0                   1        held: rows from 26 on wait
        #
        # The sum starts anew at each single one, without a loop: from the sum over all is taken
        # what it was at the last single one. Within a stretch it never falls, so at ``until`` it is
        # the most that a second can have within SPAN, and one look-up tells. Row 19 stays a retry:
        # its stretch ended, with seven, before it was proved. ``slow_echoes`` walks and counts,
        # which says the same plainly and takes a Python step a frame.
        n = len(frames)
        none = np.zeros(n, bool)
        self._seconds = self._proofs = self._singles = none
        sends = frames.kind == REQUEST
        second = self._doubled(frames, block, sends, silent=silent)
        self._before, torn_behind = self._beside(frames, block, decided, silent=silent)
        # nothing stands behind the last request of the block before but this one's first frame
        alone = silent or (n > 0 and frames.start[0] == 0 and not second[0])
        if self._last and alone and not self._last_torn:
            self._count = 0  # that was a single one
        if not second.any() and not self._count:
            self._singles = sends
            return none, None
        first = np.zeros(n, bool)
        first[:-1] = second[1:]
        # The last row may still be echoed; then it is no single one.
        waits = np.zeros(n, bool)
        if n and sends[-1] and not second[-1] and not block.final:
            waits[-1] = frames.end[-1] == decided
        segment = block.segment(frames.start)
        self._seconds = second
        self._singles = sends & ~second & ~first & ~self._before & ~torn_behind
        self._proofs = _proofs(frames, second, block)
        single = self._singles & ~waits
        run = np.cumsum(single)
        total = np.cumsum(self._proofs) + self._count
        total -= np.concatenate([[0], total[np.flatnonzero(single)]])[run]
        rows = np.flatnonzero(second)
        if not len(rows):
            return none, None
        until = np.searchsorted(frames.start, frames.start[rows] + SPAN, "right") - 1
        # the last row of the same run and stretch that stands no further behind
        stretch = run * (int(segment[-1]) + 1) + segment
        until = np.minimum(until, np.searchsorted(stretch, stretch[rows], "right") - 1)
        proved = total[until] >= CONFIRMED
        out = none.copy()
        out[rows[proved]] = True
        open_end = stretch[rows] == stretch[-1]
        open_end &= (frames.start[rows] + SPAN >= decided) & (not block.final)
        open_end &= ~proved
        if len(block.barriers):
            open_end &= frames.start[rows] >= block.barriers[-1]
        held = rows[open_end]
        return out, max(int(held[0]) - 1, 0) if len(held) else None

    def _doubled(self, frames: Frames, block: Block, sends: Mask, *, silent: bool) -> Mask:
        """Tell which rows repeat the one before, in pairs: the fourth of four is the third's."""
        # Neighbours are compared by columns first (length, op, no byte between); bytes are compared
        # only for those few that agree. The loop cannot be one comparison of arrays: whether a row
        # is a second one depends on whether the row before was, as Q Q Q Q are two pairs and not
        # three.
        same = np.zeros(len(frames), bool)
        f = frames
        if len(f) > 1:
            np.logical_and(sends[1:], sends[:-1], out=same[1:])
        if same.any():  # on a clean bus a servo speaks between two requests
            same[1:] &= f.start[1:] == f.end[:-1]
            same[1:] &= (f.length[1:] == f.length[:-1]) & (f.op[1:] == f.op[:-1])
        rows = np.flatnonzero(same)
        if len(block.barriers):
            rows = rows[~np.isin(f.start[rows], block.barriers)]
        data = block.data.tobytes() if len(rows) or self._last else b""
        out = np.zeros(len(f), bool)
        if self._last and len(f) and not silent and sends[0] and not f.start[0]:
            out[0] = data[: int(f.length[0])] == self._last
        start, end = f.start[rows].tolist(), f.end[rows].tolist()
        for row, a, b in zip(rows.tolist(), start, end, strict=True):
            out[row] = not out[row - 1] and data[2 * a - b : a] == data[a:b]
        return out

    def _beside(
        self, frames: Frames, block: Block, decided: int, *, silent: bool
    ) -> tuple[Mask, Mask]:
        """Tell right before which rows, and right behind which, bytes of no frame stand."""
        if not len(frames):
            none = np.zeros(0, bool)
            return none, none
        # A barrier between two rows is an edge as the block's own are: row 1 begins where the
        # silence ends, and row 0 ends before it.
        #
        #     byte        0    7 9      16        barrier at 9, decided up to 18
        #     frame       Q      Q
        #     behind      7      16               edges behind: 9, 18
        #     torn        1      1
        first = np.zeros(len(frames), np.int64)
        first[1:] = frames.end[:-1]
        last = np.append(frames.start[1:], decided)
        if len(block.barriers):
            behind = np.searchsorted(block.barriers, frames.start, "right")
            edges = np.concatenate([[0], block.barriers, [max(decided, block.n)]])
            first = np.maximum(first, edges[behind])
            last = np.minimum(last, np.minimum(edges[behind + 1], decided))
        before: Mask = frames.start > first
        before[0] |= self._torn and not silent and not frames.start[0]
        return before, last > frames.end

    def forget(self, frames: Frames, block: Block, kept: int, cut: int) -> None:
        """Keep what the next block must know; it begins at ``cut``, with row ``kept``."""
        if not kept:
            if cut:  # bytes that no frame claims
                self._last, self._torn = b"", True
            return
        self._last, self._torn = b"", int(frames.end[kept - 1]) < cut
        if frames.kind[kept - 1] == REQUEST and not self._seconds[kept - 1]:
            start, end = int(frames.start[kept - 1]), int(frames.end[kept - 1])
            if end == cut:
                self._last = block.data[start:end].tobytes()
                self._last_torn = bool(self._before[kept - 1])
        singles = np.flatnonzero(self._singles[: kept - 1 if self._last else kept])
        begin = int(singles[-1]) + 1 if len(singles) else 0
        self._count = int(self._proofs[begin:kept].sum()) + (0 if len(singles) else self._count)


def _proofs(frames: Frames, second: Mask, block: Block) -> Mask:
    """Tell which second requests have one answer, and not more, right behind them."""
    # Q q A is a proof; Q q A A (a program that sends twice), Q q alone and q behind a silence are
    # not. In the last row of an open block "not more than one" cannot be said yet.
    n = len(frames)
    out = np.zeros(n, bool)
    rows = np.flatnonzero(second & (frames.reply != NEVER) & (frames.reply != MANY))
    rows = rows[rows + 1 < n]
    segment = block.segment(frames.start)
    answered = (frames.kind[rows + 1] == RESPONSE) & (segment[rows + 1] == segment[rows])
    rows = rows[answered]
    more = np.minimum(rows + 2, n - 1)
    twice = (rows + 2 < n) & (frames.kind[more] == RESPONSE) & (segment[more] == segment[rows])
    # The last answer may not be the only one: that shows when something else stands behind it.
    last = 0 if not len(block.barriers) else int(block.barriers[-1])
    unknown = (rows + 2 == n) & (not block.final) & (frames.start[rows] >= last)
    out[rows[~twice & ~unknown]] = True
    return out


def slow_echoes(
    frames: Sequence[SlowFrame], count: int, begin: int, stop: int
) -> tuple[set[int], int]:
    """Return the rows of one stretch that are echoes, the obvious way, and the count behind it.

    Args:
        frames: of the stretch.
        count: the count before it.
        begin: where the stretch begins.
        stop: where it ends.
    """
    seconds: set[int] = set()
    for i in range(1, len(frames)):
        a, b = frames[i - 1], frames[i]
        both = a.kind == b.kind == REQUEST and a.end == b.start
        if both and i - 1 not in seconds and a.raw == b.raw:
            seconds.add(i)
    counts: list[tuple[int, int]] = []  # for each row, the run it is in and the proofs so far
    run = 0
    edges = [begin, *(edge for f in frames for edge in (f.start, f.end)), stop]
    for i, f in enumerate(frames):
        is_beside_torn = edges[2 * i] < f.start or f.end < edges[2 * i + 3]
        if f.kind == REQUEST and not is_beside_torn and not seconds & {i, i + 1}:
            run, count = run + 1, 0
        answers = [g.kind == RESPONSE for g in frames[i + 1 : i + 3]]
        proof = i in seconds and f.reply not in (NEVER, MANY)
        count += proof and answers[:1] == [True] and answers[1:] != [True]
        counts.append((run, count))
    out = set()
    for i in seconds:
        near = [
            proofs
            for f, (number, proofs) in zip(frames[i:], counts[i:], strict=True)
            if number == counts[i][0] and f.start <= frames[i].start + SPAN
        ]
        if near[-1] >= CONFIRMED:
            out.add(i)
    return out, count
