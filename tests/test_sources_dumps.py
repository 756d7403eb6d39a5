"""Dumps of hexdump, xxd and od: read back equal, with their repeats, gutters and offsets."""

from __future__ import annotations

import random
import shutil
import subprocess

import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from sniffer.sources import open_source
from tests.inputs import (
    BUS,
    PAYLOADS,
    ROW,
    SAMPLES,
    TOOLS,
    hexdump,
    read,
    refusal,
    rendered,
    until_damage,
    xxd,
)


@pytest.mark.parametrize("tool", TOOLS)
def test_our_rendering_is_that_of_the_tool(tool: str) -> None:
    _, ours, sample = TOOLS[tool]
    assert ours(BUS) == (SAMPLES / sample).read_bytes()


@pytest.mark.parametrize("tool", TOOLS)
@settings(max_examples=40)
@given(data=PAYLOADS)
def test_what_a_tool_dumps_reads_back_equal(tool: str, data: bytes) -> None:
    assert read(rendered(tool, data), tool) == data


@pytest.mark.parametrize("tool", TOOLS)
@given(data=PAYLOADS.filter(bool), mixed=st.booleans(), crlf=st.booleans(), bom=st.booleans())
def test_case_line_ends_and_byte_order_mark_do_not_matter(
    tool: str, data: bytes, mixed: bool, crlf: bool, bom: bool
) -> None:
    text = TOOLS[tool][1](data)
    if mixed and tool != "xxd":  # its gutter is compared with the bytes, to find xxd -e
        text = text.upper()
    if crlf:
        text = text.replace(b"\n", b"\r\n")
    assert read(b"\xef\xbb\xbf" * bom + text) == data


@pytest.mark.parametrize("tool", TOOLS)
@given(data=PAYLOADS.filter(bool), cut=st.integers(1, 200))
def test_a_dump_that_breaks_off_anywhere_gives_a_prefix(tool: str, data: bytes, cut: int) -> None:
    text = TOOLS[tool][1](data)
    assert data.startswith(read(text[: max(12, len(text) - cut)], tool))  # one byte is there


@pytest.mark.parametrize("tool", TOOLS)
@given(data=st.binary(min_size=100, max_size=400), lost=st.integers(1, 4))
def test_a_dump_that_lost_a_line_gives_what_came_before_and_names_the_line(
    tool: str, data: bytes, lost: int
) -> None:
    lines = TOOLS[tool][1](data).splitlines(keepends=True)
    got, message = until_damage(b"".join(lines[:lost] + lines[lost + 1 :]), tool)
    assert got == data[: 16 * lost]
    assert f"line {lost + 1}: " in message
    assert "skips" in message


@pytest.mark.parametrize(
    ("tool", "options"),
    [
        ("xxd", ["-g1"]),
        ("xxd", ["-g4"]),
        ("xxd", ["-g8", "-c24"]),
        ("xxd", ["-u", "-c5"]),
        ("xxd", ["-a"]),
        ("xxd", ["-d"]),
        ("xxd", ["-p"]),
        ("xxd", ["-i"]),
        ("hexdump", ["-C", "-v"]),
        ("od", ["-tx1z", "-Ax"]),
        ("od", ["-tx1z", "-Ad", "-w7"]),
        ("od", ["-tx1", "-Ad", "-w8"]),
        ("od", ["-tx1", "-An", "-v"]),
        ("od", ["-tx1z", "-An", "-v"]),
    ],
)
def test_the_usual_options_of_the_tools_are_read(tool: str, options: list[str]) -> None:
    data = BUS + bytes(300) + random.Random(5).randbytes(3000) + b"tail"
    text = rendered(tool, data, *options)
    assert read(text) == data


@pytest.mark.parametrize("radix", ["-Ao", "-Ad", "-Ax"])
def test_the_radix_of_od_is_found_although_the_dump_begins_with_repeats(radix: str) -> None:
    data = bytes(160) + BUS * 2
    assert read(rendered("od", data, radix, "-tx1")) == data


