"""Stretches in which a servo answered none of the requests that it must answer."""

from __future__ import annotations

from typing import TYPE_CHECKING, Final, NamedTuple

import numpy as np

from sniffer.diagnosis.ledger.buckets import Buckets
from sniffer.diagnosis.ledger.keys import SLOTS, slots
from sniffer.ground.codes import NO_RESPONSE, NOT_EXPECTED, OK
from sniffer.ground.distinct import numbers
from sniffer.ground.model import NEVER_NS

if TYPE_CHECKING:
    from collections.abc import Sequence

    from sniffer.ground.model import I64, Batch, Frames, Mask

MISSING: Final = "no-response"
"""The anomaly that each of these requests is."""

LEAST: Final = 3
"""Requests in a row: one or two are lost on every line."""

ENOUGH: Final = 5
"""Requests in a row without an answer that are no accident."""

KEPT: Final = 500
"""Of each servo the first so many, and the last one."""

ABOUT: Final = 2.0
"""A servo that starts anew is away for about as long each time: half as long, or twice."""

IDS: Final = 257
"""Whatever a byte may hold, and no id at all."""

TORN: Final = 4
"""Of so many requests that had no answer one may seem to have a torn one: what noise leaves behind
a request to a dead servo is no answer."""

SEVERAL: Final = -1
"""Stands for the question of a stretch in which several were asked."""

_QUESTIONS: Final = {"had": "sum", "missing": "sum", "had_last": "max"}


