"""Logs of Docklight, interceptty and grabserial: what is particular to each."""

from __future__ import annotations

from itertools import pairwise

import pytest

from sniffer.ground.model import NS, Direction, Mark, MarkKind
from sniffer.sources import open_source
from tests.inputs import SAMPLES, chunks, notes, read, refusal, until_damage

TX, RX = Direction.TX, Direction.RX


# --- Docklight --------------------------------------------------------------------------------

LINE = b"%s 14:09:28.633 [TX] - FF FF \n"


def test_a_comment_of_docklight_is_no_byte_even_if_it_looks_like_one() -> None:
    log = LINE % b"01.03.2019" + b" AB CD\n" + LINE % b"01.03.2019" + b"\n"
    log = log.replace(b"FF FF \n", b"FF FF  AB CD\n")
    assert read(log) == b"\xff" * 4
    assert "1 line of comments: left out" in notes(log)


def test_bytes_that_docklight_breaks_into_lines_belong_to_the_line_before() -> None:
    assert read(LINE % b"01.03.2019" + b"01 02 03 \n") == b"\xff\xff\x01\x02\x03"


@pytest.mark.parametrize(
    ("day", "further", "is_month_first"),
    [
        (b"01.03.2019", b"", False),
        (b"2019-03-01", b"", False),
        (b"3/1/2019", b"", True),
        (b"1/3/2019", LINE % b"13/3/2019", False),
        (b"3/1/19", LINE % b"3/13/19", True),
    ],
)
def test_a_date_of_docklight_is_read_as_windows_wrote_it(
    day: bytes, further: bytes, is_month_first: bool
) -> None:
    log = LINE % day + further
    assert chunks(log)[0].t_ns == 1_551_449_368_633_000_000
    assert ("month first" in notes(log)) == is_month_first


@pytest.mark.parametrize(
    ("time", "hour"),
    [(b"12:09:28.633 AM", 0), (b"2:09:28,633 PM", 14), (b"12:09:28.633 p.m.", 12)],
)
def test_a_time_of_docklight_may_be_of_half_a_day(time: bytes, hour: int) -> None:
    log = (LINE % b"3/1/2019").replace(b"14:09:28.633", time)
    assert chunks(log)[0].t_ns == 1_551_449_368_633_000_000 + (hour - 14) * 3600 * NS
    assert "no time" in refusal(log.replace(time, b"14:09:28.633 PM"))


def test_a_line_of_docklight_with_a_time_of_another_kind_is_no_comment() -> None:
    log = b"Docklight Log File (HEX) - Started 1.3.2019 14:09:26 \n"
    odd = b"Fr 1 Mrz 14:09:28.633 [TX] - FF FF \n"
    assert "no line of a Docklight log" in refusal(log + odd)
    assert until_damage(log + (LINE % b"01.03.2019") * 9 + odd)[0] == b"\xff\xff" * 9


