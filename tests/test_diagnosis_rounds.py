"""Rounds of requests that stand between each other: two controllers, known without a clock."""

from __future__ import annotations

from dataclasses import replace
from typing import TYPE_CHECKING, Final

import numpy as np
import pytest

from sniffer.diagnosis.rules.line.masters import crossings_of
from tests.conversations import Conversation, swinging, through_usb, without_clock
from tests.crossing_rounds import SERVOS, two_rounds
from tests.diagnosed import codes, verdicts

if TYPE_CHECKING:
    from collections.abc import Callable, Iterable

    from sniffer.ground.model import Chunk

WAYS: Final = pytest.mark.parametrize("heard", [through_usb, without_clock])


@WAYS
def test_two_controllers_are_known_by_their_order_where_no_time_tells(
    heard: Callable[[Iterable[Chunk]], list[Chunk]],
) -> None:
    talk = two_rounds(31, 43, apart_ms=0.2)
    told = talk.diagnosed(heard(talk.chunks))
    assert "rounds-cross" in codes(told)
    assert {cause for cause, _ in verdicts(told.incidents())} == {"two-masters"}


@WAYS
def test_one_program_with_two_timers_that_wait_for_each_other_is_no_fault(
    heard: Callable[[Iterable[Chunk]], list[Chunk]],
) -> None:
    talk = two_rounds(31, 43, apart_ms=0)
    told = talk.diagnosed(heard(talk.chunks))
    assert "rounds-cross" in codes(told)
    assert not told.incidents()


@WAYS
def test_one_controller_whose_requests_are_torn_keeps_its_order(
    heard: Callable[[Iterable[Chunk]], list[Chunk]],
) -> None:
    talk = two_rounds(31, apart_ms=0)
    kept = [c for k, c in enumerate(talk.chunks) if k % 34]
    assert "rounds-cross" not in codes(talk.diagnosed(heard(kept)))


@WAYS
def test_what_is_torn_when_no_rounds_cross_tells_nothing_of_a_second_controller(
    heard: Callable[[Iterable[Chunk]], list[Chunk]],
) -> None:
    talk = two_rounds(31, 43, apart_ms=0)
    for cycle in range(40):
        talk.until(10 + cycle / 32)
        for servo in SERVOS:
            talk.say(talk.tongue.ask(servo))
            talk.rest(0.3)
            answer = talk.tongue.answer(servo, swinging(servo, talk.now_s))
            talk.say(answer[:3] if servo == 2 and cycle % 2 else answer)
    told = talk.diagnosed(heard(talk.chunks))
    assert "rounds-cross" in codes(told)
    assert "two-masters" not in {cause for cause, _ in verdicts(told.incidents())}


@pytest.mark.parametrize(
    "extra",
    [
        lambda cycle: [(4, 5 + cycle // 10 % 3)] * (cycle % 10 == 0),  # behind each tenth round
        lambda cycle: [(cycle % 5, 5)],  # after each servo in its turn
        lambda cycle: [(cycle % 5, 5 + cycle % 5)],  # each servo has its own, in its turn
    ],
)
def test_what_a_loop_asks_in_turn_is_of_its_own_round(
    extra: Callable[[int], list[tuple[int, int]]],
) -> None:
    kinds = [
        kind
        for cycle in range(200)
        for servo in range(5)
        for kind in (servo, *(more for at, more in extra(cycle) if at == servo))
    ]
    assert not len(crossings_of(np.array(kinds)))


def test_what_a_program_does_seldom_servo_by_servo_is_no_other_round() -> None:
    """Each is asked where it is, and told to stay there: twice in a capture, noise beside it."""
    loop = list(range(4)) * 100
    switching_on = [kind for servo in range(4) for kind in (servo, 4 + servo)]
    setting_up = list(range(8, 28))
    kinds = [*setting_up, *switching_on, *loop, *switching_on, *loop]
    assert not len(crossings_of(np.array(kinds)))


@pytest.mark.parametrize("protocol", ["mightyzap", "wck"])
def test_one_program_with_two_timers_is_no_second_controller(protocol: str) -> None:
    talk = by_timers(protocol, {1: 0.02, 2: 0.0473})
    assert "streams-apart" in codes(talk.diagnosed())
    assert not talk.diagnosed().incidents()


def test_one_program_with_two_timers_over_a_weak_signal_is_no_second_controller() -> None:
    """What tears its frames is one bit each time: a request within another one alters many."""
    talk = by_timers("mightyzap", {1: 0.02, 2: 0.0473})
    weak = [late_edge(c) if k % 40 == 7 else c for k, c in enumerate(talk.chunks)]
    causes = {cause for cause, _ in verdicts(talk.diagnosed(weak).incidents())}
    assert causes & {"signal-integrity", "bus-noise"}
    assert "two-masters" not in causes


def late_edge(chunk: Chunk) -> Chunk:
    """Return it with the first 1 behind a 0, of its last byte that has one, read as 0."""
    data = bytearray(chunk.data)
    rises = [(n, byte & ~(byte << 1) & 0xFE) for n, byte in enumerate(data) if byte != 0xFF]
    at, bits = next((n, bits) for n, bits in reversed(rises) if bits)
    data[at] &= ~(bits & -bits)
    return replace(chunk, data=bytes(data))


def by_timers(protocol: str, seconds_of: dict[int, float]) -> Conversation:
    """One program asks each servo by a timer of its own."""
    talk = Conversation(protocol)
    due = dict.fromkeys(seconds_of, 0.0)
    while talk.now_s < 12:
        servo = min(due, key=lambda s: due[s])
        talk.until(due[servo])
        talk.read(servo, swinging(servo, talk.now_s))
        due[servo] += seconds_of[servo]
    return talk


@pytest.mark.parametrize("protocol", ["mightyzap", "wck"])
def test_two_rhythms_are_seen_through_a_host_that_holds_bytes_for_a_part_of_them(
    protocol: str,
) -> None:
    for seconds_of, are_apart in (
        ({1: 0.08, 2: 0.113}, True),
        ({1: 0.08, 2: 0.16}, False),
        ({1: 0.08, 2: 0.04}, False),
        ({1: 0.03, 2: 0.0473}, False),  # too short for a host of 16 ms
    ):
        talk = by_timers(protocol, seconds_of)
        told = talk.diagnosed(through_usb(talk.chunks))
        assert ("streams-apart" in codes(told)) == are_apart
        assert not told.incidents()
