"""A port that goes away while it is listened to."""

from __future__ import annotations

from dataclasses import replace

from sniffer.ground.model import Chunk, Clock, Mark, MarkKind
from tests.conversations import MS, TONGUES, robot
from tests.diagnosed import verdicts
from tests.lists import each_in_turn


@each_in_turn(4, "protocol", list(TONGUES))
def test_a_port_that_goes_away_behind_all_that_was_said_lost_nothing(protocol: str) -> None:
    """Unplugged at the end of a run: the tap lost bytes, 64 %, though every byte was there."""
    talk = robot(protocol, 6)
    end = talk.chunks[-1].t_ns or 0
    gone = Chunk(b"", end + 20 * MS, Clock.READ, marks=(Mark(MarkKind.LOST, 0),))
    reads = [replace(chunk, clock=Clock.READ) for chunk in talk.chunks]
    told = talk.diagnosed([*reads, gone])
    assert verdicts(told.incidents()) == []
    assert told.rest(told.incidents()).told == "1 x port-lost"
    half = len(reads) // 2
    back = replace(gone, t_ns=(reads[half].t_ns or 0) + MS // 10)
    between = talk.diagnosed([*reads[:half], back, *reads[half:]])
    assert [cause for cause, _ in verdicts(between.incidents())] == ["tap-loss"]
