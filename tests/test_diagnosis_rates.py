"""A line that is read a few per cent too fast, or too slowly, and what looks so."""

from __future__ import annotations

import itertools
import random
from dataclasses import replace
from typing import TYPE_CHECKING

import pytest

from sniffer.diagnosis.physics.uart import received, sent
from sniffer.ground.model import Chunk, Clock
from tests.conversations import BAUD, Conversation, robot, without_clock
from tests.diagnosed import codes, diagnosed, found, verdicts
from tests.lists import each_in_turn, in_turn

if TYPE_CHECKING:
    from sniffer.diagnosis import Diagnosis

PROTOCOLS = ("mightyzap", "wck", "rs30x", "lss")

RATES = [(230400, 250000), (115200, 128000), (200000, 250000)]
"""At which rate a line runs, and at which it is read."""


def read(
    protocol: str, times: float, *, baud: int = BAUD, rise: float = 0.0, clock: bool = True
) -> Diagnosis:
    """Return what is said of a sound line that is ``times`` slower than its receiver."""
    talk = robot(protocol, 6, baud=baud)
    began = talk.chunks[0].t_ns or 0
    rng = random.Random(1)  # of when in its own clock the receiver sees a start bit
    chunks = [
        replace(
            c,
            data=bytes(b.value for b in received(sent(c.data, times, rise=rise), point)),
            t_ns=began + int(((c.t_ns or 0) - began) * max(times, 1.0)),  # all lasts longer there
        )
        for c in talk.chunks
        for point in [0.5 + rng.randrange(16) / 256]
    ]
    return talk.diagnosed(chunks if clock else without_clock(chunks))


@in_turn(6)
@pytest.mark.parametrize("clock", [True, False])
@pytest.mark.parametrize("protocol", PROTOCOLS)
@pytest.mark.parametrize(("runs", "read_at"), RATES)
def test_a_line_that_is_a_little_slower_than_its_receiver_is_read_at_a_wrong_rate(
    runs: int, read_at: int, protocol: str, clock: bool
) -> None:
    told = read(protocol, read_at / runs, baud=read_at, clock=clock)
    assert verdicts(told.incidents()) == [("wrong-baud", ())]
    if protocol == "lss":  # nothing holds, and its few signs do not tell which bits are alike
        return
    (finding,) = (f for f in found(told) if f.code == "bits-read-twice")
    assert finding.value("baud") == runs
    assert f"the line runs at {runs} baud" in told.incidents()[0].story


FASTER = [(250000, 230400), (128000, 115200), (115200, 100000)]


@in_turn(6)
@pytest.mark.parametrize("clock", [True, False])
@pytest.mark.parametrize("protocol", PROTOCOLS)
@pytest.mark.parametrize(("runs", "read_at"), FASTER)
def test_a_line_that_is_a_little_faster_than_its_receiver_is_no_controllers_fault(
    runs: int, read_at: int, protocol: str, clock: bool
) -> None:
    """Three bytes FF begin a frame of mightyZAP at either rate, and nothing that follows."""
    told = read(protocol, read_at / runs, baud=read_at, clock=clock)
    assert verdicts(told.incidents()) == [("wrong-baud", ())]


@in_turn(4)
@pytest.mark.parametrize("protocol", PROTOCOLS)
@pytest.mark.parametrize(("times", "rise"), [(1.0, 0.62), (1.03, 0.0), (0.96, 0.0)])
def test_a_weak_line_and_clocks_that_are_off_read_no_bit_twice(
    times: float, rise: float, protocol: str
) -> None:
    assert "bits-read-twice" not in codes(read(protocol, times, rise=rise))


