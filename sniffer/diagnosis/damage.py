"""Damaged places with what stood around them: whose turn it was, and what should have stood there.

The first ``KEPT`` are kept with their bytes; all of them are counted by servo and by whose turn it
was.
"""

from __future__ import annotations

import itertools
from collections import deque
from dataclasses import dataclass
from typing import TYPE_CHECKING, Final, NamedTuple

import numpy as np

from sniffer.diagnosis.buckets import Buckets
from sniffer.ground.codes import MANY, NEVER, REQUEST, RESPONSE
from sniffer.ground.gaps import BLANK, IDLE_TAIL, NOISE, Gaps
from sniffer.ground.model import NS

if TYPE_CHECKING:
    from collections.abc import Iterator

    from sniffer.ground.model import I64, Batch
    from sniffer.protocols.base import BusProtocol

IN_REQUEST, IN_REPLY, AT_TURN, IN_IDLE = range(4)
"""Whose turn it was: a request torn; an answer torn; stray bytes before or behind a sound answer;
stray bytes elsewhere."""

TURNS: Final = ("requests", "replies", "turns", "idle")

KEPT: Final = 2000

BYTES: Final = 80
"""Bytes kept of each place: more than a frame of any protocol here needs to be compared."""

BEFORE: Final = 256
"""Frames before a place in which its like is looked for."""

NEAR: Final = 64
"""Frames before a torn request among which the one that it resembles most is looked for."""

_BUCKET_NS: Final = NS // 4

_COUNTS: Final = {
    "n": "sum",
    "bytes": "sum",
    "at": "first",
    "length": "first",
    "t_first": "first",
    "t_last": "last",
}


@dataclass(frozen=True, slots=True)
class Damage:
    """One place without a frame.

    ``kind`` is that of the gap, ``servo_id`` who was asked or is named (-1: nobody). ``asked`` is
    the request right before it (empty: none), ``expected`` the last sound frame that stood in such
    a place: the servo's answer to the same request, or the nearest request (empty: none known).
    """

    at: int
    length: int
    t_ns: int
    kind: int
    turn: int
    servo_id: int
    got: bytes
    asked: bytes
    expected: bytes


class _Frame(NamedTuple):
    """A sound frame; places are absolute."""

    start: int
    end: int
    kind: int
    servo_id: int
    reply: int
    data: bytes


class Damages:
    """Keeps damaged places batch after batch."""

    def __init__(self, protocol: BusProtocol) -> None:
        self._protocol = protocol
        self.counts = Buckets(_COUNTS)
        """By bucket, servo (+1) and turn."""
        self.kept: list[Damage] = []
        self._recent: deque[Batch] = deque()  # those with the last frames

    def add(self, batch: Batch) -> None:
        """Take the gaps of a batch."""
        gaps = Gaps.of(batch.gaps)
        rows = np.flatnonzero(gaps.kind != BLANK)
        if len(rows):
            self._gaps(batch, gaps, rows)
        if len(batch.frames):
            self._recent.append(batch)
            later = sum(len(b.frames) for b in self._recent)
            while later - len(self._recent[0].frames) >= BEFORE:
                later -= len(self._recent.popleft().frames)

    def _gaps(self, batch: Batch, gaps: Gaps, rows: I64) -> None:
        f = batch.frames
        start, length = gaps.start[rows], gaps.length[rows]
        before = np.searchsorted(f.end, start, "right") - 1
        after = np.searchsorted(f.start, start + length)
        last = _frame(self._recent[-1], -1) if self._recent else None
        kind, servo, end, reply = (
            np.append(column, edge)
            for column, edge in (
                (f.kind.astype(np.int64), -1 if last is None else last.kind),
                (f.servo_id.astype(np.int64), -1 if last is None else last.servo_id),
                (f.end, -1 if last is None else last.end - batch.base),
                (f.reply.astype(np.int64), 0 if last is None else last.reply),
            )
        )  # row -1, before the first frame of the batch, is the last one of the batch before
        follows = np.append(f.kind.astype(np.int64), -1)
        asks = (kind[before] == REQUEST) & (end[before] == start)
        asks &= (reply[before] != NEVER) & (reply[before] != MANY)
        next_is_answer = (follows[after] == RESPONSE) & (
            np.append(f.start, -1)[after] == start + length
        )
        stray = (gaps.kind[rows] == NOISE) | (gaps.kind[rows] == IDLE_TAIL)
        behind_answer = (kind[before] == RESPONSE) & (end[before] == start) & stray
        turn = np.where(
            asks & next_is_answer,
            AT_TURN,
            np.where(
                asks,
                IN_REPLY,
                np.where(behind_answer, AT_TURN, np.where(stray, IN_IDLE, IN_REQUEST)),
            ),
        )
        who = np.where(asks | (turn == AT_TURN), servo[before], gaps.servo_id[rows])
        self.counts.add(
            ((gaps.t_ns[rows] // _BUCKET_NS) * 512 + who + 1) * len(TURNS) + turn,
            n=1,
            bytes=length,
            at=start + batch.base,
            length=length,
            t_first=gaps.t_ns[rows],
            t_last=gaps.t_ns[rows],
        )
        for i in range(min(len(rows), KEPT - len(self.kept))):
            row = int(before[i])
            at, size = int(start[i]), int(length[i])
            turned = int(turn[i])
            asked = next(self._earlier(batch, row)).data if asks[i] else b""
            self.kept.append(
                Damage(
                    at + batch.base,
                    size,
                    int(gaps.t_ns[rows[i]]),
                    int(gaps.kind[rows[i]]),
                    turned,
                    int(who[i]),
                    batch.data[at : at + min(size, BYTES)],
                    asked,
                    _like(self._earlier(batch, row), asked, batch.data[at : at + min(size, BYTES)]),
                )
            )

    def _earlier(self, batch: Batch, row: int) -> Iterator[_Frame]:
        """Yield the frames up to a row, the latest first, no more than ``BEFORE``."""
        left = BEFORE
        for r in range(row, max(-1, row - BEFORE), -1):
            left -= 1
            yield _frame(batch, r)
        for recent in reversed(self._recent):
            for k in range(min(left, len(recent.frames))):
                left -= 1
                yield _frame(recent, len(recent.frames) - 1 - k)

    def counted(self) -> dict[str, I64]:
        """Return the counts as columns, with ``bucket``, ``servo_id`` and ``turn``."""
        key, columns = self.counts.table()
        rest = key // len(TURNS)
        return {
            **columns,
            "turn": key % len(TURNS),
            "servo_id": rest % 512 - 1,
            "bucket": rest // 512,
        }


def _frame(batch: Batch, r: int) -> _Frame:
    f = batch.frames
    start, size = int(f.start[r]), int(f.length[r])
    return _Frame(
        start + batch.base,
        start + size + batch.base,
        int(f.kind[r]),
        int(f.servo_id[r]),
        int(f.reply[r]),
        batch.data[start : start + size],
    )


def _like(earlier: Iterator[_Frame], asked: bytes, got: bytes) -> bytes:
    """Return the last sound frame that stood where this damage stands."""
    if asked:
        for answer, request in itertools.pairwise(itertools.islice(earlier, 1, None)):
            if answer.kind == RESPONSE and request.kind == REQUEST and request.data == asked:
                return answer.data
        return b""
    best, least = b"", len(got) // 2 + 1
    for frame in itertools.islice(earlier, NEAR):
        if frame.kind == REQUEST and len(frame.data) == len(got):
            differ = sum(a != b for a, b in zip(frame.data, got, strict=True))
            if differ < least:
                best, least = frame.data, differ
                if differ == 1:
                    break
    return best
