"""Which request does an answer belong to? In columns; ``pending`` says what is right.

On most buses one request is open at a time, and every answer stands right behind the request it
fits: one comparison of neighbours finds that, and is all there is to do. Only around answers that
it leaves over are rows grouped by key, and only runs that hold one of those are matched anew.

By key means: rows that agree in all that a question and its answer share (servo, token, stretch
between silences) are put side by side, in wire order within. Two controllers' reads of servos 1
and 2, both asked before either answers::

    row      0   1   2   3   4   5        key (1, 2):  Q0  A2      run "Q A":   A2 answers Q0
    kind     Q   Q   A   A   Q   A        key (2, 2):  Q1  A3      run "Q A":   A3 answers Q1
    servo    1   2   1   2   2   2                     Q4  A5      run "Q A":   A5 answers Q4
    token    2   2   2   2   2   2

By neighbours A2 stands behind Q1, which it does not fit, and A3 behind no question; A5 fits Q4.
In a run of q questions and a answers the last answer that is in time is the last question's, and so
on backwards (``mirror`` in ``by_key``): the older a question, the likelier it was given up.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import TYPE_CHECKING, Final

import numpy as np

from sniffer.ground.codes import MANY, MISMATCHED, NEVER, OK, ON_ITS_OWN, REQUEST, RESPONSE
from sniffer.ground.distinct import numbers
from sniffer.ground.framing import in_order
from sniffer.ground.model import ANY_ID, DEPTH, I64, NO_ALT, Frames, Mask

if TYPE_CHECKING:
    from collections.abc import Sequence

_MIX: Final = np.uint64(0x9E3779B97F4A7C15)
"""Odd, and its bits are as good as random: 2 ** 64 / golden ratio."""

BEFORE, BEHIND = 3, 2
"""How many reaches around an answer left over are looked at. A run that it is in lies within two
before it and one behind; the first answer to a request of that run, one more before."""

SPARSE: Final = 8
"""Where more than one row in so many is an answer left over, looking at each does not pay."""


def match(frames: Frames, segment: I64 | None, reach: int, claimed: Mask | None = None) -> I64:
    """Return for each row the row of the request it answers.

    -1 stands for none, and ``-2 - row`` for one that it stands behind but does not fit.

    Args:
        frames: rows in wire order.
        segment: the number of the silence-bounded stretch each begins in; None: all in one.
        reach: bytes after which a request is closed.
        claimed: answers to requests that stand before the first row.
    """
    n = len(frames)
    partner = np.full(n, -1, np.int64)
    answers = (frames.kind == RESPONSE) & (frames.token != ON_ITS_OWN)
    if claimed is not None:
        answers &= ~claimed
    rows = _Rows(frames, segment, reach)
    answer, asked = rows.neighbours(answers)
    fits = rows.fits(asked, answer)
    partner[answer[fits]] = asked[fits]
    left = answers.copy()
    left[answer[fits]] = False
    over = rows.in_question(np.flatnonzero(left), partner)
    if not len(over):
        rows.left_over(np.flatnonzero(left), partner)
        return partner
    left[:] = False
    left[over] = True
    near = rows.around(over)
    part: _Rows = rows
    place: I64 | None = None
    if near is not None:
        part = rows.take(near)
        place = np.cumsum(np.diff(near, prepend=-1) > 1, dtype=np.int64)
    own = answers if near is None else answers[near]
    asked, answer, anew = part.by_key(own, left if near is None else left[near], place)
    if near is not None:
        asked, answer, anew = near[asked], near[answer], near[anew]
    # What a request to all has by neighbourhood may be another's, never the reverse.
    partner[anew] = -1
    partner[answer] = asked
    rows.left_over(np.flatnonzero(answers & (partner < 0)), partner)
    return partner


def match_in_order(frames: Frames) -> I64:
    """Return the same where answers name nobody: they come in the order of their requests."""
    answers = frames.kind == RESPONSE
    asks = (frames.kind == REQUEST) & (frames.reply != NEVER)
    partner = np.full(len(frames), -1, np.int64)
    if (answers[1:] & answers[:-1]).any():
        answer = np.flatnonzero(answers)
        asked = in_order(answers)[answer]
        fits = (asked >= 0) & asks[asked]
        partner[answer[fits]] = asked[fits]
        return partner
    row = np.flatnonzero(answers[1:] & asks[:-1])
    partner[row + 1] = row
    return partner


def outcomes(partner: I64) -> tuple[I64, I64, I64]:
    """Return the answers that have a request, those requests, and whether they fit: OK or not."""
    answer = np.flatnonzero(partner != -1)
    asked = partner[answer]
    fits = asked >= 0
    if fits.all():
        return answer, asked, np.full(len(answer), OK)
    how = np.where(fits, OK, MISMATCHED)
    return answer, np.where(fits, asked, -2 - asked), how


@dataclass(frozen=True, slots=True)
class _Rows:
    """Frames to be matched, with what is derived from them."""

    frames: Frames
    segment: I64 | None
    reach: int

    def take(self, index: I64) -> _Rows:
        segment = None if self.segment is None else self.segment[index]
        return _Rows(self.frames.take(index), segment, self.reach)

    def near(self, asked: I64, answer: I64) -> Mask:
        """Tell which answers begin within reach, on the same side of all silences."""
        f = self.frames
        out: Mask = f.start[answer] - f.start[asked] - f.length[asked] <= self.reach
        if self.segment is not None:
            out &= self.segment[answer] == self.segment[asked]
        return out

    def names(self, asked: I64, answer: I64) -> Mask:
        """Tell which answers come from a servo that was asked."""
        f = self.frames
        alt, who = f.alt_id[asked], f.servo_id[answer]
        out: Mask = (who == f.servo_id[asked]) | (alt == ANY_ID)
        out |= (alt != NO_ALT) & (alt == who)
        return out

    def fits(self, asked: I64, answer: I64) -> Mask:
        token = self.frames.token[answer]
        out: Mask = (token == self.frames.token[asked]) | (token == -1)
        return out & self.names(asked, answer)

    def neighbours(self, answers: Mask) -> tuple[I64, I64]:
        """Return the answers right behind a request, behind one to all of them all, and those."""
        f = self.frames
        sends = f.kind != RESPONSE
        follows = np.zeros(len(f), bool)
        np.logical_and(answers[1:], sends[:-1], out=follows[1:])
        answer = np.flatnonzero(follows)
        asked = answer - 1
        if (f.reply == MANY).any():
            asked_by = np.maximum.accumulate(np.where(sends, np.arange(len(f)), -1))
            many = answers & (asked_by >= 0) & (f.reply[asked_by] == MANY)
            answer = np.flatnonzero(follows | many)
            asked = asked_by[answer]
        near = (f.reply[asked] != NEVER) & self.near(asked, answer)
        return (answer, asked) if near.all() else (answer[near], asked[near])

    def in_question(self, left: I64, partner: I64) -> I64:
        """Return which answers left over a request may have after all.

        A run is matched otherwise than by neighbours only where an answer left over finds a
        request open that no neighbour answers; on a bad line most find none.
        """
        f = self.frames
        if not len(left) or len(left) > len(f) // SPARSE:
            return left
        alone = (f.kind == REQUEST) & (f.reply != NEVER) & (f.reply != MANY)
        alone &= ~_asked(partner)
        asked = np.flatnonzero(alone)
        last = np.searchsorted(asked, left)
        many = np.minimum(last, DEPTH)
        of = np.repeat(np.arange(len(left)), many)
        q = asked[np.arange(len(of)) - np.repeat(np.cumsum(many) - last, many)]
        r = left[of]
        may = np.zeros(len(left), bool)
        may[of[self.near(q, r) & self.fits(q, r)]] = True
        return left[may]

    def around(self, left: I64) -> I64 | None:
        """Return the rows whose matching an answer left over can alter; None: (nearly) all."""
        f = self.frames
        span = self.reach + int(f.length.max())
        first = np.searchsorted(f.start, f.start[left] - BEFORE * span)
        last = np.searchsorted(f.start, f.start[left] + BEHIND * span, "right")
        if int((last - first).sum()) > len(f) // 2 and len(left) > len(f) // SPARSE:
            return None
        edges = np.zeros(len(f) + 1, np.int64)
        np.add.at(edges, first, 1)
        np.add.at(edges, last, -1)
        return np.flatnonzero(np.cumsum(edges[:-1]) > 0)

    def open(self, count: I64, asked: I64, answer: I64) -> Mask:
        """Tell which answers find their request open; ``count``: requests up to each row."""
        out = self.near(asked, answer) & (asked < answer)
        return out & (count[answer] - count[asked] < DEPTH)

    def by_key(self, answers: Mask, left: Mask, place: I64 | None) -> tuple[I64, I64, I64]:
        """Match the runs that hold an answer left over.

        ``place`` numbers the stretches that these rows were taken from: no run leads from one to
        the next. Returns requests, their answers, and all answers of those runs.

        For example, servo 1 is asked, then 2, then 1 again; 2 answers, then 1 twice::

            servo   1  2  1  2  1  1
            back    0  1  0  0  1  1        from here on in the order of the keys
            order   1  3  0  2  4  5        servo 2 and its answer, then what is servo 1's
            first   1  0  1  0  0  0        two runs
            middle  1  4                    where the answers of each begin
            rank    0  0  1                 of each answer in its run
            mirror  1  2  0                 the question that each would have, last one first
            step    1  2                    how many of these are open, by run
            hit     1  4  5                 in ``order``: the rows 3 4 5 answer 1 0 2

        What holds: in a run the answers are in the order of their questions, and the last answer
        that counts has the last question; a question too many goes without, the first one. To
        give each answer the nearest open question would turn two answers around.
        """
        f, none = self.frames, np.empty(0, np.int64)
        asks = (f.kind == REQUEST) & (f.reply != NEVER)
        directed = asks & (f.reply != MANY)
        count = np.cumsum(asks, dtype=np.int64)
        servo, token = f.servo_id.astype(np.int64), f.token.copy()
        counts = directed | answers
        self._resolve(servo, token, counts, directed, answers, count)
        parts = [servo, token, self.segment, self._epochs(asks, token), place]
        rows = np.flatnonzero(counts)
        if not len(rows):
            return none, none, none
        # From here on arrays are in the order of the keys. A run begins with a new key, or where a
        # question follows an answer; ``middle`` is where its answers begin, ``rank`` counts them.
        order, first = _grouped([p[rows] for p in parts if p is not None])
        order = rows[order]
        back = answers[order]
        first[1:] |= ~back[1:] & back[:-1]
        begin = np.flatnonzero(first)
        run = np.cumsum(first) - 1
        asked = np.add.reduceat(~back, begin, dtype=np.int64)
        middle = begin + asked
        at = np.flatnonzero(back)
        rank = at - middle[run[at]]
        live = rank < asked[run[at]]
        # The r-th answer's mirror is the r-th question counted back from the middle. Only how many
        # of them are open in time matters: that many steps the answers are moved, all alike.
        mirror = order[middle[run[at[live]]] - 1 - rank[live]]
        live[live] = self.open(count, mirror, order[at[live]])
        step = np.bincount(run[at[live]], minlength=len(begin))
        # One too late for its run alters nothing; and only of such runs all requests are at hand.
        anew = np.zeros(len(begin), bool)
        anew[run[at[live & left[order[at]]]]] = True
        of = anew[run[at]]
        at, rank = at[of], rank[of]
        hit = at[rank < step[run[at]]]
        return order[hit - step[run[hit]]], order[hit], order[at]

    def _epochs(self, asks: Mask, token: I64) -> I64 | None:
        """Number what lies between two requests to all that have a row's token."""
        f = self.frames
        every = np.flatnonzero(asks & (f.reply == MANY))
        if not len(every):
            return None
        out = np.zeros(len(f), np.int64)
        for asked in numbers(f.token[every]).tolist():
            mine = np.zeros(len(f), np.int64)
            mine[every[f.token[every] == asked]] = 1
            out += np.where(token == asked, np.cumsum(mine), 0)
        return out

    def _resolve(
        self, servo: I64, token: I64, counts: Mask, directed: Mask, answers: Mask, count: I64
    ) -> None:
        """Give the rows that fit several keys one of them: they are rare, so one by one."""
        f = self.frames
        wild = directed & (f.alt_id != NO_ALT) | answers & (token == -1)
        back = np.flatnonzero(f.kind == RESPONSE)
        sent = np.flatnonzero(directed)
        named = np.flatnonzero(directed & (f.alt_id == NO_ALT))
        every = np.flatnonzero((f.kind == REQUEST) & (f.reply == MANY))
        told: list[tuple[int, int, int]] = []
        for row in np.flatnonzero(wild).tolist():
            counts[row] = False
            if directed[row]:
                until = np.searchsorted(f.start, f.end[row] + self.reach, "right")
                first, last = np.searchsorted(back, [row, until])
                r = back[first:last]
                q = np.full(len(r), row)
                r = r[self.open(count, q, r) & self.fits(q, r)]
                if f.alt_id[row] == ANY_ID:
                    r = r[~self._own(named, row, r)]
                told += [(row, int(servo[r[0]]), int(token[row]))] if len(r) else []
                continue
            last = int(np.searchsorted(sent, row))
            q = sent[max(last - DEPTH, 0) : last]
            r = np.full(len(q), row)
            q = q[self.names(q, r) & self.open(count, q, r)]
            behind = int(np.searchsorted(every, row))
            q = q[q > every[behind - 1]] if behind else q
            told += [(row, int(servo[row]), int(f.token[q[-1]]))] if len(q) else []
        for row, who, what in told:
            counts[row], servo[row], token[row] = True, who, what

    def _own(self, named: I64, row: int, answers: I64) -> Mask:
        """Tell which answers come from a servo that was asked by name behind a row that asks any.

        Then it is that request's: an answer to the one before would have come before it.
        """
        first = int(np.searchsorted(named, row))
        out = np.zeros(len(answers), bool)
        for k, answer in enumerate(answers.tolist()):
            q = named[first : int(np.searchsorted(named, answer))]
            out[k] = bool(self.fits(q, np.full(len(q), answer)).any())
        return out

    def left_over(self, left: I64, partner: I64) -> None:
        """Settle the answers that no request to their servo is open for."""
        if not len(left):
            return
        f = self.frames
        asks = (f.kind == REQUEST) & (f.reply != NEVER)
        if (f.reply == MANY).any():
            left = self._of_all(left, asks, partner)
        q = left - 1
        misfit = (q >= 0) & asks[q] & (f.reply[q] != MANY) & ~_asked(partner)[q]
        misfit &= self.near(q, left)
        partner[left[misfit]] = -2 - q[misfit]

    def _of_all(self, left: I64, asks: Mask, partner: I64) -> I64:
        """Give answers to the latest request to all that they fit; return the others."""
        f = self.frames
        count = np.cumsum(asks, dtype=np.int64)
        every = np.flatnonzero(asks & (f.reply == MANY))
        requests = np.flatnonzero(f.kind == REQUEST)
        rest: list[int] = []
        for row in left.tolist():
            last = int(np.searchsorted(every, row))
            q: I64 = every[max(last - DEPTH, 0) : last]
            r: I64 = np.full(len(q), row)
            open_to = self.open(count, q, r)
            good: I64 = q[open_to & self.fits(q, r)]
            before = int(np.searchsorted(requests, row)) - 1
            if len(good):
                partner[row] = good[-1]
            elif len(q) and requests[before] == q[-1] and open_to[-1]:
                partner[row] = -2 - q[-1]
            else:
                rest.append(row)
        return np.array(rest, np.int64)


