"""Requests and their responses, in columns; no protocol is named here.

Which request an answer belongs to, ``matching`` finds; several may be open at once. What a request
expects stands in the Frames columns (``reply``, ``token``, ``alt_id``).

The decoder cuts its blocks in front of the first request that bytes to come may still answer. If an
exchange leads across that place, the block is cut before that exchange. One may lead into the next
without end; then the cut stays, and requests whose answers stand behind it are carried along.
"""

from __future__ import annotations

from dataclasses import replace
from typing import TYPE_CHECKING, Final, NamedTuple

import numpy as np

from sniffer.decoding.echo import Echoes
from sniffer.decoding.listing import Beside, questions_of
from sniffer.decoding.matching import match, match_in_order, outcomes
from sniffer.decoding.staging import StagedIds
from sniffer.decoding.torn import TornAnswers, room_behind
from sniffer.ground.asked import own_rows
from sniffer.ground.codes import (
    MANY,
    NEVER,
    NO_RESPONSE,
    NOT_EXPECTED,
    OK,
    ON_ITS_OWN,
    REQUEST,
    RESPONSE,
    UNSOLICITED,
)
from sniffer.ground.memory import Remembering
from sniffer.ground.model import ECHO, I64, U8, Frames, Mask, Transactions

if TYPE_CHECKING:
    from sniffer.ground.framing import Block
    from sniffer.ground.model import Batch
    from sniffer.protocols.base import BusProtocol

CHAIN: Final = 4096
"""Bytes within which a place is looked for that no exchange leads across. A controller that always
has another request under way never leaves one; holding more back would delay the screen (4096 bytes
take 0.36 s at 115200 baud) and bounds no memory."""


class Paired(NamedTuple):
    """What follows from which request each answer belongs to, for the frames before a cut."""

    frames: Frames
    transactions: Transactions
    """One a request or unasked response, in order; ``place`` is where each stands in the frames."""
    place: I64
    torn: Mask
    """For each transaction whether unclaimed bytes stand where its answer should."""
    readable: Mask
    """For each frame whether its values can be read."""
    accepted: Mask
    """For each frame whether they became true: false for a request that was refused."""
    before: Frames
    """Requests that are no row of these frames: ``-2 - row`` in the transactions. First those of
    earlier blocks that are answered here, then what lists ask of each servo."""

    def asking(self) -> tuple[Frames, I64]:
        """Return all requests, and the row of each transaction's in them; -1: nobody asked."""
        n, request = len(self.frames), self.transactions.request
        if not len(self.before):
            return self.frames, request
        both = Frames.concat([self.frames, self.before])
        return both, np.where(request < -1, n - 2 - request, request)

    @property
    def by_own_rows(self) -> Transactions:
        """The transactions with the row that each request stands in, -1 where that is none here."""
        request = own_rows(self.frames.start, self.before.start, self.transactions.request)
        return replace(self.transactions, request=request)

    def told(self, transactions: Transactions) -> Transactions:
        """Return the transactions without those whose answer a later block holds."""
        inside = transactions.response < len(self.frames)
        return transactions if inside.all() else transactions.take(inside)


