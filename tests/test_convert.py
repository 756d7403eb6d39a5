"""``sniffer convert``: bytes as other files hold them."""

from __future__ import annotations

import tempfile
from pathlib import Path
from typing import Final

import pytest
from hypothesis import given
from hypothesis import strategies as st

from sniffer.ground.model import Chunk, Clock, Direction, Mark, MarkKind
from sniffer.mcapfile.sink import McapSink
from sniffer.mcapfile.source import session
from sniffer.sinks.raw import RAW_FILES
from sniffer.sources import open_source
from tests.commands import within
from tests.inputs import chunks, read
from tests.streams.mightyzap import packet

Capsys = pytest.CaptureFixture[str]

CAPTURES: Final = Path(__file__).parents[1] / "sample_captures"
LOG: Final = CAPTURES / "mightyzap_damaged.log"
T0: Final = 1_700_000_000_123_456_789

TIMED = st.builds(
    Chunk,
    st.binary(min_size=1, max_size=40),
    st.integers(0, 1 << 62),
    st.just(Clock.FILE),
    st.sampled_from(["bus0", "can0", "left-arm", "é", "0"]),
    st.sampled_from(Direction),
)
"""Chunks as a log has them."""


def written(suffix: str, told: list[Chunk], format_: str) -> tuple[list[Chunk], str]:
    """Write chunks into a file of bytes and read it back; return what it had no room for, too."""
    with tempfile.TemporaryDirectory() as folder:
        path = Path(folder) / f"x{suffix}"
        file = RAW_FILES[suffix](path)
        file.take(told)
        file.close()
        return chunks(path, format_), file.lost()


@given(told=st.lists(TIMED, min_size=1, max_size=20))
def test_a_log_read_back_is_the_same_chunks(told: list[Chunk]) -> None:
    again, lost = written(".log", told, "candump")
    assert again == told
    assert not lost
    assert written(".log", told, "auto")[0] == told


@given(told=st.lists(st.binary(min_size=1, max_size=40).map(Chunk), min_size=1, max_size=9))
def test_chunks_without_times_come_back_from_a_log_without_times(told: list[Chunk]) -> None:
    assert written(".log", told, "auto") == (told, "")


@given(told=st.lists(st.binary(min_size=1, max_size=40), min_size=1, max_size=9))
def test_bytes_come_back_from_raw_bytes_and_from_hex(told: list[bytes]) -> None:
    for suffix, form in ((".bin", "bin"), (".hex", "auto")):
        again, lost = written(suffix, [Chunk(data) for data in told], form)
        assert b"".join(chunk.data for chunk in again) == b"".join(told)
        assert not lost


def test_what_a_log_has_no_room_for_is_said_in_a_line() -> None:
    mark = Mark(MarkKind.BREAK, 0, 1)
    told = [
        Chunk(b"a", T0, Clock.READ, "my (left) arm", marks=(mark, mark)),
        Chunk(b"b", T0, Clock.READ, "my_(left)_arm"),
    ]
    again, lost = written(".log", told, "auto")
    assert [(c.data, c.t_ns, c.bus) for c in again] == [
        (b"a", T0, "my__left__arm"),
        (b"b", T0, "my__left__arm_"),
    ]
    assert lost.partition("log lines have no room for ")[2] == (
        "2 tap marks, who stamped the times (they are read as a log's), the name "
        "'my (left) arm' (there it is my__left__arm) and the name 'my_(left)_arm' (there it is "
        "my__left__arm_)"
    )


def test_a_line_of_a_bus_whose_name_looks_like_bytes_is_no_list_of_bytes() -> None:
    again, lost = written(".log", [Chunk(b"\x01\x02", bus="beef")], "auto")
    assert again == [Chunk(b"\x01\x02", bus="bus_beef")]
    assert "the name 'beef'" in lost


def test_converting_there_and_back_gives_the_same_file(tmp_path: Path, capsys: Capsys) -> None:
    names = ["one.mcap", "two.log", "three.jsonl", "four.log"]
    at: Path = LOG
    for name in names:
        ran = within(capsys, "convert", at, tmp_path / name, "--quiet")
        assert (ran.status, ran.out, ran.err) == (0, "", "")
        at = tmp_path / name
    assert chunks(tmp_path / "two.log") == chunks(LOG)
    assert read(tmp_path / "four.log") == read(LOG)


