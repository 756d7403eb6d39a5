"""Seeded traffic with many requests in flight: the columns match as the slow way does."""

from __future__ import annotations

from typing import TYPE_CHECKING

import numpy as np
import pytest

from sniffer.decoding import matching
from sniffer.decoding.decoder import Decoder
from sniffer.decoding.matching import match, outcomes
from sniffer.decoding.reference.pending import matched
from sniffer.ground.codes import MANY, MUST, NEVER, REQUEST, RESPONSE, UNSOLICITED
from sniffer.ground.model import ANY_ID, NO_ALT, Frames
from sniffer.protocols.base import SlowFrame
from tests.lists import in_turn
from tests.streams.mightyzap import packet

if TYPE_CHECKING:
    from collections.abc import Iterator

    from sniffer.ground.model import I64

REACHES = (0, 20, 60, 262, 512)
Told = tuple[int, int]


class Traffic:
    """Random requests and answers: pipelined, lost, doubled, repeated, of others, late."""

    def __init__(self, rng: np.random.Generator) -> None:
        self.rng = rng
        self.frames: list[SlowFrame] = []
        self.at = 0
        self.reach = int(rng.choice(REACHES))
        depth = int(rng.integers(1, 17))
        self.ids, self.tokens = int(rng.integers(1, 5)), int(rng.integers(1, 4))
        wild, broad, lost, wrong, twice, hush = rng.random(6) * rng.choice([0, 0.05, 0.3], 6)
        self.hush = hush * 0.3
        due: list[Told] = []
        for _ in range(int(rng.integers(1, 40))):
            for _ in range(int(rng.integers(1, depth + 1))):
                due += self._ask(wild, broad, lost, twice)
            while due and rng.random() < 0.9:
                late = rng.random() < 0.1
                self._answer(*due.pop(int(rng.integers(len(due))) if late else 0), wrong)

    def _put(self, kind: int, servo: int, reply: int, token: int, alt: int = NO_ALT) -> None:
        self.at += int(self.rng.integers(1, 200)) if self.rng.random() < self.hush else 0
        end = self.at + int(self.rng.integers(1, 20))
        frame = SlowFrame(self.at, end, kind, servo, 0, b"", reply=reply, token=token, alt_id=alt)
        self.frames.append(frame)
        self.at = end

    def _ask(self, wild: float, broad: float, lost: float, twice: float) -> Iterator[Told]:
        rng = self.rng
        servo, token = int(rng.integers(1, self.ids + 1)), int(rng.integers(0, self.tokens))
        if rng.random() < broad:
            if rng.random() < 0.5:
                self._put(REQUEST, 254, NEVER, token)
                return
            self._put(REQUEST, 254, MANY, token, ANY_ID)
            yield from ((s, token) for s in range(1, self.ids + 1) if rng.random() > lost)
            return
        alt = int(rng.choice([ANY_ID, 1, 2, 3])) if rng.random() < wild else NO_ALT
        for _ in range(2 if rng.random() < twice else 1):
            self._put(REQUEST, servo if alt == NO_ALT else 0, MUST, token, alt)
        if rng.random() >= lost:
            yield from [(servo, token)] * (2 if rng.random() < twice else 1)

    def _answer(self, servo: int, token: int, wrong: float) -> None:
        rng = self.rng
        servo = int(rng.integers(1, 6)) if rng.random() < wrong else servo
        token = int(rng.choice([-1, 0, 1, 2])) if rng.random() < wrong else token
        self._put(RESPONSE, -1 if rng.random() < wrong * 0.2 else servo, NEVER, token)


def columns(frames: list[SlowFrame]) -> Frames:
    """Return the same frames as columns."""
    told = Frames.empty()
    n = len(frames)
    out = {}
    for name in Frames.__slots__:
        kind = getattr(told, name).dtype
        values = [f.end - f.start if name == "length" else getattr(f, name, 0) for f in frames]
        out[name] = np.array([v if isinstance(v, int) else 0 for v in values], kind)
        assert len(out[name]) == n
    return Frames(**out)


