"""Damaged places with what stood around them: whose turn it was, and what should have stood there.

A place is a run of bytes that no frame claims, in one go. The first ``KEPT`` are kept with their
bytes; all of them are counted by servo and by whose turn it was.
"""

from __future__ import annotations

from typing import TYPE_CHECKING, Final, NamedTuple

import numpy as np

from sniffer.diagnosis.ledger.answered import AnsweredCommands, is_awaited, outcomes_of
from sniffer.diagnosis.ledger.buckets import TimedBuckets
from sniffer.diagnosis.ledger.likes import Asking, Likes, RequestBefore, asking_of
from sniffer.diagnosis.ledger.torn import TornRuns, is_held, only_value
from sniffer.ground.codes import REQUEST, RESPONSE
from sniffer.ground.gaps import BLANK, CHECKSUM, IDLE_TAIL, NOISE, Gaps
from sniffer.ground.model import Clock, Frames

if TYPE_CHECKING:
    from collections.abc import Iterator

    from sniffer.ground.model import I64, Batch, Mask
    from sniffer.protocols.base import BusProtocol

IN_REQUEST, IN_REPLY, AT_TURN, IN_IDLE, HELD, REST = range(6)
"""Whose turn it was: a request torn; an answer torn; stray bytes right before or behind a sound
answer; stray bytes elsewhere; one value over and over; more pieces of a torn answer."""

STRAYS: Final = (AT_TURN, IN_IDLE)
"""Where stray bytes stand: the last one of a bare answer that took one for its first does, too."""

TURNS: Final = ("requests", "replies", "turns", "idle", "held", "rest")

KEPT: Final = 2000

BYTES: Final = 80
"""Bytes kept of each place: more than a frame of any protocol here needs to be compared."""

STRAY: Final = 4
"""Fewer bytes of no frame are stray: no frame with a header is so short."""

NEAR_BYTES: Final = 2
"""What comes within so many byte times behind a frame comes with its end."""

BLANKS: Final = 2
"""So many bytes without a meaning (line feeds) may stand between a frame and what follows it."""

APART_BYTES: Final = 3
"""Pieces of one run that are further apart than so many byte times are two."""

PAUSE_NS: Final = 100_000
"""What a sender may pause within a frame beside that: some clients wait between bytes."""

_COUNTS: Final = {
    "n": "sum",
    "bytes": "sum",
    "at": "first",
    "length": "first",
    "t_first": "first",
    "t_last": "last",
}


class Damage(NamedTuple):
    """One place without a frame.

    ``kind`` is that of the gap, ``servo_id`` who was asked or is named (-1: nobody). ``asked`` is
    the request right before it (empty: none). ``alike`` are sound frames that stood in such a place
    not long before: the servo's answers to the same request, or requests of that length, the
    likeliest first. ``since_ns`` is how long the frame before was over, ``until_ns`` how long it
    took until the next frame began; -1 where nobody knows. ``is_answered``: a sound answer to the
    same request follows, ``behind`` the kind of the frame before (-1: none). ``begins_ns`` is when
    its first byte began (-1: nobody knows), ``asked_before`` are the last requests before it, the
    latest first, ``then`` is what the next frame asks (None: it is no request, or not heard yet).
    ``between`` are all bytes from the frame before to that one (-1: nobody knows).
    """

    at: int
    length: int
    t_ns: int
    kind: int
    turn: int
    servo_id: int
    got: bytes
    asked: bytes
    alike: tuple[bytes, ...]
    since_ns: int = -1
    until_ns: int = -1
    is_answered: bool = False
    behind: int = -1
    begins_ns: int = -1
    asked_before: tuple[RequestBefore, ...] = ()
    then: Asking | None = None
    between: int = -1

    @property
    def expected(self) -> bytes:
        """What should have stood there, empty where nothing is known."""
        return self.alike[0] if self.alike else b""

    @property
    def asked_id(self) -> int:
        """Whom the last request before it asked; -1: nobody."""
        return self.asked_before[0].servo_id if self.asked_before else -1

    @property
    def earlier_id(self) -> int:
        """Whom the last request before it asked that asked somebody else; -1: nobody."""
        return -1 if (asked := self._earlier) is None else asked.servo_id

    @property
    def asked_ns(self) -> int:
        """How long the last request was over when it began; -1: nobody knows."""
        return self._since(self.asked_before[0] if self.asked_before else None)

    @property
    def earlier_ns(self) -> int:
        """How long the last request to somebody else was over; -1: nobody knows."""
        return self._since(self._earlier)

    @property
    def _earlier(self) -> RequestBefore | None:
        return next((a for a in self.asked_before if a.servo_id != self.asked_id), None)

    def _since(self, asked: RequestBefore | None) -> int:
        return -1 if asked is None or self.since_ns < 0 else self.begins_ns - asked.t_ns


class _Edge(NamedTuple):
    """The last frame before a batch, as far as a run needs it; ``end`` is absolute."""

    end: int
    kind: int
    servo_id: int
    reply: int
    t_end: int
    uncertainty: int
    window_ns: int
    outcome: int
    op: int


