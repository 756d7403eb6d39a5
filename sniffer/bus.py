"""Requests and their responses, by neighbour comparison; no protocol is named here.

The decoder cuts its blocks so that an open request and its answer always lie in one block. What a
request expects stands in the Frames columns (``reply``, ``token``, ``alt_id``).
"""

from __future__ import annotations

import itertools
from dataclasses import dataclass, replace
from typing import TYPE_CHECKING

import numpy as np

from sniffer.model import (
    ANY_ID,
    DAMAGED,
    I64,
    IF_ALL,
    IF_READ,
    MANY,
    MISMATCHED,
    MUST,
    NEVER,
    NO_ALT,
    NO_RESPONSE,
    NOT_EXPECTED,
    OK,
    RESPONSE,
    UNSOLICITED,
    Frames,
    Mask,
    Transactions,
)

if TYPE_CHECKING:
    from collections.abc import Sequence

    from sniffer.framing import Block


def open_request(frames: Frames, decided: int, reach: int) -> int | None:
    """Return the start of the last request if a reply to it may still come."""
    if not len(frames):
        return None
    asked = np.flatnonzero(frames.kind != RESPONSE)
    if not len(asked):
        return None
    row = int(asked[-1])
    expects = int(frames.reply[row])
    if expects == NEVER or (row != len(frames) - 1 and expects != MANY):
        return None
    end = int(frames.start[row] + frames.length[row])
    return int(frames.start[row]) if decided - end <= reach else None


def pair(
    frames: Frames, block: Block, until: int, reach: int, blank: bytes = b""
) -> tuple[Frames, Transactions, Mask]:
    """Give each response the request it answers.

    It takes over the request's op, and its address and servo id where it states none itself.

    Args:
        frames: rows in wire order.
        block: for its barriers, which no pair crosses.
        until: where the first thing left to a later batch begins.
        reach: bytes after which a request is closed.
        blank: byte values that mean nothing between frames.

    Returns:
        The frames, one transaction a request or unasked response (in order), and for each
        transaction whether unclaimed bytes stand right behind its request.
    """
    n = len(frames)
    none = np.empty(0, np.int64)
    if not n:
        empty = Transactions(none, none, np.empty(0, np.uint8), none, none)
        return frames, empty, np.empty(0, bool)
    rows = np.arange(n)
    is_response = frames.kind == RESPONSE
    end = frames.end
    answer, asked = _answers(frames, is_response, end, block, reach)
    alt = frames.alt_id[asked]
    fits = (frames.servo_id[answer] == frames.servo_id[asked]) | (alt == ANY_ID)
    fits |= (alt != NO_ALT) & (alt == frames.servo_id[answer])
    token = frames.token[answer]
    fits &= (token == frames.token[asked]) | (token == -1)
    op, address = frames.op.copy(), frames.address.copy()
    op[answer] = op[asked]
    # A response that states an address of its own keeps it.
    address[answer] = np.where(address[answer] >= 0, address[answer], address[asked])
    # A bare answer names nobody: it is that of the servo asked.
    servo_id = frames.servo_id
    bare = servo_id[answer] < 0
    if bare.any():
        servo_id = servo_id.copy()
        servo_id[answer[bare]] = servo_id[asked[bare]]

    following = np.append(frames.start[1:], until)
    if len(block.barriers):
        following = np.minimum(following, block.limit(end - 1))
    torn = following > end
    if blank and torn.any():
        _forgive(torn, block, end, following, blank)

    request = np.where(is_response, -1, rows)
    response = np.where(is_response, rows, -1)
    outcome = np.where(is_response, UNSOLICITED, NO_RESPONSE).astype(np.uint8)
    took = np.full(n, -1, np.int64)
    spread = np.full(n, -1, np.int64)
    many = frames.reply[asked] == MANY
    # A pair is one row: the request's, or the response's own where a request has many.
    at = np.where(many, answer, asked)
    request[at], response[at] = asked, answer
    outcome[at] = np.where(fits, OK, MISMATCHED)
    known = (frames.uncertainty[answer] >= 0) & (frames.uncertainty[asked] >= 0)
    took[at] = np.where(known, np.maximum(frames.t_start[answer] - frames.t_end[asked], 0), -1)
    spread[at] = np.where(
        known, np.maximum(frames.uncertainty[answer], frames.uncertainty[asked]), -1
    )
    keep = np.ones(n, bool)
    keep[answer[~many]] = False
    keep[asked[many]] = False
    kept = np.flatnonzero(keep)
    transactions = Transactions(request, response, outcome, took, spread).take(kept)
    return replace(frames, op=op, address=address, servo_id=servo_id), transactions, torn[kept]


