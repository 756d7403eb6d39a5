"""The kinds of requests that a controller makes: how often each was said, when, and its bytes.

A kind is whom it is for, the command, the address, and whether it is in the manual's form.
"""

from __future__ import annotations

from typing import TYPE_CHECKING, Final

import numpy as np

from sniffer.diagnosis.ledger.keys import SLOTS, slots
from sniffer.diagnosis.ledger.requests import last_bytes
from sniffer.ground.model import MALFORMED, UNKNOWN, UNUSUAL

if TYPE_CHECKING:
    from sniffer.ground.model import I64, Batch, Frames, Mask

KINDS: Final = 1024
"""Kinds that are told apart, the first ones met: a bus has some servos and some commands."""

ODD: Final = MALFORMED | UNKNOWN | UNUSUAL
"""Flags of requests that are not as the manual has them."""

SELDOM: Final = 0.05
"""Part of the requests of a kind that may be others: it is asked in two ways, or one was torn."""


class RequestKinds:
    """Numbers kinds in the order in which they are met.

    Two kinds that fall on one of 65536 slots count as one: of fifty, in one bus of fifty.
    """

    def __init__(self) -> None:
        self._number = np.full(SLOTS, -1, np.int64)
        self.servo_id: list[int] = []
        self.op: list[int] = []
        self.address: list[int] = []
        self.odd: list[int] = []
        """Which of the flags ``ODD`` it has."""
        self.example: list[bytes] = []
        """The bytes of the first one of each kind."""
        self.at: list[int] = []
        self.t_first: list[int] = []
        self._n = np.zeros(0, np.int64)
        self._t_last = np.zeros(0, np.int64)
        self._ends = np.zeros(0, np.int64)
        """Of the first one of each kind."""
        self._others = np.zeros(0, np.int64)

    def __len__(self) -> int:
        return len(self.op)

    @property
    def n(self) -> I64:
        """How often each kind was said."""
        return self._n

    @property
    def requests(self) -> tuple[bytes, ...]:
        """The examples, each once."""
        return tuple(dict.fromkeys(self.example))

    @property
    def t_last(self) -> I64:
        """When each kind was said last."""
        return self._t_last

    @property
    def are_alike(self) -> Mask:
        """Which kinds are nearly always the first one again, by their ends: no goal is in them."""
        alike: Mask = self._others <= SELDOM * self._n
        return alike

    def add(self, batch: Batch, asks: I64) -> I64:
        """Count the requests in some rows of a batch; return the kind of each, -1: one too many."""
        f = batch.frames
        who = f.servo_id[asks].astype(np.int64) << 8 | (f.flags[asks] & ODD)
        slot = slots(f.op[asks], f.address[asks], who)
        kind, ends = self._number[slot], last_bytes(batch.data, f.start[asks], f.length[asks])
        if (kind < 0).any() and len(self) < KINDS:
            new = np.flatnonzero(kind < 0)
            _, first = np.unique(slot[new], return_index=True)
            met = new[np.sort(first)][: KINDS - len(self)]
            for i in met.tolist():
                self._meet(batch, f, int(asks[i]), int(slot[i]))
            more = np.zeros(len(self) - len(self._n), np.int64)
            self._n = np.concatenate([self._n, more])
            self._t_last = np.concatenate([self._t_last, more])
            self._ends = np.concatenate([self._ends, ends[met]])
            self._others = np.concatenate([self._others, more])
            kind = self._number[slot]
        known = kind if (kind >= 0).all() else kind[kind >= 0]
        others = kind[(kind >= 0) & (ends != self._ends[kind])]
        self._others += np.bincount(others, minlength=len(self))
        self._n += np.bincount(known, minlength=len(self))
        self._t_last[kind[kind >= 0]] = f.t_start[asks][kind >= 0]
        return kind

    def _meet(self, batch: Batch, f: Frames, row: int, slot: int) -> None:
        self._number[slot] = len(self)
        start = int(f.start[row])
        self.servo_id.append(int(f.servo_id[row]))
        self.op.append(int(f.op[row]))
        self.address.append(int(f.address[row]))
        self.odd.append(int(f.flags[row]) & ODD)
        self.example.append(batch.data[start : start + int(f.length[row])])
        self.at.append(start + batch.base)
        self.t_first.append(int(f.t_start[row]))
