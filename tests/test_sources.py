"""Inputs: what is read gives its bytes back, what is not read says what to do instead."""

from __future__ import annotations

import contextlib
import io
import itertools
import json
import os
import random
import shutil
import subprocess
import sys
import threading
import tracemalloc
import types
from pathlib import Path
from typing import TYPE_CHECKING

import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from sniffer.model import Chunk, Clock, DamagedInputError, Direction, InputError, SnifferError
from sniffer.sources import SOURCES, open_source

if TYPE_CHECKING:
    from collections.abc import Callable, Iterator

SAMPLES = Path(__file__).parent / "data" / "formats"
BUS = (SAMPLES / "bus.bin").read_bytes()


def chunks(text: bytes | Path, input_format: str = "auto") -> list[Chunk]:
    return [chunk for group in open_source(text, input_format) for chunk in group]


def read(text: bytes | Path, input_format: str = "auto") -> bytes:
    return b"".join(chunk.data for chunk in chunks(text, input_format))


def until_damage(text: bytes, input_format: str = "auto") -> tuple[bytes, str]:
    """Return what is read before the damage, and the message."""
    got: list[bytes] = []
    groups = iter(open_source(text, input_format))

    def rest() -> None:
        got.extend(chunk.data for group in groups for chunk in group)

    with pytest.raises(DamagedInputError) as caught:
        rest()
    return b"".join(got), str(caught.value)


def refusal(text: bytes | str | Path, input_format: str = "auto") -> str:
    with pytest.raises(InputError) as caught:
        list(open_source(text, input_format))
    message = str(caught.value)
    assert "\n" not in message
    return message


# --- the tools, and the same in Python where a tool is not installed --------------------------


def shown(data: bytes) -> str:
    return "".join(chr(byte) if 32 <= byte < 127 else "." for byte in data)


def lines_of(data: bytes) -> Iterator[tuple[int, bytes]]:
    return ((at, data[at : at + 16]) for at in range(0, len(data), 16))


def starred(lines: list[tuple[int, bytes]], draw: Callable[[int, bytes], str]) -> list[str]:
    """Leave out lines equal to the one before, as hexdump and od do."""
    out: list[str] = []
    for (_, before), (at, data) in itertools.pairwise([(-1, b""), *lines]):
        if data != before or len(data) < 16:
            out.append(draw(at, data))
        elif out[-1] != "*":
            out.append("*")
    return out


def xxd(data: bytes) -> bytes:
    rows = [f"{at:08x}: {row.hex(' ', -2):<39}  {shown(row)}\n" for at, row in lines_of(data)]
    return "".join(rows).encode()


def hexdump(data: bytes) -> bytes:
    def draw(at: int, row: bytes) -> str:
        return f"{at:08x}  {row[:8].hex(' '):<23}  {row[8:].hex(' '):<23}  |{shown(row)}|"

    rows = starred(list(lines_of(data)), draw)
    return "".join(f"{row}\n" for row in [*rows, f"{len(data):08x}"] if data).encode()


def od(data: bytes) -> bytes:
    rows = starred(list(lines_of(data)), lambda at, row: f"{at:07o} {row.hex(' ')}")
    return "".join(f"{row}\n" for row in [*rows, f"{len(data):07o}"]).encode()


TOOLS: dict[str, tuple[list[str], Callable[[bytes], bytes], str]] = {
    "xxd": (["xxd"], xxd, "xxd.txt"),
    "hexdump": (["hexdump", "-C"], hexdump, "hexdump-C.txt"),
    "od": (["od", "-tx1"], od, "od-tx1.txt"),
}


def rendered(tool: str, data: bytes, *options: str) -> bytes:
    command, ours, _ = TOOLS[tool]
    if shutil.which(command[0]) and data:  # a fork costs: see the stored samples for the rest
        command = [*command[:1], *(options or command[1:])]
        return subprocess.run(command, input=data, capture_output=True, check=True).stdout
    if options:
        pytest.skip(f"{tool} is not installed")
    return ours(data)


