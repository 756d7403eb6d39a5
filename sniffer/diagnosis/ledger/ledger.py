"""What is remembered of a bus for its diagnosis: traffic by servo and time, and what is rare.

A ledger takes batch after batch and keeps columns: sums and extremes by servo in buckets of
a quarter second, events one by one, durations in histograms. It does not grow with the traffic (old
buckets are joined), and does not depend on how the stream was cut. Nothing is judged here.
"""

from __future__ import annotations

from typing import TYPE_CHECKING, Final

import numpy as np

from sniffer.anomalies.found import CODES, Anomalies
from sniffer.decoding.pairing import unasked
from sniffer.diagnosis.ledger.buckets import TimedBuckets, in_groups
from sniffer.diagnosis.ledger.damage import Damages
from sniffer.diagnosis.ledger.events import ANOMALY, Events, happened, remarked
from sniffer.diagnosis.ledger.exchanges import Exchanges
from sniffer.diagnosis.ledger.excused import Excused
from sniffer.diagnosis.ledger.histograms import Histograms
from sniffer.diagnosis.ledger.kept import ALARMS, ANSWERS, LINE, TRAFFIC, VALUES
from sniffer.diagnosis.ledger.keys import pair_key, request_key
from sniffer.diagnosis.ledger.lineerrors import LineErrors
from sniffer.diagnosis.ledger.lowest import Lowest
from sniffer.diagnosis.ledger.optional import OptionalAnswers, UnansweredReads
from sniffer.diagnosis.ledger.orders import Orders
from sniffer.diagnosis.ledger.refusals import Refusals
from sniffer.diagnosis.ledger.returns import GoalsBack, Returns
from sniffer.diagnosis.ledger.seconds import SecondAnswers
from sniffer.diagnosis.ledger.settings import Settings, kept_addresses
from sniffer.diagnosis.ledger.silences import Silences
from sniffer.diagnosis.ledger.slowest import SlowestAnswers
from sniffer.diagnosis.ledger.steps import Steps
from sniffer.diagnosis.ledger.unclaimed import Unclaimed
from sniffer.diagnosis.ledger.unnamed import UnnamedWrites
from sniffer.diagnosis.ledger.unproven import Unproven
from sniffer.ground.codes import (
    DAMAGED,
    MEASURED,
    MISMATCHED,
    NO_RESPONSE,
    NOT_EXPECTED,
    OK,
    REQUEST,
    RESPONSE,
    WHOLE,
)
from sniffer.ground.distinct import within
from sniffer.ground.gaps import Gaps
from sniffer.ground.heard import HeardSpan
from sniffer.ground.milli import in_milli
from sniffer.ground.model import ECHO, Clock
from sniffer.ground.timing import byte_time_ns

if TYPE_CHECKING:
    from sniffer.decoding.pacing import Pace
    from sniffer.ground.model import Batch, Frames
    from sniffer.protocols.base import BusProtocol

FINE_OCTAVE: Final = 64
"""Periods are known to 1 %: whether one is a multiple of another turns on less than 4."""

HEAD: Final = 1 << 15
"""Bytes kept from the beginning, and of what no frame claims: enough to look for another rate."""

ASKED: Final = 4096
"""Kinds of requests at most whose periods are followed, the first ones: a scan asks thousands."""

_REFUSED: Final = -2

NOT_KNOWN: Final = 1 << 62
"""Stands for no duration among minima."""


