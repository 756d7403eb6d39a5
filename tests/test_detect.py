"""Which protocol is it? Told where it can be told, and otherwise not guessed."""

from __future__ import annotations

import itertools
import random

import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from sniffer.decoding.detect import ENOUGH, UndecidedError, detect
from sniffer.ground.model import Chunk
from sniffer.protocols import PROTOCOLS
from sniffer.simulation.buses import simulate
from tests.streams import module

EVERY = pytest.mark.parametrize("name", PROTOCOLS)


def heard(name: str, seconds: float = 2) -> bytes:
    """Return what a simulated bus says."""
    return b"".join(frame.wire for frame in simulate(name, seed=3, duration_s=seconds))


@EVERY
def test_each_protocol_is_told_from_its_own_stream(name: str) -> None:
    found = detect([Chunk(heard(name))])
    assert (found.protocol, found.certainty) == (name, "sure")
    assert found.scores[name] > 0.99
    assert set(found.scores) == set(PROTOCOLS)
    assert not any(f"{other} " in str(found) for other in PROTOCOLS if other != name)


@EVERY
@settings(max_examples=20)
@given(data=st.data())
def test_each_protocol_is_told_from_any_talk(name: str, data: st.DataObject) -> None:
    talk = b"".join(data.draw(st.lists(module(name).TALK, min_size=3, max_size=8)))
    talk += heard(name, 0.3)
    assert detect([Chunk(talk)]).protocol == name


@EVERY
@pytest.mark.parametrize("share", [0.002, 0.01, 0.03, 0.1])
def test_a_damaged_stream_is_still_told(name: str, share: float) -> None:
    rng = random.Random(7)
    data = bytearray(heard(name))
    for at in range(len(data)):
        if rng.random() < share:
            data[at] ^= rng.randint(1, 255)
    assert detect([Chunk(bytes(data))]).protocol == name


@EVERY
def test_a_stream_after_as_much_noise_is_told_without_being_sure(name: str) -> None:
    data = heard(name)
    found = detect([Chunk(random.Random(1).randbytes(2 * len(data)) + data)])
    assert (found.protocol, found.certainty) == (name, "not sure")


@pytest.mark.parametrize(("one", "other"), list(itertools.combinations(PROTOCOLS, 2)))
def test_two_protocols_half_and_half_share_the_wire(one: str, other: str) -> None:
    first, second = heard(one), heard(other)
    size = min(len(first), len(second), ENOUGH // 2)
    found = detect([Chunk(first[:size] + second[:size])])
    assert (found.protocol, found.certainty) == ("+".join(sorted((one, other))), "sure")
    assert found.share > 0.97
    assert all(f"{name} " in str(found) for name in (one, other))


@pytest.mark.parametrize(("one", "other"), list(itertools.permutations(PROTOCOLS, 2)))
def test_a_second_protocol_is_found_beside_one_that_says_nine_times_as_much(
    one: str, other: str
) -> None:
    talk = heard(one)[: ENOUGH * 9 // 10 - 200] + heard(other)[: ENOUGH // 10]
    assert detect([Chunk(talk)]).protocol == "+".join(sorted((one, other)))


@EVERY
@pytest.mark.parametrize("other", PROTOCOLS)
def test_what_little_another_one_sees_in_damage_is_no_second_protocol(
    name: str, other: str
) -> None:
    data = bytearray(heard(name))
    once = heard(other, 0.1)[:12]
    data[len(data) // 2 : len(data) // 2] = once
    assert detect([Chunk(bytes(data))]).protocol == name


@pytest.mark.parametrize("seed", range(5))
def test_noise_cannot_be_told(seed: int) -> None:
    with pytest.raises(UndecidedError):
        detect([Chunk(random.Random(seed).randbytes(ENOUGH))])


@pytest.mark.parametrize(
    "data", [bytes(5000), b"\xff" * 5000, bytes(range(256)) * 20, b"Hello, world.\r\n" * 200]
)
def test_what_is_no_bus_cannot_be_told(data: bytes) -> None:
    with pytest.raises(UndecidedError):
        detect([Chunk(data)])


def test_what_cannot_be_told_names_the_best_two_and_no_more() -> None:
    talk = heard("mightyzap")[:600] + random.Random(5).randbytes(30_000)
    with pytest.raises(UndecidedError) as caught:
        detect([Chunk(talk)])
    assert sum(f"{name} " in str(caught.value) for name in PROTOCOLS) <= 2
    assert "--protocol" in str(caught.value)


def test_nothing_cannot_be_told() -> None:
    with pytest.raises(UndecidedError, match="no bytes"):
        detect([])


def test_only_the_beginning_is_looked_at() -> None:
    data = heard("rs30x", 6)
    assert len(data) > ENOUGH
    rest = random.Random(2).randbytes(20 * ENOUGH)
    cut = [Chunk(data[at : at + 100]) for at in range(0, ENOUGH, 100)]
    assert detect([*cut, Chunk(rest)]).scores == detect([Chunk(data[:ENOUGH])]).scores