def test_a_loop_that_has_two_bits_alike_in_all_it_says_is_not_read_so_for_noise() -> None:
    """What noise does to such bytes does not spare these bits."""
    talk, rng = robot("mightyzap", 20), random.Random(3)
    other = [v for v in range(256) if (v >> 5 ^ v >> 6) & 1 == 0]
    said = [c.data for c in talk.chunks if all(v in other for v in c.data)]
    assert len({*b"".join(said)}) > 40
    loop = Conversation("mightyzap")
    for k in range(1500):
        data = bytearray(said[k % len(said)])
        loop.rest(0.5)
        if k % 50 == 3:
            data[rng.randrange(3, len(data))] ^= 1 << rng.randrange(8)
        loop.say(bytes(data))
    assert "bits-read-twice" not in codes(loop.diagnosed())


def test_one_command_with_a_wrong_checksum_amid_sound_talk_is_no_other_rate() -> None:
    """All it says, and what is wrong besides, may have two bits alike: 40 values are soon said."""
    wrong = bytes.fromhex("FF FF FF 19 04 F3 81 03 94")  # not inverted
    loop = Conversation("mightyzap")
    said = [c.data for c in robot("mightyzap", 40, servos=(25,), goals=False).chunks]
    asked = [
        pair
        for pair in zip(said[::2], said[1::2], strict=True)
        if all(not (v >> 5 ^ v >> 6) & 1 for v in b"".join(pair))
    ]
    assert len({*b"".join(itertools.chain(*asked))}) > 40
    for k, (request, answer) in enumerate(3 * asked):
        loop.rest(20)
        loop.say(request)
        loop.rest(0.5)
        loop.say(answer)
        if k % 40 == 3:
            loop.rest(0.5)
            loop.say(wrong)
    told = loop.diagnosed()
    assert "bits-read-twice" not in codes(told)
    assert verdicts(told.incidents())[:1] == [("malformed-command", (25,))]


@in_turn(5)
@pytest.mark.parametrize("protocol", PROTOCOLS)
@pytest.mark.parametrize("times", [0.5, 0.92, 3.0, 6.0, 12.0])
def test_a_line_at_a_rate_far_from_its_receivers_is_read_at_a_wrong_rate(
    times: float, protocol: str
) -> None:
    """At six times all is 00 and E0, at twelve 00 alone; at half FF FF FF is FF and two bytes."""
    told = read(protocol, times)
    assert verdicts(told.incidents())[:1] == [("wrong-baud", ())]
    assert not codes(told) & {"begins-hold", "bytes-translated"}


def test_a_rate_that_nobody_stated_is_not_told_as_the_lines() -> None:
    said = robot("lss", 6).chunks
    slow = [replace(c, data=bytes(b.value for b in received(sent(c.data, 3.0)))) for c in said]
    (finding,) = (f for f in found(diagnosed(slow, "lss")) if f.code == "bits-of-another-rate")
    assert not finding.values
    assert "heard at 115200 baud, it runs at about 38400; heard at 57600 baud" in finding.what
    assert finding.brief == "the line is 3 times slower than the receiver"


def test_zeros_one_behind_the_other_are_a_line_that_is_held_and_no_slow_one() -> None:
    talk = Conversation("lss")
    for _ in range(400):
        talk.say(bytes(1024))
    told = talk.diagnosed()
    assert [incident.cause for incident in told.incidents()] == ["line-stuck"]


@each_in_turn(3, "size", [600, 3000, 40_000])
def test_bytes_that_are_as_even_as_random_ones_are_no_conversation_at_any_rate(size: int) -> None:
    """A packed or encrypted file that somebody takes for a capture."""
    chunk = Chunk(random.Random(size).randbytes(size), None, Clock.NONE)
    assert "nothing-holds" not in codes(diagnosed([chunk], "mightyzap"))


@in_turn(4)
@pytest.mark.parametrize("size", [60_000, 600_000])
@pytest.mark.parametrize("protocol", PROTOCOLS)
def test_bytes_of_which_nothing_holds_have_no_torn_frames_of_anybody(
    protocol: str, size: int
) -> None:
    """A file that is no capture: of LSS all requests were torn, and it was noise, 53 %."""
    data = random.Random(5).randbytes(size)
    told = diagnosed([Chunk(data)], protocol)
    assert verdicts(told.incidents()) == []