@pytest.mark.parametrize("tool", TOOLS)
def test_our_rendering_is_that_of_the_tool(tool: str) -> None:
    _, ours, sample = TOOLS[tool]
    assert ours(BUS) == (SAMPLES / sample).read_bytes()


# bytes as captures have them: runs of one value (idle, stars in dumps) between anything
PAYLOADS = st.lists(
    st.one_of(
        st.binary(max_size=40),
        st.tuples(st.binary(min_size=1, max_size=1), st.integers(0, 100)).map(
            lambda p: p[0] * p[1]
        ),
        st.just(b"|1443..fa af|  >00 <\n0000: 4142 * "),
    ),
    max_size=12,
).map(b"".join)


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
        (["od", "-tu1"], "od -tx1"),
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

ROW = b"00000000  fa af 01 00 1e 02 01 84  03 9b fa af 01 0f 2a 02  |..............*.|\n"


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


# --- plain lists ------------------------------------------------------------------------------


@pytest.mark.parametrize(
    "text",
    [
        "ff 00 0a",
        "FF000A",
        "0xFF,0x00,0x0A",
        "0xFF, 0x0; 0xA;",
        r"\xff\x00\x0a",
        r'"\xff\x00" b"\x0a"',
        "const uint8_t data[3] = {\n  0xFF, 0x00, // header\n  0x0A, /* id */\n};\n",
        "unsigned char a[] = {\n  0xff, 0x00, 0x0a\n};\nunsigned int a_len = 3;\n",
        "# a comment with ff 00\n// another\nff 00 # and one behind\n\n0a\n",
        "ff\tff\r\n".replace("\tff", "\t00") + "0a",
        "  ff;00;\n\n 0a ",
    ],
)
def test_hex_is_read_in_every_spelling(text: str) -> None:
    assert open_source(text.encode()).format == "hex"
    assert read(text.encode()) == b"\xff\x00\x0a"


@given(
    data=st.binary(min_size=1, max_size=200), style=st.sampled_from(["", " ", ", ", "\n", "\\x"])
)
def test_plain_hex_reads_back_equal(data: bytes, style: str) -> None:
    text = "".join(style + f"{byte:02x}" for byte in data).lstrip(", ")
    assert read(text.encode(), "hex") == data


def test_an_odd_number_of_digits_is_told_with_line_and_column() -> None:
    assert "line 2, column 7: 'f0f' has an odd number" in refusal(b"ff 00\nff 00 f0f\n")
    assert "line 1, column 13: 'O0' is not hex" in refusal(b"FF FF FF 00 O0")


def test_garbage_far_down_is_damage_and_what_came_before_is_read() -> None:
    lines = [bytes(range(16)).hex(" ").encode()] * 3000
    lines[999] = b"ff what is this"
    got, message = until_damage(b"\n".join(lines))
    assert got == bytes(range(16)) * 999 + b"\xff"
    assert "line 1000, column 4: 'what' is not hex" in message


@pytest.mark.parametrize("garbage", [b"what", b"\0\xff", b"*" * 70])
@pytest.mark.parametrize("tool", TOOLS)
def test_garbage_far_down_in_a_dump_is_damage_too(tool: str, garbage: bytes) -> None:
    data = random.Random(1).randbytes(40_000)
    lines = TOOLS[tool][1](data).split(b"\n")
    lines[999] = garbage
    got, message = until_damage(b"\n".join(lines))
    assert got == data[: 999 * 16]
    assert "line 1000: " in message


def test_garbage_in_the_first_lines_is_the_wrong_format() -> None:
    assert "line 3" in refusal(ROW + b"00000010" + ROW[8:] + b"hello\n")


def test_an_endless_line_streams() -> None:
    data = random.Random(2).randbytes(500_000)
    for text in (data.hex(), data.hex(" "), "0x" + data.hex(","), "\\x" + data.hex("|")):
        assert read(text.replace(",", ",0x").replace("|", "\\x").encode()) == data


