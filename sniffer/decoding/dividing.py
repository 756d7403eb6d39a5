"""Several protocols on one wire: each byte is claimed once.

The rule is that of one protocol, for all of them together: from left to right, the first frame that
holds wins, whoever it is of. Where frames of two begin at the same byte, the longer one wins. What
wins is passed over as a whole; behind it everybody looks anew. So a frame that contains another
one's wins over it, and who is asked first never matters. Of two of the same bytes the protocol
whose name comes first has them: nothing in the bytes tells them apart.

    bytes       FF FF FF 01 02 F1 0B  FF FF 01 02 01 FB
    mightyzap   [0 ................7)
    dynamixel1     [1 .............7) [7 ............13)
    claimed     mightyzap             dynamixel1

Each protocol frames the block as if it were alone, at column speed. Where their frames keep apart
or lie one within the other, comparing columns divides them. Only where two frames overlap in part,
or one waits for bytes inside another, its protocol has to frame again from behind the winner: the
frame that lost may have hidden others. It is framed again as far as it takes to meet a frame that
was known before, from which on all is as it was.

Nobody's frame is taken that begins behind a place where another protocol still waits for bytes:
what comes may contain it. So what is claimed does not depend on how the stream was cut.
"""

from __future__ import annotations

from typing import TYPE_CHECKING, Any, Final, NamedTuple

import numpy as np

from sniffer.ground.codes import RESPONSE
from sniffer.ground.distinct import numbers
from sniffer.ground.framing import Block
from sniffer.ground.model import DEPTH, I64, U8, Mask, Spans

if TYPE_CHECKING:
    from collections.abc import Sequence

    from sniffer.protocols.base import BusProtocol

WINDOW: Final = 4096
"""Bytes that are divided in one go behind a place where frames overlap in part, and that are framed
again there at first."""


class Divided(NamedTuple):
    """Each protocol's frames, none of which touch, and how far every byte has its fate.

    ``each`` is how far it has for one protocol alone, which need not wait for the others.
    """

    spans: list[Spans]
    decided: int
    each: list[int]


def divide(protocols: Sequence[BusProtocol], blocks: Sequence[Block]) -> Divided:
    """Divide a block among protocols.

    Args:
        protocols: in the order of their names.
        blocks: the same bytes for each, with its own silences.
    """
    views = [_View(p, b) for p, b in zip(protocols, blocks, strict=True)]
    ordered = np.array([p.ordered for p in protocols])
    parts: list[_Claims] = []
    at, room = 0, blocks[0].n
    while True:
        for view in views:
            view.look_from(at)
        stop = min(view.decided for view in views)
        until = min(stop, at + room)
        good, lost = _settled(_Claims.of(views, at, until), ordered)
        parts.append(good)
        for k, view in enumerate(views):
            view.took(good.end[good.owner == k])
        if lost is not None:
            at, room = lost, WINDOW  # what lost may have hidden what stands behind the winner
            continue
        at = max([at, *good.end[-1:].tolist()])
        if until < stop:
            at, room = max(at, until), 2 * room
        elif all(view.decided >= at for view in views):
            spans = _by_owner(parts, len(views))
            decided = min(v.whole(s, max(stop, at)) for v, s in zip(views, spans, strict=True))
            told = [s.take(slice(int(np.searchsorted(s.start, decided)))) for s in spans]
            return Divided(told, decided, [view.decided for view in views])


class _Claims(NamedTuple):
    """Frames of all protocols, by where they begin, the longer one first."""

    start: I64
    end: I64
    kind: U8
    owner: I64

    @classmethod
    def of(cls, views: Sequence[_View], at: int, until: int) -> _Claims:
        """Return the frames that begin in ``at..until``."""
        mine = [slice(*np.searchsorted(v.start, [at, until]).tolist()) for v in views]
        start = np.concatenate([v.start[m] for v, m in zip(views, mine, strict=True)])
        end = np.concatenate([v.end[m] for v, m in zip(views, mine, strict=True)])
        kind = np.concatenate([v.kind[m] for v, m in zip(views, mine, strict=True)])
        owner = np.repeat(np.arange(len(views)), [m.stop - m.start for m in mine])
        order = np.lexsort((owner, -end, start))
        return cls(start[order], end[order], kind[order], owner[order])

    def take(self, index: Any) -> _Claims:
        """Return the rows that ``index`` selects."""
        return _Claims(*(column[index] for column in self))


