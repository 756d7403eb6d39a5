"""Which servos are expected to answer what, so that silence is a fault or none."""

from __future__ import annotations

import itertools
from dataclasses import replace
from typing import TYPE_CHECKING

import numpy as np

from sniffer.ground.codes import (
    DAMAGED,
    IF_ALL,
    IF_READ,
    MUST,
    NO_RESPONSE,
    NOT_EXPECTED,
    OK,
)
from sniffer.ground.memory import Remembering
from sniffer.ground.model import ECHO

if TYPE_CHECKING:
    from collections.abc import Sequence

    from sniffer.anomalies.learned import FeedbackWrite
    from sniffer.decoding.pairing import Paired
    from sniffer.ground.model import I64, U8, Frames, Mask, Transactions


class Expectations(Remembering):
    """Which servos answer what: known from their return mode, or from having answered before.

    Modes: 0 nothing but pings, 1 reads, 2 everything; -1 not known (reads are answered, other
    commands may be).
    """

    LASTING = ("_mode",)

    def __init__(self) -> None:
        self._mode = np.full(256, -1, np.int64)

    def judge(
        self,
        paired: Paired,
        writes: Sequence[FeedbackWrite] = (),
    ) -> Transactions:
        """Settle the outcome of requests nobody answered."""
        frames, request = paired.asking()
        transactions, torn = replace(paired.transactions, request=request), paired.torn
        outcome = transactions.outcome.copy()
        order = paired.place
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
        return replace(paired.transactions, outcome=outcome)

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
        mode: I64 | None = None
        if (frames.reply == IF_ALL).any():
            mode = self._proved(frames, transactions, part, row, kind)
        alone = np.flatnonzero((kind == NO_RESPONSE) & (row >= 0))
        if not len(alone):
            return
        asked = row[alone]
        reply = frames.reply[asked]
        known = self._mode[frames.servo_id[asked] & 255] if mode is None else mode[alone]
        expected = (reply >= MUST) | ((reply == IF_READ) & (known != 0))
        expected |= (reply == IF_ALL) & (known == 2)
        verdict = np.where(torn[part][alone], DAMAGED, NO_RESPONSE)
        outcome[part][alone] = np.where(expected, verdict, NOT_EXPECTED)

    def _proved(
        self, frames: Frames, transactions: Transactions, part: slice, row: I64, kind: U8
    ) -> I64:
        """Return each row's mode, by what is known and what answers to writes prove on the way."""
        asked = row >= 0
        row = np.where(asked, row, 0)
        servo = frames.servo_id[row] & 255
        mode: I64 = self._mode[servo]
        # Among several open requests the answer may be another's: right behind its own it is not.
        behind = row + 1
        echo = frames.flags & ECHO > 0
        if echo.any():
            behind += np.append(echo, False)[behind]
        proof = asked & (kind == OK) & (transactions.response[part] == behind)
        answered = np.flatnonzero(proof & (frames.reply[row] == IF_ALL) & (mode != 2))
        if len(answered):
            # whoever answers a write once answers them all: later rows of that servo expect it
            who, first = np.unique(servo[answered], return_index=True)
            since = np.full(256, len(row))
            since[who] = answered[first]
            mode = np.where(np.arange(len(row)) > since[servo], 2, mode)
            self._mode[who] = 2
        return mode