def test_decimal_is_read_only_when_told() -> None:
    assert "--input-format decimal" in refusal(b"255 255 1 4 2 21 1 226")
    assert "--input-format decimal" in refusal(b"{10, 20, 30}")
    for text in (b"255 255 1 4", b"[255, 255,\n 1, 4]", b"255;255;1;4; # four"):
        assert read(text, "decimal") == b"\xff\xff\x01\x04"
    source = open_source(b"10 20", radix="decimal")
    assert [chunk.data for group in source for chunk in group] == [b"\n\x14"]
    assert "line 1, column 5: '256'" in refusal(b"255 256", "decimal")
    assert "'-1'" in refusal(b"1 -1", "decimal")


def test_a_star_without_offsets_cannot_be_counted() -> None:
    assert "dump again with -v" in refusal(b" 00 00\n*\n 01 02\n")


# --- raw bytes that look like text ------------------------------------------------------------


@pytest.mark.parametrize(
    "text",
    [
        b"#5QD\r*5QD1443\r",
        b"#5D1800\r#6D1800T500\r#254L\r",
        b"#5QD\n*5QD1443\n",
        b"#5D1800\n#6D1800\n",
        b"#5QD\r\n*5QD1443\r\n",
        b"43\r#5QD\r*5QD1443\r#5Q",
        b"*5QMSLSS-HS1\r*QID5\r",
        b"#5QD\r",
        BUS,
        b"\xff\xfe\x01\x02 FF FE begins a wCK command, too",
        b"\xff\xff\xff\x00\x02\xf1\x0c",
    ],
)
def test_raw_bytes_stay_raw_even_where_they_are_text(text: bytes) -> None:
    assert open_source(text).format == "bin"
    assert read(text) == text


def test_hex_with_a_command_as_its_comment_is_hex() -> None:
    assert read(b"#5QD\n23 35 51 44 0d\n") == b"#5QD\r"


def test_the_suffix_breaks_the_tie_of_a_few_digits_only(tmp_path: Path) -> None:
    for name, text, data in (
        ("a.bin", b"ab12", b"ab12"),
        ("a.txt", b"ab12", b"\xab\x12"),
        ("b.dat", b"FF FF FF 00 02 F1 0C", b"\xff\xff\xff\x00\x02\xf1\x0c"),
        ("c.raw", b"1500 mV, says the servo", b"1500 mV, says the servo"),
    ):
        (tmp_path / name).write_bytes(text)
        assert read(tmp_path / name) == data


# --- logs with times --------------------------------------------------------------------------


def test_log_lines_keep_time_direction_and_bus_and_not_the_id() -> None:
    text = (
        b"(1795215306.000100) bus0 RX#FAAF\n(1795215306.123456789) bus1 TX#01\r\n"
        b"(1795215307) can0 123#02\n(1795215307.5) can0 00000343##1AABB T\n\n"
        b"(1795215308.1) can0 123#R\n(1795215308.2) can0 20000080#00\nbus0 #fd"
    )
    assert chunks(text) == [
        Chunk(b"\xfa\xaf", 1795215306_000100000, Clock.FILE, "bus0", Direction.RX),
        Chunk(b"\x01", 1795215306_123456789, Clock.FILE, "bus1", Direction.TX),
        Chunk(b"\x02", 1795215307_000000000, Clock.FILE, "can0"),
        Chunk(b"\xaa\xbb", 1795215307_500000000, Clock.FILE, "can0", Direction.TX),
        Chunk(b"\xfd"),
    ]


@given(st.integers(0, 2**63 - 1))
def test_a_time_is_exact_to_the_nanosecond(t_ns: int) -> None:
    text = f"({t_ns // 10**9}.{t_ns % 10**9:09d}) bus0 RX#00\n"
    assert chunks(text.encode())[0].t_ns == t_ns


