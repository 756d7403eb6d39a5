"""The simulated buses against their own truth, and the decoders against both."""

from __future__ import annotations

import itertools
from collections import Counter
from typing import TYPE_CHECKING

import numpy as np
import pytest

from sniffer.decoding.decoder import Decoder
from sniffer.ground.codes import KINDS, NOT_EXPECTED, OK
from sniffer.ground.model import NS, Chunk, Clock, SnifferError
from sniffer.protocols import PROTOCOLS
from sniffer.simulation import BUSES, LINE_FAULTS, Fault, TrueFrame, simulate
from sniffer.simulation.captures import CAPTURES, MANUALS, VECTORS, manual, write
from sniffer.simulation.render import candump, frame_reads, hexdump, raw, usb_reads, xxd
from sniffer.sources import open_source
from tests.lists import each_in_turn, in_turn

if TYPE_CHECKING:
    from collections.abc import Sequence
    from pathlib import Path

EVERY_BUS = each_in_turn(4, "name", BUSES)
# A protocol is tested as soon as there is a decoder for it.
EVERY_DECODED = each_in_turn(2, "name", [n for n in BUSES if n in PROTOCOLS])

ALL_FAULTS = tuple(Fault(kind, 0.01) for kind in LINE_FAULTS)
START = 1_700_000_000 * NS

WITHOUT_CHECKSUM = ("lss", "wck")
"""LSS has none at all, wCK none in its answers: what is altered there may still be a frame."""

Row = tuple[int, bytes, str, int, str]
"""Offset, bytes, kind, servo id, command."""


def clean(name: str, seed: int = 5, seconds: float = 3.0) -> list[TrueFrame]:
    return list(simulate(name, seed=seed, start_ns=START, duration_s=seconds))


def damaged(name: str, seed: int, seconds: float = 6.0) -> list[TrueFrame]:
    return list(simulate(name, seed=seed, start_ns=START, duration_s=seconds, faults=ALL_FAULTS))


class Decoded:
    """All that the decoder says of a run, with absolute offsets."""

    def __init__(self, name: str, frames: Sequence[TrueFrame], *, usb: bool = False) -> None:
        protocol, baud = PROTOCOLS[name], BUSES[name].baud
        reads = usb_reads(frames, baud) if usb else frame_reads(frames)
        decoder = Decoder(name, baud=baud)
        chunks = [Chunk(data, t_ns, Clock.FILE) for t_ns, data in reads]
        # in groups of many sizes, as a live port gives them
        cuts = [0, *itertools.accumulate(1 + k % 50 for k in range(len(chunks)))]
        groups = [chunks[a:b] for a, b in itertools.pairwise(cuts) if chunks[a:b]]
        self.frames: list[Row] = []
        self.t_end: list[int] = []
        self.gaps: list[tuple[int, int]] = []
        self.outcomes: Counter[int] = Counter()
        self.values: dict[int, list[tuple[int, str, int]]] = {}
        self.took: dict[int, tuple[int, int]] = {}
        """By offset of each paired response: how long it took, and the window for it."""
        for b in [*(decoder.feed(*group) for group in groups), decoder.close()]:
            f = b.frames
            for i in range(len(f)):
                a, z = int(f.start[i]), int(f.end[i])
                kind, op = KINDS[int(f.kind[i])], protocol.op_name(int(f.op[i]))
                row = (b.base + a, b.data[a:z], kind, int(f.servo_id[i]), op)
                self.frames.append(row)
                self.t_end.append(int(f.t_end[i]))
            self.gaps += [(b.base + g.start, b.base + g.start + g.length) for g in b.gaps]
            self.outcomes.update(b.transactions.outcome.tolist())
            t = b.transactions.take(b.transactions.outcome == OK)
            windows = protocol.window_ns(f)[t.request]
            places = (b.base + f.start[t.response]).tolist()
            times = zip(t.response_time_ns.tolist(), windows.tolist(), strict=True)
            self.took.update(zip(places, times, strict=True))
            s = b.samples
            for i in range(len(s)):
                at = b.base + int(f.start[s.row[i]])
                name_of = protocol.registers[int(s.register[i])].name
                value = (int(s.servo_id[i]), name_of, int(s.raw[i]))
                self.values.setdefault(at, []).append(value)


def rows(frames: Sequence[TrueFrame]) -> list[tuple[Row, TrueFrame]]:
    """Return where each frame stands in the bytes of the line."""
    out, at = [], 0
    for f in frames:
        out.append(((at, f.wire, f.kind, f.servo_id, f.op), f))
        at += len(f.wire)
    return out


# ---------------------------------------------------------------- the generator


@EVERY_BUS
def test_the_same_seed_gives_the_same_frames_and_another_seed_others(name: str) -> None:
    assert damaged(name, 1, 2) == damaged(name, 1, 2)
    assert raw(damaged(name, 1, 2)) != raw(damaged(name, 2, 2))


