"""Text whose every digit is one of hex, and that is no hex: never read wrong, always told.

Written as the programs named here write it: coreutils' od and cat, Arduino's Serial.print,
CPython's repr, PuTTY's log.
"""

from __future__ import annotations

from typing import TYPE_CHECKING

import pytest

from sniffer.sources import open_source
from tests.inputs import read, refusal

if TYPE_CHECKING:
    from pathlib import Path

FRAMES = [
    bytes.fromhex(frame)
    for frame in ("FFFFFF0102F10B", "FFFFFF010200FC", "FFA00020", "0069", "FAAF010300000103")
]
LSS = b"#1QMS\r*1QMSLSS-ST1\r#1QN\r*1QN12345671\r#1QF\r*1QF368\r#2QMS\r"


def lines_of(form: str) -> bytes:
    """Return a line for each frame; ``n``, ``ms``, ``size`` and ``s`` may stand beside its hex."""
    return "".join(
        form.format(n=n, ms=1000 + 7 * n, size=len(data), s=1795215306, hex=data.hex(" ")) + "\n"
        for n, data in enumerate(FRAMES)
    ).encode()


@pytest.mark.parametrize(
    ("form", "column"),
    [
        ("{n:02d}  {hex}", "line numbers"),
        ("{n:6d}\t{hex}", "line numbers"),  # cat -n
        ("{n}:{hex}", "line numbers"),  # grep -n
        ("{size:02d} {hex}", "lengths"),
        ("[{size}] {hex}", "lengths"),
        ("{size:02X} {hex}", "lengths"),
        ("{ms} {hex}", "times"),  # millis()
        ("{ms},{hex}", "times"),
        ("{s} {hex}", "times"),  # time(NULL)
    ],
)
def test_a_column_before_the_bytes_is_never_read_as_bytes(form: str, column: str) -> None:
    assert f"behind a column of {column} is not read: keep only" in refusal(lines_of(form))


@pytest.mark.parametrize("form", ["{hex}", "0{n}", "FFFFFF {hex}", "12 {hex}", "0102 {hex}"])
def test_bytes_that_stand_first_in_each_line_are_no_column(form: str) -> None:
    text = lines_of(form)
    assert read(text) == bytes.fromhex(text.decode())


def rows_of(size: int, form: str, data: bytes) -> bytes:
    """Return a line for each row of a dump."""
    rows = [data[at : at + size] for at in range(0, len(data), size)]
    return "".join(form.format(size=len(row), hex=row.hex(" ")) + "\n" for row in rows).encode()


@pytest.mark.parametrize("size", [8, 16, 32])
@pytest.mark.parametrize(
    ("form", "column"), [("{size:02x} {hex}", "lengths"), ("01 {hex}", "numbers that are all 01")]
)
def test_a_column_that_says_the_same_in_all_rows_of_a_dump_is_no_byte(
    size: int, form: str, column: str
) -> None:
    text = rows_of(size, form, b"".join(FRAMES) * 15)
    assert f"behind a column of {column} is not read: keep only" in refusal(text)


def test_frames_of_one_length_a_line_are_bytes_although_all_begin_alike() -> None:
    answers = [bytes.fromhex("FFFFFF010A00") + bytes(range(n, n + 11)) for n in range(20)]
    text = "\n".join(answer.hex(" ") for answer in answers)
    assert read(text.encode()) == b"".join(answers)


def test_decimal_numbers_of_two_digits_are_asked_about_where_no_bus_speaks_so_in_hex() -> None:
    for between in (" ", ",", "\n", "  "):
        text = between.join(map(str, LSS)).encode()
        assert "looks like decimal numbers: say" in refusal(text)
        assert read(text, "decimal") == LSS


def test_a_dump_in_decimal_is_told_by_its_wide_columns() -> None:
    rows = [LSS[at : at + 16] for at in range(0, len(LSS), 16)]
    text = "".join(
        f"{16 * n:07o}" + "".join(f" {value:3d}" for value in row) + "\n"
        for n, row in enumerate(rows)
    )
    told = "a dump in decimal (od -tu1) is not read: dump it again with"
    assert told in refusal(text.encode())
    assert told in refusal(b"0000000 255 255   1\n0000003 241  11 250\n")


def test_numbers_in_binary_are_no_hex() -> None:
    text = " ".join(f"0b{value:08b}" for value in FRAMES[0])
    assert "a list of bits is not read" in refusal(text.encode())


