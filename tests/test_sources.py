"""Inputs: what is read gives its bytes back, what is not read says what to do instead."""

from __future__ import annotations

import contextlib
import gzip
import itertools
import json
import random
from pathlib import Path

import pytest
from hypothesis import example, given
from hypothesis import strategies as st

from sniffer.ground.model import Chunk, Clock, Direction, SnifferError
from sniffer.sources import SOURCES, open_source
from tests.inputs import (
    BUS,
    PAYLOADS,
    ROW,
    SAMPLES,
    TOOLS,
    chunks,
    read,
    refusal,
    until_damage,
)

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
        "FF:00:0A\n",
        "ff-00-\r\n0a",
        "<FF><00>\n<0A>",
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
    data = random.Random(2).randbytes(600_000)
    for text in (
        data.hex(),
        data.hex(" "),
        "0x" + data.hex(","),
        "\\x" + data.hex("|"),
        data.hex(":"),
    ):
        assert read(text.replace(",", ",0x").replace("|", "\\x").encode()) == data


def test_decimal_is_read_when_told_or_where_nothing_else_fits() -> None:
    for text in (b"255 255 1 4 2 21 1 226", b"{255, 255, 1}", b"# all\n10 20\n" * 20 + b"100"):
        assert open_source(text).format == "decimal"
    assert read(b"255 255 1 4 2 21 1 226") == bytes((255, 255, 1, 4, 2, 21, 1, 226))
    assert "say `input_format='decimal'`" in refusal(b"{10, 20, 30}")
    for text in (b"255 255 1 4", b"[255, 255,\n 1, 4]", b"255;255;1;4; # four"):
        assert read(text, "decimal") == b"\xff\xff\x01\x04"
    assert read(b"10 20", "decimal") == b"\n\x14"
    assert "line 1, column 5: '256'" in refusal(b"255 256", "decimal")
    assert "'-1'" in refusal(b"1 -1", "decimal")


@pytest.mark.parametrize(
    ("text", "format_or_refusal"),
    [
        (b"10 20 30", "hex"),
        (b"10 20 99\n" * 9, "hex"),
        (b"01 02 FF 255", "line 1, column 10: '255' has an odd number"),
        (b"372 257 001 000", "'372' has an odd number"),  # od -An -b
        (b"101 102 177\n001 002", "or hex"),  # octal as well as decimal
        (b"0000000 255 255\n0000002 100 101", "a dump of words"),  # od -tu1, with offsets
        (b"000 255 1 4\n003 7 100", "or hex"),  # three digits of an offset
        (b"1,200\n2,180\n3,170", "or hex"),  # a table
        (b"1 4 2", "odd number"),  # numbers, or hex without zeros in front
        (b"256 255 1", "odd number"),
        (b"255 1 4\n0007 100", "odd number"),  # no byte has four digits
    ],
)
def test_decimal_is_never_guessed(text: bytes, format_or_refusal: str) -> None:
    if format_or_refusal == "hex":
        assert open_source(text).format == "hex"
    else:
        assert format_or_refusal in refusal(text)


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


# --- our own lines ----------------------------------------------------------------------------


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
    "jpnevulator.txt": "jpnevulator",
    "socat-x-v.txt": "socat",
    "docklight-hex.txt": "docklight",
    "interceptty.txt": "interceptty",
    "interceptty-T.txt": "interceptty",
    "interceptty-T-e.txt": "interceptty",
    "interceptty-nicedump.txt": "interceptty",
    "grabserial-T-t.txt": "grabserial",
    "sigrok-csv-dedup.txt": "logic-csv",
    "wave.sr": "sr",
}
REFUSED = {
    "hexdump.txt": "hexdump -C",
    "python-can.asc": "candump -L",
    "python-can.csv": "python-can",
    "sigrok-ann-samplenum.txt": "sigrok-cli",
    "sigrok-ann.txt": "sigrok-cli",
    "sigrok-json.txt": "sigrok-cli",
    "t2p.txt": "text2pcap",
}