@EVERY_BUS
def test_frames_never_overlap_and_no_byte_is_faster_than_the_baud_rate(name: str) -> None:
    for baud in (BUSES[name].baud, 1_000_000):
        frames = simulate(name, seed=3, baud=baud, duration_s=3, faults=ALL_FAULTS)
        end = 0
        for f in frames:
            assert f.t_start_ns >= end
            assert (f.t_end_ns - f.t_start_ns) * baud >= len(f.wire) * 10 * NS
            end = f.t_end_ns


@EVERY_BUS
def test_an_endless_run_begins_like_a_short_one(name: str) -> None:
    short = clean(name, seconds=1)
    endless = simulate(name, seed=5, start_ns=START)
    assert list(itertools.islice(endless, len(short))) == short


@EVERY_BUS
def test_without_faults_everything_is_whole(name: str) -> None:
    assert all(f.wire == f.data and f.wire and f.fault is None for f in clean(name))


@EVERY_BUS
def test_every_kind_of_fault_happens_and_is_told(name: str) -> None:
    frames = damaged(name, 4, 12)
    assert {f.fault for f in frames} == {None, *LINE_FAULTS}
    for f in frames:
        match f.fault:
            case "drop":
                assert f.data
                assert not f.wire
            case "flip":
                assert len(f.wire) == len(f.data)
                assert sum(a != b for a, b in zip(f.wire, f.data, strict=True)) == 1
            case "cut":
                assert f.data.startswith(f.wire)
                assert 0 < len(f.wire) < len(f.data)
            case "noise":
                assert f.kind == "noise"
                assert f.wire
                assert not f.data
            case "brownout":
                assert f.wire in (f.data, b"")
            case _:
                assert f.wire == f.data


@EVERY_BUS
def test_a_fault_of_one_servo_leaves_the_others_alone(name: str) -> None:
    who = BUSES[name].servo_ids[1]
    faults = [Fault(kind, 0.05, who) for kind in ("drop", "cut", "flip", "brownout")]
    struck = [f for f in simulate(name, seed=2, duration_s=4, faults=faults) if f.fault]
    assert struck
    assert {f.servo_id for f in struck} == {who}


@EVERY_BUS
def test_servos_follow_their_goals(name: str) -> None:
    goals: dict[int, list[int]] = {}
    places: dict[int, list[int]] = {}
    for f in clean(name, seconds=8):
        for servo_id, register, value in f.values:
            if register == "goal_position" and f.kind == "request":
                goals.setdefault(servo_id, []).append(value)
            elif register in ("present_position", "position"):
                places.setdefault(servo_id, []).append(value)
    for servo_id in BUSES[name].servo_ids:
        goal, place = goals[servo_id], places[servo_id]
        span = max(goal) - min(goal)
        assert span > 0
        assert abs(max(place) - max(goal)) < span / 4
        assert abs(min(place) - min(goal)) < span / 4


def test_a_wrong_name_is_the_callers_mistake() -> None:
    with pytest.raises(SnifferError, match="mightyzap"):
        simulate("nothing")
    with pytest.raises(SnifferError, match="brownout"):
        Fault("nothing", 0.1)


# ---------------------------------------------------------------- the decoders


@in_turn(2)
@EVERY_DECODED
@pytest.mark.parametrize("usb", [False, True], ids=["by frame", "by usb read"])
def test_a_clean_run_is_decoded_to_its_truth(name: str, usb: bool) -> None:
    frames = clean(name)
    got = Decoded(name, frames, usb=usb)
    assert got.frames == [row for row, _ in rows(frames)]
    assert got.gaps == []
    assert set(got.outcomes) <= {OK, NOT_EXPECTED}
    if not usb:
        assert got.t_end == [f.t_end_ns for f in frames]


@in_turn(2)
@EVERY_DECODED
def test_samples_are_the_true_values(name: str) -> None:
    frames = clean(name)
    got = Decoded(name, frames)
    stated = {row[0]: sorted(f.values) for row, f in rows(frames) if f.values}
    assert {at: sorted(values) for at, values in got.values.items()} == stated


@in_turn(4)
@EVERY_DECODED
@pytest.mark.parametrize("seed", range(1, 5))
def test_a_damaged_run_is_decoded_as_far_as_it_is_whole(name: str, seed: int) -> None:
    frames = damaged(name, seed)
    truth = rows(frames)
    got = Decoded(name, frames)
    found = {row[0]: row for row in got.frames}
    # a second answer answers nothing: it has no command, and a bare one is no frame at all
    whole = {row[0]: row for row, f in truth if f.wire and not f.damaged and f.fault != "duplicate"}
    missed = [row for at, row in whole.items() if found.get(at) != row]
    assert len(missed) <= 0.005 * len(whole), missed
    # what was found beside the truth touches damaged bytes, or a second answer
    torn = [(row[0], row[0] + len(f.wire)) for row, f in truth if f.damaged and f.wire]
    answers = [(row[0], row[0] + len(f.wire)) for row, f in truth if f.fault == "duplicate"]
    for at, row in found.items():
        if whole.get(at) != row:
            end = at + len(row[1])
            assert any(a < end and at < z for a, z in torn + answers), row
    # every byte is accounted for, and torn frames are gaps, unless no checksum tells
    in_gaps = np.zeros(len(raw(frames)), bool)
    for a, z in got.gaps:
        in_gaps[a:z] = True
    assert in_gaps.sum() + sum(len(row[1]) for row in got.frames) == len(in_gaps)
    covered = sum(bool(in_gaps[a:z].all()) for a, z in torn)
    assert covered >= (0.5 if name in WITHOUT_CHECKSUM else 0.95) * len(torn)