class Pairing(Remembering):
    """Gives each response of a bus the request it answers, block after block."""

    PASSING = ("_owing", "_owed", "_how")
    PARTS = ("_echoes", "_staged_ids", "_torn")

    def __init__(self, protocol: BusProtocol) -> None:
        self._protocol = protocol
        self._longest = protocol.longest
        # Requests told already, whose answers are known but stand in bytes that are not.
        self._owing = Frames.empty()  # starts count from the beginning of the stream
        self._owed = np.empty(0, np.int64)  # the start of each answer, likewise
        self._how = np.empty(0, np.int64)
        self._echoes = Echoes()
        self._staged_ids = StagedIds(protocol)
        self._torn = TornAnswers(protocol)
        self._held: int | None = None  # from this row on it is not known what is an echo

    def match(
        self, frames: Frames, block: Block, decided: int, base: int, *, silent: bool = False
    ) -> tuple[Frames, I64]:
        """Mark echoes and new ids; return the frames, and the partner of each as ``match`` does.

        Args:
            frames: all rows of the block.
            block: for its bytes and its barriers, which no pair crosses.
            decided: how far every byte of the block has its fate.
            base: offset in the stream of the block's first byte.
            silent: a silence stands before the block.
        """
        frames = self._staged_ids.mark(frames)
        echo, self._held = self._echoes.find(frames, block, decided, silent=silent)
        if not echo.any():
            return frames, self._match(frames, block, base)
        rows = np.flatnonzero(~echo)
        found = self._match(frames.take(rows), block, base)
        partner = np.full(len(frames), -1, np.int64)
        behind = np.where(found < -1, -2 - found, found)
        partner[rows] = np.where(
            found >= 0, rows[behind], np.where(found < -1, -2 - rows[behind], -1)
        )
        flags = frames.flags | np.where(echo, np.uint8(ECHO), np.uint8(0))
        return replace(frames, flags=flags), partner

    def _match(self, frames: Frames, block: Block, base: int) -> I64:
        if self._protocol.ordered:
            return match_in_order(frames)
        segment = block.segment(frames.start) if len(block.barriers) else None
        claimed = np.isin(frames.start + base, self._owed) if len(self._owed) else None
        return match(frames, segment, self._protocol.reach, claimed)

    def cut(self, frames: Frames, partner: I64, decided: int, block: Block) -> int | None:
        """Return the row of a block's cut: nothing before it is open. None: behind all frames."""
        alone = self.open_rows(frames, partner, decided, block)
        first = int(alone[0]) if len(alone) else None
        if self._held is not None:
            first = self._held if first is None else min(first, self._held)
        if first is None:
            return None
        clear = _clear(frames, partner, first)
        # How many answers stand in a row is known from all of their requests.
        near = frames.start[first] - frames.start[clear] <= CHAIN or self._protocol.ordered
        return clear if near else first

    def clear_at(self, frames: Frames, partner: I64, cut: int) -> int:
        """Return the last place up to ``cut`` that no exchange leads across; ``cut`` if far."""
        row = int(np.searchsorted(frames.start, cut))
        clear = _clear(frames, partner, row)
        if clear == row or not (self._protocol.ordered or cut - frames.start[clear] <= CHAIN):
            return cut
        return int(frames.start[clear])

    def forget(self, frames: Frames, block: Block, kept: int, cut: int) -> None:
        """Keep what the next block must know; it begins at ``cut``, with row ``kept``."""
        self._echoes.forget(frames, block, kept, cut)
        self._staged_ids.forget(frames.take(slice(0, kept)))

    def open_rows(self, frames: Frames, partner: I64, decided: int, block: Block) -> I64:
        """Return the rows of the requests that bytes from ``decided`` on may still answer.

        That others have closed it does not count: torn bytes may still be its answer.
        """
        near = int(np.searchsorted(frames.start, decided - self._protocol.reach - self._longest))
        # A silence ends them, once it is known what the bytes before it are: where another protocol
        # is on the wire, it may hold those up.
        passed = block.barriers[block.barriers <= decided]
        last = int(passed[-1]) if len(passed) else 0
        near = max(near, int(np.searchsorted(frames.start, last)))
        tail = frames.take(slice(near, None))
        asks = (tail.kind == REQUEST) & (tail.reply != NEVER) & (tail.flags & ECHO == 0)
        asks &= decided - tail.end <= self._protocol.reach
        behind = partner[near:]
        answered = np.zeros(len(tail), bool)
        answered[behind[behind >= near] - near] = True
        return near + np.flatnonzero(asks & (~answered | (tail.reply == MANY)))

    def pair(
        self, frames: Frames, whole: Frames, partner: I64, block: Block, decided: int, base: int
    ) -> Paired:
        """Give each response the request it answers.

        It takes over the request's op, and its address and servo id where it states none itself;
        but one that does not fit keeps the name it bears, and is read where that is enough.

        For example, a question with its answer, one without, one whose answer is too short, and an
        answer of servo 3, whom nobody asked::

            row       0   1   2   3   4   5
            partner   -1  0   -1  -1  -5  -1     -5: behind row 3, and does not fit (-2 - 3)
            asked     0   3                      rows with an answer, and ...
            answer    1   4                      ... where that stands
            how       0   3                      OK, MISMATCHED
            request   0   -1  2   3   -1  -1     a transaction as each row would tell it
            response  1   1   -1  4   4   5
            keep      1   0   1   1   0   1      an answer with a request is told by that

        Invariant: every request and every answer stands in exactly one row that is kept. Rows are
        not put together from pairs and leftovers: they would have to be sorted, and are in order.

        Args:
            frames: rows before the cut, with times.
            whole: the same rows and those behind the cut.
            partner: what ``match`` returned for those.
            block: for its barriers, which no pair crosses.
            decided: how far every byte of the block has its fate.
            base: offset in the stream of the block's first byte.
        """
        n = len(frames)
        protocol = self._protocol
        answer, asked, how = outcomes(partner)
        now = asked < n
        answer, asked, how = answer[now], asked[now], how[now]
        inside = answer < n
        due, late, late_how = self._due(frames, base)
        questions = questions_of(protocol, block, frames, whole, partner)
        later = ~inside
        if questions is not None:
            self._owe(*questions.later(n), whole, base)
            later &= ~np.isin(answer, questions.answer)
        self._owe(frames.take(asked[later]), answer[later], how[later], whole, base)
        if not n:
            none = np.empty(0, np.int64)
            nothing = np.empty(0, bool)
            return Paired(frames, Transactions.empty(), none, nothing, nothing, nothing, due)
        is_response = frames.kind == RESPONSE
        refused = np.zeros(n, bool)
        status = whole.status[answer]
        no = (how == OK) & (status >= 0) & protocol.refused(status)
        refused[asked[no]] = True
        torn = self._torn.find(whole, partner, block, decided, base, n, across=not inside.all())

        rows = np.arange(n)
        request = np.where(is_response, -1, rows)
        response = np.where(is_response, rows, -1)
        outcome = np.where(is_response, UNSOLICITED, NO_RESPONSE).astype(np.uint8)
        took, spread = np.full(n, -1, np.int64), np.full(n, -1, np.int64)
        keep = np.ones(n, bool)
        many = frames.reply[asked] == MANY
        # A pair is one row: the request's, or the response's own where a request has many.
        if many.any() or not inside.all():
            keep[answer[inside & ~many]] = False
            keep[asked[many]] = False
            told = inside | ~many
            at = np.where(many, answer, asked)[told]
            request[at], response[at], outcome[at] = asked[told], answer[told], how[told]
            at = np.where(many, answer, asked)[inside]
            answer, asked, how = answer[inside], asked[inside], how[inside]
        else:
            at = asked
            keep[answer] = False
            response[at], outcome[at] = answer, how
        echo = frames.flags & ECHO > 0
        sent = asked
        if echo.any():
            outcome[echo] = NOT_EXPECTED
            # The echo tells when the request was on the wire, not when the adapter was given it.
            sent = asked + np.append(echo, False)[asked + 1]
        took[at], spread[at] = _took(frames, answer, frames, sent)
        fits = how == OK

        readable = ~is_response & ~echo
        readable[answer[fits]] = readable[late[late_how == OK]] = True
        # What does not fit keeps the name it bears, if it bears one.
        own = is_response & ~readable & (frames.op >= 0)
        odd = np.flatnonzero(is_response & ~readable)
        if len(odd):
            readable[odd] = protocol.states_itself(frames.take(odd))
        readable &= frames.data_length > 0
        frames = _told_by(frames, answer, frames, asked, own)
        frames = _told_by(frames, late, due, np.arange(len(late)), own)
        beside = _of_due(frames, due, late, late_how)
        if questions is not None:
            keep[questions.row] = False
            room = room_behind(whole, block, decided)
            beside = beside.and_those(questions.until(n).told(torn, room, took, spread))
        keep[beside.place] = False
        place = np.flatnonzero(keep)
        transactions = Transactions(request, response, outcome, took, spread).take(place)
        torn = torn[place]
        if len(beside.place):
            transactions, place, torn = beside.among(transactions, place, torn)
        return Paired(frames, transactions, place, torn, readable, ~refused, beside.asks)

    def _due(self, frames: Frames, base: int) -> tuple[Frames, I64, U8]:
        """Return requests of earlier blocks, the rows that answer them, and the outcomes."""
        if not len(self._owed):
            return self._owing, np.empty(0, np.int64), np.empty(0, np.uint8)
        row = np.searchsorted(frames.start, self._owed - base)
        here = row < len(frames)
        before, how, row = self._owing.take(here), self._how[here], row[here]
        self._owing, self._owed = self._owing.take(~here), self._owed[~here]
        self._how = self._how[~here]
        start, data_start = before.start - base, before.data_start - base
        return replace(before, start=start, data_start=data_start), row, how.astype(np.uint8)

    def _owe(self, asks: Frames, answer: I64, how: I64, whole: Frames, base: int) -> None:
        if not len(answer):
            return
        asks = replace(asks, start=asks.start + base, data_start=asks.data_start + base)
        self._owing = Frames.concat([self._owing, asks])
        self._owed = np.concatenate([self._owed, whole.start[answer] + base])
        self._how = np.concatenate([self._how, how])


