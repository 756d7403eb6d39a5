"""A controller that computes checksums wrongly is told how, and nobody else is accused."""

from __future__ import annotations

import functools
import operator
import random
from dataclasses import replace
from typing import TYPE_CHECKING

import pytest

from sniffer.decoding.sums import wrong_sums
from sniffer.ground.model import Chunk, Clock, Direction
from sniffer.protocols import PROTOCOLS
from tests.commands import within
from tests.conversations import Conversation, one_wire, robot
from tests.diagnosed import codes, found, verdicts
from tests.lists import each_in_turn
from tests.streams import mightyzap

if TYPE_CHECKING:
    from collections.abc import Callable
    from pathlib import Path

    Driver = Callable[[bytes], bytes]


def sealed(seal: Callable[[bytes], int]) -> Driver:
    """Return a driver that makes of a packet without its checksum what it takes for it."""
    return lambda packet: packet[:-1] + bytes((seal(packet[:-1]) & 0xFF,))


def xor(data: bytes) -> int:
    """Return the XOR of some bytes."""
    return functools.reduce(operator.xor, data, 0)


def named(value: object) -> str:
    """Return what a case is called: its words, and nothing of its functions."""
    return value if isinstance(value, str) else ""


DRIVERS: list[tuple[str, str, Driver]] = [
    ("mightyzap", "the sum of the bytes", sealed(lambda p: sum(p[3:]))),
    ("mightyzap", "the sum of the bytes, negated", sealed(lambda p: -sum(p[3:]))),
    ("mightyzap", "the XOR of the bytes, inverted", sealed(lambda p: ~xor(p[3:]))),
    (
        "mightyzap",
        "the sum of the bytes without the first of them, inverted",
        sealed(lambda p: ~sum(p[4:])),
    ),
    ("mightyzap", "the sum of the bytes with the header, inverted", sealed(lambda p: ~sum(p))),
    ("mightyzap", "00, always", sealed(lambda p: 0)),
    ("mightyzap", "nothing: the next packet begins there", lambda p: p[:-1]),
    ("rs30x", "the sum of the bytes", sealed(lambda p: sum(p[2:]))),
    ("rs30x", "the XOR of the bytes with the header", sealed(xor)),
    ("rs30x", "1 too much", sealed(lambda p: xor(p[2:]) + 1)),
    ("wck", "the sum of the bytes & 7F", sealed(lambda p: sum(p[1:]) & 0x7F)),
    ("wck", "the XOR of the bytes", sealed(lambda p: xor(p[1:]))),
]  # fmt: skip
"""Protocols, what is said of a driver, and the driver: faults that first drivers have."""


def alone(protocol: str, driver: Driver, cycles: int = 120) -> Conversation:
    """Return a controller whom nobody answers."""
    talk, rng = Conversation(protocol), random.Random(2)
    for _ in range(cycles):
        for servo in (1, 2, 3):
            talk.say(driver(talk.tongue.ask(servo)))
            talk.rest(5)
        talk.say(driver(talk.tongue.goal(1, rng.random())))
        talk.rest(5)
    return talk


@each_in_turn(2, ("protocol", "told", "driver"), DRIVERS, ids=named)
def test_what_a_driver_makes_of_a_checksum_is_named(
    protocol: str, told: str, driver: Driver
) -> None:
    diagnosis = alone(protocol, driver).diagnosed()
    assert verdicts(diagnosis.incidents()) == [("malformed-command", ())]
    assert diagnosis.incidents()[0].causes[0].confidence > 0.9
    (finding,) = (f for f in found(diagnosis) if f.code == "sums-wrong")
    assert finding.what.endswith(f"and there is {told}")


def test_one_command_with_a_wrong_checksum_among_others_is_told() -> None:
    rng = random.Random(4)

    def goals(talk: Conversation, cycle: int) -> None:
        data = bytes((0x86, rng.randrange(256), rng.randrange(16)))
        packet = mightyzap.packet(1, 0xF3, data)
        talk.say(packet[:-1] + bytes((packet[-1] ^ 0xFF,)))

    diagnosis = robot("mightyzap", 8, behind=goals, goals=False).diagnosed()
    assert diagnosis.incidents()[0].cause == "malformed-command"
    assert "sums-wrong" in codes(diagnosis)


