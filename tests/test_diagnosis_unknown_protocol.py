"""Sound traffic of protocols that are not known here: at a wrong rate no packet has its length."""

from __future__ import annotations

import random
from collections.abc import Callable

import pytest

from sniffer.diagnosis.physics.uart import heard, sent
from sniffer.ground.model import Chunk
from tests.conversations import Conversation
from tests.diagnosed import codes, diagnosed, verdicts
from tests.lists import in_turn

Packet = Callable[[int, int, bytes], bytes]


def dynamixel1(servo: int, code: int, parameters: bytes) -> bytes:
    """Return a packet of DYNAMIXEL 1.0 (e-Manual, Protocol 1.0, Instruction Packet)."""
    body = bytes([servo, len(parameters) + 2, code]) + parameters
    return b"\xff\xff" + body + bytes([~sum(body) & 0xFF])


def herkulex(servo: int, code: int, parameters: bytes) -> bytes:
    """Return a packet of HerkuleX (manual of DRS-0101, 6.1): its length counts the header."""
    size = 7 + len(parameters)
    first = size ^ servo ^ code
    for value in parameters:
        first ^= value
    return bytes([0xFF, 0xFF, size, servo, code, first & 0xFE, ~first & 0xFE]) + parameters


def talk_of(packet: Packet, baud: int = 115200) -> Conversation:
    talk, rng = Conversation("mightyzap", baud), random.Random(2)
    for k in range(400):
        servo = 1 + k % 4
        talk.say(packet(servo, 4, b"\x24\x02"))
        talk.rest(0.4)
        talk.say(packet(servo, 0, rng.randbytes(2 + 2 * (k % 2))))
        talk.rest(2)
    return talk


PACKETS: list[Packet] = [dynamixel1, herkulex]


@in_turn(4)
@pytest.mark.parametrize("packet", PACKETS)
@pytest.mark.parametrize("named", ["mightyzap", "rs30x", "lss", "wck"])
def test_packets_of_another_protocol_are_no_wrong_rate(packet: Packet, named: str) -> None:
    told = diagnosed(talk_of(packet).chunks, named).incidents()
    assert verdicts(told) == [("mixed-protocols", ())]
    assert "plug-in" in told[0].next


@in_turn(3)
@pytest.mark.parametrize("packet", PACKETS)
@pytest.mark.parametrize("times", [0.5, 2, 3])
def test_at_a_wrong_rate_no_packet_is_as_long_as_it_says(packet: Packet, times: float) -> None:
    talk = talk_of(packet)
    chunks = [Chunk(heard(sent(c.data, times)), c.t_ns, c.clock) for c in talk.chunks]
    assert "unknown-packets" not in codes(diagnosed(chunks, "mightyzap"))