def _asked(partner: I64) -> Mask:
    """Tell which rows somebody answers.

    What is no row is negative, down to -2 - n: it falls behind the rows, where it does no harm.
    Picking out those that are would take thrice as long.
    """
    n = len(partner)
    out = np.zeros(2 * n + 2, bool)
    out[partner] = True
    return out[:n]


def _grouped(parts: Sequence[I64]) -> tuple[I64, Mask]:
    """Return an order that groups equal keys, in wire order within, and where each group begins.

    Sixteen bits of a hash are sorted by radix; where two keys share them all are sorted in full.
    """
    mixed = np.zeros(len(parts[0]), np.uint64)
    for p in parts:
        mixed = (mixed ^ p.astype(np.uint64)) * _MIX
        mixed ^= mixed >> np.uint64(29)
    short = ((mixed * _MIX) >> np.uint64(48)).astype(np.uint16)
    order = np.argsort(short, kind="stable")
    first = _edges(parts, order)
    same = short[order]
    if (first[1:] & (same[1:] == same[:-1])).any():
        order = np.lexsort(parts)
        first = _edges(parts, order)
    return order, first


def _edges(parts: Sequence[I64], order: I64) -> Mask:
    out = np.ones(len(order), bool)
    if len(order):
        out[1:] = False
    for p in parts:
        sorted_by_key = p[order]
        out[1:] |= sorted_by_key[1:] != sorted_by_key[:-1]
    return out
