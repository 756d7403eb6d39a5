"""``sniffer merge``: several captures as one, by time, by offset, by what taps both heard."""

from __future__ import annotations

import functools
import re
from dataclasses import replace
from pathlib import Path
from typing import Final

import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

import sniffer
from sniffer.decoding.rows import FrameRow
from sniffer.ground.model import NS, Chunk, Clock, Direction
from sniffer.mcapfile.source import session
from sniffer.merging.aligning import aligned
from sniffer.merging.answering import WireHeard, answered
from sniffer.messages import ANCHOR
from sniffer.protocols import protocol_named
from sniffer.sinks.raw import LogFile
from tests.commands import log, talk, within
from tests.inputs import chunks
from tests.lists import each_in_turn
from tests.recordings import START_NS
from tests.recordings import talk as simulated

Capsys = pytest.CaptureFixture[str]

CAPTURES: Final = Path(__file__).parents[1] / "sample_captures"
TALK: Final = simulated("mightyzap", 2.0)


def lines(path: Path, told: list[Chunk]) -> Path:
    file = LogFile(path)
    file.take(told)
    file.close()
    return path


def moved(told: list[Chunk], ns: int) -> list[Chunk]:
    return [replace(c, t_ns=(c.t_ns or 0) + ns, clock=Clock.FILE) for c in told]


def test_captures_of_several_buses_become_one_in_the_order_of_time(
    tmp_path: Path, capsys: Capsys
) -> None:
    left = lines(tmp_path / "left.log", moved(TALK[:200], 0))
    right = lines(tmp_path / "right.log", moved(TALK[:200], 3_000_000))
    out, text = tmp_path / "both.mcap", tmp_path / "both.log"
    assert within(capsys, "merge", left, right, "-o", out, "-o", text).status == 0
    times = [c.t_ns or 0 for c in chunks(text)]
    assert len(times) == 400
    assert times == sorted(times)
    got = chunks(out)
    for bus, path in (("left", left), ("right", right)):
        assert [(c.data, c.t_ns) for c in got if c.bus == bus] == [
            (c.data, c.t_ns) for c in chunks(path)
        ]
    facts = session(out)
    assert facts["merged.1.source"] == str(left)
    assert facts["merged.2.shift_ns"] == "0"


def test_buses_of_different_names_keep_them(tmp_path: Path, capsys: Capsys) -> None:
    one = lines(tmp_path / "one.log", [replace(c, bus="leg") for c in moved(TALK[:50], 0)])
    two = lines(tmp_path / "two.log", [replace(c, bus="arm") for c in moved(TALK[:50], 0)])
    out = tmp_path / "x.log"
    assert within(capsys, "merge", one, two, "-o", out).status == 0
    assert {c.bus for c in chunks(out)} == {"leg", "arm"}


@pytest.mark.parametrize("name", ["b.log", "b", "path"])
def test_a_clock_offset_that_is_given_is_added(name: str, tmp_path: Path, capsys: Capsys) -> None:
    a = lines(tmp_path / "a.log", moved(TALK[:50], 0))
    b = lines(tmp_path / "b.log", moved(TALK[:50], -NS))
    told = f"{b if name == 'path' else name}=+1.25s"
    out = tmp_path / "x.log"
    assert within(capsys, "merge", a, b, "--offset", told, "-o", out).status == 0
    first = {c.bus: c.t_ns or 0 for c in reversed(chunks(out))}
    assert first["b"] - first["a"] == NS // 4


def test_clocks_are_told_from_what_two_taps_of_one_bus_heard(
    tmp_path: Path, capsys: Capsys
) -> None:
    a = lines(tmp_path / "a.log", moved(TALK, 0))
    b = lines(tmp_path / "b.log", moved(TALK[100:], -3_725_000_000_000))
    out = tmp_path / "x.mcap"
    ran = within(capsys, "merge", a, b, "--align", "-o", out)
    assert ran.status == 0
    assert f"sniffer: {b}: +3725.000000 s to its times, by " in ran.err
    assert session(out)["merged.2.shift_ns"] == "3725000000000"
    got = chunks(out)
    heard = [c.t_ns for c in got if c.bus == "a"][100:]
    assert heard == [c.t_ns for c in got if c.bus == "b"]


@pytest.mark.parametrize("protocol", ["mightyzap", "rs30x", "lss"])
def test_two_taps_that_heard_the_whole_bus_are_not_taken_for_its_two_wires(
    protocol: str, tmp_path: Path, capsys: Capsys
) -> None:
    """All that both heard was there twice, and the line was said to run faster."""
    told = simulated(protocol, 4.0)
    a = lines(tmp_path / "a.log", moved(told[:-50], 0))
    b = lines(tmp_path / "b.log", moved(told[50:], 3_000_000))
    for more in ((), ("--align",)):
        ran = within(capsys, "merge", a, b, "--pair", *more, "-o", tmp_path / "x.log")
        assert ran.status == 2
        assert f"{a} and {b} each heard requests and answers: two taps of the whole" in ran.err
        assert "leave out --pair" in ran.err
    assert within(capsys, "merge", a, b, "-o", tmp_path / "x.log").status == 0