@pytest.mark.parametrize("data", [LSS, b"\xff\xa0\x00 ", b"\x0012\\'", b"\"\x01ab'", b"\xff\t\n"])
def test_bytes_as_python_shows_them_are_read_with_what_is_printable(data: bytes) -> None:
    assert read(f"{data!r}\n".encode()) == data
    assert read(f"{[data, FRAMES[0]]!r}\n".encode()) == data + FRAMES[0]


def test_byte_arrays_of_python_are_read_as_its_bytes_are() -> None:
    log = "".join(f"{bytearray(data)!r}\n" for data in FRAMES).encode()
    assert read(log) == b"".join(FRAMES)
    assert read(b"bytearray(b'fffffff0')\nbytearray(b'01')\n") == bytes.fromhex("fffffff001")


def test_bytes_of_python_that_break_off_are_damage() -> None:
    text = b"b'\\xff\\x00'\nb'\\xff\\xa0\\x00 \n"
    assert "line 2, column 1: bytes in quotes that do not end on this line" in refusal(text)


def test_bytes_of_python_behind_other_words_are_told_how_to_be_logged() -> None:
    log = "".join(f"got {data!r}\n" for data in FRAMES).encode()
    assert "bytes as Python shows them is not read: print `f'({time.time()" in refusal(log)


def test_the_line_that_putty_writes_first_is_no_traffic() -> None:
    log = b"=~=~=~=~=~=~=~=~=~=~=~= PuTTY log 2026.11.20 22:55:06 =~=~=~=~=~=~=~=~=~=~=~=\r\n"
    assert "`tail -n +2 FILE" in refusal(log + b"".join(FRAMES))
    assert open_source(FRAMES[0]).format == "bin"


@pytest.mark.parametrize(
    ("line", "instead"),
    [
        (":0700000001020304050607DD", "objcopy -I ihex"),
        ("S1070000FFA00020B9", "objcopy -I srec"),
        ("Id,Time[ns],1:UART: RX/TX\n1,173600.00,FF", "open the capture (.dsl)"),
        ("Time [s],Decoded Protocol Result\n0.000173600,0xFF", "(seconds.fraction)"),
        ("Index,Time (s),Type,Data\n0,0.001216000,UART,hFF", "(seconds.fraction)"),
        ("0.001216,FF\n0.001390,A0", "(seconds.fraction)"),
        ("1216-1355 UART: RX data: FF\n1390-1529 UART: RX data: A0", "sigrok-cli"),
        ("0\t0.00121600\tservo.exe\tIRP_MJ_WRITE\tSerial0\tSUCCESS\tLength 2: FF A0", "HEX"),
        ("Offset(h) 00 01 02\n\n00000000  FF A0 00  ...", "dump with `xxd`"),
        ("ffff88812ac9f000 3575914555 S Bo:1:009:2 -115 4 = ffa00020", "dumpcap -i usbmon1"),
    ],
)
def test_what_other_programs_write_is_refused_with_the_way_out(line: str, instead: str) -> None:
    assert instead in refusal(line.encode() + b"\n")


@pytest.mark.parametrize("after_offset", [2, 3])
def test_what_wireshark_copies_as_hex_and_ascii_is_a_dump(after_offset: int) -> None:
    data = LSS + b"".join(FRAMES)
    rows = [(at, data[at : at + 16]) for at in range(0, len(data), 16)]
    text = "".join(
        f"{at:04x}{'':{after_offset}}{row.hex(' '):<47}   "
        + "".join(chr(c) if 32 <= c < 127 else "." for c in row)
        + "\n"
        for at, row in rows
    ).encode()
    assert open_source(text).format == "hexdump"
    assert read(text) == data


@pytest.mark.parametrize("between", [" ", "  ", "\t", " |", " ; "])
@pytest.mark.parametrize("data", [b"".join(FRAMES) + LSS, b"12345678" * 2])
def test_bytes_once_more_as_text_are_never_read_as_bytes(data: bytes, between: str) -> None:
    rows = [data[at : at + 8] for at in range(0, len(data), 8)]
    shown = ["".join(chr(c) if 32 <= c < 127 else "." for c in row) for row in rows]
    text = "".join(f"{r.hex(' '):<23}{between}{s}\n" for r, s in zip(rows, shown, strict=True))
    assert "once more as text is not read: keep only the hex: `cut -c1-23" in refusal(text.encode())
    assert read("".join(line[:23] + "\n" for line in text.splitlines()).encode()) == data