def test_a_log_that_breaks_off_is_read_as_far_as_it_goes() -> None:
    text = b"(1.5) bus0 RX#FAAF01\n(2.5) bus0 TX#FAAF01"
    for cut in range(1, 20):
        assert b"\xfa\xaf\x01\xfa\xaf\x01".startswith(read(text[:-cut], "candump"))
    damaged = b"(1.5) bus0 RX#FA\n" * 20 + b"(1.5) bus0 RX:FA\n"
    assert until_damage(damaged)[0] == b"\xfa" * 20


def test_own_json_lines_are_the_bus_again() -> None:
    records: list[dict[str, object]] = [
        {"type": "frame", "bus": "a", "t_ns": 7, "offset": 0, "hex": "ff00", "clock": "read"},
        {"type": "sample", "t_ns": 7, "value": 1.5},
        {"type": "gap", "bus": "a", "offset": 2, "hex": "0a", "reason": "noise"},
        {"type": "frame", "bus": "a", "t_ns": 9, "offset": 3, "hex": "0b", "clock": "none"},
        {"type": "frame", "t_ns": 2**62 + 1, "offset": 4, "hex": "0c"},
        {"type": "summary", "bytes": 4},
    ]
    text = "".join(json.dumps(record) + "\n" for record in records)
    assert chunks(text.encode()) == [
        Chunk(b"\xff\x00", 7, Clock.READ, "a"),
        Chunk(b"\x0a", bus="a"),
        Chunk(b"\x0b", bus="a"),
        Chunk(b"\x0c", 2**62 + 1, Clock.FILE),
    ]


def frame(offset: int, data: bytes = b"\xff\xff") -> bytes:
    record = {"type": "frame", "bus": "bus0", "t_ns": 1, "offset": offset, "hex": data.hex()}
    return json.dumps(record).encode() + b"\n"


def test_json_lines_out_of_order_or_damaged_name_the_line() -> None:
    assert "line 3: offset 2 goes back" in until_damage(frame(0) + frame(2) + frame(2))[1]
    assert "line 2" in refusal(frame(0) + b'{"type":"frame","offset":2,"hex":"f"}\n')
    text = b"".join(frame(2 * n) for n in range(20))
    assert until_damage(text + b"garbage\n") == (
        b"\xff" * 40,
        "the given bytes, line 21: 'garbage' is no JSON object with a \"type\"",
    )
    assert read(text[:-5]) == b"\xff" * 38


def test_holes_in_json_lines_are_noted() -> None:
    source = open_source(frame(0) + frame(6))
    assert sum(len(chunk.data) for group in source for chunk in group) == 4
    assert source.notes == ["4 bytes are missing between the records: were gaps filtered out?"]


# --- the stored samples, and what is refused ---------------------------------------------------

READ = {
    "bus.bin": "bin",
    "xxd.txt": "xxd",
    "xxd-p.txt": "hex",
    "hexdump-C.txt": "hexdump",
    "od-tx1.txt": "od",
    "od-Ax-t-x1z.txt": "od",
}
REFUSED = {
    "hexdump.txt": "hexdump -C",
    "jpnevulator.txt": "jpnevulator",
    "pyserial-spy.txt": "pySerial spy",
    "python-can.asc": "candump -L",
    "python-can.csv": "python-can",
    "rtac.pcap": "pcap capture is not read: export",
    "sigrok-ann-samplenum.txt": "sigrok-cli",
    "sigrok-ann.txt": "sigrok-cli",
    "sigrok-csv-dedup.txt": "sigrok-cli",
    "sigrok-json.txt": "sigrok-cli",
    "socat-x-v.txt": "socat",
    "socat-x.txt": "socat",
    "t2p.txt": "text2pcap",
    "wave.sr": "sigrok session",
}


def test_every_stored_sample_is_tested() -> None:
    stored = {path.name for path in SAMPLES.iterdir()} - {"README.md", "candump.log"}
    assert stored == READ.keys() | REFUSED.keys()