def _clear(frames: Frames, partner: I64, row: int) -> int:
    """Return the last row up to ``row`` that no exchange leads across.

    Over row r lead all exchanges that are asked before it and answered from it on:
    +1 behind each question, -1 behind its answer, summed up. Row 3 answers 1, row 4 answers 2::

        row      0  1  2  3  4  5
        kind     Q  Q  Q  A  A  Q       row 5 waits for its answer and asks where to cut: before 5
        edges    0  0  1  1 -1 -1  0
        open     0  0  1  2  1  0       were it row 4 that waited, the cut would be before row 1
    """
    answer, asked, _ = outcomes(partner[row:])
    if not (asked < row).any():
        return row
    answer, asked, _ = outcomes(partner)
    edges = np.zeros(len(frames) + 2, np.int64)
    np.add.at(edges, asked + 1, 1)
    np.add.at(edges, answer + 1, -1)
    return int(np.flatnonzero(np.cumsum(edges[: row + 1]) == 0)[-1])


def _of_due(frames: Frames, due: Frames, late: I64, how: U8) -> Beside:
    """Return the transactions of requests of earlier blocks, which the rows ``late`` answer."""
    took, spread = _took(frames, late, due, np.arange(len(late)))
    return Beside(due, late, how, took, spread, late, np.zeros(len(late), bool))