def test_every_stored_sample_is_tested() -> None:
    parts = {"README.md", "candump.log", "pyserial-spy.txt", "rtac.pcap", "socat-x.txt"}
    stored = {path.name for path in SAMPLES.iterdir()} - parts
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
        (b"\x34\xcd\xb2\xa1\x02\0\x04\0" + bytes(16), "`editcap -F pcapng FILE new.pcapng`"),
        (b"PK\x03\x04" + bytes(30), "zip"),
        (b"run.log".ljust(257, b"\0") + b"ustar\x0000" + bytes(248), "tar archive"),
        (b"RRF2\0\x29\0\0", "Rerun recording"),
        (b"\x1f\x8b\x08\0\0\0", "cut off before anything is in it"),
        (gzip.compress(gzip.compress(b"ff ff", mtime=0), mtime=0), "gunzip"),
        (b"PAR1\x15\x04", "Parquet"),
        ("00000000: faaf".encode("utf-16"), "UTF-8"),
        ("﻿ff ff ff".encode("utf-16-be"), "UTF-8"),
        (b"Time [s],Value,Parity Error,Framing Error\n0.04,h,,\n", "radix Hexadecimal"),
        (b'name,type,start_time,duration,"data"\n"A","data",1.0,0.1,"5"\n', "radix Hexa"),
        (b"Time [s],Packet ID,Address,Data,Framing Error\n0.04,0,0x01,0x02,\n", "MP mode"),
        (b"> 2026/11/20 22:55:17.000158  length=2 from=0 to=1\nOK", "socat -x"),
        (b"Docklight Log File (ASCII) - Started 01.03.2019 14:09:26.248 \n", "representation HEX"),
        (b"01.03.2019 14:09:28.633 [TX] - EVT0<CR>\n", "representation HEX"),
        (b"<html>\n<title>Docklight Log File (HEX) - Started 2/21/2007</title>", "plain text"),
        (b"[0.000001 0.000001] FF FF 01 > ..\n", "`--hex-output` alone"),
        (b"  vcan0  1F0   [8]  80 4A 0F 00 00 00 00 00\n", "candump -L"),
        (b"\x1b[1;32m00000000: \x1b[0m4141  AA\n", "colours"),
        ("00000000: faaf 0100 1e02\n".encode("utf-16-le"), "UTF-8"),
        ("00000000: faaf 0100 1e02\n".encode("utf-16-be"), "UTF-8"),
        (b"11111111 00000001\n00000100\n", "write the bytes in hex"),
        (b"FF FF 01\n12:30:59\nFF 00\n", "'12:30:59' is not hex"),  # it may be a time
        (b"26-11-20\nFF 00\n", "'26-11-20' is not hex"),
        (b"libsigrok 0.5.2\nAcquisition with 1/1 channels\n", "-o wave.sr"),
        (b";Rate: 1000000\n;Channels: 1\n", "VCD"),
        (b'1795215306.001562 write(3, "\\xff\\xff", 2) = 2\n', "socat -x"),
        (b'[pid  77] read(3, "\\377", 1) = 1\n', "socat -x"),
        (b"2026-11-20 22:55:06.001 FF FF 01 4\n", "write each byte with two"),
        (b"22:55:06 FF FF 01 04\n", "(seconds.fraction) bus0 #HEX"),
        (b"P10:55:06.001A FF FF 01\n", "(seconds.fraction) bus0 #HEX"),
        (b"TX: 255 255 1 400\n", "this is text, but no dump"),
        (b"TX: [16, 32, 10]\n", "(seconds.fraction) bus0 #HEX"),
        (b"TX: FF FF 01 04\nFF FF 01 04\n", "(seconds.fraction) bus0 #HEX"),
        (b"hello world\n", "say `input_format='bin'`"),
        (b'{"some": "json"}\n', "say `input_format='bin'`"),
        (b"# only\n# comments\n", "say `input_format='bin'`"),
        (b"\n\n", "blank"),
        (b"Add more bad\n", "say `input_format='bin'`"),
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


@example(b"\x00\r\x00")
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
