"""Edges -> bytes: what is said on a wire is found, whatever its rate, polarity and clock are."""

from __future__ import annotations

import random
from typing import TYPE_CHECKING, Final

import numpy as np
import pytest
from hypothesis import example, given
from hypothesis import strategies as st

import sniffer
from sniffer.ground.model import NS, Clock, MarkKind
from sniffer.protocols import PROTOCOLS
from sniffer.signals.chunking import Chunker
from sniffer.signals.glitches import GlitchFilter
from sniffer.signals.grid import grid_in
from sniffer.signals.rates import (
    BitTime,
    WireEdges,
    bit_time,
    received,
    snapped,
)
from sniffer.signals.stretch import LogicInput, Sampler
from sniffer.signals.uart import BREAK, FRAMING, PARITY, Receiver, UartBytes
from sniffer.sources import open_source
from tests.pcaps import ASK
from tests.waves import Wire, edges_of, saleae_0, saleae_csv, sampled, spoken, sr, vcd

if TYPE_CHECKING:
    from pathlib import Path

RATES: Final = frozenset(rate for p in PROTOCOLS.values() for rate in p.bauds)

TALK: Final = {
    "mightyzap": bytes.fromhex("FFFFFF0104F28C027A FFFFFF010400FF07F4 FFFFFF0102F10B"),
    "lss": b"#5QD\r*5QD1443\r#5Q\r",
    "wck": bytes.fromhex("FF8100015A FF1E0000 5A3C FFE11E7E"),
    "rs30x": bytes.fromhex("FAAF01001E020184039B FAAF010F2A020026 FDDF01002A02018303A8"),
}


def seen(wire: Wire, rate: float, *, invert: bool = False) -> WireEdges:
    levels = sampled(wire, rate, invert=invert)
    return WireEdges(int(levels[0]), edges_of(levels), len(levels) - 1)


def told(baud: int, rate: float, *, invert: bool = False, parity: str = "N") -> BitTime:
    return BitTime(rate / baud, baud, baud, 1.0, 0.0, 0, invert, parity)


def values(found: WireEdges, how: BitTime) -> bytes:
    return received(found, how).value.tobytes()


@given(
    name=st.sampled_from(sorted(TALK)),
    baud=st.sampled_from(sorted(RATES)),
    samples=st.sampled_from([3.1, 4.0, 5.3, 8.0, 8.68, 17.3, 50.0]),
    off=st.sampled_from([-0.02, -0.01, 0.0, 0.01, 0.02]),
    invert=st.booleans(),
    pause=st.sampled_from([0.0, 3.0, 40.0]),
)
def test_rate_and_polarity_are_found_of_all_that_is_spoken_at_all_rates(
    name: str, baud: int, samples: float, off: float, invert: bool, pause: float
) -> None:
    data = TALK[name] * 3
    rate = round(baud * samples)
    found = seen(spoken(data, baud * (1 + off), pause_bits=pause), rate, invert=invert)
    how = bit_time(found, NS / rate, sample=1, preferred=RATES)
    assert how is not None
    assert (how.baud, how.invert, how.parity) == (baud, invert, "N")
    assert values(found, how) == data


@given(
    data=st.binary(min_size=1, max_size=60),
    cuts=st.lists(st.integers(0, 8000), max_size=12),
    every=st.integers(1, 9),
    glitches=st.lists(st.integers(0, 7000), max_size=8),
)
def test_however_a_capture_is_cut_its_bytes_are_the_same(
    data: bytes, cuts: list[int], every: int, glitches: list[int]
) -> None:
    levels = sampled(spoken(data, 10_000, every=every, pause_bits=7), 100_000)
    for at in glitches:
        if at < len(levels):
            levels[at] ^= 1
    edges, end = edges_of(levels), len(levels) - 1

    def read(bounds: list[int]) -> list[tuple[int, int, int]]:
        filtered, receiver = GlitchFilter(3.0), Receiver(10.0, int(levels[0]))
        out = []
        for before, until in zip([-1, *bounds], [*bounds, end], strict=True):
            part = edges[(edges > before) & (edges <= until)]
            got = receiver.take(*filtered.take(part, until, last=until == end))
            assert all(start < receiver.horizon for start in got.start)
            out += list(zip(*(column.tolist() for column in got), strict=True))
        return out

    assert read(sorted(c for c in cuts if c < end)) == read([])