def _took(answers: Frames, answer: I64, requests: Frames, asked: I64) -> tuple[I64, I64]:
    """Return response times and their uncertainties, -1 where they are not known."""
    unsure = answers.uncertainty[answer], requests.uncertainty[asked]
    known = (unsure[0] >= 0) & (unsure[1] >= 0)
    if not known.any():
        return np.full(len(answer), -1), np.full(len(answer), -1)
    took = np.maximum(answers.t_start[answer] - requests.t_end[asked], 0)
    return np.where(known, took, -1), np.where(known, np.maximum(*unsure), -1)


def _told_by(frames: Frames, answer: I64, requests: Frames, asked: I64, own: Mask) -> Frames:
    """Fill in what responses do not state themselves; rows of ``own`` keep what they do."""
    if not len(answer):
        return frames
    op, address, servo_id = frames.op.copy(), frames.address.copy(), frames.servo_id
    kept = own[answer]
    some, of = (answer[~kept], asked[~kept]) if kept.any() else (answer, asked)
    op[some] = requests.op[of]
    states = address[some] >= 0
    if states.any():
        some, of = some[~states], of[~states]
    address[some] = requests.address[of]
    # A bare answer names nobody: it is that of the servo asked.
    bare = servo_id[answer] < 0
    if bare.any():
        servo_id = servo_id.copy()
        servo_id[answer[bare]] = requests.servo_id[asked[bare]]
    return replace(frames, op=op, address=address, servo_id=servo_id)


def unasked(batch: Batch) -> Mask:
    """Tell which transactions are answers that fit no request: not what comes of its own later."""
    t, token = batch.transactions, batch.frames.token
    own = token[np.maximum(t.response, 0)] == ON_ITS_OWN
    rows: Mask = (t.outcome == UNSOLICITED) & ~own
    return rows
