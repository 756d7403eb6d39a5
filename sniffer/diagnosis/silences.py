"""Stretches in which a servo answered none of the requests that it must answer."""

from __future__ import annotations

from typing import TYPE_CHECKING, Final, NamedTuple

import numpy as np

from sniffer.ground.codes import NO_RESPONSE, NOT_EXPECTED, OK

if TYPE_CHECKING:
    from collections.abc import Sequence

    from sniffer.ground.model import I64, Batch, Frames, Mask

LEAST: Final = 3
"""Requests in a row: one or two are lost on every line."""

KEPT: Final = 500
"""Of each servo the first so many, and the last one."""


class Silence(NamedTuple):
    """One stretch: the first request that had no answer, how many had none, when one came again.

    ``back_ns`` is None where none did until the end.
    """

    first_ns: int
    at: int
    length: int
    missed: int
    back_ns: int | None


class Silences:
    """Follows all servos request by request, by what became of them."""

    def __init__(self) -> None:
        self._open: dict[int, Silence] = {}
        self._over: dict[int, list[Silence]] = {}
        self._runs: dict[int, list[Silence]] = {}
        self._lengths: dict[int, list[int]] = {}
        self._unheard: set[int] = set()
        """Whose open stretch began before they ever answered."""
        self._late: dict[int, Silence] = {}
        self.heard: set[int] = set()
        """Servos that answered at least once."""

    def add(self, batch: Batch) -> None:
        """Take the exchanges of a batch."""
        t = batch.transactions
        told = np.flatnonzero((t.request != -1) & (t.outcome != NOT_EXPECTED))
        if not len(told):
            return
        frames, rows = batch.asking(t.request[told])
        servo, outcome = frames.servo_id[rows].astype(np.int64), t.outcome[told]
        answered = outcome == OK
        before = self.heard.copy()
        self.heard.update((np.flatnonzero(np.bincount(servo[answered] + 1)) - 1).tolist())
        missed = outcome == NO_RESPONSE
        if not missed.any() and not self._open:
            return
        for who in sorted({*np.unique(servo[missed]).tolist(), *self._open}):
            mine = np.flatnonzero(servo == who)
            if len(mine):
                ok = np.flatnonzero(answered[mine])
                first = 0 if who in before else int(ok[0]) if len(ok) else len(mine)
                self._follow(who, batch.base, frames, rows[mine], missed[mine], first)

    def _follow(
        self, who: int, base: int, frames: Frames, rows: I64, missed: Mask, heard: int
    ) -> None:
        """Follow one servo; from the row ``heard`` on it has answered."""
        edges = np.flatnonzero(np.diff(missed.astype(np.int8), prepend=0, append=0))
        n = len(missed)
        if who in self._open and not missed[0]:
            self._close(who, int(frames.t_start[rows[0]]))
        for a, b in zip(edges[::2].tolist(), edges[1::2].tolist(), strict=True):
            row = rows[a]
            count = b - a
            if who in self._open:
                one = self._open[who]
                self._open[who] = one._replace(missed=one.missed + count)
            else:
                self._open[who] = Silence(
                    int(frames.t_start[row]),
                    int(frames.start[row]) + base,
                    int(frames.length[row]),
                    count,
                    None,
                )
                if a < heard:
                    self._unheard.add(who)
            if b < n:
                self._close(who, int(frames.t_start[rows[b]]))

    def _close(self, who: int, t_ns: int) -> None:
        one = self._open.pop(who)._replace(back_ns=t_ns)
        if who in self._unheard:
            self._unheard.remove(who)
            before = self._late.get(who)
            if before is not None:
                one = before._replace(missed=before.missed + one.missed, back_ns=one.back_ns)
            self._late[who] = one
            return
        lengths = self._lengths.setdefault(who, [0] * LEAST)
        lengths[min(one.missed, LEAST) - 1] += 1
        runs = self._runs.setdefault(who, [])
        if len(runs) < KEPT:
            runs.append(one)
        if one.missed >= LEAST:
            over = self._over.setdefault(who, [])
            if len(over) > KEPT:
                over.pop()
            over.append(one)

    def of(self, servo_id: int) -> Sequence[Silence]:
        """Return the silences of a servo, the one that lasts until the end among them."""
        last = self._open.get(servo_id)
        over = self._over.get(servo_id, [])
        return [*over, last] if last is not None and last.missed >= LEAST else over

    def runs(self, servo_id: int) -> Sequence[Silence]:
        """Return the first stretches of a servo that were over, also those of one request."""
        return self._runs.get(servo_id, ())

    def late(self, servo_id: int) -> Silence | None:
        """Return the stretch before a servo's first answer: it came later, and was not away."""
        return self._late.get(servo_id)

    def lengths(self, servo_id: int) -> tuple[int, ...]:
        """Return how many stretches that were over had one request, two, and ``LEAST`` or more."""
        return tuple(self._lengths.get(servo_id, (0,) * LEAST))