def test_several_files_are_made_of_one_reading_of_standard_input(tmp_path: Path) -> None:
    from tests.commands import sniffer as called

    outs = [tmp_path / name for name in ("a.log", "b.hex", "c.jsonl")]
    ran = called("convert", "-", *outs, data=LOG.read_bytes())
    assert ran.status == 0
    assert read(outs[1]) == read(outs[0]) == read(LOG) == read(outs[2])
    assert f"{outs[1]}: bytes in hex have no room for times" in ran.err


def test_bytes_are_converted_whose_protocol_nobody_can_tell(tmp_path: Path, capsys: Capsys) -> None:
    source = tmp_path / "x.bin"
    source.write_bytes(bytes(range(7)))
    ran = within(capsys, "convert", source, tmp_path / "x.hex")
    assert ran.status == 0
    assert (tmp_path / "x.hex").read_text() == "00 01 02 03 04 05 06\n"


def test_decode_writes_the_bytes_beside_what_it_prints(tmp_path: Path, capsys: Capsys) -> None:
    ran = within(capsys, "decode", LOG, "--summary", "-o", tmp_path / "x.log")
    assert ran.status == 0
    assert "18442 bytes" in ran.out
    assert chunks(tmp_path / "x.log") == chunks(LOG)


@pytest.mark.parametrize("suffix", [".log", ".hex", ".csv", ".mcap"])
def test_nothing_is_replaced_that_nobody_asked_to_be(
    suffix: str, tmp_path: Path, capsys: Capsys
) -> None:
    out = tmp_path / f"x{suffix}"
    out.write_text("mine")
    ran = within(capsys, "convert", LOG, out)
    assert (ran.status, out.read_text()) == (2, "mine")
    assert ran.complaint == f"{out} is there already: choose another name, or --force"
    assert within(capsys, "convert", LOG, out, "--force").status == 0
    assert out.stat().st_size > 1000


@pytest.mark.parametrize(
    ("arguments", "told"),
    [
        (
            ("x.txt",),
            "x.txt: the suffix must be one of .jsonl, .csv, .parquet, .mcap, .rrd, .pcapng, .log",
        ),
        (
            ("x.xlsx",),
            "x.xlsx: the suffix must be one of ",
        ),
        (("x.candump",), "x.candump: lines as candump -L writes them are a .log"),
        (("x.csv", "--hold"), "--hold goes with --wide"),
        (("x.log", "--wide"), "--wide is about tables: name a .csv or a .parquet"),
    ],
)
def test_what_cannot_be_converted_says_what_to_do(
    arguments: tuple[str, ...], told: str, capsys: Capsys
) -> None:
    ran = within(capsys, "convert", LOG, *arguments)
    assert ran.status == 2
    assert ran.complaint.startswith(told)


def test_several_buses_do_not_fit_into_raw_bytes_and_spoil_no_other_output(
    tmp_path: Path, capsys: Capsys
) -> None:
    source = tmp_path / "two.log"
    source.write_text("(1.0) a #FF\n(2.0) b #FE\n")
    ran = within(capsys, "convert", source, tmp_path / "x.bin", tmp_path / "x.log")
    assert ran.status == 2
    assert "several buses (a, b)" in ran.complaint
    assert "a .log holds them all" in ran.complaint
    assert chunks(tmp_path / "x.log") == chunks(source)


def test_an_input_that_breaks_off_is_converted_up_to_there(tmp_path: Path, capsys: Capsys) -> None:
    good = [f"({n}.5) bus0 #FFFF\n" for n in range(20)]
    source = tmp_path / "broken.log"
    source.write_text("".join([*good, "(20.5) what is this?\n", *good]))
    ran = within(capsys, "convert", source, tmp_path / "x.log")
    assert ran.status == 3
    assert "line 21" in ran.complaint
    assert (tmp_path / "x.log").read_text() == "".join(good)


# --- without names -----------------------------------------------------------------------------


def recording(path: Path, told: list[Chunk], **facts: str) -> Path:
    sink = McapSink(path, {"tool": "servo-sniffer 0", "source": "/dev/ttyUSB7", **facts})
    for chunk in told:
        sink.raw(chunk.bus, [chunk])
    sink.close()
    return path


def test_a_recording_made_of_a_recording_keeps_what_that_said_of_itself(
    tmp_path: Path, capsys: Capsys
) -> None:
    told = chunks(LOG)
    source = recording(tmp_path / "in.mcap", told, **{"port.bus0": "/dev/ttyUSB7", "baud": "57600"})
    second, third = tmp_path / "second.mcap", tmp_path / "third.mcap"
    assert within(capsys, "convert", source, second).status == 0
    assert within(capsys, "convert", second, third).status == 0
    facts = session(third)
    assert facts["source"] == str(second)
    assert facts["port.bus0"] == "/dev/ttyUSB7"
    assert facts["origin.source"] == "/dev/ttyUSB7"
    assert facts["origin.tool"] == "servo-sniffer 0"