@pytest.mark.parametrize(("stamp", "unsure_ns"), [(b"", NS), (b".248", NS // 1000)])
def test_a_time_of_docklight_is_as_uncertain_as_its_last_digit(
    stamp: bytes, unsure_ns: int
) -> None:
    log = b"01.03.2019 14:09:26%b [TX] - FA AF\n" % stamp
    first, rest = chunks(log, "docklight")
    assert first.marks == (Mark(MarkKind.COARSE, 0, 1, unsure_ns),)
    assert rest.marks == ()


def test_a_log_of_docklight_may_call_its_channels_anything_but_has_two() -> None:
    log = b"".join((LINE % b"01.03.2019").replace(b"TX", name) for name in (b"COM1", b"COM 2"))
    assert read(log) == b"\xff" * 4
    assert "COM1 or COM 2" in notes(log)
    got, message = until_damage(log * 5 + (LINE % b"01.03.2019").replace(b"TX", b"x"))
    assert (got, "third channel" in message) == (b"\xff" * 20, True)


def test_a_log_in_ascii_behind_one_in_hex_is_damage() -> None:
    log = LINE % b"01.03.2019" + b"Docklight Log File (ASCII) - Started 01.03.2019 14:09:26.248 \n"
    got, message = until_damage(log)
    assert got == b"\xff\xff"
    assert "representation HEX" in message


# --- interceptty ------------------------------------------------------------------------------


def test_a_buffer_of_interceptty_is_a_chunk_with_its_time_and_side() -> None:
    got = chunks(SAMPLES / "interceptty-T.txt")
    assert [len(c.data) for c in got] == [10, 8, 10, 5, 9]
    assert [c.direction for c in got] == [TX, TX, RX, TX, RX]
    assert [any(m.kind == MarkKind.SENT for m in c.marks) for c in got] == [1, 1, 0, 1, 0]
    assert got[0].t_ns == ((20 * 60 + 17) * 60 + 44) * NS + 673_730_000  # [20:17 44.673730]
    assert all(
        a.t_ns is not None and b.t_ns is not None and a.t_ns < b.t_ns for a, b in pairwise(got)
    )


def test_signs_in_brackets_are_no_bytes() -> None:
    log = b"< 28(():29()):3a(:):27('):20(' '):5b([):0d([CR])\n< 30(0)\n> \t61(a)\n"
    assert read(log) == b"():' [\r0a"
    assert read(b"< 0x28 (()\n< 0x29 ())\n> \t0x0d ([CR])\n> \t0xff (\xff)\n") == b"()\r\xff"


def test_a_time_of_the_day_that_goes_far_back_is_of_the_next_day() -> None:
    line = b"[%s.000001]< 0x01\n"
    got = chunks(line % b"23:59 59" + line % b"00:00 01")
    assert [(c.t_ns or 0) // NS for c in got] == [86_399, 86_401]
    got = chunks(b"[23:59:59.000001 0.100000] 01 \n[00:00:01.000001 2.000000] 02 \n")
    assert [(c.t_ns or 0) // NS for c in got] == [86_399, 86_401]
    assert "there is no time '24:00:01'" in refusal(line % b"24:00 01")


# --- grabserial -------------------------------------------------------------------------------


@pytest.mark.parametrize(
    ("stamp", "t_ns"),
    [
        (b"[1.000002 0.000001]", 1_000_002_000),
        (b"[1.000002]", 1_000_002_000),
        (b"[-1.000002 -0.000001]", -1_000_002_000),
        (b"[00:00:01.000002 0.000001]", 1_000_002_000),
        (b"[00:00:01.000002]", 1_000_002_000),
        (b"[00:00:01.000002 7.000000 0.000001]", 1_000_002_000),
        (b"[1970-01-01 00:00:01.000002]", 1_000_002_000),
    ],
)
def test_a_row_of_grabserial_has_the_time_of_its_first_byte(stamp: bytes, t_ns: int) -> None:
    got = chunks(stamp + b" FF FF 01 \n")
    assert [(c.t_ns, c.data) for c in got] == [(t_ns, b"\xff"), (None, b"\xff\x01")]


def test_a_label_of_grabserial_is_a_bus_and_what_it_says_itself_is_left_out() -> None:
    log = b"left arm [1.000002] FF \nThe inlinepat: was matched\n[1.000003] 01 \n"
    assert [(c.bus, c.data) for c in chunks(log)] == [("left arm", b"\xff"), ("bus0", b"\x01")]
    assert "1 line between its rows is none of grabserial's" in notes(log)


@pytest.mark.parametrize("name", ["interceptty-T.txt", "grabserial-T-t.txt"])
def test_whatever_is_odd_about_a_log_is_told_in_two_notes(name: str) -> None:
    log = (SAMPLES / name).read_bytes()[:-1]
    lines = log.splitlines(keepends=True)
    log = b"".join([*lines[:2], b"hello\n", *lines[2:]]).rstrip() + b"\n" + lines[0][:9]
    source = open_source(log)
    list(source)
    assert len([note for note in source.notes if "controller" not in note]) == 2
