"""A logger that is held up writes its lines late, several with one time: no loop stopped there."""

from __future__ import annotations

import random
from typing import TYPE_CHECKING

from sniffer.ground.model import Chunk, Clock
from tests.conversations import Conversation, swinging
from tests.diagnosed import alarms
from tests.lists import each_in_turn

if TYPE_CHECKING:
    from collections.abc import Iterable

MS = 1_000_000
SERVOS = range(1, 6)


@each_in_turn(3, "protocol", ["mightyzap", "rs30x", "wck"])
def test_pauses_behind_which_more_stands_than_a_line_carries_are_the_loggers(protocol: str) -> None:
    talk = Conversation(protocol)
    while talk.now_s < 20:
        for servo in SERVOS:
            talk.send(servo, swinging(servo, talk.now_s))
            talk.read(servo, swinging(servo, talk.now_s))
    assert not alarms(talk.diagnosed(held_up(talk.chunks)))


def held_up(chunks: Iterable[Chunk]) -> list[Chunk]:
    """Write the lines of 17 ms late, now and then, all with the time at which they are written."""
    rng = random.Random(4)
    out, until = [], 0
    for chunk in chunks:
        assert chunk.t_ns is not None
        if chunk.t_ns > until and rng.random() < 0.004:
            until = chunk.t_ns + 17 * MS
        out.append(Chunk(chunk.data, max(chunk.t_ns, until), Clock.FILE))
    return out
