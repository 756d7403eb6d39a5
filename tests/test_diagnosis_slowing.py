"""Control loops that get slower and slower, and programs that only do something else later."""

from __future__ import annotations

from typing import TYPE_CHECKING, Any

import pytest

from tests.conversations import Conversation, swinging, through_usb, without_clock
from tests.diagnosed import codes, found, verdicts
from tests.lists import each_in_turn

if TYPE_CHECKING:
    from collections.abc import Callable, Mapping

SECONDS = 40


def looped(
    cycle_ms: Callable[[float], float],
    *,
    protocol: str = "mightyzap",
    asked: Callable[[float], int] = lambda s: 3,
    late_ms: Callable[[float], float] = lambda s: 0.3,
    away: Callable[[float], bool] = lambda s: False,
) -> Conversation:
    """Return 40 s of a loop whose cycles, servos and answers go by the time."""
    talk = Conversation(protocol)
    while talk.now_s < SECONDS:
        began_s = talk.now_s
        for servo in range(1, 1 + asked(began_s)):
            talk.send(servo, swinging(servo, began_s))
            if servo == 2 and away(began_s):
                talk.ask_in_vain(servo)
                continue
            talk.say(talk.tongue.ask(servo))
            talk.rest(late_ms(began_s))
            talk.say(talk.tongue.answer(servo, swinging(servo, began_s)))
            talk.rest(0.4)
        talk.until(began_s + cycle_ms(began_s) / 1000)
    return talk


@each_in_turn(4, "protocol", ["mightyzap", "lss", "rs30x", "wck"])
def test_a_loop_that_gets_slower_and_slower_is_told_so(protocol: str) -> None:
    talk = looped(lambda s: 20 + s, protocol=protocol)
    told = talk.diagnosed()
    assert verdicts(told.incidents()) == [("controller-slows", ())]
    late = talk.diagnosed(through_usb(talk.chunks))
    assert ("controller-slows", ()) in verdicts(late.incidents())


def test_how_slow_a_loop_gets_is_told_in_requests_a_second() -> None:
    (slows,) = (
        f for f in found(looped(lambda s: 20 + 1.5 * s).diagnosed()) if f.code == "loop-slows"
    )
    assert slows.brief == "from 258 to 78.4 requests a second"


SOUND: Mapping[str, Mapping[str, Any]] = {
    "it keeps its time": {"cycle_ms": lambda s: 20},
    "it becomes faster": {"cycle_ms": lambda s: 80 - 1.5 * s},
    "a fast mode, then an idle one": {"cycle_ms": lambda s: 20 if s < 18 else 60},
    "now fast, now idle": {"cycle_ms": lambda s: 60 if s % 20 < 9 else 20},
    "three modes, ever slower": {"cycle_ms": lambda s: 20 if s < 11 else 40 if s < 25 else 80},
    "it asks for all at first": {"cycle_ms": lambda s: 5 if s < 3 else 40},
    "more and more servos are asked": {
        "cycle_ms": lambda s: 20 * (1 + s // 8),
        "asked": lambda s: 1 + int(s // 8),
    },
    "answers take longer and longer": {
        "cycle_ms": lambda s: 0,
        "late_ms": lambda s: 0.3 + s / 4,
    },
    "more and more is missing": {
        "cycle_ms": lambda s: 0,
        "away": lambda s: (s * 10) % 40 < s,
    },
}


@pytest.mark.parametrize("goes", SOUND)
def test_a_program_that_does_something_else_later_does_not_get_slower(goes: str) -> None:
    assert "loop-slows" not in codes(looped(**SOUND[goes]).diagnosed())


def test_without_a_clock_nothing_is_said_of_how_fast_a_loop_is() -> None:
    talk = looped(lambda s: 20 + 1.5 * s)
    assert "loop-slows" not in codes(talk.diagnosed(without_clock(talk.chunks)))
