"""What a request to a list of servos asks of each, and what became of that.

Such a request is one packet and many questions. Each servo in the list is taken for asked by
itself: it has a transaction of its own, answered or not.
"""

from __future__ import annotations

from dataclasses import dataclass, replace
from typing import TYPE_CHECKING, NamedTuple

import numpy as np

from sniffer.decoding.matching import outcomes
from sniffer.ground.codes import NO_RESPONSE
from sniffer.ground.model import ECHO, NO_ALT, Frames, Transactions
from sniffer.protocols.listing import targets_of

if TYPE_CHECKING:
    from sniffer.ground.framing import Block
    from sniffer.ground.model import I64, U8, Mask
    from sniffer.protocols.base import BusProtocol


@dataclass(frozen=True, slots=True)
class Questions:
    """One row a servo of a list, in the order of requests and of their lists."""

    asks: Frames
    """The request as one to this servo alone."""
    row: I64
    """The row of the request that lists it."""
    answer: I64
    """The row of its answer, -1 where there is none."""
    outcome: U8
    behind: I64
    """The row behind which its answer stands or should stand."""
    begins: I64
    """How many bytes of a packet for all stand before its own."""

    def take(self, index: Mask) -> Questions:
        """Return some of them."""
        return Questions(
            self.asks.take(index),
            self.row[index],
            self.answer[index],
            self.outcome[index],
            self.behind[index],
            self.begins[index],
        )

    def later(self, n: int) -> tuple[Frames, I64, I64]:
        """Return those that a row from ``n`` on answers, with that row and the outcome."""
        mine = self.answer >= n
        return self.asks.take(mine), self.answer[mine], self.outcome[mine].astype(np.int64)

    def until(self, n: int) -> Questions:
        """Return those that no row from ``n`` on answers."""
        return self.take(self.answer < n)

    def told(self, torn: Mask, room: I64, took: I64, spread: I64) -> Beside:
        """Return their transactions.

        Args:
            torn: behind which rows torn bytes stand.
            room: how many stand right behind each.
            took: the response time of each row that is an answer.
            spread: its uncertainty.
        """
        answered = self.answer >= 0
        # Of a packet for all that is cut short, those whose bytes are not in it said nothing.
        reached = (self.begins == 0) | (room[self.behind] > self.begins)
        return Beside(
            self.asks,
            self.answer,
            self.outcome,
            np.where(answered, took[self.answer], -1),
            np.where(answered, spread[self.answer], -1),
            np.where(answered, self.answer, self.row),
            torn[self.behind] & reached & ~answered,
        )


class Beside(NamedTuple):
    """Transactions whose requests are no row of their own; ``place`` is where each stands."""

    asks: Frames
    response: I64
    outcome: U8
    took: I64
    spread: I64
    place: I64
    torn: Mask

    def and_those(self, more: Beside) -> Beside:
        """Return these and further ones behind them."""
        return Beside(
            Frames.concat([self.asks, more.asks]),
            np.concatenate([self.response, more.response]),
            np.concatenate([self.outcome, more.outcome]),
            np.concatenate([self.took, more.took]),
            np.concatenate([self.spread, more.spread]),
            np.concatenate([self.place, more.place]),
            np.concatenate([self.torn, more.torn]),
        )

    def among(
        self, transactions: Transactions, place: I64, torn: Mask
    ) -> tuple[Transactions, I64, Mask]:
        """Return transactions, where they stand and whether they are torn, with these in order."""
        request = -2 - np.arange(len(self.place))
        own = Transactions(request, self.response, self.outcome, self.took, self.spread)
        place = np.concatenate([place, self.place])
        order = np.argsort(place, kind="stable")
        both = Transactions.concat([transactions, own]).take(order)
        return both, place[order], np.concatenate([torn, self.torn])[order]


def questions_of(
    protocol: BusProtocol, block: Block, frames: Frames, whole: Frames, partner: I64
) -> Questions | None:
    """Return what the requests among ``frames`` ask of each servo they list; None: of nobody.

    For example a read of servos 1, 2 and 3 (row 0), of which 2 says nothing; 3 answers twice::

        row       0   1   2   3
        servo     254 1   3   3
        partner   -1  0   0   -2      row 3 does not fit: one answer a servo is asked for

        servo     1   2   3           a row for each that is listed
        answer    1   -1  2
        behind    0   1   1           2 would answer behind 1, and so would 3

    Args:
        protocol: says who is listed.
        block: what the frames stand in.
        frames: rows before a cut, with times.
        whole: the same rows and those behind the cut.
        partner: the request of each of those, as ``match`` returned it.
    """
    targets = targets_of(protocol, block, frames)
    if targets is None:
        return None
    sent = frames.flags[targets.row] & ECHO == 0
    row, servo_id, by, address, length, reply, begins = (column[sent] for column in targets)
    n = len(row)
    asks = replace(
        frames.take(row),
        servo_id=servo_id.astype(np.int16),
        address=address,
        token=length,
        reply=reply.astype(np.uint8),
        alt_id=np.full(n, NO_ALT, np.int16),
    )
    answer, asked, how = outcomes(partner)
    key = asked << 16 | whole.servo_id[answer].astype(np.int64) & 0xFFFF
    order = np.argsort(key, kind="stable")
    key, wanted = np.append(key[order], -1), row << 16 | by & 0xFFFF
    first = np.searchsorted(key[:-1], wanted)
    found = key[first] == wanted
    at = np.append(order, 0)[first]
    mine = np.where(found, np.append(answer, -1)[at], -1)
    outcome = np.where(found, np.append(how, NO_RESPONSE)[at], NO_RESPONSE).astype(np.uint8)
    # The last one before it in its list that answered, carried forward; else the request itself.
    last = np.maximum.accumulate(np.append(-1, np.where(found, np.arange(n), -1)))[:n]
    is_same = (last >= 0) & (row[last] == row)
    behind = np.where(is_same, mine[last], row)
    return Questions(asks, row, mine, outcome, behind, begins)