@pytest.mark.parametrize(
    ("options", "what"),
    [
        (["hexdump"], "hexdump -C"),
        (["hexdump", "-x"], "hexdump -C"),
        (["hexdump", "-b"], "hexdump -C"),
        (["hexdump", "-c"], "hexdump -C"),
        (["od"], "od -tx1"),
        (["od", "-x"], "od -tx1"),
        (["od", "-Ax", "-x"], "od -tx1"),
        (["od", "-td1"], "od -tx1"),
        (["od", "-tu1"], "decimal (od -tu1)"),
        (["od", "-Ax", "-tu1"], "decimal (od -tu1)"),
        (["od", "-tx1c"], "od -tx1"),
        (["od", "-Ax", "-tx1", "-tx2"], "od -tx1"),
        (["xxd", "-e"], "little-endian"),
        (["xxd", "-e", "-g2"], "little-endian"),
        (["xxd", "-b"], "bits"),
    ],
)
def test_a_dump_of_anything_but_bytes_is_refused_and_told_apart(
    options: list[str], what: str
) -> None:
    if not shutil.which(options[0]):
        pytest.skip(f"{options[0]} is not installed")
    text = subprocess.run(options, input=BUS + bytes(64), capture_output=True, check=True).stdout
    assert what in refusal(text)


# --- offsets ----------------------------------------------------------------------------------


def test_a_gutter_that_looks_like_hex_is_not_read() -> None:
    assert (
        read(b"00000000  31 34 34 33 20 20 61 62                           |1443  ab|\n")
        == b"1443  ab"
    )
    assert read(b"00000000: 3134 3433 2020 6162                      1443  ab\n") == b"1443  ab"


def test_an_offset_that_claims_terabytes_of_repeats_is_damage_and_costs_nothing() -> None:
    got, message = until_damage(ROW + b"*\n" + b"a0000000000" + ROW[8:])
    assert got == bytes.fromhex(ROW[10:58].decode())
    assert "line 3" in message
    assert "not credible" in message


def test_repeats_are_counted_by_the_closing_offset_even_in_mid_line() -> None:
    assert len(read(ROW + b"*\n00000205\n")) == 0x205


def test_repeats_that_do_not_fit_the_next_offset_are_damage() -> None:
    assert "does not fit" in until_damage(ROW + b"*\n00000035" + ROW[8:])[1]


def test_an_offset_that_goes_back_is_damage() -> None:
    text = ROW + b"00000010" + ROW[8:] + b"00000010" + ROW[8:]
    got, message = until_damage(text)
    assert len(got) == 32
    assert "line 3: offset 00000010 goes back 16 bytes" in message


def test_dumps_one_behind_the_other_are_one_stream_with_a_note() -> None:
    source = open_source(hexdump(BUS) * 3)
    assert b"".join(chunk.data for group in source for chunk in group) == BUS * 3
    assert source.notes == ["3 dumps, one behind the other, are read as one stream"]


def test_a_dump_with_tabs_or_indented_as_in_a_web_page_is_read() -> None:
    assert read(b"00000000:\tfaaf 010f\t....\n") == b"\xfa\xaf\x01\x0f"
    assert read(b"".join(b"    " + line for line in hexdump(BUS).splitlines(keepends=True))) == BUS


def test_dumps_of_other_makes_are_read() -> None:
    tshark = b"0000  fa af 01 0f 2a 02 00 26                           ....*..&\n\n"
    assert read(tshark + tshark) == b"\xfa\xaf\x01\x0f*\x02\x00&" * 2
    bsd = b"0000000    fa  af  01  0f  2a  02  00  26                        \n0000010\n"
    assert read(bsd) == b"\xfa\xaf\x01\x0f*\x02\x00&"


def test_what_stands_before_a_dump_is_pointed_at() -> None:
    assert "remove the lines before it" in refusal(b"$ xxd bus.bin\n" + xxd(BUS))
