"""The slow decoder that defines what is right: one frame at a time, plain objects, whole stream.

Framing parses the construct grammar at every offset; pairing, expectations and values are written
in the obvious way. Tests hold the block decoder equal to this one; nothing else uses it.
"""

from __future__ import annotations

import itertools
from dataclasses import dataclass, field
from typing import TYPE_CHECKING

from sniffer.decoding.echo import slow_echoes
from sniffer.decoding.reference.pending import matched
from sniffer.decoding.reference.values import SampleRow, SlowValues
from sniffer.decoding.staging import slow_staged_ids
from sniffer.ground.chunks import clock_of
from sniffer.ground.codes import (
    DAMAGED,
    IF_ALL,
    IF_READ,
    MANY,
    MUST,
    NO_RESPONSE,
    NOT_EXPECTED,
    OK,
    REQUEST,
    UNSOLICITED,
)
from sniffer.ground.model import ECHO, Chunk, Clock
from sniffer.ground.timing import LATENCY_NS, byte_time_ns

if TYPE_CHECKING:
    from collections.abc import Mapping, Sequence

    from sniffer.protocols.base import BusProtocol, SlowFrame


FrameRow = tuple[int, int, int, int, int, int, bytes, int, int, int, int, int, int, int]
TransactionRow = tuple[int, int, int, int]


@dataclass(slots=True)
class Result:
    """What a stream says, as plain tuples that compare."""

    frames: list[FrameRow] = field(default_factory=list)
    transactions: list[TransactionRow] = field(default_factory=list)
    samples: list[SampleRow] = field(default_factory=list)


@dataclass(slots=True)
class _Pair:
    request: SlowFrame | None
    response: SlowFrame | None
    outcome: int
    took: int = -1