@each_in_turn(3, "protocol", ["mightyzap", "rs30x", "wck"])
def test_damage_follows_no_formula(protocol: str) -> None:
    rng = random.Random(9)
    talk = robot(protocol, 8)
    for often in (0.02, 0.2):
        torn = []
        for chunk in one_wire(talk):
            data = bytearray(chunk.data)
            if rng.random() < often:
                data[rng.randrange(len(data))] ^= 1 << rng.randrange(8)
            torn.append(replace(chunk, data=bytes(data)))
        assert "sums-wrong" not in codes(talk.diagnosed(torn))
        heard = b"".join(chunk.data for chunk in torn)
        assert wrong_sums(heard, PROTOCOLS[protocol]) is None


def test_a_bit_that_is_always_misread_is_no_formula() -> None:
    talk = robot("rs30x", 8)
    torn = [
        replace(c, data=bytes(v | 0x10 for v in c.data)) if c.direction == Direction.RX else c
        for c in talk.chunks
    ]
    assert "sums-wrong" not in codes(talk.diagnosed(torn))


def test_who_cannot_tell_the_protocol_says_whose_packets_fail(
    tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    path = tmp_path / "first_try.bin"
    _, told, driver = DRIVERS[7]
    path.write_bytes(b"".join(c.data for c in alone("rs30x", driver).chunks))
    done = within(capsys, "decode", path)
    assert done.status == 2
    assert "name it with --protocol; all 480 packets of rs30x" in done.complaint
    assert done.complaint.endswith(f"it should be XOR of the bytes, and there is {told}")


def longer(packet: bytes) -> bytes:
    """Make of an RS30x packet one whose length says a byte more."""
    return packet[:5] + bytes((packet[5] + 1,)) + packet[6:]


def test_frames_that_begin_well_and_have_a_wrong_length_are_at_the_right_rate() -> None:
    talk = alone("rs30x", longer)
    diagnosis = talk.diagnosed()
    (incident, *_) = diagnosis.incidents()
    assert incident.cause == "malformed-command"
    assert "wrong-baud" not in [one.cause for one in incident.causes if one.confidence > 0.05]
    (finding,) = (f for f in found(diagnosis) if f.code == "begins-hold")
    assert "begins as it should, such as FA AF" in finding.what


def stated(packet: bytes, at: int, more: int, *, as_sent: bool) -> bytes:
    """Make of an RS30x packet one that states another length, or count, than it has.

    Its checksum is over the bytes as they are sent, or as they were before somebody erred.
    """
    wrong = packet[:at] + bytes((packet[at] + more,)) + packet[at + 1 :]
    return wrong[:-1] + bytes((xor(wrong[2:-1]),)) if as_sent else wrong


@pytest.mark.parametrize(
    ("at", "more", "as_sent", "clock"),
    [(5, -1, True, Clock.SAMPLE), (6, -1, False, Clock.SAMPLE), (6, 1, True, Clock.NONE)],
)
def test_packets_that_state_another_length_than_they_have_are_the_controllers(
    at: int, more: int, as_sent: bool, clock: Clock
) -> None:
    rng = random.Random(3)

    def goals(talk: Conversation, cycle: int) -> None:
        for servo in (1, 2, 3):
            talk.say(stated(talk.tongue.goal(servo, rng.random()), at, more, as_sent=as_sent))
            talk.rest(3)

    talk = robot("rs30x", 0.6, behind=goals, goals=False)
    chunks = talk.chunks
    if clock == Clock.NONE:
        chunks = [Chunk(b"".join(c.data for c in chunks), 0, clock)]
    diagnosis = talk.diagnosed(chunks)
    assert verdicts(diagnosis.incidents()) == [("malformed-command", ())]
    assert diagnosis.incidents()[0].causes[0].confidence > 0.9
    assert "head-wrong" in codes(diagnosis)


@each_in_turn(5, "requests", [10, 13, 18, 25, 27])
def test_from_ten_on_any_number_of_them_is_enough(requests: int) -> None:
    def goals(talk: Conversation, cycle: int) -> None:
        if cycle < requests:
            talk.say(stated(talk.tongue.goal(1, cycle / requests), 6, 1, as_sent=True))
            talk.rest(3)

    assert "head-wrong" in codes(robot("rs30x", 1, behind=goals, goals=False).diagnosed())


@pytest.mark.parametrize("protocol", ["mightyzap", "rs30x"])
def test_a_head_that_is_torn_at_times_is_not_sent_so(protocol: str) -> None:
    rng = random.Random(11)
    at = 6 if protocol == "rs30x" else 4
    torn = []
    talk = robot(protocol, 2)
    for chunk in one_wire(talk):
        data = bytearray(chunk.data)
        if len(data) > at + 2 and rng.random() < 0.3:
            data[at] ^= 1
        torn.append(replace(chunk, data=bytes(data)))
    assert "head-wrong" not in codes(talk.diagnosed(torn))
