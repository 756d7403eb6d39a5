"""Which protocol is it? Told where it can be told, and otherwise not guessed."""

from __future__ import annotations

import functools
import itertools
import random
from dataclasses import replace
from pathlib import Path
from typing import TYPE_CHECKING, cast

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from sniffer.decoding.detect import ENOUGH, Detection, UndecidedError, detect
from sniffer.decoding.pipeline import Options, Pipeline
from sniffer.ground.framing import Block
from sniffer.ground.model import UNKNOWN, Chunk, Frames
from sniffer.jobs.diagnose import diagnose
from sniffer.protocols import PROTOCOLS
from sniffer.simulation.buses import simulate
from sniffer.sources import open_source
from tests.dynamixel import WRITE, Dynamixel1, packet, said
from tests.lists import in_turn
from tests.streams import module

if TYPE_CHECKING:
    from collections.abc import Sequence

    from sniffer.ground.model import Spans
    from sniffer.protocols.base import BusProtocol

SAMPLES = Path(__file__).parents[1] / "sample_captures"

EVERY = pytest.mark.parametrize("name", PROTOCOLS)


@functools.cache
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


@in_turn(2)
@EVERY
@settings(max_examples=20)
@given(data=st.data())
def test_each_protocol_is_told_from_any_talk(name: str, data: st.DataObject) -> None:
    talk = b"".join(data.draw(st.lists(module(name).TALK, min_size=3, max_size=8)))
    talk += heard(name, 0.3)
    assert detect([Chunk(talk)]).protocol == name


def test_one_long_frame_that_many_of_another_protocol_make_up_is_chance() -> None:
    """FF FF before FF E0 FB is the head of a mightyZAP frame of 256 bytes, whose sum is right."""
    talk = bytes.fromhex("ff 00 00 00" * 3 + "ff e1 64 ff ff 05 ff ff ff e0 fb a0 60 5b")
    talk += bytes.fromhex("ff ff c8 30 78 8e e9 ff 44 01 45 ff ff aa 55 aa 55 37 ba 10 ff ff")
    talk += bytes.fromhex("aa 55 aa 55 37 ba 10 00 00 00 00 00 00 ff ff aa 55 aa 55 37 ba 10")
    talk += bytes.fromhex("01 00 00 00 06 ff ff ff ff 00 01 01 ff ff aa 55 aa 55 37 ba 12 01")
    talk += bytes.fromhex("00 00 00 06") + heard("wck", 0.3)
    mighty = Block(np.frombuffer(talk, np.uint8), np.empty(0, np.int64), True)
    spans, _ = PROTOCOLS["mightyzap"].frame(mighty)
    assert max(spans.end - spans.start) == 256
    found = detect([Chunk(talk)])
    assert (found.protocol, found.scores["mightyzap"]) == ("wck", 0)


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
    assert "name it with `protocol`" in str(caught.value)


def test_nothing_cannot_be_told() -> None:
    with pytest.raises(UndecidedError, match="no bytes"):
        detect([])


def test_only_the_beginning_is_looked_at() -> None:
    data = heard("rs30x", 6)
    assert len(data) > ENOUGH
    rest = random.Random(2).randbytes(20 * ENOUGH)
    cut = [Chunk(data[at : at + 100]) for at in range(0, ENOUGH, 100)]
    assert detect([*cut, Chunk(rest)]).scores == detect([Chunk(data[:ENOUGH])]).scores


@pytest.fixture
def five(monkeypatch: pytest.MonkeyPatch) -> None:
    """Let Dynamixel 1.0 be known, whose frames mightyZAP's contain."""
    five = [*PROTOCOLS.candidates(), cast("BusProtocol", Dynamixel1())]
    monkeypatch.setattr(PROTOCOLS, "candidates", lambda heard=None: five)


@pytest.mark.usefixtures("five")
class TestAFrameWithinAFrame:
    @pytest.mark.parametrize("kind", ["clean.log", "damaged.log", "manual.hex"])
    def test_the_captures_of_the_container_are_told(self, kind: str) -> None:
        source = open_source(SAMPLES / f"mightyzap_{kind}")
        found = detect([chunk for group in source for chunk in group])
        assert (found.protocol, found.certainty) == ("mightyzap", "sure")
        assert found.scores["dynamixel1"] < 0.01

    @pytest.mark.parametrize("share", [0.002, 0.01, 0.03, 0.1])
    def test_a_damaged_stream_of_the_container_is_still_told(self, share: float) -> None:
        """The shorter frames stay whole more often; that makes nobody of them."""
        rng = random.Random(7)
        data = bytearray(heard("mightyzap"))
        for at in range(len(data)):
            if rng.random() < share:
                data[at] ^= rng.randint(1, 255)
        assert detect([Chunk(bytes(data))]).protocol == "mightyzap"

    def test_a_stream_of_the_contained_is_told(self) -> None:
        found = detect([Chunk(said(400))])
        assert (found.protocol, found.certainty) == ("dynamixel1", "sure")
        assert found.scores["mightyzap"] < 0.1

    def test_both_on_one_wire_are_told(self) -> None:
        zap, dynamixel = heard("mightyzap")[:4000], said(300)
        found = detect([Chunk(zap + dynamixel)])
        assert (found.protocol, found.certainty) == ("dynamixel1+mightyzap", "sure")

    @EVERY
    def test_it_takes_nothing_from_the_others(self, name: str) -> None:
        assert detect([Chunk(heard(name))]).protocol == name


