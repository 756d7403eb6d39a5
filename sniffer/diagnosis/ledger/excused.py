"""Requests that nobody can answer, for the controller's own doing: they are no lost answers.

A servo that is told to start anew is deaf until it has, so is one that writes its memory, and who
gave a servo another id may ask for the old one to see whether it is gone, or until the next one is
plugged in::

    request   restart 1   echo 1   echo 1   echo 1        id 0 := 4   echo 0   echo 0   echo 0
    answer    ok          -        -        ok            ok          -        -        ok
                          excused  excused                            excused  excused

Of one that is not back in the time that a start takes all counts since the order.
"""

from __future__ import annotations

from collections import Counter
from dataclasses import dataclass, field, replace
from typing import TYPE_CHECKING, Final, NamedTuple

import numpy as np

from sniffer.anomalies.found import NUMBER, Anomalies
from sniffer.ground.codes import NO_RESPONSE, NOT_EXPECTED, REQUEST
from sniffer.ground.distinct import among, numbers, within
from sniffer.ground.model import ECHO, NS, RESETS, Batch, Clock, Frames, Samples, Transactions
from sniffer.protocols.base import RESTARTS, ends_goal
from sniffer.protocols.ids import shared_ids

if TYPE_CHECKING:
    from collections.abc import Iterator, Sequence

    from sniffer.ground.model import I64
    from sniffer.protocols.base import BusProtocol

START_NS: Final = 3 * NS
"""No servo here takes longer to start: third-party clients of RS30x wait so long; mightyZAP and LSS
are there within a second."""

LONG_AGO_NS: Final = 10 * START_NS
"""Behind that nothing that was asked while servos started is open any more."""

WITHOUT_CLOCK: Final = 30
"""So many requests are excused where no clock tells how long a start takes: bytes take far less."""

FEW: Final = 2
"""Requests to an id that was given away that look whether it is gone."""

KEPT: Final = 500
"""So many requests to such an id wait for an answer to it; further ones count as they come. To a
servo that starts so many are kept that count if it is not back in time."""

ALL: Final = -1
"""Stands for every id where all servos are told at once."""

_MISSING: Final = NUMBER["no-response"]


class _Order(NamedTuple):
    """What a servo was told, where in the stream and when: to start anew, or another id.

    It may be both: who was given another id is told to start anew, and is gone with that.
    """

    at: int
    t_ns: int
    is_start: bool
    is_id: bool


@dataclass(slots=True)
class _InVain:
    """Requests that are excused until one knows better, and the anomalies that they are."""

    frames: list[Frames] = field(default_factory=list)
    found: list[Anomalies] = field(default_factory=list)

    def keep(self, request: Frames, found: Anomalies) -> None:
        """Keep one request, and what was found of it."""
        self.frames.append(request)
        mine = (found.code == _MISSING) & (found.at == request.start[0])
        self.found.append(found.take(np.flatnonzero(mine)))


