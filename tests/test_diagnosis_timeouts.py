"""Pauses of one length, before any request of a loop: a time-out for what is lost elsewhere."""

from __future__ import annotations

import random
from typing import TYPE_CHECKING

import pytest

from tests.conversations import Conversation
from tests.diagnosed import codes, found, verdicts

if TYPE_CHECKING:
    from collections.abc import Callable

SERVOS = (1, 2, 3)


def loop(waits: Callable[[int], bool], *, lost: bool = False, of: int = 2400) -> Conversation:
    """Read servo after servo; some requests come 100 ms later, or are lost for as long."""
    talk = Conversation("mightyzap")
    for k in range(of):
        is_late = waits(k)
        if is_late:
            talk.rest(100)
        if not (is_late and lost):
            talk.read(SERVOS[k % 3], 0.5)
        talk.rest(8)
    return talk


def by_chance(part: float) -> Callable[[int], bool]:
    rng = random.Random(3)
    return lambda _: rng.random() < part


@pytest.mark.parametrize("lost", [False, True])
@pytest.mark.parametrize("part", [0.01, 0.03, 0.1])
def test_the_oftener_a_loop_waits_the_surer_it_is_told(part: float, *, lost: bool) -> None:
    """Where most quarter seconds have such a pause it is no longer than what is usual there."""
    told = loop(by_chance(part), lost=lost).diagnosed()
    assert verdicts(told.incidents()) == [("controller-stall", ())]
    (what,) = (f.what for f in found(told) if f.code == "waits-alike")
    assert ("lost before this wire" in what) == lost


@pytest.mark.parametrize(
    "waits",
    [
        pytest.param(lambda k: k % 60 == 59, id="always behind the same request"),
        pytest.param(lambda k: k % 20 == 19, id="behind so many requests"),
        pytest.param(lambda k: k // 300 % 2 == 1, id="a loop that is slower for a while"),
        pytest.param(lambda k: False, id="never"),
    ],
)
def test_pauses_that_a_program_makes_by_plan_are_not_told(waits: Callable[[int], bool]) -> None:
    assert "waits-alike" not in codes(loop(waits).diagnosed())


def test_pauses_behind_what_is_torn_are_time_outs_for_that() -> None:
    rng = random.Random(3)
    talk = Conversation("mightyzap")
    for k in range(2400):
        if rng.random() < 0.03:
            asked = talk.tongue.ask(SERVOS[k % 3])
            talk.say(asked[:3] + bytes([asked[3] ^ 1 << rng.randrange(8)]) + asked[4:])
            talk.rest(108)
        else:
            talk.read(SERVOS[k % 3], 0.5)
            talk.rest(8)
    assert "waits-alike" not in codes(talk.diagnosed())
