"""Torn frames that hold: what a checksum lets pass is no second fault."""

from __future__ import annotations

import random
from dataclasses import replace
from typing import TYPE_CHECKING, Final

from sniffer.diagnosis.evidence.passing import misread_senders
from sniffer.ground.model import Direction
from tests.conversations import Conversation
from tests.diagnosed import codes, diagnosed, verdicts
from tests.lists import each_in_turn
from tests.streams import mightyzap, rs30x

if TYPE_CHECKING:
    from sniffer.diagnosis import Diagnosis
    from sniffer.ground.model import Chunk

IDS: Final = (2, 3, 4)
SICK: Final = 3


def states(protocol: str) -> Conversation:
    """Read position, speed, load, voltage and temperature of three servos at rest."""
    talk = Conversation(protocol)
    for cycle in range(300):
        talk.until(cycle / 30)
        for servo in IDS:
            place = 1000 + (cycle * 7 + servo) % 90
            if protocol == "mightyzap":
                ask = mightyzap.packet(servo, 0xF2, b"\x8c\x08")
                data = place.to_bytes(2, "little") + bytes([0, 0, 70, 0, 120 + cycle % 2, 35])
                answer = mightyzap.packet(servo, 0, data)
            else:
                ask = rs30x.packet(servo, 0x0F, 0x2A, 12, 0)
                words = (place, 0, 0, 70, 35, 740 + cycle % 3)
                data = b"".join(word.to_bytes(2, "little") for word in words)
                answer = rs30x.returned(servo, 0x2A, data)
            talk.say(ask, Direction.TX)
            talk.rest(0.3)
            talk.say(answer, Direction.RX)
            talk.rest(0.4)
    return talk


def slow(chunks: list[Chunk], servo: int, rng: random.Random) -> list[Chunk]:
    """Read the last bit of bytes of a servo as the one before, now and then: its clock is slow."""
    out, whose = [], -1
    for chunk in chunks:
        data = chunk.data
        if chunk.direction == Direction.TX:
            whose = data[3] if data[0] == 0xFF else data[2]
        elif whose == servo:
            data = bytes(
                byte & 0x7F | (byte & 0x40) << 1 if rng.random() < 0.25 else byte for byte in data
            )
        out.append(replace(chunk, data=data, direction=Direction.UNKNOWN))
    return out


def heard(protocol: str) -> Diagnosis:
    rng = random.Random(1)
    return diagnosed(slow(states(protocol).chunks, SICK, rng), protocol, baud=115200)


@each_in_turn(2, "protocol", ["mightyzap", "rs30x"])
def test_a_slow_clock_whose_torn_answers_hold_at_times_is_one_fault(protocol: str) -> None:
    told = heard(protocol)
    assert verdicts(told.incidents()) == [("clock-drift", (SICK,))]
    assert "last-bits" in codes(told)


def test_only_the_servo_whose_frames_are_torn_in_one_bit_is_misread() -> None:
    (case,) = heard("mightyzap").cases()
    assert list(misread_senders(case)) == [SICK]


def test_of_a_sound_bus_nothing_is_misread() -> None:
    (case,) = states("mightyzap").diagnosed().cases()
    assert not misread_senders(case)