def test_a_clock_offset_that_is_given_is_not_looked_for_and_that_is_told(
    tmp_path: Path, capsys: Capsys
) -> None:
    """It was left out without a word: the times were by the offset off, and looked aligned."""
    a, b = (lines(tmp_path / f"{name}.log", moved(TALK, 0)) for name in "ab")
    out = tmp_path / "x.log"
    ran = within(capsys, "merge", a, b, "--align", "--offset", "b=1s", "-o", out)
    assert ran.status == 0
    assert f"{b}: +1.000000 s to its times, as was told: nothing was looked for\n" in ran.err


@settings(max_examples=15)
@given(
    shift=st.integers(-(10**15), 10**15),
    start=st.integers(0, len(TALK) // 3),
    late=st.lists(st.integers(0, 16), min_size=len(TALK), max_size=len(TALK)),
    lost=st.sets(st.integers(0, len(TALK)), max_size=20),
)
def test_the_difference_of_two_clocks_is_found_to_what_adapters_hold_back(
    shift: int, start: int, late: list[int], lost: set[int]
) -> None:
    second = [
        replace(c, t_ns=(c.t_ns or 0) + shift + ms * 1_000_000)
        for k, (c, ms) in enumerate(zip(TALK, late, strict=True))
        if k >= start and k not in lost
    ]
    found = aligned(TALK, second)
    assert found is not None
    assert -1_000_000 <= found.offset_ns - shift <= 17_000_000


def test_traffic_that_only_repeats_itself_tells_no_clock(tmp_path: Path, capsys: Capsys) -> None:
    """Polling that always says the same: any whole number of rounds would do."""
    ask, answer = bytes.fromhex("FFFFFF0102F10B"), bytes.fromhex("FFFFFF010200FC")
    same = [Chunk((ask, answer)[k % 2], START_NS + k * 2_000_000, Clock.FILE) for k in range(400)]
    assert aligned(same, moved(same, 12_345_000_000)) is None
    a, b = (lines(tmp_path / f"{n}.log", same) for n in "ab")
    ran = within(capsys, "merge", a, b, "--align", "-o", tmp_path / "x.log")
    assert ran.status == 2
    assert ran.complaint == (
        f"{b} and {a} have no traffic in common that tells their clocks apart: give --offset"
    )


def test_a_few_lines_tell_no_clock() -> None:
    assert aligned(TALK[:1], TALK[:1]) is None
    assert aligned([], TALK) is None


def test_two_wires_become_one_bus_in_the_order_of_cause_and_effect(
    tmp_path: Path, capsys: Capsys
) -> None:
    """Both hosts fetch what came every 16 ms: by time alone half of the exchanges are torn."""
    both = []
    source = log(talk(40)).encode()
    for row in sniffer.decode(source):
        if isinstance(row, FrameRow):
            late = -(-row.t_ns // 16_000_000) * 16_000_000
            wire = Direction.TX if row.kind == "request" else Direction.RX
            both.append(Chunk(bytes.fromhex(row.hex), late, Clock.FILE, "bus0", wire))
    whole = sniffer.decode(source).summary.buses["bus0"]
    by_wire = {
        wire: lines(
            tmp_path / f"{wire.name}.log",
            [replace(c, direction=Direction.UNKNOWN) for c in both if c.direction == wire],
        )
        for wire in (Direction.TX, Direction.RX)
    }
    out = tmp_path / "x.mcap"
    ran = within(
        capsys, "merge", by_wire[Direction.TX], by_wire[Direction.RX], "--pair", "-o", out,
        "--latency", "16",
    )  # fmt: skip
    assert ran.status == 0, ran.err
    assert "two wires, put in order by cause and effect" in ran.err
    got = sniffer.decode(out).summary.buses["bus0"]
    assert got.outcomes["ok"] > 0.95 * whole.outcomes["ok"] > 50


@functools.cache
def rows(name: str) -> list[FrameRow]:
    return [row for row in sniffer.decode(CAPTURES / name) if isinstance(row, FrameRow)]


def wires(name: str, shift_ns: int = 0, grid_ns: int = 1) -> tuple[list[Chunk], list[Chunk]]:
    """What each wire of a simulated bus carried, a frame a read, each by its own clock."""
    both: tuple[list[Chunk], list[Chunk]] = [], []
    for row in rows(name):
        is_answer = row.kind == "response"
        t = -(-(row.t_ns + is_answer * shift_ns) // grid_ns) * grid_ns
        both[is_answer].append(Chunk(bytes.fromhex(row.hex), t, Clock.FILE))
    return both


@each_in_turn(2, "ahead_ms", [20, -20, 1250, -3_600_000])
def test_clocks_of_two_wires_that_differ_are_told_and_mended(
    ahead_ms: int, tmp_path: Path, capsys: Capsys
) -> None:
    """Two hosts, a wire each: 20 ms made sound servos slow and the controller impatient."""
    asked, heard = wires("mightyzap_clean.log", ahead_ms * 1_000_000)
    a, b = lines(tmp_path / "a.log", asked), lines(tmp_path / "b.log", heard)
    out = tmp_path / "x.mcap"
    ran = within(capsys, "merge", a, b, "--pair", "-o", out)
    side = "ahead of" if ahead_ms > 0 else "behind"
    told = f"sniffer: the clock of {b} seems to be {abs(ahead_ms) / 1000:.3f} s {side} that of {a}"
    assert ran.err.startswith(told)
    assert "say --align, or what to add by --offset" in ran.err
    ran = within(capsys, "merge", a, b, "--pair", "--align", "-o", out, "--force")
    assert re.search(r" s to its times, by [56]\d\d answers and the requests", ran.err)
    assert abs(int(session(out)["merged.2.shift_ns"]) + ahead_ms * 1_000_000) < 500_000
    assert +sniffer.decode(out).summary.buses["bus0"].outcomes == {"ok": 651, "not_expected": 204}
    assert not sniffer.diagnose(out).incidents
    given = f"b={'+' if ahead_ms < 0 else '-'}{abs(ahead_ms)}ms"
    for more in (("--offset", given), ("--offset", given, "--align")):
        ran = within(capsys, "merge", a, b, "--pair", *more, "-o", out, "--force")
        assert ran.err.startswith("sniffer: bus0: two wires, put in order"), ran.err


def test_a_tap_that_began_long_before_the_other_tells_its_clock_too(
    tmp_path: Path, capsys: Capsys
) -> None:
    """More requests than are compared, before the other wire was heard at all."""
    asked, heard = wires("mightyzap_clean.log", 40_000_000)
    before = [replace(c, t_ns=(c.t_ns or 0) - k * 8 * NS) for k in (3, 2, 1) for c in asked]
    a, b = lines(tmp_path / "a.log", [*before, *asked]), lines(tmp_path / "b.log", heard)
    ran = within(capsys, "merge", a, b, "--pair", "-o", tmp_path / "x.mcap")
    assert ran.err.startswith(f"sniffer: the clock of {b} seems to be 0.040 s ahead of ")


@each_in_turn(
    3,
    ("name", "protocol"),
    [
        ("mightyzap_clean.log", "mightyzap"),
        ("mightyzap_damaged.log", "mightyzap"),
        ("lss_damaged.log", "lss"),
        ("rs30x_damaged.log", "rs30x"),
        ("wck_clean.log", "wck"),
    ],
)
@settings(max_examples=4)
@given(shift=st.integers(-(10**13), 10**13), grid_ms=st.sampled_from([0, 1, 4, 10, 16]))
def test_who_answers_what_tells_the_clocks_to_what_adapters_hold_back(
    name: str, protocol: str, shift: int, grid_ms: int
) -> None:
    asked, heard = wires(name, shift, max(grid_ms * 1_000_000, 1))
    spoken = protocol_named(protocol)
    both = (WireHeard.of(w, protocol=spoken, baud=spoken.baud) for w in (asked, heard))
    found = answered(*both)
    if found is None:
        assert protocol == "wck"  # answers that name nobody
        assert grid_ms > 1
    else:
        assert abs(found.offset_ns - shift) <= max(3, 18 * (grid_ms > 1)) * 1_000_000


def test_the_servos_wire_in_place_of_the_controllers_is_refused(
    tmp_path: Path, capsys: Capsys
) -> None:
    asked, heard = wires("mightyzap_clean.log")
    a, b = lines(tmp_path / "a.log", asked), lines(tmp_path / "b.log", heard)
    ran = within(capsys, "merge", b, a, "--pair", "-o", tmp_path / "x.mcap")
    assert ran.status == 2
    assert ran.complaint == (
        f"{b} heard only answers, and {a} only requests: name the controller's wire first"
    )
    assert not (tmp_path / "x.mcap").exists()


def test_rounds_that_are_all_alike_tell_no_clock_of_two_wires(
    tmp_path: Path, capsys: Capsys
) -> None:
    ask, answer = bytes.fromhex("FFFFFF0102F10B"), bytes.fromhex("FFFFFF010200FC")
    asked = [Chunk(ask, START_NS + k * 20_000_000, Clock.FILE) for k in range(200)]
    heard = [replace(c, data=answer, t_ns=(c.t_ns or 0) + NS) for c in asked]
    a, b = lines(tmp_path / "a.log", asked), lines(tmp_path / "b.log", heard)
    out = tmp_path / "x.mcap"
    assert "clock" not in within(capsys, "merge", a, b, "--pair", "-o", out).err
    ran = within(capsys, "merge", a, b, "--pair", "--align", "-o", out, "--force")
    assert ran.status == 2
    assert ran.complaint.endswith("or as many with several differences; give --offset")


def test_files_of_one_recording_are_one_bus_again(tmp_path: Path, capsys: Capsys) -> None:
    from sniffer.mcapfile.sink import McapSink

    half = len(TALK) // 2
    at = sum(len(c.data) for c in TALK[:half])
    parts = []
    for nth, (told, start) in enumerate(((TALK[:half], 0), (TALK[half:], at))):
        sink = McapSink(tmp_path / f"run.{nth}.mcap", {}, starts={"bus0": start})
        sink.raw("bus0", told)
        sink.close()
        parts.append(tmp_path / f"run.{nth}.mcap")
    out = tmp_path / "x.mcap"
    assert within(capsys, "merge", *parts, "-o", out).status == 0
    assert chunks(out) == TALK


def test_files_of_two_recorders_are_no_one_bus_though_one_of_them_goes_on_with_another(
    tmp_path: Path, capsys: Capsys
) -> None:
    """Of two robots: a bus of both protocols, two thirds of whose bytes were in frames."""
    from sniffer.mcapfile.sink import McapSink

    parts = []
    for nth, start in enumerate((0, 700)):
        facts = dict(zip(ANCHOR, (str(nth), str(nth)), strict=True))
        sink = McapSink(tmp_path / f"run.{nth}.mcap", facts, starts={"bus0": start})
        sink.raw("bus0", moved(TALK[:40], nth * 10**10))
        sink.close()
        parts.append(tmp_path / f"run.{nth}.mcap")
    out = tmp_path / "x.log"
    assert within(capsys, "merge", *parts, "-o", out).status == 0
    assert {c.bus for c in chunks(out)} == {"run", "run_"}


def test_pieces_of_a_log_are_one_bus_where_they_are_one_capture(
    tmp_path: Path, capsys: Capsys
) -> None:
    third = len(TALK) // 3
    pieces = (TALK[:third], TALK[third : 2 * third], TALK[2 * third :])
    parts = [lines(tmp_path / f"{n}.log", piece) for n, piece in enumerate(pieces)]
    out = tmp_path / "x.log"
    mixed = [parts[2], parts[0], parts[1]]
    assert within(capsys, "merge", *mixed, "--together", "-o", out).status == 0
    assert out.read_text() == lines(tmp_path / "whole.log", TALK).read_text()
    assert within(capsys, "merge", *mixed, "-o", out, "--force").status == 0
    assert {c.bus for c in chunks(out)} == {"0", "1", "2"}


@pytest.mark.parametrize(
    ("arguments", "told"),
    [
        (("{a}",), "merge takes two files or more"),
        (("{a}", "{b}", "--offset", "b.log"), "Invalid value for '--offset': 'b.log': write FILE="),
        (("{a}", "{b}", "--offset", "c=1s"), "'c' is none of the captures: "),
        (
            ("{a}", "{b}", "--pair", "--align"),
            "no answers of {b} tell its clock from that of {a}: ",
        ),
        (("{a}", "{b}", "--pair", "--together"), "--pair is about two wires, --together about"),
        (("{a}", "{b}", "{a}", "--pair"), "--pair is about two captures, one of each wire"),
        (("{a}", "{b}", "{a}"), "{a} is named twice"),
        (("{a}", "{hex}"), "{hex} has no times: it cannot be merged by them"),
    ],
)
def test_what_cannot_be_merged_says_what_to_do(
    arguments: tuple[str, ...], told: str, tmp_path: Path, capsys: Capsys
) -> None:
    names = {n: str(lines(tmp_path / f"{n}.log", moved(TALK[:9], 0))) for n in "ab"}
    names["hex"] = str(CAPTURES / "mightyzap_manual.hex")
    out = tmp_path / "out" / "x.mcap"
    out.parent.mkdir()
    ran = within(capsys, "merge", *(a.format(**names) for a in arguments), "-o", out)
    assert ran.status == 2
    assert ran.complaint.startswith(told.format(**names))
    assert not list(out.parent.iterdir())


def test_no_input_is_written_over(tmp_path: Path, capsys: Capsys) -> None:
    a, b = (lines(tmp_path / f"{n}.log", moved(TALK[:9], 0)) for n in "ab")
    before = b.read_bytes()
    ran = within(capsys, "merge", a, b, "-o", b, "--force")
    assert ran.complaint == f"{b} is the input: choose another output"
    assert b.read_bytes() == before
