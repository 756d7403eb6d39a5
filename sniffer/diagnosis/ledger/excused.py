"""Requests that nobody can answer, for the controller's own doing: they are no lost answers.

A servo that is told to start anew is deaf until it has, so is one that writes its memory, and who
gave a servo another id may ask for the old one to see whether it is gone, or until the next one is
plugged in::

    request   restart 1   echo 1   echo 1   echo 1        id 0 := 4   echo 0   echo 0   echo 0
    answer    ok          -        -        ok            ok          -        -        ok
                          excused  excused                            excused  excused
"""

from __future__ import annotations

from collections import Counter
from dataclasses import dataclass, field, replace
from typing import TYPE_CHECKING, Final, NamedTuple

import numpy as np

from sniffer.anomalies.found import NUMBER, Anomalies
from sniffer.ground.codes import NO_RESPONSE, NOT_EXPECTED, REQUEST
from sniffer.ground.model import ECHO, NS, RESETS, Batch, Clock, Frames, Samples, Transactions
from sniffer.protocols.base import RESTARTS, ends_goal
from sniffer.protocols.ids import shared_ids

if TYPE_CHECKING:
    from collections.abc import Iterator

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
"""So many requests to such an id wait for an answer to it; further ones count as they come."""

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
    """Requests to an id that was given away, and the anomalies that they are."""

    frames: list[Frames] = field(default_factory=list)
    found: list[Anomalies] = field(default_factory=list)


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
        mine = np.ones(len(rows), bool) if ALL in who else np.isin(frames.servo_id[of], list(who))
        rows, of = rows[mine], of[mine]
        at, t_start = frames.start[of] + batch.base, frames.t_start[of]
        found = Anomalies.of(batch.anomalies)
        excused: list[int] = []
        order = np.argsort(at, kind="stable")
        columns = (frames.servo_id[of], at, t_start, t.outcome[rows])
        for k, servo, place, t_ns, outcome in zip(
            order.tolist(), *(column[order].tolist() for column in columns), strict=True
        ):
            while told and told[0][0].at < place:
                self._take(*told.pop(0))
            if outcome != NO_RESPONSE:
                self._answered(servo, place)
            elif self._is_excused(servo, place, t_ns, has_clock=batch.clock != Clock.NONE):
                excused.append(k)
                self._keep(frames.take(of[k : k + 1]).having(start=at[k : k + 1]), found)
        for one, servo in told:
            self._take(one, servo)
        self._forget(int(t_start.max()) if len(rows) else 0)
        if not excused:
            return batch
        became = t.outcome.copy()
        became[rows[excused]] = NOT_EXPECTED
        left = (found.code != _MISSING) | ~np.isin(found.at, at[excused])
        return replace(
            batch,
            transactions=replace(t, outcome=became),
            anomalies=found.take(np.flatnonzero(left)),
        )

    def withheld(self) -> Batch | None:
        """Return the requests to ids that were given away which are answered no more, if any."""
        some = [one for one in self._in_vain.values() if len(one.frames) > FEW]
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

    def _told(self, batch: Batch) -> Iterator[tuple[_Order, int]]:
        """Yield who is told to start anew, and whose id is given away."""
        f = batch.frames
        deaf = [op for op in np.unique(f.op).tolist() if self._is_deafening(op)]
        mine = (f.flags & RESETS != 0) | np.isin(f.op, deaf)
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

    def _is_excused(self, servo: int, at: int, t_ns: int, *, has_clock: bool) -> bool:
        for who in (servo, ALL):
            order = self._orders.get(who)
            if order is None or order.at >= at or self._had.get(servo, -1) > order.at:
                continue
            if order.is_id:
                return len(self._in_vain[servo].frames) < KEPT
            self._asked[servo, order.at] += 1
            is_early = has_clock or self._asked[servo, order.at] <= WITHOUT_CLOCK
            if is_early and t_ns - order.t_ns <= START_NS:
                return True
        return False

    def _forget(self, now_ns: int) -> None:
        """Drop orders to start that are done, also where everybody answered."""
        for who, order in list(self._orders.items()):
            if not order.is_id and now_ns - order.t_ns > LONG_AGO_NS:
                del self._orders[who]
        live = {order.at for order in self._orders.values()}
        self._asked = Counter({key: n for key, n in self._asked.items() if key[1] in live})

    def _keep(self, request: Frames, found: Anomalies) -> None:
        """Keep a request to an id that was given away, and what was found of it."""
        held = self._in_vain.get(int(request.servo_id[0]))
        if held is not None:
            held.frames.append(request)
            mine = (found.code == _MISSING) & (found.at == request.start[0])
            held.found.append(found.take(np.flatnonzero(mine)))

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