def _settled(rows: _Claims, ordered: Mask) -> tuple[_Claims, int | None]:
    """Return the frames that win, and the end of the first one whose loser must look anew."""
    start, end, kind, owner = rows
    if not len(start):
        return rows, None
    # Winners keep apart, so what reaches furthest so far is the last of them.
    reach = np.maximum.accumulate(end)
    before = np.concatenate([[0], reach[:-1]])
    loses = start < before
    if not loses.any():
        return rows, None
    again = loses & ((end > before) | ordered[owner])
    # An answer without a header is none without the request it stands behind.
    for k in numbers(owner[loses]).tolist():
        mine = np.flatnonzero(owner == k)
        one, next_one = mine[:-1], mine[1:]
        bare = loses[one] & (kind[next_one] == RESPONSE) & (start[next_one] == end[one])
        again[next_one[bare]] = True
    hits = np.flatnonzero(again)
    if not len(hits):
        return rows.take(~loses), None
    first = int(hits[0])
    return rows.take(np.flatnonzero(~loses[:first])), int(before[first])


def _by_owner(parts: Sequence[_Claims], count: int) -> list[Spans]:
    whole = _Claims(*(np.concatenate(columns) for columns in zip(*parts, strict=True)))
    return [
        Spans(mine.start, mine.end, mine.kind)
        for mine in (whole.take(whole.owner == k) for k in range(count))
    ]


class _View:
    """The frames that one protocol sees from some place on, as if it were alone."""

    def __init__(self, protocol: BusProtocol, block: Block) -> None:
        self._protocol, self._block = protocol, block
        spans, self.decided = protocol.frame(block)
        self.start: I64 = spans.start
        self.end: I64 = spans.end
        self.kind: U8 = spans.kind
        self._taken_until = -1  # end of the last frame of it that won

    def took(self, ends: I64) -> None:
        """Remember which frames won."""
        if len(ends):
            self._taken_until = int(ends[-1])

    def look_from(self, at: int) -> None:
        """See to it that the frames from ``at`` on are those seen by who begins to look there."""
        stale = self.decided < at
        row = int(np.searchsorted(self.start, at))
        if row and self.end[row - 1] != self._taken_until:  # that one has lost
            behind = int(self.end[row - 1])
            stale |= behind > at or self._protocol.ordered
            if row < len(self.start) and self.kind[row] == RESPONSE:
                stale |= behind == self.start[row]
        if stale:
            self._look_again(at)

    def whole(self, spans: Spans, decided: int) -> int:
        """Return how far bytes are decided if a request is not without its answer.

        Where another protocol cannot tell yet what the answer's bytes are, the request waits too,
        and with it the commands in a row to which answers in a row belong.
        """
        row, last = int(np.searchsorted(self.start, decided)), len(spans) - 1
        if last < 0 or row == len(self.start) or spans.end[last] != self.start[row]:
            return decided
        ordered = self._protocol.ordered
        is_linked = self.kind[row] == RESPONSE or (ordered and spans.kind[last] != RESPONSE)
        if not is_linked:
            return decided
        commands = 0
        while last and spans.end[last - 1] == spans.start[last]:
            commands += spans.kind[last] != RESPONSE
            in_a_row = ordered and spans.kind[last - 1] != RESPONSE and commands < DEPTH
            if spans.kind[last] != RESPONSE and not in_a_row:
                break
            last -= 1
        return int(spans.start[last])

    def _look_again(self, at: int) -> None:
        block, size = self._block, WINDOW
        while True:
            until = min(block.n, at + size)
            inside = block.barriers[(block.barriers > at) & (block.barriers < until)] - at
            is_all = until == block.n
            part = Block(block.data[at:until], inside, block.final and is_all)
            spans, decided = self._protocol.frame(part)
            start, end, kind = spans.start + at, spans.end + at, spans.kind
            if is_all:
                self.start, self.end, self.kind = start, end, kind
                self.decided = at + decided
                return
            known = np.searchsorted(self.start, start)
            same = known < len(self.start)
            known = np.minimum(known, len(self.start) - 1)
            same &= (self.start[known] == start) & (self.end[known] == end)
            if self._protocol.ordered:  # answers in a row belong to the commands of all the row
                same &= _begins_a_row(start, end, kind)
                same &= _begins_a_row(self.start, self.end, self.kind)[known]
            if same.any():
                k = int(np.argmax(same))
                row = int(known[k])
                self.start = np.concatenate([start[:k], self.start[row:]])
                self.end = np.concatenate([end[:k], self.end[row:]])
                self.kind = np.concatenate([kind[:k], self.kind[row:]])
                return
            size *= 4


def _begins_a_row(start: I64, end: I64, kind: U8) -> Mask:
    """Tell which frames are requests that stand behind an answer, or behind nothing."""
    out: Mask = kind != RESPONSE
    out[1:] &= (start[1:] != end[:-1]) | (kind[:-1] == RESPONSE)
    return out
