"""Captures that are shown to others: nobody's name, number or time is left in them."""

from __future__ import annotations

import itertools
import json
import tracemalloc
from dataclasses import replace
from typing import TYPE_CHECKING

import pytest
from hypothesis import example, given
from hypothesis import strategies as st

import sniffer
from sniffer.ground.model import Chunk, Clock, Mark, MarkKind
from sniffer.mcapfile.source import session
from tests.commands import within
from tests.inputs import chunks
from tests.streams.mightyzap import packet
from tests.test_convert import T0, Capsys, recording

if TYPE_CHECKING:
    from pathlib import Path

SERIAL = b"*5QN87654321\r"


def test_a_capture_without_names_tells_nobody_whose_it_is(tmp_path: Path, capsys: Capsys) -> None:
    said = [b"#5QN\r", SERIAL, b"#5QD\r", b"*5QD900\r"] * 8
    told = [
        Chunk(data, T0 + n * 2_000_000, Clock.READ, "left-leg-of-anna")
        for n, data in enumerate(said)
    ]
    marked = replace(told[3], marks=(Mark(MarkKind.OVERRUN, 0),))
    source = recording(
        tmp_path / "in.mcap",
        [*told[:3], marked, *told[4:]],
        **{
            "port.left-leg-of-anna": "/dev/ttyUSB7",
            "port.left-leg-of-anna.serial_number": "FT1234",
            "baud.left-leg-of-anna": "115200",
            "host": "anna-pc",
        },
    )
    outs = [tmp_path / name for name in ("x.mcap", "x.log", "x.jsonl")]
    parts = [tmp_path / name for name in ("cut.mcap", "cut.log", "both.mcap", "both.log")]
    assert within(capsys, "convert", source, *outs, "--anonymise").status == 0
    options = sniffer.Options(names={5: "anna"})
    sniffer.cut(source, parts[:2], sniffer.Window(0.0, 1.0), options, anonymise=True)
    other = tmp_path / "anna.log"
    other.write_text("".join(f"({n}.5) annas-arm #FFFFFF0102F10B\n" for n in range(9)))
    sniffer.merge([source, other], parts[2:], options, anonymise=True)
    for part, bus in ((parts[0], "bus0"), (parts[2], "bus1")):
        assert chunks(part)[0].t_ns == 0
        mine = b"".join(c.data for c in chunks(part) if c.bus == bus)
        assert mine == b"".join(c.data for c in chunks(outs[0]))
        assert session(part)[f"baud.{bus}"] == "115200"
    again = chunks(outs[0])
    assert [c.t_ns for c in again] == [n * 2_000_000 for n in range(len(said))]
    assert {c.bus for c in again} == {"bus0"}
    assert again[3].marks == marked.marks
    assert b"".join(c.data for c in again) == b"".join(said).replace(b"87654321", b"00000000")
    facts = session(outs[0])
    assert facts["baud.bus0"] == "115200"
    for out in (*outs, *parts):
        facts = session(out) if out.suffix == ".mcap" else {}
        assert not {key for key in facts if key.endswith("written")}  # often it is the same day
        content = out.read_bytes() + "".join(f"{k}={v}" for k, v in facts.items()).encode()
        for name in (
            b"anna",
            b"ttyUSB7",
            b"FT1234",
            b"8765",
            SERIAL[3:].hex().encode(),
            b"in.mcap",
        ):
            assert name not in content, (out, name)


def test_times_without_names_count_from_the_first_frame_that_a_host_held_back(
    tmp_path: Path, capsys: Capsys
) -> None:
    said = b"#5QD\r*5QD900\r" * 80
    source = recording(tmp_path / "in.mcap", [Chunk(said, T0, Clock.READ, "arm")])
    out = tmp_path / "x.jsonl"
    how = ("--protocol", "lss", "--anonymise")
    assert within(capsys, "convert", source, out, *how).status == 0
    told = [json.loads(line) for line in out.read_text().splitlines()]
    times = [row["t_ns"] for row in told if row["type"] == "frame"]
    assert (times[0], len(times)) == (0, 160)
    assert times == sorted(times)


@pytest.mark.parametrize(
    ("torn", "shown"),
    [
        (b"*5QN87654321", b"*5QN00000000"),
        (b"*5QN876\xb54321\r", b"*5QN000\xb50000\r"),
        (b"*5Q.87654321\r", b"*0Q.00000000\r"),
        (b"*5QD87654321\r", b"*5QD00000000\r"),
        (b"87654321\r", b"00000000\r"),
    ],
)
def test_a_serial_number_in_a_torn_answer_is_left_out(
    torn: bytes, shown: bytes, tmp_path: Path, capsys: Capsys
) -> None:
    said = [b"#5QD\r", b"*5QD987\r", b"#5QN\r", torn, b"#5QD\r", b"*5QD987\r"] * 2
    told = [Chunk(data, T0 + n * 20_000_000, Clock.READ, "bus0") for n, data in enumerate(said)]
    source = recording(tmp_path / "in.mcap", told, **{"baud.bus0": "115200"})
    out = tmp_path / "out.mcap"
    asked = ("--protocol", "lss", "--anonymise")
    assert within(capsys, "convert", source, out, *asked).status == 0
    assert b"".join(c.data for c in chunks(out)) == b"".join(said).replace(torn, shown)


def test_a_serial_number_under_a_checksum_is_left_out_and_the_frame_holds() -> None:
    from sniffer.jobs.anonymous import without

    zap = sniffer.PROTOCOLS["mightyzap"]
    frame = packet(1, 0, bytes.fromhex("12345678"))
    told = without(frame, frame.index(b"\x12"), 4, zap)
    assert told == packet(1, 0, bytes(4))


@example(data=bytes(60), cuts=[35])
@given(data=st.binary(max_size=60), cuts=st.lists(st.integers(0, 60), max_size=6))
def test_what_stands_over_a_stream_does_so_however_it_is_cut(data: bytes, cuts: list[int]) -> None:
    from sniffer.jobs.anonymous import Blanks

    found = [(3, b"abc"), (10, b"de"), (28, b"ABCDEFGHIJ"), (30, b"fg"), (58, b"mnopq")]
    want = bytearray(data)
    for at, text in found:
        want[at : at + len(text)] = text[: max(len(data) - at, 0)]
    edges = [0, *sorted(min(cut, len(data)) for cut in cuts), len(data)]
    blanks = Blanks(found)
    got = [blanks.of(data[a:b]) for a, b in itertools.pairwise(edges)]
    assert b"".join(got) == want[: len(data)]


def test_what_is_still_to_come_costs_no_piece_of_a_stream_anything() -> None:
    from sniffer.jobs.anonymous import Blanks

    blanks = Blanks([(at, b"0") for at in range(0, 100_000, 5)])
    tracemalloc.start()
    try:
        assert blanks.of(b"12345678") == b"02345078"
        assert tracemalloc.get_traced_memory()[1] < 20_000
    finally:
        tracemalloc.stop()


# --- what a recording says of itself -----------------------------------------------------------