@given(st.lists(st.integers(0, 255), min_size=1, max_size=300), st.integers(1, 9), st.data())
def test_samples_are_edges_however_wide_they_are_and_wherever_they_are_cut(
    samples: list[int], size: int, data: st.DataObject
) -> None:
    bit = data.draw(st.integers(0, 8 * size - 1))
    rows = np.zeros((len(samples), size), np.uint8)
    rows[:, bit >> 3] = samples
    cut = data.draw(st.integers(0, len(samples)))
    sampler = Sampler([bit], size)
    parts = [sampler.take(rows[:cut].tobytes()), sampler.take(rows[cut:].tobytes())]
    levels = (rows[:, bit >> 3] >> (bit & 7) & 1).astype(np.uint8)
    there = [part for part in parts if part is not None]
    assert there[0].levels == [levels[0]]
    got = np.concatenate([part.edges[0] for part in there])
    assert got.tolist() == edges_of(levels).tolist()
    assert there[-1].until == len(samples) - 1


def test_line_errors_stand_at_their_bytes() -> None:
    wire = Wire(0.01)
    wire.say(b"\x12\x34", 9600, wrong="stop", after=0.01)
    wire.low(30 / 9600, after=0.01)
    wire.say(b"\x56", 9600, after=0.01)
    wire.now += 0.01
    got = received(seen(wire, 96_000), told(9600, 96_000))
    assert got.value.tobytes() == b"\x12\x34\x00\x56"
    assert got.flags.tolist() == [0, FRAMING, BREAK, 0]


@pytest.mark.parametrize("parity", ["E", "O"])
def test_a_parity_bit_is_found_and_a_wrong_one_told(parity: str) -> None:
    wire = Wire(0.001)
    for _ in range(9):
        wire.say(TALK["mightyzap"], 57600, parity=parity, after=0.001)
    wire.say(b"\xff\xff\x01", 57600, parity=parity, wrong="parity", after=0.001)
    wire.now += 0.001
    found = seen(wire, 1_000_000)
    how = bit_time(found, 1000, sample=1, preferred=RATES)
    assert how is not None
    assert (how.baud, how.parity) == (57600, parity)
    got = received(found, how)
    assert got.value.tobytes() == TALK["mightyzap"] * 9 + b"\xff\xff\x01"
    assert got.flags.tolist() == [0] * (len(got.value) - 1) + [PARITY]


def test_pulses_of_less_than_a_third_of_a_bit_do_not_count() -> None:
    data = TALK["rs30x"]
    levels = sampled(spoken(data, 100_000), 2_000_000)
    rng = np.random.default_rng(7)
    for at in rng.choice(len(levels) - 10, 40, replace=False).tolist():
        levels[at : at + 3] ^= 1
    found = WireEdges(int(levels[0]), edges_of(levels), len(levels) - 1)
    how = bit_time(found, 500, sample=1, preferred=RATES)
    assert how is not None
    assert how.baud == 100_000
    assert values(found, how) == data
    assert received(found, how, glitch=0).value.tobytes() != data


@example([0, 3, 4, 5], 9)  # the last pulse is short, and its end unknown
@given(st.lists(st.integers(0, 400), unique=True, max_size=40), st.integers(1, 9))
def test_the_glitch_filter_leaves_levels_that_last_and_no_short_ones(
    at: list[int], shortest: int
) -> None:
    edges = np.array(sorted(at), np.int64)
    kept, _ = GlitchFilter(shortest).take(edges, 500, last=True)
    assert (len(edges) - len(kept)) % 2 == 0
    # before and behind what lasts, the level is as it was
    bounds = np.concatenate([[-1000], edges, [1000]])
    for a, b in zip(bounds[:-1].tolist(), bounds[1:].tolist(), strict=True):
        if b - a >= shortest:
            middle = (a + b) / 2
            assert np.count_nonzero(edges < middle) % 2 == np.count_nonzero(kept < middle) % 2