class Excused:
    """Tells of each request without an answer whether there was somebody who could answer."""

    def __init__(self, protocol: BusProtocol) -> None:
        self._everyone = shared_ids(protocol)
        self._protocol = protocol
        self._starts = {op for op, kind in ends_goal(protocol).items() if kind == RESTARTS}
        self._known: dict[int, bool] = {}
        """Of each command whether a servo is deaf for a while behind it."""
        self._orders: dict[int, _Order] = {}
        """By servo, what it was told last, until it answers again."""
        self._had: dict[int, int] = {}
        """Where the last request began that a servo answered, while all are to start anew."""
        self._asked: Counter[tuple[int, int]] = Counter()
        """By servo and the place of the order to start, how often it was asked in vain since."""
        self._in_vain: dict[int, _InVain] = {}
        """By ids that were given away."""
        self._starting: dict[int, _InVain] = {}
        """By servos that start anew."""
        self._overdue: list[_InVain] = []
        """Of servos that were not back in time: what counts after all."""
        self.started: dict[int, list[int]] = {}
        """By servo, when it answered again behind an order to start, the first so many times."""
        self._given: set[int] = set()
        """Those that answer still: some servos take another id with their next start."""

    def without(self, batch: Batch) -> Batch:
        """Return a batch in which requests that nobody can answer expect no answer."""
        told = sorted(self._told(batch))
        if not told and not self._orders:
            return batch
        t = batch.transactions
        rows = np.flatnonzero((t.request != -1) & (t.outcome != NOT_EXPECTED))
        frames, of = batch.asking(t.request[rows])
        who = {*self._orders, *(servo for _, servo in told)}
        mine = np.ones(len(rows), bool) if ALL in who else within(frames.servo_id[of], list(who))
        rows, of = rows[mine], of[mine]
        at, t_start = frames.start[of] + batch.base, frames.t_start[of]
        found = Anomalies.of(batch.anomalies)
        excused: list[int] = []
        starting: dict[int, list[int]] = {}
        order = np.argsort(at, kind="stable")
        columns = (frames.servo_id[of], at, t_start, t.outcome[rows])
        for k, servo, place, t_ns, outcome in zip(
            order.tolist(), *(column[order].tolist() for column in columns), strict=True
        ):
            while told and told[0][0].at < place:
                self._take(*told.pop(0))
            if outcome != NO_RESPONSE:
                self._answered(servo, place)
                if servo in starting or self._starting.pop(servo, None) is not None:
                    self._start_over(servo, t_ns)
                excused += starting.pop(servo, [])
                continue
            last = self._last_told(servo, place)
            if last is None:
                continue
            if not last.is_id and not self._is_early(servo, last, t_ns, batch.clock):
                starting.pop(servo, None)
                self._overdue += [self._starting.pop(servo)] if servo in self._starting else []
            elif not last.is_id:
                starting.setdefault(servo, []).append(k)
            elif len(self._in_vain[servo].frames) < KEPT:
                excused.append(k)
                self._in_vain[servo].keep(_one(frames, of, at, k), found)
        for servo, some in starting.items():
            excused += some
            held = self._starting.setdefault(servo, _InVain())
            for k in some[: KEPT - len(held.frames)]:
                held.keep(_one(frames, of, at, k), found)
        for one, servo in told:
            self._take(one, servo)
        self._forget(int(t_start.max()) if len(rows) else 0)
        if not excused:
            return batch
        became = t.outcome.copy()
        became[rows[excused]] = NOT_EXPECTED
        left = (found.code != _MISSING) | ~within(found.at, at[excused])
        return replace(
            batch,
            transactions=replace(t, outcome=became),
            anomalies=found.take(np.flatnonzero(left)),
        )

    def overdue(self) -> Batch | None:
        """Return, once, the requests to servos that were not back in time, if any."""
        some, self._overdue = self._overdue, []
        return _counting(some)

    def withheld(self) -> Batch | None:
        """Return the requests to ids that were given away which are answered no more, if any."""
        return _counting([one for one in self._in_vain.values() if len(one.frames) > FEW])

    def _told(self, batch: Batch) -> Iterator[tuple[_Order, int]]:
        """Yield who is told to start anew, and whose id is given away."""
        f = batch.frames
        deaf = [op for op in numbers(f.op).tolist() if self._is_deafening(op)]
        mine = (f.flags & RESETS != 0) | among(f.op, deaf)
        for row in np.flatnonzero(mine & (f.kind == REQUEST) & (f.flags & ECHO == 0)).tolist():
            servo = int(f.servo_id[row])
            at = int(f.start[row]) + batch.base
            yield (
                _Order(at, int(f.t_end[row]), is_start=True, is_id=False),
                ALL if servo in self._everyone else servo,
            )
        found = Anomalies.of(batch.anomalies)
        for row in found.rows("id-changed").tolist() if len(found) else ():
            servo = int(found.servo_id[row])
            if servo not in self._everyone:
                at, t_ns = int(found.at[row]), int(found.t_ns[row])
                yield _Order(at, t_ns, is_start=False, is_id=True), servo

    def _is_deafening(self, op: int) -> bool:
        if op not in self._known:
            keeps = getattr(self._protocol, "keeps", "")
            is_kept = bool(keeps) and self._protocol.op_name(op) == keeps
            self._known[op] = is_kept or op in self._starts
        return self._known[op]

    def _take(self, order: _Order, servo: int) -> None:
        if order.is_id:
            self._given.add(servo)
        order = order._replace(is_id=servo in self._given)
        self._orders[servo] = order
        if servo == ALL:
            self._had = {}
        if order.is_id:
            self._in_vain[servo] = _InVain()

    def _last_told(self, servo: int, at: int) -> _Order | None:
        """Return what a servo was told last before a place and has not done yet."""
        some = (self._orders.get(who) for who in (servo, ALL))
        open_ones = [
            order
            for order in some
            if order is not None and self._had.get(servo, -1) <= order.at < at
        ]
        return max(open_ones, key=lambda order: (order.is_id, order.at), default=None)

    def _is_early(self, servo: int, order: _Order, t_ns: int, clock: Clock) -> bool:
        """Tell whether a servo may still start."""
        self._asked[servo, order.at] += 1
        is_counted = clock != Clock.NONE or self._asked[servo, order.at] <= WITHOUT_CLOCK
        return is_counted and t_ns - order.t_ns <= START_NS

    def _start_over(self, servo: int, t_ns: int) -> None:
        """Take that a servo is there again behind its start."""
        times = self.started.setdefault(servo, [])
        times += [t_ns] if len(times) < KEPT else []

    def _forget(self, now_ns: int) -> None:
        """Drop orders to start that are done, also where everybody answered."""
        for who, order in list(self._orders.items()):
            if not order.is_id and now_ns - order.t_ns > LONG_AGO_NS:
                del self._orders[who]
        if ALL not in self._orders:
            self._starting = {who: x for who, x in self._starting.items() if who in self._orders}
        live = {order.at for order in self._orders.values()}
        self._asked = Counter({key: n for key, n in self._asked.items() if key[1] in live})

    def _answered(self, servo: int, at: int) -> None:
        """Take that somebody answers to an id: what he was told is done."""
        order = self._orders.get(servo)
        if order is not None and order.at < at:
            del self._orders[servo]
            self._in_vain.pop(servo, None)
            if order.is_start:
                self._given.discard(servo)
        if ALL in self._orders:
            self._had[servo] = at


def _one(frames: Frames, of: I64, at: I64, k: int) -> Frames:
    """Return one request with its place in the stream."""
    return frames.take(of[k : k + 1]).having(start=at[k : k + 1])


def _counting(some: Sequence[_InVain]) -> Batch | None:
    """Return requests as a batch in which none has an answer, if any."""
    if not some:
        return None
    frames = Frames.concat([row for one in some for row in one.frames])
    frames = frames.take(np.argsort(frames.start, kind="stable"))
    n = len(frames)
    none = np.full(n, -1, np.int64)
    return Batch(
        0,
        b"",
        Clock.NONE,  # nobody asks for it
        frames,
        (),
        Transactions(np.arange(n), none, np.full(n, NO_RESPONSE, np.uint8), none, none),
        Samples.empty(),
        Anomalies.joined([found for one in some for found in one.found]),
    )