class Silence(NamedTuple):
    """One stretch: the first request that had no answer, how many had none, when one came again.

    ``back_ns`` is None where none did until the end. ``before_ns`` is the last request before it
    that was not left without an answer, ``last_ns`` the last one in it that was. ``question`` is
    which question it was each time.
    """

    first_ns: int
    at: int
    length: int
    missed: int
    back_ns: int | None
    before_ns: int
    last_ns: int
    question: int

    @property
    def lasted_ns(self) -> int:
        """How long it was until an answer came again; 0 where none did."""
        return 0 if self.back_ns is None else self.back_ns - self.first_ns

    @property
    def bounds_ns(self) -> tuple[int, int]:
        """How long the servo was away at least and at most.

        It missed the first request and the last one, and had the one before and the one behind.
        """
        most = 0 if self.back_ns is None else self.back_ns - self.before_ns
        return self.last_ns - self.first_ns, most


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
        self._since: dict[int, Silence] = {}
        """What had no answer since the last sound one, torn ones between them or not."""
        self._torn: dict[int, int] = {}
        """How many torn ones are between them."""
        self._had: I64 = np.full(IDS, -NEVER_NS, np.int64)
        """The last request to each servo that was not left without an answer."""
        self.heard: set[int] = set()
        """Servos that answered at least once."""
        self._is_known = np.zeros(SLOTS, bool)
        """Which questions (commands and addresses) were answered at least once, by whomever."""
        self._questions = Buckets(_QUESTIONS)

    def add(self, batch: Batch) -> None:
        """Take the exchanges of a batch."""
        t = batch.transactions
        told = np.flatnonzero((t.request != -1) & (t.outcome != NOT_EXPECTED))
        if not len(told):
            return
        frames, rows = batch.asking(t.request[told])
        servo, outcome = frames.servo_id[rows].astype(np.int64), t.outcome[told]
        answered = outcome == OK
        question = slots(frames.op[rows], frames.address[rows])
        self._is_known[question[outcome != NO_RESPONSE]] = True
        before = self.heard.copy()
        self.heard.update((np.flatnonzero(np.bincount(servo[answered] + 1)) - 1).tolist())
        missed = outcome == NO_RESPONSE
        self._questions.add(
            servo * SLOTS + question,
            had=(~missed).astype(np.int64),
            missing=missed.astype(np.int64),
            had_last=np.where(missed, -NEVER_NS, frames.t_start[rows]),
        )
        for who in sorted({*numbers(servo[missed]).tolist(), *self._open, *self._since}):
            mine = np.flatnonzero(servo == who)
            if len(mine):
                ok = np.flatnonzero(answered[mine])
                if who in self.heard:
                    self._last(who, batch.base, frames, rows[mine], missed[mine], ok)
                first = 0 if who in before else int(ok[0]) if len(ok) else len(mine)
                self._follow(
                    who, batch.base, frames, rows[mine], missed[mine], first, question[mine]
                )
        self._had[servo[~missed]] = frames.t_start[rows[~missed]]

    def _last(self, who: int, base: int, frames: Frames, rows: I64, missed: Mask, ok: I64) -> None:
        """Follow what a servo leaves unanswered behind its last sound answer."""
        had_ns = int(self._had[who])
        if len(ok):
            self._since.pop(who, None)
            had_ns = int(frames.t_start[rows[ok[-1]]])
            rows, missed = rows[ok[-1] + 1 :], missed[ok[-1] + 1 :]
        lost = np.flatnonzero(missed)
        if who not in self._since:
            if not len(lost):
                return
            if lost[0]:
                had_ns = int(frames.t_start[rows[lost[0] - 1]])
            one = _silence(base, frames, int(rows[lost[0]]), 0)
            self._since[who] = one._replace(before_ns=min(had_ns, one.first_ns))
            self._torn[who] = 0
            missed = missed[lost[0] :]
        one = self._since[who]
        self._since[who] = one._replace(missed=one.missed + int(missed.sum()))
        self._torn[who] += int((~missed).sum())

    def _follow(
        self,
        who: int,
        base: int,
        frames: Frames,
        rows: I64,
        missed: Mask,
        heard: int,
        question: I64,
    ) -> None:
        """Follow one servo; from the row ``heard`` on it has answered."""
        edges = np.flatnonzero(np.diff(missed.astype(np.int8), prepend=0, append=0))
        n = len(missed)
        if who in self._open and not missed[0]:
            self._close(who, int(frames.t_start[rows[0]]))
        begin, end = edges[::2], edges[1::2]
        kept = self._kept(who, end - begin, begin < heard)
        lengths = self._lengths.setdefault(who, [0] * LEAST)
        for missed_by in np.minimum(end - begin, LEAST)[~kept].tolist():
            lengths[missed_by - 1] += 1
        for a, b in zip(begin[kept].tolist(), end[kept].tolist(), strict=True):
            row = rows[a]
            count = b - a
            if who not in self._open:
                known_ns = int(frames.t_start[rows[a - 1]] if a else self._had[who])
                one = _silence(base, frames, int(row), 0)
                one = one._replace(question=int(question[a]))
                self._open[who] = one._replace(before_ns=min(known_ns, one.first_ns))
                if a < heard:
                    self._unheard.add(who)
            one = self._open[who]
            last_ns = int(frames.t_start[rows[b - 1]])
            same = bool((question[a:b] == one.question).all())
            one = one._replace(question=one.question if same else SEVERAL)
            self._open[who] = one._replace(missed=one.missed + count, last_ns=last_ns)
            if b < n:
                self._close(who, int(frames.t_start[rows[b]]))

    def _kept(self, who: int, missed: I64, is_unheard: Mask) -> Mask:
        """Tell which stretches of a batch are looked at: of the others there are enough."""
        number = np.arange(len(missed))
        room = KEPT - len(self._runs.get(who, ())) + int(is_unheard.sum())
        kept: Mask = (number <= room) | (number == len(missed) - 1) | is_unheard
        long = np.flatnonzero(missed >= LEAST)
        kept[long[: KEPT + 1 - len(self._over.get(who, ()))]] = kept[long[-1:]] = True
        return kept

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

    def questions(self) -> dict[str, I64]:
        """Return what became of questions, by servo: how many were left, and ``had`` an answer.

        ``had_last`` is when the last of these was asked; a question is a command and an address.
        """
        key, columns = self._questions.table()
        return {**columns, "question": key % SLOTS, "servo_id": key // SLOTS}

    def of(self, servo_id: int) -> Sequence[Silence]:
        """Return the silences of a servo, the one that lasts until the end among them."""
        last = self.ending(servo_id)
        over = self._before(self._over.get(servo_id, ()), last)
        over = [s for s in over if not self._is_unknown(s)]
        return [*over, last] if last is not None and last.missed >= LEAST else over

    def runs(self, servo_id: int) -> Sequence[Silence]:
        """Return the first stretches of a servo that were over, also those of one request."""
        runs = self._before(self._runs.get(servo_id, ()), self.ending(servo_id))
        return [s for s in runs if not self._is_unknown(s)]

    def in_vain(self, servo_id: int) -> Sequence[Silence]:
        """Return the first stretches of a servo in which it was asked what nobody ever answered.

        It was not away: it does not know the question.
        """
        return [s for s in self._runs.get(servo_id, ()) if self._is_unknown(s)]

    def _is_unknown(self, one: Silence) -> bool:
        return one.question != SEVERAL and not self._is_known[one.question]

    def ending(self, servo_id: int) -> Silence | None:
        """Return the stretch that lasts until the end; a few torn answers in it are none."""
        since, torn = self._since.get(servo_id), self._torn.get(servo_id, 0)
        if since is not None and since.missed >= LEAST and torn * TORN <= since.missed:
            return since
        return self._open.get(servo_id)

    def _before(self, some: Sequence[Silence], last: Silence | None) -> Sequence[Silence]:
        return some if last is None else [s for s in some if s.at < last.at]

    def late(self, servo_id: int) -> Silence | None:
        """Return the stretch before a servo's first answer: it came later, and was not away."""
        return self._late.get(servo_id)

    def lengths(self, servo_id: int) -> tuple[int, ...]:
        """Return how many stretches that were over had one request, two, and ``LEAST`` or more."""
        lengths = self._lengths.get(servo_id, [0] * LEAST).copy()
        for one in self.in_vain(servo_id):
            lengths[min(one.missed, LEAST) - 1] -= 1
        return tuple(lengths)


def of_one_length(some: Sequence[Silence], slack_ns: int) -> Mask:
    """Tell which silences may all have been of one length, as many as possible.

    ``slack_ns`` is how late the host may stamp either end of them.
    """
    least, most = np.array([s.bounds_ns for s in some], np.float64).T
    low, high = (least - slack_ns) / ABOUT, (most + slack_ns) * ABOUT
    # as many hold at the lower bound of one of them as anywhere
    holds = (low <= low[:, None]) & (low[:, None] <= high)
    best: Mask = holds[int(holds.sum(axis=1).argmax())]
    return best


def _silence(base: int, frames: Frames, row: int, missed: int) -> Silence:
    """Return a stretch that begins with the request in a row of a batch."""
    t_ns = int(frames.t_start[row])
    return Silence(
        t_ns,
        int(frames.start[row]) + base,
        int(frames.length[row]),
        missed,
        None,
        t_ns,
        t_ns,
        SEVERAL,
    )