@pytest.mark.parametrize(
    ("measured", "meant"),
    [(58_700, 57_600), (253_000, 250_000), (31_250, 31_250), (62_000, 62_500)],
)
def test_a_measured_rate_is_taken_for_a_usual_one_near_it(measured: float, meant: int) -> None:
    assert snapped(measured, RATES) == meant


def test_f0_alone_is_read_at_a_rate_that_servos_have() -> None:
    found = seen(spoken(b"\xf0" * 30, 115_200), 2_000_000)
    how = bit_time(found, 500, sample=1, preferred=RATES)
    assert how is not None
    assert how.baud == 115_200


@given(
    off=st.floats(-0.019, 0.019),
    stops=st.sampled_from([0.0, 0.04, 0.5, 1.0, 2.0]),
    data=st.binary(min_size=1, max_size=60),
)
def test_chunks_state_no_more_than_the_edges_tell(off: float, stops: float, data: bytes) -> None:
    baud, rate = 57_600, 8_000_000
    wire = Wire(0.001)
    for byte in data:
        wire.say(bytes([byte]), baud * (1 + off), after=stops / baud)
    wire.now += 0.001
    how = told(baud, rate)._replace(bit=rate / baud / (1 + off))
    got = received(seen(wire, rate), how)
    chunks = Chunker(how, LogicInput([], NS / rate, 1, iter(())), "bus0").chunks(got)
    assert b"".join(chunk.data for chunk in chunks) == data
    assert {chunk.clock for chunk in chunks} == {Clock.SAMPLE}
    byte_ns, sample_ns, at = 10 * NS / baud, NS / rate, 0
    for chunk in chunks:
        assert chunk.t_ns is not None
        for back in range(len(chunk.data), 0, -1):
            laid = chunk.t_ns - back * byte_ns
            # what is stated of such a byte: 2 % of those that are laid out, and a sample
            assert abs(laid - wire.starts[at] * NS) <= 0.02 * back * byte_ns + sample_ns + 1
            at += 1
    first = chunks[0]
    assert abs((first.t_ns or 0) - byte_ns - wire.starts[0] * NS) <= sample_ns + 1


def talked(baud: float) -> Wire:
    """Return what all say, with pauses as long as they happen to be."""
    wire, chance = Wire(0.001), random.Random(1)
    for _ in range(6):
        for said in TALK.values():
            wire.say(said, baud, after=chance.uniform(0.0003, 0.01))
    wire.now += 0.001
    return wire


@pytest.mark.parametrize("samples", [3.3, 4.0, 6.1, 8.0, 17.36, 33.3])
def test_a_grid_of_any_rate_is_found_and_none_where_nobody_sampled(samples: float) -> None:
    rate = round(115_200 * samples)
    wire = talked(113_900)
    at = np.rint(edges_of(sampled(wire, rate)) * (NS / rate)).astype(np.int64)
    assert grid_in(at, 1, NS / 115_200, 3) == pytest.approx(NS / rate, rel=1e-5)
    true = np.rint(np.array(wire.toggles) * NS).astype(np.int64)
    assert grid_in(true, 1, NS / 115_200, 3) == 0
    coarse = np.rint(np.array(wire.toggles) * 1e6).astype(np.int64)
    assert grid_in(coarse, 1000, NS / 115_200 / 1000, 3) == 0


@pytest.mark.parametrize("rate", [1_000_000, 2_500_000, 6_250_000, 24_000_000, 12_500_000])
def test_edges_that_lie_on_a_grid_say_how_often_they_were_looked_at(rate: int) -> None:
    talk = b"".join(TALK.values())
    wire = spoken(talk, 115200)
    at = np.rint(edges_of(sampled(wire, rate)) * (NS / rate)).astype(np.int64)
    assert grid_in(at, 1, NS / 115200, 3) == pytest.approx(NS / rate)
    true = np.rint(np.array(wire.toggles) * NS).astype(np.int64)  # of a simulator: on no grid
    assert grid_in(true, 1, NS / 115200, 3) == 0
    own = spoken(talk, 125_000)  # whole microseconds: the wire's, and not those of samples
    assert grid_in(np.rint(np.array(own.toggles) * 1e6).astype(np.int64), 1e3, 8, 3) == 0
    assert grid_in(at[:20], 1, NS / 115200, 3) == 0  # so few may lie there by chance