def test_reading_a_source_again_gives_the_same(tmp_path: Path) -> None:
    with open_source(LOG) as source:
        assert list(source) == list(source)


# --- what is played again ------------------------------------------------------------------------


def test_what_is_played_again_is_written_too(tmp_path: Path, capsys: Capsys) -> None:
    outs = [tmp_path / "x.mcap", tmp_path / "x.log"]
    told = ("--speed", "0", "-o", outs[0], "-o", outs[1])
    ran = within(capsys, "replay", LOG, *told)
    assert ran.status == 0
    assert "no frame" in ran.out
    assert read(outs[0]) == read(outs[1]) == read(LOG)
    again = within(capsys, "replay", LOG, *told)
    assert again.status == 2
    assert again.complaint.endswith("is there already: choose another name, or --force")


@pytest.mark.parametrize(
    ("option", "told"),
    [
        ("--loop", "--loop plays the same again: it is written once, without"),
        ("--redecode", "--redecode compares, -o writes: choose one"),
    ],
)
def test_what_is_played_in_another_way_is_not_written(
    option: str, told: str, tmp_path: Path, capsys: Capsys
) -> None:
    ran = within(capsys, "replay", LOG, option, "-o", tmp_path / "x.mcap")
    assert (ran.status, ran.complaint) == (2, told)


@pytest.mark.parametrize("command", ["decode", "replay"])
@pytest.mark.parametrize("suffix", [".log", ".bin", ".hex"])
def test_a_file_of_bytes_has_them_all(
    command: str, suffix: str, tmp_path: Path, capsys: Capsys
) -> None:
    ran = within(capsys, command, LOG, "--to", "1", "-o", tmp_path / f"x{suffix}")
    assert ran.status == 2
    assert ran.complaint == f"a {suffix} has every byte: `sniffer cut` makes one of a part"
    assert not list(tmp_path.iterdir())


def test_an_output_may_be_named_as_other_commands_have_it(
    tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    one, two = tmp_path / "one.hex", tmp_path / "two.bin"
    assert within(capsys, "convert", LOG, one, "-o", two).status == 0
    assert two.read_bytes() == bytes.fromhex(one.read_text())
    none = within(capsys, "convert", LOG)
    assert (none.status, none.out) == (2, "")
    assert "name OUT, a file whose suffix says what to make" in none.err


def test_parts_that_a_shell_put_for_a_pattern_are_not_replaced(
    tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    """``convert run-*.mcap -o all.mcap --force``: the second one was written, not read."""
    first, second = tmp_path / "run-1.mcap", tmp_path / "run-2.mcap"
    for part in (first, second):
        part.write_bytes(b"kept")
    for out in (("-o", tmp_path / "all.mcap"), (tmp_path / "all.csv",)):
        ran = within(capsys, "convert", first, second, *out, "--force")
        assert ran.status == 2
        assert "run-2.mcap would be written, not read; `sniffer merge" in ran.err
        assert "--together reads several as one capture" in ran.err
        assert second.read_bytes() == b"kept"


@pytest.mark.parametrize(
    ("facts", "said"),
    [
        ({}, ""),
        ({"baud.arm": "57600"}, "the bytes do not tell their rate: decode them with --baud 57600"),
        (
            {"baud.arm": "57600", "baud.leg": "115200"},
            "the bytes do not tell their rates (57600 on arm and 115200 on leg): a recording does",
        ),
    ],
)
def test_a_rate_that_a_recording_tells_and_a_log_does_not_is_said(
    facts: dict[str, str], said: str, tmp_path: Path, capsys: Capsys
) -> None:
    told = [Chunk(packet(1, 0xF1), T0, Clock.READ, bus) for bus in ("arm", "leg")]
    source = recording(tmp_path / "in.mcap", told, **facts)
    ran = within(capsys, "convert", source, tmp_path / "x.log")
    assert ran.status == 0
    assert ("do not tell their rate" in ran.err) == bool(said)
    assert said in ran.err


def test_what_a_spreadsheet_reads_is_told_for_a_suffix_of_its_own(capsys: Capsys) -> None:
    complaint = within(capsys, "convert", LOG, "x.xlsx").complaint
    assert complaint.endswith(" .hex: what reads .xlsx reads .csv, too")
    assert within(capsys, "convert", LOG, "x.pcap").complaint.endswith(": did you mean .pcapng?")