class Reference:
    """Decodes a whole stream at once."""

    def __init__(
        self,
        protocol: BusProtocol,
        *,
        baud: int | None = None,
        models: Mapping[int | None, str] | None = None,
    ) -> None:
        self.protocol = protocol
        self.byte_ns = byte_time_ns(baud or protocol.baud)
        self.values = SlowValues(protocol, models)
        self.mode = [-1] * 256
        self.staged_ids: dict[int, int] = {}
        self.echoes = 0  # doubled requests in a row that look like an adapter's echo
        self.themselves: set[int] = set()  # starts of misfits that need no request to be read
        self.out = Result()

    def decode(self, chunks: Sequence[Chunk]) -> Result:
        """Return all records of the stream."""
        times: list[int] = []
        clocks: list[Clock] = []
        data = bytearray()
        silences: list[int] = []
        last: int | None = None
        ever = Clock.NONE
        for chunk in chunks:
            n = len(chunk.data)
            if not n:
                continue
            clock = clock_of(chunk)
            ever = max(ever, clock)
            if chunk.t_ns is None:
                t = (last if last is not None else 0) + n * self.byte_ns
            else:
                t = chunk.t_ns
                # A nominal time says nothing of the pause behind it.
                told = last is not None and clocks[-1] != Clock.NONE
                lull = t - n * self.byte_ns - (last or 0) if told else 0
                if lull > max(self.protocol.tail_ns, LATENCY_NS[ever]):
                    silences.append(len(data))
            times += [t - (n - 1 - k) * self.byte_ns for k in range(n)]
            clocks += [clock] * n
            data += chunk.data
            last = t
        self.times, self.clocks = times, clocks
        edges = [0, *silences, len(data)]
        for a, b in itertools.pairwise(edges):
            self._stretch(bytes(data), a, b)
        self.out.transactions.sort(key=in_order)
        self.out.samples = self.values.samples
        return self.out

    def _stretch(self, data: bytes, a: int, b: int) -> None:
        frames: list[SlowFrame] = []
        p = a
        while p < b:
            found = self.protocol.slow_parse(data, p, b)
            if found is None:
                p += 1
                continue
            replies = sum(kind != REQUEST for _, _, kind in found)
            for start, end, kind in found:
                # of several bare replies in a row the first is to the first of as many commands
                bare = kind != REQUEST and found[0][2] == REQUEST
                back = replies if bare else 1
                before = frames[-back] if len(frames) >= back else None
                if before is not None and not bare and start - before.end > self.protocol.reach:
                    before = None
                if before is not None and before.asked is not None:
                    far = start - before.asked.end > self.protocol.reach
                    before.asked = None if far else before.asked
                frame = self.protocol.slow_describe(data[start:end], kind, before)
                frame.start, frame.end = start, end
                frame.data_start += start
                frames.append(frame)
                p = end
        slow_staged_ids(frames, self.staged_ids, self.protocol.everyone)
        echoes, self.echoes = slow_echoes(frames, self.echoes, a, b)
        for row in echoes:
            frames[row].flags |= ECHO
        pairs = self._pair(frames)
        self._judge(pairs, frames, data, b)
        for f in frames:
            self.out.frames.append(
                (
                    f.start,
                    f.end - f.start,
                    f.kind,
                    f.servo_id,
                    f.op,
                    f.address,
                    f.data,
                    f.status,
                    f.reply,
                    f.token,
                    f.alt_id,
                    f.flags,
                    self._t_start(f),
                    self.times[f.end - 1],
                )
            )

    def _t_start(self, f: SlowFrame) -> int:
        first = self.times[f.start] - self.byte_ns
        latest = self.times[f.end - 1] - (f.end - f.start) * self.byte_ns
        if not self.clocks[f.start] and self.clocks[f.end - 1]:
            return latest  # a nominal time is none beside a stamp
        if self.clocks[f.start] == Clock.SAMPLE:
            return min(first, self.times[f.end - 1])
        return min(first, latest)

    def _pair(self, frames: list[SlowFrame]) -> list[_Pair]:
        pairs = [_Pair(f, None, NOT_EXPECTED) for f in frames if f.flags & ECHO]
        sent = {a.start: b for a, b in itertools.pairwise(frames) if b.flags & ECHO}
        frames = [f for f in frames if not f.flags & ECHO]
        alone = {row for row, f in enumerate(frames) if f.kind == REQUEST}
        reach, ordered = self.protocol.reach, self.protocol.ordered
        for answer, asked, outcome in matched(frames, reach, ordered=ordered):
            f = frames[answer]
            if outcome != OK and self.protocol.slow_states_itself(f):
                self.themselves.add(f.start)
            if asked < 0:
                pairs.append(_Pair(None, f, UNSOLICITED))
                continue
            alone.discard(asked)
            q = frames[asked]
            own = outcome != OK and f.op >= 0  # it keeps the name it bears
            f.op = f.op if own else q.op
            f.servo_id = f.servo_id if f.servo_id >= 0 else q.servo_id
            f.address = f.address if own or f.address >= 0 else q.address
            end = sent.get(q.start, q).end  # an echo tells when it was on the wire
            known = self.clocks[f.end - 1] and self.clocks[end - 1]
            took = max(self._t_start(f) - self.times[end - 1], 0) if known else -1
            pairs.append(_Pair(q, f, outcome, took))
        pairs += [_Pair(frames[row], None, NO_RESPONSE) for row in alone]
        pairs.sort(key=_place)
        return pairs

    def _judge(self, pairs: list[_Pair], frames: list[SlowFrame], data: bytes, stop: int) -> None:
        """Walk the stretch once, in order: outcomes and values depend on what came before."""
        paired = {id(p.response) for p in pairs if p.response is not None and p.outcome == OK}
        refused = {
            id(p.request)
            for p in pairs
            if p.outcome == OK
            and p.request is not None
            and p.response is not None
            and p.response.status >= 0
            and self.values.refused(p.response.status)
        }
        answered_by = {
            id(p.request): p.response.servo_id
            for p in pairs
            if p.outcome == OK and p.request is not None and p.response is not None
        }
        told: dict[int, list[tuple[int, int, int]]] = {}
        for f in frames:
            answers = id(f) in paired or f.start in self.themselves
            who = answered_by.get(id(f), -1)
            told[f.start] = self.values.read(
                f, self.times[f.end - 1], answers, id(f) not in refused, who
            )
        torn = self._torn(pairs, frames, data, stop)
        row = {id(f): i for i, f in enumerate(f for f in frames if not f.flags & ECHO)}
        heard = 0  # frames before what is judged: what they tell of return modes holds
        for p in pairs:
            q, r = p.request, p.response
            while heard < len(frames) and frames[heard].start < _place(p):
                self._hear(told[frames[heard].start])
                heard += 1
            if q is not None and r is None and not q.flags & ECHO:
                mode = self.mode[q.servo_id & 255]
                expected = (
                    q.reply >= MUST
                    or (q.reply == IF_READ and mode != 0)
                    or (q.reply == IF_ALL and mode == 2)
                )
                p.outcome = (
                    (DAMAGED if id(q) in torn else NO_RESPONSE) if expected else NOT_EXPECTED
                )
            # Of several open requests the answer may be another's: right behind its own it is not.
            right_behind = q is not None and r is not None and row[id(r)] == row[id(q)] + 1
            if q is not None and right_behind and p.outcome == OK and q.reply == IF_ALL:
                self.mode[q.servo_id & 255] = 2
            self.out.transactions.append(
                (q.start if q else -1, r.start if r else -1, p.outcome, p.took)
            )
        for f in frames[heard:]:
            self._hear(told[f.start])

    def _hear(self, told: list[tuple[int, int, int]]) -> None:
        for servo, mode, new in told:
            if new >= 0:
                self.mode[new] = self.mode[servo & 255]
            elif servo < 0:
                self.mode = [mode] * 256
            else:
                self.mode[servo & 255] = mode

    def _torn(
        self, pairs: list[_Pair], frames: list[SlowFrame], data: bytes, stop: int
    ) -> set[int]:
        """Return the requests behind which unclaimed bytes stand where their answer should."""
        starts = {f.start for f in frames}
        answers = {
            id(p.request): p.response
            for p in pairs
            if p.request is not None and p.response is not None and p.outcome == OK
        }

        def torn(f: SlowFrame) -> bool:
            behind = f.end
            while behind < stop and data[behind] in self.protocol.blank:
                behind += 1
            return behind != stop and behind not in starts

        turn: list[SlowFrame] = []
        turns = [turn]
        for i, f in enumerate(frames):
            if i and (f.kind != REQUEST or frames[i - 1].kind != REQUEST or torn(frames[i - 1])):
                turn = []
                turns.append(turn)
            if f.kind == REQUEST:
                turn.append(f)
        out: set[int] = set()
        for turn in turns:
            for i, q in enumerate(turn):
                where = q
                before = [answers[id(p)] for p in turn[:i] if id(p) in answers]
                behind = [answers[id(p)] for p in turn[i + 1 :] if id(p) in answers]
                if before:
                    where = before[-1]
                elif any(r.start - q.end <= self.protocol.reach for r in behind):
                    where = turn[-1]
                echo = i + 1 < len(turn) and bool(turn[i + 1].flags & ECHO)
                if (
                    torn(q)
                    or (echo and torn(turn[i + 1]))
                    or (torn(where) and where.end - q.end < self.protocol.reach)
                ):
                    out.add(id(q))
        return out


def in_order(row: TransactionRow) -> tuple[int, int]:
    """Order by request; a block may tell of one where its answer stands."""
    return (row[0] if row[0] >= 0 else row[1]), row[1]


def _place(p: _Pair) -> int:
    """Where a transaction stands in the order: at its request, or at its own response."""
    if p.request is None or (p.request.reply == MANY and p.response is not None):
        return p.response.start if p.response is not None else 0
    return p.request.start
