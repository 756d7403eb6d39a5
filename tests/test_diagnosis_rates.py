"""A line that is read a few per cent too fast, or too slowly, and what looks so."""

from __future__ import annotations

import random
from dataclasses import replace
from typing import TYPE_CHECKING

import pytest

from sniffer.diagnosis.uart import received, sent
from tests.conversations import BAUD, Conversation, robot, without_clock
from tests.diagnosed import codes, found, verdicts
from tests.lists import in_turn

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
    rng = random.Random(1)  # of when in its own clock the receiver sees a start bit
    chunks = [
        replace(c, data=bytes(b.value for b in received(sent(c.data, times, rise=rise), point)))
        for c in talk.chunks
        for point in [0.5 + rng.randrange(16) / 256]
    ]
    return talk.diagnosed(chunks if clock else without_clock(chunks))


@in_turn(3)
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


@in_turn(3)
@pytest.mark.parametrize("clock", [True, False])
@pytest.mark.parametrize("protocol", PROTOCOLS)
@pytest.mark.parametrize(("runs", "read_at"), FASTER)
def test_a_line_that_is_a_little_faster_than_its_receiver_is_no_controllers_fault(
    runs: int, read_at: int, protocol: str, clock: bool
) -> None:
    """Three bytes FF begin a frame of mightyZAP at either rate, and nothing that follows."""
    told = read(protocol, read_at / runs, baud=read_at, clock=clock)
    assert verdicts(told.incidents()) == [("wrong-baud", ())]


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
