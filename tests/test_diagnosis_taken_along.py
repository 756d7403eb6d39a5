"""A dead servo in the list of a read that one packet answers: the others are not at fault."""

from __future__ import annotations

import math
import random
from typing import TYPE_CHECKING

import pytest

from sniffer.ground.model import NS, Chunk, Clock
from tests.conversations import MS, T0
from tests.diagnosed import diagnosed, verdicts
from tests.members import protocol
from tests.streams.members import joint, packet

if TYPE_CHECKING:
    from sniffer.diagnosis import Diagnosis

IDS = (1, 2, 3)
BYTE_NS = 10 * NS // 115200


def read_at_once(dead: int, *, alone: bool, other: int = 0, dies_s: float = 4.0) -> Diagnosis:
    """Return the diagnosis of three servos that are read by one packet, and of which one dies.

    Each adds its part to what the one before it says. ``alone``: their temperatures are read one by
    one; one in five of those of servo ``other`` has no answer either.
    """
    rng, t, chunks = random.Random(2), T0, []

    def say(data: bytes) -> None:
        nonlocal t
        t += len(data) * BYTE_NS
        chunks.append(Chunk(data, t, Clock.SAMPLE))
        t += MS // 3

    for cycle in range(300):
        t = max(t, T0 + cycle * NS // 25)
        gone = {dead} if (t - T0) / NS >= dies_s else set()
        say(packet("dynamixel2", 254, 0x8A, b"\x84\x00\x04\x00" + bytes(IDS)))
        place = round(2048 + 900 * math.sin(cycle / 30))
        whole = joint([(i, 0, place.to_bytes(4, "little")) for i in IDS])
        before = IDS.index(dead) if gone else len(IDS)
        heard = whole if not gone else whole[: 8 + 8 * before if before else 0]
        if heard:
            say(heard)
        t += 8 * MS if gone else 0
        for servo in IDS if alone else ():
            say(packet("dynamixel2", servo, 2, b"\x92\x00\x01\x00"))
            if servo in gone or (servo == other and rng.random() < 0.2):
                t += 8 * MS
            else:
                say(packet("dynamixel2", servo, 0x55, b"\x00\x1f"))
    return diagnosed(chunks, protocol("dynamixel2"), baud=115200)


@pytest.mark.parametrize("dead", IDS)
def test_a_dead_servo_in_the_list_of_a_read_is_one_fault(dead: int) -> None:
    told = read_at_once(dead, alone=True)
    assert verdicts(told.incidents()) == [("servo-dead", (dead,))]


@pytest.mark.parametrize("dead", IDS)
def test_who_is_asked_in_that_list_alone_is_not_a_second_fault_either(dead: int) -> None:
    (incident,) = read_at_once(dead, alone=False).incidents()
    assert incident.cause == "servo-dead"
    assert dead in incident.servo_ids


def test_what_another_servo_loses_by_itself_stays_its_own() -> None:
    told = read_at_once(1, alone=True, other=3).incidents()
    assert ("servo-dead", (1,)) in verdicts(told)
    assert any(3 in one.servo_ids for one in told)