@in_turn(4)
@EVERY_DECODED
def test_a_late_answer_is_beyond_the_window_and_still_pairs(name: str) -> None:
    frames = list(
        simulate(name, seed=6, start_ns=START, duration_s=4, faults=[Fault("late", 0.05)])
    )
    late = {row[0] for row, f in rows(frames) if f.fault == "late"}
    got = Decoded(name, frames)
    assert late
    assert {at for at, (took, window) in got.took.items() if took > window} == late


# ---------------------------------------------------------------- rendering


def test_dumps_look_like_those_of_the_tools() -> None:
    data = (
        bytes.fromhex("faaf01001e020184039bfaaf010f2a020026fddf01002a02018303a8")
        + b"#5QD\r*5QD1443\r"
    )
    assert xxd(data).splitlines() == [
        "00000000: faaf 0100 1e02 0184 039b faaf 010f 2a02  ..............*.",
        "00000010: 0026 fddf 0100 2a02 0183 03a8 2335 5144  .&....*.....#5QD",
        "00000020: 0d2a 3551 4431 3434 330d                 .*5QD1443.",
    ]
    assert hexdump(data).splitlines() == [
        "00000000  fa af 01 00 1e 02 01 84  03 9b fa af 01 0f 2a 02  |..............*.|",
        "00000010  00 26 fd df 01 00 2a 02  01 83 03 a8 23 35 51 44  |.&....*.....#5QD|",
        "00000020  0d 2a 35 51 44 31 34 34  33 0d                    |.*5QD1443.|",
        "0000002a",
    ]
    rows_of_zeros = hexdump(bytes(70)).splitlines()
    assert rows_of_zeros[1:] == ["*", f"00000040  {'00 ' * 6:<48}  |......|", "00000046"]
    assert candump([(1_609_779_922_655_421_000, b"\xfa\xaf")]) == (
        "(1609779922.655421) bus0 #FAAF\n"
    )


@EVERY_BUS
def test_usb_reads_keep_every_byte_and_never_run_ahead_of_the_line(name: str) -> None:
    frames = damaged(name, 1, 2)
    reads = list(usb_reads(frames, BUSES[name].baud))
    assert b"".join(data for _, data in reads) == raw(frames)
    baud = BUSES[name].baud
    ends = [f.t_start_ns + k * 10 * NS // baud for f in frames for k in range(1, len(f.wire) + 1)]
    at = 0
    for t_ns, data in reads:
        at += len(data)
        assert len(data) <= 62
        assert ends[at - 1] <= t_ns <= ends[at - len(data)] + 1_000_001
    assert [t for t, _ in reads] == sorted(t for t, _ in reads)


@each_in_turn(3, "capture", CAPTURES, ids=lambda c: c.file)
def test_a_rendered_capture_reads_back(capture: object, tmp_path: Path) -> None:
    assert isinstance(capture, type(CAPTURES[0]))
    frames = capture.frames()
    path = tmp_path / capture.file
    path.write_bytes(capture.render(frames))
    assert path.stat().st_size <= 150_000
    with open_source(path) as source:
        data = b"".join(chunk.data for group in source for chunk in group)
    assert data == raw(frames)


@pytest.mark.parametrize("name", MANUALS)
def test_the_manuals_examples_read_back(name: str, tmp_path: Path) -> None:
    text = manual(name)
    path = tmp_path / ("manual.bin" if name == "lss" else "manual.hex")
    path.write_bytes(text)
    with open_source(path) as source:
        data = b"".join(chunk.data for group in source for chunk in group)
    lines = [x for x in text.decode().splitlines() if not x.startswith("#")]
    assert data == (text if name == "lss" else bytes.fromhex("".join(lines)))


def test_the_sample_captures_are_those_that_the_program_writes(tmp_path: Path) -> None:
    write(tmp_path)
    kept = VECTORS.parents[1] / "sample_captures"
    made = {p.name: p.read_bytes() for p in tmp_path.iterdir()}
    assert {p.name: p.read_bytes() for p in kept.iterdir() if p.name in made} == made


@each_in_turn(2, "name", ["mightyzap", "rs30x"])
def test_the_supply_of_many_servos_holds_as_that_of_few_does(name: str) -> None:
    least = []
    for count in (3, 20):
        frames = simulate(name, seed=2, servo_ids=range(1, count + 1), duration_s=4)
        volts = [raw for f in frames for _, what, raw in f.values if what == "present_voltage"]
        least.append(min(volts))
    assert least[1] > 0.75 * least[0]
