"""What a long fuzz of all readers found behind them: each left a vector here."""

from __future__ import annotations

from typing import TYPE_CHECKING, NamedTuple

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from sniffer.decoding import torn as columns
from sniffer.ground.codes import NEVER
from sniffer.ground.model import Frames
from tests.commands import within

if TYPE_CHECKING:
    from pathlib import Path

    from sniffer.ground.model import I64, Mask


class Turns(NamedTuple):
    """What ``_in_turn`` is asked: rows of requests and answers, in turns."""

    frames: Frames
    torn: Mask
    turn: I64
    answered: I64
    latest: I64
    reach: int


def one_by_one(t: Turns) -> Mask:
    """Tell which answers are torn, row by row: each turn is walked for each of its requests."""
    some = set(t.turn[(t.answered >= 0) | (t.latest >= 0)].tolist()) - {0}
    start, end = t.frames.start, t.frames.end
    out = t.torn.copy()
    for row in range(len(t.turn)):
        if int(t.turn[row]) not in some or t.answered[row] >= 0 or t.frames.reply[row] == NEVER:
            continue
        where = int(t.latest[row])
        if where < 0:
            last = row
            while last + 1 < len(t.turn) and t.turn[last + 1] == t.turn[row]:
                last += 1
            answers = [int(t.answered[k]) for k in range(row, last + 1) if t.answered[k] >= 0]
            where = last if any(start[a] - end[row] <= t.reach for a in answers) else row
        out[row] |= t.torn[where] and end[where] - end[row] < t.reach
    return out


def drawn(seed: int, rows: int, *, asks: float = 0.7, answers: float = 0.4) -> Turns:
    rng = np.random.default_rng(seed)
    sends = rng.random(rows) < asks
    turn = (np.cumsum(sends & (rng.random(rows) < 0.4)) * sends).astype(np.int64)
    frames = Frames.blank(rows)
    length = rng.integers(1, 6, rows)
    frames = frames.having(
        start=np.cumsum(length + rng.integers(0, 4, rows)) - length,
        length=length,
        reply=np.where(rng.random(rows) < 0.1, int(NEVER), int(NEVER) + 1),
    )

    def some_rows(share: float) -> I64:
        return np.where(rng.random(rows) < share, rng.integers(0, rows, rows), -1)

    answered = np.where(sends, some_rows(answers), -1)
    torn = rng.random(rows) < 0.5
    return Turns(frames, torn, turn, answered, some_rows(0.4), int(rng.integers(1, 30)))


def in_columns(t: Turns) -> Mask:
    torn = t.torn.copy()
    columns._in_turn(t.frames, torn, t.turn, t.answered, t.latest, t.reach)
    return torn


@given(st.integers(0, 2**32), st.integers(1, 14))
def test_torn_answers_of_turns_are_told_in_columns_as_one_by_one(seed: int, rows: int) -> None:
    turns = drawn(seed, rows)
    np.testing.assert_array_equal(in_columns(turns), one_by_one(turns))


def test_a_turn_as_long_as_a_capture_is_gone_through_once() -> None:
    rows = 100_000  # walked for each of its requests that would be minutes
    turns = drawn(1, rows)._replace(turn=np.ones(rows, np.int64), latest=np.full(rows, -1))
    assert in_columns(turns).sum() >= turns.torn.sum()


@pytest.mark.parametrize(
    "line",
    [
        b"(100.5) bus0 #FFFFFF0104F28C027A\n",
        b"20.11.2026 22:55:10.012 [TX] - FA AF 01 0F 2A 02 00 26 \n",
    ],
)
def test_requests_that_all_have_one_time_have_no_rhythm_and_do_no_harm(
    line: bytes, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    (tmp_path / "log.txt").write_bytes(line * 200)
    ran = within(capsys, "decode", tmp_path / "log.txt", "--summary")
    assert "fault of this program" not in ran.err
    assert "in 200 frames" in ran.out