@pytest.mark.parametrize(
    ("line", "instead"),
    [
        ("0x7ffe1000:\t0xff\t0xa0\t0x00\t0x20", "dump binary memory"),
        ("0x20000100 <buf+8>:\t0xff\t0xa0", "dump binary memory"),
        ("\t0x0000:  ffa0 0020                                ...", "tcpdump -w"),
        ("10:00:00.000001 IP 10.0.0.1.5000 > 10.0.0.2.5001: UDP, length 4", "tcpdump -w"),
        (" | 00000  ff a0 00 20                   ...              |", "socat -x"),
        ("Nov 24 10:00:00 robot servod[812]: TX ff a0 00 20", "journalctl -o cat"),
        ("Nov 24 10:00:00 00000000  ff a0 00 20  |... |", "(seconds.fraction)"),
        ("1795215306.000100 00000000: ffa0 0020  ... ", "(seconds.fraction)"),
        ("Nov 24 10:00:00 00000000: ffa0 0020  ... ", "(seconds.fraction)"),
        (" (2026-11-24 10:00:00.000001)  can0  123   [2]  FF A0", "candump -L"),
        ("Host -->  0xFF 0xA0 0x00 0x20", "(seconds.fraction)"),
        ("let d: [u8; 2] = [0xff, 0xa0];", "brackets"),
        ("[]byte{0xff, 0xa0}", "brackets"),
        ("<Buffer ff a0 00 20>", "brackets"),
        ("FFh A0h 00h 20h", "tr -d"),
        ("```text\nFF A0 00 20\n```", "grep -v"),
        ("%FF%A0%00%20", "tr -d"),
        ("start_time,name,data\n0.001,UART,0xFF", "start_time, duration, data"),
        ("FF A0 0 20", "write each byte with two"),
        ("IzFRTVMNKjFRTVNMU1MtU1QxDSMxUU4NKjFRTjEy", "base64 -d"),
    ],
)
def test_what_terminals_and_debuggers_show_is_refused_with_the_way_out(
    line: str, instead: str
) -> None:
    assert instead in refusal(line.encode() + b"\n")


@pytest.mark.parametrize(
    ("head", "instead"),
    [
        ("microseconds,logic,logic\n1,1,1\n2,1,1", "-o wave.sr"),
        ("# CSV generated by libsigrok 0.5.2\n# Samplerate: 1 MHz\nlogic\n1", "-o wave.sr"),
        ("Time,0,1,2,3\n-0.000000250,1,1,1,1", "value change dump (VCD)"),
        ("Times;CH1 MOSI;CH2 CLK\n0 ns;1;1\n4.860 530 ms;1;0", "value change dump (VCD)"),
        ("Time [s],Channel 1\n-0.000004508,2.499", "value change dump (VCD)"),
        ("x-axis,1,2\nsecond,Volt,Volt\n-1.0E-03,-249.9E-06,+31.5E-03", "a logic analyser"),
        ("Model,MDO4104C\nFirmware Version,1.10\n", "a logic analyser"),
        ("X,CH1,Start,Increment\nSequence,VOLT,-6.0e-04,1.0e-06", "a logic analyser"),
    ],
)
def test_tables_of_analysers_and_oscilloscopes_are_refused_with_the_way_out(
    head: str, instead: str
) -> None:
    assert instead in refusal(f"{head}\n".encode())


@pytest.mark.parametrize(
    ("begin", "instead"),
    [
        (b"\x7f\x01\x05\x01\x09Data save\x03\0", "in Logic 1, export the data as VCD"),
        (b"\x16\0\0\0serialization::archive\x05\0", "in Logic 1, export the data as VCD"),
        (b"RIFF\x1c\x20\x02\0WAVEfmt ", "a logic analyser"),
        (b":WFMPRE:NR_PT 100000;:WFMPRE:BYT_N 2", "a logic analyser"),
        (b"AGILENT_BINARY_DATA\nHEADER_BEGIN\n", "value change dump (VCD)"),
        (b"PK\x03\x04" + bytes(22) + b"\x0c\0\0\0analog-0.bin\xff", "Export raw data"),
    ],
)
def test_captures_of_instruments_are_never_read_as_bytes_of_a_bus(
    begin: bytes, instead: str
) -> None:
    assert instead in refusal(begin + bytes(64))


def test_a_session_of_logic_2_is_told_by_its_suffix(tmp_path: Path) -> None:
    path = tmp_path / "run.sal"
    path.write_bytes(b"PK\x03\x04" + bytes(60))
    assert "Export raw data gives CSV or binary" in refusal(path)