@pytest.mark.parametrize("name", READ)
def test_the_stored_sample_is_recognised_by_content_and_read(name: str) -> None:
    data = (SAMPLES / name).read_bytes()
    assert open_source(data).format == READ[name]
    assert open_source(SAMPLES / name).format == READ[name]
    assert read(SAMPLES / name, READ[name]) == BUS == read(data)


def test_the_log_of_another_tool_keeps_its_time() -> None:
    data, t_ns = b"\xfa\xaf\x01\x0f*\x02\x00&", 1732142106_123456000
    assert chunks(SAMPLES / "candump.log") == [Chunk(data, t_ns, Clock.FILE, "can0", Direction.RX)]


@pytest.mark.parametrize("name", REFUSED)
def test_the_stored_sample_is_refused_by_name(name: str) -> None:
    assert REFUSED[name] in refusal(SAMPLES / name)


@pytest.mark.parametrize(
    ("text", "says"),
    [
        (b"\x0a\x0d\x0d\x0a\xcc\0\0\0\x4d\x3c\x2b\x1a", "pcapng"),
        (b"PK\x03\x04" + bytes(30), "zip"),
        (b"RRF2\0\x29\0\0", "Rerun recording"),
        (b"\x1f\x8b\x08\0\0\0", "gunzip"),
        (b"PAR1\x15\x04", "Parquet"),
        ("00000000: faaf".encode("utf-16"), "UTF-8"),
        ("﻿ff ff ff".encode("utf-16-be"), "UTF-8"),
        (b"Time [s],Value,Parity Error,Framing Error\n0.04,0x00,,Error\n", "Saleae"),
        (b'name,type,start_time,duration,"data"\n', "Saleae"),
        (b"Docklight Log File (HEX) - Started 01.03.2019 14:09:26.248 \n", "Docklight"),
        (b"< 0x54 (T)\n> \t0x4b (K)\n", "interceptty"),
        (b"  vcan0  1F0   [8]  80 4A 0F 00 00 00 00 00\n", "candump -L"),
        (b"\x1b[1;32m00000000: \x1b[0m4141  AA\n", "colours"),
        (b"hello world\n", "--input-format bin"),
        (b'{"some": "json"}\n', "--input-format bin"),
        (b"# only\n# comments\n", "--input-format bin"),
        (b"\n\n", "blank"),
        (b"Add more bad\n", "--input-format bin"),
    ],
)
def test_what_is_not_read_is_refused_in_one_line_that_says_what_to_do(
    text: bytes, says: str
) -> None:
    assert says in refusal(text)