class Ledger:
    """Remembers one protocol's part of one bus."""

    def __init__(self, bus: str, protocol: BusProtocol) -> None:
        self.bus = bus
        self.protocol = protocol
        self.pace: Pace | None = None
        self.clock = Clock.NONE
        self.bytes = 0
        self.frames = 0
        self.first_ns: int | None = None
        self.last_ns = 0
        self.heard = HeardSpan()
        self.models: dict[int, tuple[str, int]] = {}
        self.has_wires = False
        """Whether frames came in on wires that are told apart."""
        self.traffic = TimedBuckets(TRAFFIC)
        """By bucket and servo: frames."""
        self.own_names = dict.fromkeys(protocol.everyone, 0)
        """How many answers came in the name of each id that addresses all."""
        self.answers = TimedBuckets(ANSWERS)
        """By bucket and servo asked: what became of requests; ``took`` in ns, bounds apart, and
        the longest as it was stamped (``told_max``)."""
        self.line = TimedBuckets(LINE)
        """By bucket: bytes, unclaimed ones, the longest pause between two requests."""
        self.values = TimedBuckets(VALUES, register=len(protocol.registers))
        """By bucket, servo and register, in thousandths; ``step`` is between two neighbours."""
        self.alarms = TimedBuckets(ALARMS, code=len(CODES))
        """By bucket, code (a row of ``found.CODES``) and servo."""
        self.events = Events()
        self.took = Histograms()
        """Response times by servo and command (``pair_key``), of what writes no lasting memory."""
        self.slowest = SlowestAnswers()
        self.periods = Histograms(FINE_OCTAVE)
        """Times from a request to the next like it, by servo, command and address."""
        self.pauses = Histograms()
        """Times between the beginnings of two requests of the bus; key 0."""
        self.settings = Settings(protocol)
        self.damages = Damages(protocol)
        self.second_answers = SecondAnswers()
        self.line_errors = LineErrors()
        self.silences = Silences()
        self.orders = Orders(protocol)
        self.refusals = Refusals(protocol)
        self.optional, self.unanswered_reads = OptionalAnswers(), UnansweredReads()
        self.steps = Steps(protocol)
        self.returns, self.goals_back = Returns(protocol), GoalsBack(protocol)
        self.exchanges = Exchanges(protocol)
        self.unnamed = UnnamedWrites(protocol)
        self.unclaimed = Unclaimed()
        self.unproven = Unproven(protocol)
        self.excused = Excused(protocol)
        self.is_shared = False
        """Whether another protocol is on the same wire."""
        self.head = b""
        """The first bytes of the bus."""
        self.has_checksum: bool | None = None
        """Whether answers of more than a byte have one; None: there was none yet."""
        self.answer_length = 0
        """Bytes of the first such answer."""
        self._asked_at: dict[int, int] = {}
        self._last_asked: int | None = None
        self._kept = kept_addresses(protocol)
        registers = protocol.registers
        self._is_value = np.array([bool(r.quantity) for r in registers], bool)
        self._has_unit = np.array([bool(r.unit) for r in registers], bool)
        self._is_measured = np.array([r.role == MEASURED for r in registers], bool)
        self.lowest = Lowest([r.quantity == "voltage" for r in registers])

    def add(self, batch: Batch) -> None:
        """Take what one pass decided."""
        self.unanswered_reads.add(batch)
        batch = self.excused.without(self.unproven.without(batch))
        overdue = self.excused.overdue()
        if overdue is not None:
            self.count_in_vain(overdue)
        self.clock = batch.clock
        self.bytes += len(batch.data)
        if batch.base < HEAD:
            self.head = (self.head + batch.data)[:HEAD]
        self.models.update(batch.models)
        if batch.remarks:
            self.line_errors.add(batch)
            self.events.add(remarked(batch.remarks))
        if len(batch.anomalies):
            self.count_alarms(Anomalies.of(batch.anomalies))
            self.second_answers.add(batch, self.damages.likes)
        f = batch.frames
        self._line(batch)
        if len(batch.transactions):
            self.count_answers(batch)
            self.silences.add(batch)
            self.refusals.add(batch)
            self.optional.add(batch)
        if len(f):
            self.frames += len(f)
            self.has_wires = self.has_wires or bool(f.direction.any())
            if self.has_checksum is None:
                self._look_for_checksum(batch)
            self.heard.take(self.protocol.name, f)
            self.first_ns = self.heard.first_ns
            self.last_ns = max(self.last_ns, int(f.t_end[-1]))
            self._traffic(batch)
            self._periods(f)
            self.orders.add(batch)
        if len(batch.values):
            self._values(batch)
        self.damages.add(batch, self.byte_ns)
        self.exchanges.add(batch, self.byte_ns)
        self.unnamed.add(batch)
        self.unclaimed.add(batch)
        self.is_shared |= batch.is_shared

    @property
    def byte_ns(self) -> int:
        """How long a byte takes at the rate by which the bus is decoded."""
        return byte_time_ns(self.protocol.baud if self.pace is None else self.pace.baud)

    def _look_for_checksum(self, batch: Batch) -> None:
        f = batch.frames
        rows = np.flatnonzero((f.kind != REQUEST) & (f.length > 1))
        if len(rows):
            start, self.answer_length = int(f.start[rows[0]]), int(f.length[rows[0]])
            raw = batch.data[start : start + self.answer_length]
            self.has_checksum = self.protocol.checksum_of(raw) is not None

    def _traffic(self, batch: Batch) -> None:
        f = batch.frames
        asks = (f.kind == REQUEST) & (f.flags & ECHO == 0)
        for who in self.own_names:
            self.own_names[who] += int(((f.servo_id == who) & (f.kind == RESPONSE)).sum())
        self.traffic.add(
            f.t_end,
            f.servo_id,
            frames=1,
            requests=asks,
            bytes=f.length,
            at=f.start + batch.base,
            end=f.end + batch.base,
            t_first=f.t_start,
            t_last=f.t_end,
        )

    def count_answers(self, batch: Batch) -> None:
        """Count in what became of the requests of a batch."""
        t, f = batch.transactions, batch.frames
        told = np.flatnonzero(t.outcome != NOT_EXPECTED)
        if not len(told):
            return
        outcome, request, response = t.outcome[told], t.request[told], t.response[told]
        frames, rows = batch.asking(request)
        is_asked = request != -1
        rows = np.where(is_asked, rows, 0)
        answer = np.maximum(response, 0)
        servo = np.where(is_asked, frames.servo_id[rows], f.servo_id[answer])
        t_ns = np.where(is_asked, frames.t_end[rows], f.t_end[answer])
        at = np.where(is_asked, frames.start[rows], f.start[answer]) + batch.base
        timed = (outcome == OK) & (t.response_time_ns[told] >= 0)
        took, spread = t.response_time_ns[told], np.maximum(t.uncertainty_ns[told], 0)
        least = np.maximum(took - spread, 0)
        sound = bool(timed.all())
        self.answers.add(
            t_ns,
            servo,
            asked=1 if sound else is_asked,
            ok=1 if sound else outcome == OK,
            missing=0 if sound else outcome == NO_RESPONSE,
            damaged=0 if sound else outcome == DAMAGED,
            mismatched=0 if sound else outcome == MISMATCHED,
            unsolicited=0 if sound else unasked(batch)[told],
            took_n=1 if sound else timed,
            took_sum=took if sound else np.where(timed, took, 0),
            took_min=least if sound else np.where(timed, least, NOT_KNOWN),
            took_max=least if sound else np.where(timed, least, 0),
            told_max=took if sound else np.where(timed, took, 0),
            spread_max=spread if sound else np.where(timed, spread, 0),
            at=at,
            t_first=t_ns,
            t_last=t_ns,
        )
        # Who answers behind others, to requests in one go, waited for them; or for its memory.
        writes = is_asked & (frames.data_length[rows] > 0)
        lasts = writes & within(frames.address[rows], self._kept)
        alone = timed & (response == request + 1) & ~lasts
        whose = pair_key(servo[alone].astype(np.int64), frames.op[rows[alone]])
        self.took.add(whose, least[alone], took[alone] + spread[alone])
        rows = rows[alone]
        self.slowest.add(whose, least[alone], t_ns[alone], at[alone], frames.length[rows])

    def _periods(self, f: Frames) -> None:
        """Count the times between requests that are alike, and between any two."""
        asks = np.flatnonzero((f.kind == REQUEST) & (f.flags & ECHO == 0))
        if not len(asks):
            return
        t_start = f.t_start[asks]
        before = t_start[0] if self._last_asked is None else self._last_asked
        pause = np.maximum(np.diff(t_start, prepend=before), 0)
        if self._last_asked is None:
            pause, since = pause[1:], t_start[1:]
        else:
            since = t_start
        self._last_asked = int(t_start[-1])
        spread = np.zeros(len(pause), np.int64)
        self.pauses.add(spread, pause, pause)
        if len(pause):
            self.line.add(
                since,
                np.full(len(since), -1),
                bytes=0,
                gap_bytes=0,
                gaps=0,
                pause_max=pause,
                at=NOT_KNOWN,
                t_first=since,
                t_last=since,
            )
        key = request_key(f.servo_id[asks].astype(np.int64), f.op[asks], f.address[asks])
        order, first = in_groups(key)
        last = np.append(first[1:], len(order)) - 1
        key, t = key[order], t_start[order]
        keys = key[first].tolist()
        for k in np.argsort(order[first]).tolist():  # in the order of time, whatever the cut
            if len(self._asked_at) < ASKED:
                self._asked_at.setdefault(keys[k], -1)
        begun = np.array([self._asked_at.get(k, _REFUSED) for k in keys], np.int64)
        earlier = np.concatenate([[0], t[:-1]])
        earlier[first] = begun
        known = (earlier >= 0) & np.repeat(begun != _REFUSED, np.diff(first, append=len(order)))
        period = np.maximum(t - earlier, 0)[known]
        self.periods.add(key[known], period, period)
        self._asked_at.update(
            (k, at)
            for k, at, since in zip(keys, t[last].tolist(), begun.tolist(), strict=True)
            if since != _REFUSED
        )

    def _values(self, batch: Batch) -> None:
        v = batch.values
        whole = (v.part == WHOLE) & self._is_value[v.register]
        value = np.where(np.isnan(v.value) & ~self._has_unit[v.register], v.raw, v.value)
        whole &= v.accepted & np.isfinite(value)
        written = batch.frames.kind[v.row] == REQUEST
        if written.any():  # who writes what is measured has not measured it
            whole &= ~(written & self._is_measured[v.register])
        mine = np.flatnonzero(whole)
        self.events.add(self.settings.changes(batch))
        if not len(mine):
            return
        milli = in_milli(value[mine])
        register = v.register[mine].astype(np.int64)
        who = (v.servo_id[mine].astype(np.int64) + 1) * len(self._is_value) + register
        t_ns = v.t_ns[mine]
        at = batch.frames.start[v.row[mine]] + batch.base
        if not self.has_checksum:
            f, rows = batch.frames, v.row[mine]
            self.returns.add(
                who, milli, t_ns, at, lambda k: batch.data[f.start[rows[k]] : f.end[rows[k]]]
            )
        self.goals_back.take(who, milli, t_ns, at)
        self.lowest.add(register, v.servo_id[mine].astype(np.int64), milli, t_ns, at)
        self.values.add(
            t_ns,
            v.servo_id[mine],
            register,
            n=1,
            low=milli,
            high=milli,
            total=milli,
            first=milli,
            last=milli,
            step=self.steps.add(who, milli, t_ns, at),
            at=at,
            t_first=t_ns,
            t_last=t_ns,
        )

    def _line(self, batch: Batch) -> None:
        f = batch.frames
        if len(f):
            self.line.add(
                f.t_end,
                np.full(len(f), -1),
                bytes=f.length,
                gap_bytes=0,
                gaps=0,
                pause_max=0,
                at=f.start + batch.base,
                t_first=f.t_end,
                t_last=f.t_end,
            )
        if len(batch.gaps):
            gaps = Gaps.of(batch.gaps)
            self.line.add(
                gaps.t_ns,
                np.full(len(gaps), -1),
                bytes=gaps.length,
                gap_bytes=gaps.length,
                gaps=1,
                pause_max=0,
                at=gaps.start + batch.base,
                t_first=gaps.t_ns,
                t_last=gaps.t_ns,
            )

    def count_in_vain(self, held: Batch) -> None:
        """Count requests in that were excused and have no answer; their place is before others'."""
        self.count_alarms(Anomalies.of(held.anomalies))
        self.count_answers(held)
        self.silences.add(held)
        self.events.sort()

    def count_alarms(self, found: Anomalies) -> None:
        """Count anomalies in, and keep them one by one."""
        code, servo = found.code.astype(np.int64), found.servo_id.astype(np.int64)
        self.alarms.add(
            found.t_ns,
            servo,
            code,
            n=1,
            at=found.at,
            length=found.length,
            t_first=found.t_ns,
            t_last=found.t_ns,
        )
        self.events.add(happened(ANOMALY, code, servo, found.t_ns, found.at, found.length))