def slowly(frames: list[SlowFrame], segment: I64 | None, reach: int) -> I64:
    """Match each stretch the slow way, in the form that the columns give."""
    out = np.full(len(frames), -1, np.int64)
    numbers = np.zeros(len(frames), np.int64) if segment is None else segment
    for number in np.unique(numbers).tolist():
        mine = np.flatnonzero(numbers == number)
        for r, q, how in matched([frames[i] for i in mine.tolist()], reach):
            if q >= 0:
                out[mine[r]] = mine[q] if how == 0 else -2 - mine[q]
            else:
                assert how == UNSOLICITED
    return out


def drawn(case: int) -> tuple[Traffic, I64 | None]:
    rng = np.random.default_rng(case)
    traffic = Traffic(rng)
    silences = rng.random(len(traffic.frames)) < 0.05
    segment = np.cumsum(silences, dtype=np.int64) if rng.random() < 0.5 else None
    return traffic, segment


@in_turn(4)
@pytest.mark.parametrize("first", range(0, 600, 100))
@pytest.mark.parametrize("sparse", [matching.SPARSE, 1], ids=["usual", "each_looked_at"])
def test_columns_match_as_the_slow_way_does(
    first: int, sparse: int, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(matching, "SPARSE", sparse)
    seen = 0
    for case in range(first, first + 100):
        traffic, segment = drawn(case)
        want = slowly(traffic.frames, segment, traffic.reach)
        got = match(columns(traffic.frames), segment, traffic.reach)
        assert got.tolist() == want.tolist(), case
        seen += len(outcomes(got)[0])
    assert seen > 1000


@in_turn(2)
@pytest.mark.parametrize("first", range(0, 200, 50))
def test_answers_claimed_by_requests_before_the_rows_leave_the_others_as_they_are(
    first: int,
) -> None:
    """A block may begin anywhere, if it is known which answers belong to what stood before it."""
    spanned = 0
    for case in range(first, first + 50):
        traffic, segment = drawn(case)
        rows = columns(traffic.frames)
        n = len(rows)
        whole = match(rows, segment, traffic.reach)
        answer, asked, _ = outcomes(whole)
        for cut in range(0, n, max(1, n // 7)):
            claimed = np.zeros(n, bool)
            claimed[answer[(asked < cut) & (answer >= cut)]] = True
            spanned += int(claimed.sum())
            rest = None if segment is None else segment[cut:]
            got = match(rows.take(slice(cut, None)), rest, traffic.reach, claimed[cut:])
            want = whole[cut:].copy()
            want[claimed[cut:]] = -1
            want = np.where(want >= 0, want - cut, np.where(want < -1, want + cut, want))
            assert got.tolist() == want.tolist(), (case, cut)
    assert spanned > 100


@pytest.mark.parametrize(
    ("said", "pairs"),
    [
        # 0 names any; negative: an answer of that servo
        ((0, 1, -1, -1), {2: 1, 3: -1}),
        ((0, -1, 1, -1), {1: 0, 3: 2}),
        ((1, 0, -1, -1), {2: 0, 3: 1}),
        ((0, 1, 2, -1, -2), {3: 1, 4: 2}),
        ((0, 1, -2, -1), {2: 0, 3: 1}),
    ],
)
def test_a_servo_that_was_asked_by_name_does_not_answer_for_any(
    said: tuple[int, ...], pairs: dict[int, int]
) -> None:
    wires = [packet(-who, 0) if who < 0 else packet(who, 0xF1) for who in said]
    decoder = Decoder("mightyzap")
    batches = decoder.feed(b"".join(wires)), decoder.close()
    found: dict[int, int] = {}
    for batch in batches:
        t = batch.transactions
        found |= dict(zip(t.response.tolist(), t.request.tolist(), strict=True))
    assert {answer: found[answer] for answer in pairs} == pairs