def test_files_that_cannot_be_had_are_told_in_one_line(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    assert "no such file" in refusal(tmp_path / "nothing.txt")
    assert "no such file" in refusal(tmp_path / "no\nthing.txt")
    assert "cannot be read" in refusal("no\0thing.txt")
    assert "directory" in refusal(tmp_path)
    assert "choose one of auto, bin" in refusal(b"ff", "hexx")

    def forbidden(*_: object, **__: object) -> None:
        raise PermissionError

    monkeypatch.setattr(Path, "open", forbidden)
    assert "no permission" in refusal(SAMPLES / "xxd.txt")


def test_an_empty_input_is_no_mistake(tmp_path: Path) -> None:
    (tmp_path / "empty.txt").touch()
    source = open_source(tmp_path / "empty.txt")
    assert source.format == "bin"
    assert list(source) == []


@given(st.one_of(st.binary(max_size=300), st.text(max_size=100).map(str.encode)))
def test_no_input_raises_anything_but_our_own_errors(data: bytes) -> None:
    for input_format in ("auto", *SOURCES.keys() - {"mcap"}):
        with contextlib.suppress(SnifferError):
            assert len(read(data, input_format)) <= len(data)


@given(
    data=PAYLOADS, cuts=st.lists(st.tuples(st.integers(0, 2000), st.binary(max_size=3)), max_size=4)
)
def test_a_mangled_dump_raises_nothing_but_our_own_errors(
    data: bytes, cuts: list[tuple[int, bytes]]
) -> None:
    for tool in TOOLS:
        text = TOOLS[tool][1](data)
        for at, garbage in cuts:
            text = text[:at] + garbage + text[at + 1 :]
        with contextlib.suppress(SnifferError):
            for group in itertools.islice(open_source(text, tool), 4):
                assert group


# --- streams -----------------------------------------------------------------------------------


def test_standard_input_is_recognised_without_reading_it_all(
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    class Endless(io.RawIOBase):
        given = 0

        def readable(self) -> bool:
            return True

        def readinto(self, buffer: bytearray) -> int:  # type: ignore[override]
            self.given += len(buffer)
            buffer[:] = b"ff00\n" * (len(buffer) // 5) + b"\n" * (len(buffer) % 5)
            return len(buffer)

    endless = Endless()
    stdin = types.SimpleNamespace(closed=False, buffer=endless)
    monkeypatch.setattr(sys, "stdin", stdin)
    source = open_source("-")
    assert source.format == "hex"
    assert source.describe() == "standard input: plain hex, no times"
    group = next(iter(source))
    assert 250_000 < sum(len(chunk.data) for chunk in group) < 400_000
    assert endless.given < 3_000_000
    with pytest.raises(InputError, match="only once"):
        list(source)


def test_a_pipe_with_a_name_is_read_once_from_its_first_byte(tmp_path: Path) -> None:
    if not hasattr(os, "mkfifo"):
        pytest.skip("no named pipes here")
    pipe = tmp_path / "pipe"
    os.mkfifo(pipe)
    data = xxd(BUS * 5000)
    writer = threading.Thread(target=pipe.write_bytes, args=(data,))
    writer.start()
    assert read(pipe) == BUS * 5000
    writer.join()


def test_a_file_can_be_read_again() -> None:
    with open_source(SAMPLES / "xxd.txt", bus="arm") as source:
        assert list(source) == list(source) == [[Chunk(BUS, bus="arm")]]
        assert source.describe().endswith("xxd.txt: an xxd dump, no times")


def test_groups_hold_many_chunks_and_about_256_kib() -> None:
    line = b"(1.000000001) bus0 RX#" + b"ff" * 64 + b"\n"
    groups = list(open_source(line * 10_000))
    assert [len(group) for group in groups] == [4096, 4096, 1808]
    assert [len(group) for group in open_source(b"(1.5) a RX#ff\n" * 40_000)] == [32768, 7232]


def test_a_recording_is_given_to_the_mcap_source_by_its_path(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    stub = types.ModuleType("sniffer.sources.mcap")
    stub.chunks = lambda path: iter([Chunk(str(path).encode())])  # type: ignore[attr-defined]
    monkeypatch.setitem(sys.modules, stub.__name__, stub)
    monkeypatch.setattr("sniffer.sources.mcap", stub, raising=False)
    path = tmp_path / "run.mcap"
    path.write_bytes(b"\x89MCAP0\r\n")
    assert open_source(path).format == "mcap"
    assert read(path) == str(path).encode()
    assert "save it" in refusal(path.read_bytes())


def test_memory_does_not_grow_with_the_file(tmp_path: Path) -> None:
    once = hexdump(random.Random(3).randbytes(240_000))  # about 1.2 MB of text

    def peak(times: int) -> int:
        path = tmp_path / f"{times}.txt"
        with path.open("wb") as file:
            for _ in range(times):
                file.write(once)
        tracemalloc.start()
        size = sum(len(chunk.data) for group in open_source(path) for chunk in group)
        _, most = tracemalloc.get_traced_memory()
        tracemalloc.stop()
        assert size == 240_000 * times
        return most

    small, large = peak(5), peak(50)
    assert large < 1.25 * small