_NOBODY: Final = _Edge(-1 << 40, -1, -1, 0, 0, -1, 0, -1, -1)


class _Told(NamedTuple):
    """What is known of runs: whose turn each was, whom it is about, and the frame before."""

    turn: I64
    who: I64
    since_ns: I64
    until_ns: I64
    row: I64
    behind: I64
    asks: Mask
    follows: Mask
    after: I64
    between: I64


class Damages:
    """Keeps damaged places batch after batch."""

    def __init__(self, protocol: BusProtocol) -> None:
        self._protocol = protocol
        self._counts = TimedBuckets(_COUNTS, turn=len(TURNS))
        self.likes = Likes()
        self._answered = AnsweredCommands()
        self._kept: list[Damage] = []
        self._open = TornRuns.empty()
        self._begun = b""
        self._edge: _Edge | None = None
        self._byte_ns = 0

    @property
    def kept(self) -> list[Damage]:
        """The first places, with the one that may still go on."""
        left = KEPT - len(self._kept)
        if not len(self._open) or not left:
            return self._kept
        told = self._told(self._open, None)
        return [*self._kept, *self._made(self._open, told, None, left)]

    def counted(self) -> dict[str, I64]:
        """Return the counts as columns, with ``bucket``, ``servo_id`` and ``turn``."""
        counts = self._counts
        if len(self._open):
            counts = counts.copy()
            self._count(counts, self._open, self._told(self._open, None))
        return counts.table()

    def add(self, batch: Batch, byte_ns: int) -> None:
        """Take the gaps of a batch; ``byte_ns`` is how long a byte takes on the line."""
        self._byte_ns = byte_ns
        self._answered.add(batch)
        if len(batch.data) and (len(batch.gaps) or len(self._open)):
            self._places(batch)
        if len(batch.frames):
            self._edge = self._last(batch)
            self.likes.add(batch)

    def _last(self, batch: Batch) -> _Edge:
        """Return the last frame of a batch."""
        f = batch.frames
        last = f.take(slice(len(f) - 1, None))
        return _Edge(
            int(last.end[0]) + batch.base,
            int(last.kind[0]),
            int(last.servo_id[0]),
            int(last.reply[0]),
            int(last.t_end[0]),
            int(last.uncertainty[0]),
            int(self._protocol.window_ns(last)[0]),
            int(outcomes_of(batch)[len(f) - 1]),
            int(last.op[0]),
        )

    def _places(self, batch: Batch) -> None:
        """Join gaps in a row; take those to which nothing more can be joined."""
        runs = self._runs(batch)
        if not len(runs):
            return
        last = runs.take(slice(len(runs) - 1, None))
        self._open = TornRuns.empty()
        if int(last.start[0] + last.length[0]) == batch.base + len(batch.data):
            self._open = last
            runs = runs.take(slice(0, len(runs) - 1))
        if len(runs):
            told = self._told(runs, batch)
            self._count(self._counts, runs, told)
            self._kept += self._made(runs, told, batch, KEPT - len(self._kept))
        if len(self._open):
            at = int(last.start[0]) - batch.base
            self._begun = ((self._begun if at < 0 else b"") + batch.data[max(at, 0) :])[:BYTES]

    def _runs(self, batch: Batch) -> TornRuns:
        """Return the runs of a batch, the one that is open first."""
        gaps = Gaps.of(batch.gaps)
        rows = np.flatnonzero(gaps.kind != BLANK)
        start, length, t_ns = gaps.start[rows], gaps.length[rows], gaps.t_ns[rows]
        pieces = TornRuns(
            start + batch.base,
            length,
            t_ns - length * self._byte_ns,
            t_ns,
            gaps.kind[rows].astype(np.int64),
            gaps.servo_id[rows],
            only_value(batch.data, start, length),
        )
        if len(self._open):
            pieces = TornRuns.concat([self._open, pieces])
        if len(pieces) < 2:
            return pieces
        end, p = pieces.start + pieces.length, pieces
        apart = p.start[1:] != end[:-1]
        if batch.clock != Clock.NONE:
            pause = p.begins_ns[1:] - p.t_ns[:-1]
            apart |= pause > APART_BYTES * self._byte_ns + PAUSE_NS
        held = is_held(p)
        # two frames that are whole but for their checksums are two
        apart |= (p.kind[1:] == CHECKSUM) & (p.kind[:-1] == CHECKSUM)
        # what is held for long is not what was torn beside it
        apart |= (p.value[1:] != p.value[:-1]) & (held[1:] | held[:-1])
        first = np.flatnonzero(np.concatenate([[True], apart]))
        last = np.append(first[1:], len(p)) - 1
        one = np.maximum.reduceat(p.value, first) == np.minimum.reduceat(p.value, first)
        return TornRuns(
            p.start[first],
            end[last] - p.start[first],
            p.begins_ns[first],
            p.t_ns[last],
            np.maximum.reduceat(p.kind, first),
            np.maximum.reduceat(p.servo_id, first),
            np.where(one, p.value[first], -1),
        )

    def _told(self, runs: TornRuns, batch: Batch | None) -> _Told:
        """Judge whose turn each run was, by the frames before and behind it.

        Row -1, before the first frame of a batch, is the last one of the batch before.
        """
        f = Frames.empty() if batch is None else batch.frames
        base = 0 if batch is None else batch.base
        start, end = runs.start - base, runs.start + runs.length - base
        row = np.searchsorted(f.end, start, "right") - 1
        after = np.searchsorted(f.start, end)
        edge = self._edge or _NOBODY
        kind, servo, reply, ends, ended, doubt, op = (
            np.append(column.astype(np.int64), last)[row]
            for column, last in (
                (f.kind, edge.kind),
                (f.servo_id, edge.servo_id),
                (f.reply, edge.reply),
                (f.end, edge.end - base),
                (f.t_end, edge.t_end),
                (f.uncertainty, edge.uncertainty),
                (f.op, edge.op),
            )
        )
        then = np.append(f.kind.astype(np.int64), -1)[after]
        asked = np.where(then == REQUEST, after, -1)
        next_start = np.append(f.start, -1)[after]
        between = np.where((next_start >= 0) & (kind >= 0), next_start - ends, -1)
        follows = (then == RESPONSE) & (next_start == end)
        known = outcomes_of(batch)[:-1] if batch is not None else np.empty(0, np.int64)
        outcome = np.append(known, edge.outcome)[row]
        timed = np.append(f.uncertainty, -1)[after]
        since = np.where(doubt >= 0, runs.begins_ns - ended, -1)
        next_to = (start - ends <= BLANKS) & (kind >= 0)
        peers = (doubt >= 0) & self._answered.are_known(op, runs.start)
        asks = (kind == REQUEST) & is_awaited(reply, outcome, follows, peers)
        inside = asks & (doubt >= 0)
        if inside.any():
            own = row[inside] >= 0
            window = np.full(len(own), edge.window_ns)
            window[own] = self._protocol.window_ns(f.take(row[inside][own]))
            asks[inside] = since[inside] - doubt[inside] <= window
        stray = ((runs.kind == NOISE) | (runs.kind == IDLE_TAIL)) & (runs.length < STRAY)
        near = next_to & (doubt >= 0) & (doubt <= self._byte_ns)
        near &= since <= NEAR_BYTES * self._byte_ns + PAUSE_NS
        turn = np.where(
            is_held(runs),
            HELD,
            np.where(
                stray & ((asks & follows) | (near & ~asks)),
                AT_TURN,
                np.where(
                    asks & (next_to | follows),
                    IN_REPLY,
                    np.where(asks, REST, np.where(stray, IN_IDLE, IN_REQUEST)),
                ),
            ),
        )
        who = np.where(asks | (turn == AT_TURN), servo, runs.servo_id)
        next_ns = np.append(f.t_start, -1)[after]
        until = np.where((next_ns >= 0) & (timed >= 0), next_ns - runs.t_ns, -1)
        return _Told(turn, who, since, until, row, kind, asks, follows, asked, between)

    def _count(self, counts: TimedBuckets, runs: TornRuns, told: _Told) -> None:
        counts.add(
            runs.t_ns,
            told.who,
            told.turn,
            n=1,
            bytes=runs.length,
            at=runs.start,
            length=runs.length,
            t_first=runs.begins_ns,
            t_last=runs.t_ns,
        )

    def _made(
        self, runs: TornRuns, told: _Told, batch: Batch | None, most: int
    ) -> Iterator[Damage]:
        """Make the first few of some runs, each with what should have stood there."""
        base, f = (0, None) if batch is None else (batch.base, batch.frames)
        for i in range(min(len(runs), most)):
            at, size = int(runs.start[i]), int(runs.length[i])
            row, after = int(told.row[i]), int(told.after[i])
            if batch is None or at < base:
                got = (self._begun + (b"" if batch is None else batch.data))[:size][:BYTES]
            else:
                got = batch.data[at - base : at - base + min(size, BYTES)]
            turn = int(told.turn[i])
            asked = b""
            alike: tuple[bytes, ...] = ()
            if told.asks[i]:
                asked = self.likes.last(batch, row)
                alike = self.likes.answers(batch, row, asked)
            elif turn == IN_REQUEST and size <= BYTES:
                alike = self.likes.requests(batch, row, got)
            yield Damage(
                at,
                size,
                int(runs.t_ns[i]),
                int(runs.kind[i]),
                turn,
                int(told.who[i]),
                got,
                asked,
                alike,
                int(told.since_ns[i]),
                int(told.until_ns[i]),
                bool(told.asks[i] and told.follows[i]),
                int(told.behind[i]),
                int(runs.begins_ns[i]) if told.since_ns[i] != -1 else -1,
                self.likes.asked_before(batch, row),
                asking_of(f, after) if f is not None and after >= 0 else None,
                int(told.between[i]),
            )