@pytest.mark.parametrize("samples", [3.4, 4.3, 8.0])
def test_times_of_frames_are_as_unsure_as_a_sample_and_the_senders_clock_together(
    samples: float, tmp_path: Path
) -> None:
    rate = round(57_600 * samples)
    wire, said, chance = Wire(0.001), [], random.Random(2)
    for off in (0.019, -0.019) * 40:  # the rate that is measured is that of neither
        begin = len(wire.starts)
        end = wire.say(ASK, 57_600 * (1 + off), after=chance.uniform(0.001, 0.002))
        said.append((wire.starts[begin], end))
    wire.now += 0.01
    path = sr(tmp_path / "x.sr", {"D0": sampled(wire, rate)}, rate)
    frames = [row for row in sniffer.decode(path) if isinstance(row, sniffer.FrameRow)]
    assert len(frames) == len(said)
    for frame, (begin_s, end_s) in zip(frames, said, strict=True):
        assert frame.t_ns is not None
        assert frame.t_start_ns is not None
        assert frame.uncertainty_ns is not None
        assert abs(frame.t_start_ns - begin_s * NS) <= frame.uncertainty_ns + 1
        assert abs(frame.t_ns - end_s * NS) <= frame.uncertainty_ns + 1
        assert frame.uncertainty_ns <= NS / rate + 0.02 * 10 * NS / 57_600 + 1


def test_a_byte_with_parity_ends_where_it_does_wherever_the_capture_is_cut() -> None:
    how = told(9600, 96_000, parity="E")
    wire = Wire(0.01)
    end = wire.say(b"\x12\x34\x56\x78", 9600, parity="E")
    wire.now += 0.01
    got = received(seen(wire, 96_000), how)
    for cut in range(1, 4):
        chunker = Chunker(how, LogicInput([], NS / 96_000, 1, iter(())), "bus0")
        parts = [
            UartBytes(got.value[part], got.start[part], got.flags[part])
            for part in (slice(0, cut), slice(cut, None))
        ]
        chunks = [k for part in parts for k in chunker.chunks(part)]
        assert abs((chunks[-1].t_ns or 0) - end * NS) <= NS / 96_000


def test_errors_become_marks_of_their_chunks() -> None:
    wire = Wire(0.01)
    wire.say(b"\x12\x34", 9600, wrong="stop", after=0.01)
    wire.now += 0.01
    how = told(9600, 96_000)
    got = received(seen(wire, 96_000), how)
    chunks = Chunker(how, LogicInput([], NS / 96_000, 1, iter(())), "bus0").chunks(got)
    assert [(c.data, [(m.kind, m.start, m.length) for m in c.marks]) for c in chunks] == [
        (b"\x12", []),
        (b"\x34", [(MarkKind.FRAMING, 0, 1)]),
    ]


def test_times_of_a_dump_in_nanoseconds_are_as_late_as_the_samples_behind_it(
    tmp_path: Path,
) -> None:
    wire = spoken(bytes.fromhex("FFFFFF0104F28C027A FFFFFF0102F10B") * 20, 57600)
    levels = sampled(wire, 1_000_000)
    files = {
        "a.vcd": vcd({"RX": levels}, 1_000_000),
        "a.csv": saleae_csv({"RX": levels}, 1_000_000),
        "RX.bin": saleae_0(levels, 1_000_000),
    }
    for name, written in files.items():
        (tmp_path / name).write_bytes(written)
        source = open_source(tmp_path / name)
        list(source)
        assert source.facts()["latency_ns.RX"] == "1000"