def _forgive(torn: Mask, block: Block, end: I64, following: I64, blank: bytes) -> None:
    """Blanks behind a request are no torn answer."""
    data = block.data.tobytes()
    for i in np.flatnonzero(torn).tolist():
        if not data[int(end[i]) : int(following[i])].strip(blank):
            torn[i] = False


def _answers(
    frames: Frames, is_response: Mask, end: I64, block: Block, reach: int
) -> tuple[I64, I64]:
    """Return the rows of responses that answer a request, and the rows of those requests.

    A response answers the row before it; where a request is open to many, all that follow it.
    """
    follows = np.zeros(len(frames), bool)
    np.logical_and(is_response[1:], ~is_response[:-1], out=follows[1:])
    answer = np.flatnonzero(follows)
    asked = answer - 1
    if (frames.reply == MANY).any():
        rows = np.arange(len(frames))
        asked_by = np.maximum.accumulate(np.where(is_response, -1, rows))
        many = is_response & (asked_by >= 0) & (frames.reply[asked_by] == MANY)
        answer = np.flatnonzero(follows | many)
        asked = asked_by[answer]
    near = (frames.reply[asked] != NEVER) & (frames.start[answer] - end[asked] <= reach)
    if len(block.barriers):
        segment = block.segment(frames.start)
        near &= segment[answer] == segment[asked]
    return (answer, asked) if near.all() else (answer[near], asked[near])


@dataclass(frozen=True, slots=True)
class FeedbackWrite:
    """A servo's return mode became known (-1: unknown) at a row; ``servo_id`` -1: every servo's.

    With a ``new_id`` the servo took that one, and its return mode goes along.
    """

    row: int
    servo_id: int
    mode: int
    new_id: int = -1


class Expectations:
    """Which servos answer what: known from their return mode, or from having answered before.

    Modes: 0 nothing but pings, 1 reads, 2 everything; -1 not known (reads are answered, other
    commands may be).
    """

    def __init__(self) -> None:
        self._mode = np.full(256, -1, np.int64)

    def judge(
        self,
        frames: Frames,
        transactions: Transactions,
        torn: Mask,
        writes: Sequence[FeedbackWrite] = (),
    ) -> Transactions:
        """Settle the outcome of requests nobody answered."""
        outcome = transactions.outcome.copy()
        order = np.where(transactions.request >= 0, transactions.request, transactions.response)
        edges = [0, *(int(np.searchsorted(order, w.row, "right")) for w in writes), len(order)]
        for number, (a, b) in enumerate(itertools.pairwise(edges)):
            if number:
                write = writes[number - 1]
                where = slice(None) if write.servo_id < 0 else write.servo_id & 255
                if write.new_id >= 0:
                    self._mode[write.new_id] = self._mode[write.servo_id & 255]
                else:
                    self._mode[where] = write.mode
            if b > a:
                self._judge(frames, transactions, torn, outcome, slice(a, b))
        return replace(transactions, outcome=outcome)

    def _judge(
        self,
        frames: Frames,
        transactions: Transactions,
        torn: Mask,
        outcome: np.ndarray[tuple[int, ...], np.dtype[np.uint8]],
        part: slice,
    ) -> None:
        row: I64 = transactions.request[part]
        kind = transactions.outcome[part]
        asked = row >= 0
        reply = np.where(asked, frames.reply[row], NEVER)
        servo = frames.servo_id[row] & 255
        mode = self._mode[servo]
        answered = np.flatnonzero(asked & (kind == OK) & (reply == IF_ALL) & (mode != 2))
        if len(answered):
            # whoever answers a write once answers them all: later rows of that servo expect it
            who, first = np.unique(servo[answered], return_index=True)
            since = np.full(256, len(row))
            since[who] = answered[first]
            mode = np.where(np.arange(len(row)) > since[servo], 2, mode)
            self._mode[who] = 2
        alone = asked & (kind == NO_RESPONSE)
        expected = (reply >= MUST) | ((reply == IF_READ) & (mode != 0))
        expected |= (reply == IF_ALL) & (mode == 2)
        verdict = np.where(expected, np.where(torn[part], DAMAGED, NO_RESPONSE), NOT_EXPECTED)
        outcome[part] = np.where(alone, verdict, kind)