class Twin(Dynamixel1):
    """The same packets by another name, with one more rate and one command that is its own."""

    def __init__(self) -> None:
        super().__init__()
        self.name, self.bauds = "twin", (*self.bauds, 333333)
        self._described, self.describe = self.describe, self._unwritten

    def _unwritten(self, block: Block, spans: Spans) -> Frames:
        frames = self._described(block, spans)
        return replace(frames, flags=np.where(frames.op == WRITE, UNKNOWN, 0).astype(np.uint8))


@pytest.fixture
def twins(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(PROTOCOLS, "candidates", lambda heard=None: [Dynamixel1(), Twin()])


@pytest.mark.usefixtures("twins")
class TestTwoThatExplainTheSameBytes:
    def test_a_tie_stays_one_and_is_told(self) -> None:
        with pytest.raises(UndecidedError, match=r"dynamixel1 100.0%, twin 100.0%") as caught:
            detect([Chunk(said(40))])
        assert "name it with `protocol`" in str(caught.value)

    def test_nothing_is_diagnosed_in_bytes_that_two_explain(self, tmp_path: Path) -> None:
        (tmp_path / "dump.bin").write_bytes(said(400))
        with pytest.raises(UndecidedError, match=r"dynamixel1 100.0%, twin 100.0%"):
            diagnose(tmp_path / "dump.bin")

    def test_who_knows_the_commands_is_taken(self) -> None:
        writes = b"".join(packet(n % 4, WRITE, bytes([30, n])) for n in range(60))
        assert detect([Chunk(writes)]).protocol == "dynamixel1"

    def test_a_rate_that_was_stated_decides(self) -> None:
        assert detect([Chunk(said(40))], 333333).protocol == "twin"

    def test_a_rate_that_both_can_have_decides_nothing(self) -> None:
        with pytest.raises(UndecidedError):
            detect([Chunk(said(40))], 57600)


def test_a_rate_that_no_list_has_excludes_nobody() -> None:
    assert detect([Chunk(heard("mightyzap"))], 123456).protocol == "mightyzap"


def test_a_protocol_is_found_once(monkeypatch: pytest.MonkeyPatch) -> None:
    """What told that there are bytes enough tells the protocol, too."""
    asked: list[int] = []

    def counted(chunks: Sequence[Chunk], baud: int | None = None) -> Detection:
        asked.append(sum(len(c.data) for c in chunks))
        return detect(chunks, baud)

    monkeypatch.setattr("sniffer.decoding.pipeline.detect", counted)
    pipeline = Pipeline(Options(), [])
    for at in range(0, 4000, 50):
        pipeline.feed([Chunk(heard("mightyzap")[at : at + 50])])
    assert pipeline.speaks("bus0") == "mightyzap"
    assert len(asked) == len(set(asked)) == 1


@pytest.mark.parametrize("name", PROTOCOLS.built_in)
@given(picked=st.data())
def test_who_is_not_asked_would_have_seen_no_frame(name: str, picked: st.DataObject) -> None:
    """Signs of protocols save loading them; a frame without one would make the protocol deaf."""
    talk = st.lists(st.sampled_from([*heard(name, 0.3)]), max_size=60).map(bytes)
    data = picked.draw(st.one_of(st.binary(max_size=60), talk, st.just(heard(name, 0.1))))
    kept = picked.draw(st.frozensets(st.sampled_from([*range(256)])))
    data = bytes(byte for byte in data if byte not in kept)
    asked = PROTOCOLS[name] in PROTOCOLS.candidates(data)
    block = Block(np.frombuffer(data, np.uint8), np.empty(0, np.int64), True)
    assert asked or not len(PROTOCOLS[name].frame(block)[0])


def test_bytes_in_which_nobody_can_have_a_frame_are_told_as_before() -> None:
    assert not {p.name for p in PROTOCOLS.candidates(b"\x00\x01\x02")} & {*PROTOCOLS.built_in}
    with pytest.raises(UndecidedError, match="none explains any of them"):
        detect([Chunk(bytes(3000))])
    text = b"#5QD\r*5QD1443\r" * 30
    found = detect([Chunk(text)])
    assert found.scores == {"mightyzap": 0.0, "lss": 1.0, "rs30x": 0.0, "wck": 0.0}
