"""Commands to several servos whose items are of another length than the command says."""

from __future__ import annotations

import math
from typing import TYPE_CHECKING, Final

import pytest

from tests.conversations import Conversation
from tests.diagnosed import codes, verdicts
from tests.streams import mightyzap

if TYPE_CHECKING:
    from collections.abc import Callable

GOAL_AT: Final = 0x86
SERVOS: Final = (1, 2, 3)

Items = dict[int, bytes]


def u16(value: float) -> bytes:
    return round(value).to_bytes(2, "little")


def led(items: Callable[[int], Items], asked: tuple[int, ...] = SERVOS) -> Conversation:
    """Send several servos somewhere at once, cycle after cycle, and read where some are."""
    talk = Conversation("mightyzap")
    for cycle in range(200):
        body = b"".join(bytes([servo]) + item for servo, item in items(cycle).items())
        talk.write(mightyzap.packet(0xFE, 0x73, bytes([GOAL_AT, 2]) + body))
        talk.rest(10)
        for servo in asked:
            talk.read(servo, 0.5)
    return talk


def path(cycle: int) -> bytes:
    return u16(2047 + 800 * math.sin(cycle / 30))


def test_items_that_are_longer_than_they_say_are_a_malformed_command() -> None:
    """Goal and speed behind each id, and a length of two: values are read as ids, 255, too."""
    talk = led(lambda cycle: {servo: path(cycle) + u16(300) for servo in SERVOS})
    told = talk.diagnosed()
    ((cause, servos),) = verdicts(told.incidents())
    assert cause == "malformed-command"
    assert set(servos) <= set(SERVOS)
    assert "goal-beyond-range" not in codes(told)


@pytest.mark.parametrize(
    "items",
    [
        pytest.param(
            lambda cycle: {servo: path(cycle) for servo in range(1, 19)}, id="18 that nobody reads"
        ),
        pytest.param(
            lambda cycle: {servo: path(cycle) for servo in (range(1, 19) if not cycle else SERVOS)},
            id="a posture once",
        ),
        pytest.param(
            lambda cycle: {servo: u16(5000) for servo in range(1, 19)}, id="all out of range"
        ),
    ],
)
def test_servos_that_are_sent_somewhere_and_never_asked_are_there(
    items: Callable[[int], Items],
) -> None:
    assert "items-misread" not in codes(led(items).diagnosed())
