"""Logs that people and programs of their own write: bytes behind a time, a direction, or both."""

from __future__ import annotations

import tomllib
from typing import TYPE_CHECKING, Any

import pytest
from hypothesis import given
from hypothesis import strategies as st

from sniffer.ground.model import MS, NS, Chunk, Direction, Mark, MarkKind
from sniffer.sources import open_source
from sniffer.sources.labelled import LabelledLog
from sniffer.sources.text import LineBlock
from tests.inputs import SAMPLES, chunks, notes, read, refusal, until_damage

if TYPE_CHECKING:
    from collections.abc import Callable

TX, RX, UNKNOWN = Direction.TX, Direction.RX, Direction.UNKNOWN
ASKED = bytes.fromhex("FF FF FF 01 02 F1 0B")
SAID = bytes.fromhex("FF FF FF 01 02 00 FC")

TABLE = SAMPLES.parent / "labelled.toml"
SHAPES: list[dict[str, Any]] = tomllib.loads(TABLE.read_text(encoding="utf-8"))["shape"]
"""One conversation in the spellings of many logs, and what is read of each."""


@pytest.mark.parametrize("shape", SHAPES, ids=[shape["name"] for shape in SHAPES])
def test_one_conversation_is_read_alike_however_it_is_written_down(shape: dict[str, Any]) -> None:
    log = shape["text"].encode()
    assert open_source(log).format == "labelled"
    got = [chunk for chunk in chunks(log) if chunk.data]
    ways = [Direction[way] if way else UNKNOWN for way in shape["ways"]]
    assert [c.direction for c in got] == ways
    told = b"".join(ASKED if way is TX else SAID for way in ways)
    assert b"".join(c.data for c in got) == (told if any(shape["ways"]) else ASKED + SAID)
    moments = [None if c.t_ns is None else c.t_ns // MS % 1000 for c in got]
    assert moments == shape.get("t_ms", [None] * len(got))
    said = notes(log)
    assert shape.get("left_out", "its bytes are laid out") in said or "t_ms" in shape
    assert ("left out" in said) == ("left_out" in shape)


FRONTS = ["", "22:55:06.001 ", "[22:55:06.001] ", "2026-11-20 22:55:06 ", "12 ms ", "0.001,"]
WAYS = [
    ("TX: ", "RX: "),
    ("[TX] ", "[RX] "),
    (">> ", "<< "),
    ("tx=", "rx="),
    ("TX [7]: ", "RX [7] "),
    ("Sent 7 bytes: ", "Received len=7 "),
    ("TX frame 009 ", "RX frame 010 "),
    ("TX 7: ", "RX (id 1): "),
    ("TX,", "RX,"),
    ("W - ", "R - "),
]
SPELLINGS: list[Callable[[bytes], str]] = [
    lambda data: data.hex(" "),
    lambda data: data.hex().upper(),
    lambda data: data.hex("-"),
    lambda data: data.hex(":"),
    lambda data: ", ".join(f"0x{value:02X}" for value in data),
    lambda data: "[" + ",".join(f"0x{value:x}" for value in data) + "]",
    lambda data: " ".join(f"${value:02X}" for value in data),
    lambda data: " ".join(f"{value:02X}h" for value in data),
    lambda data: "".join(f"<{value:02X}>" for value in data),
    lambda data: f'"{data.hex(" ")}"',
    lambda data: f"<Buffer {data.hex(' ')}>",
    lambda data: "b'" + "".join(f"\\x{value:02x}" for value in data) + "'",
]
NOTES = ["", " (ok)", "  # ping", " // x", "  ; read", "  checksum ok", "  <- it", " |..abcd|"]


@given(
    st.lists(st.tuples(st.booleans(), st.binary(min_size=1, max_size=20)), min_size=1, max_size=5),
    st.sampled_from(FRONTS),
    st.sampled_from(WAYS),
    st.sampled_from(SPELLINGS),
    st.sampled_from(NOTES),
)
def test_no_byte_is_invented_or_lost_whatever_stands_around_it(
    talk: list[tuple[bool, bytes]],
    front: str,
    ways: tuple[str, str],
    spell: Callable[[bytes], str],
    note: str,
) -> None:
    text = "\n".join(f"{front}{ways[heard]}{spell(data)}{note}" for heard, data in talk)
    got = LabelledLog("bus0").chunks(LineBlock(text.encode(), 1, 0, cut_off=False))
    assert [(c.direction, c.data) for c in got] == [(RX if h else TX, data) for h, data in talk]


@pytest.mark.parametrize(
    "log",
    [
        "22:55:06.001 -> FF FF FF 01 02 F1 0B\n22:55:06.003 -> FF FF FF 01 02 00 FC\n",
        "TX: FF FF FF 01 02 F1 0B\nRX: FF FF FF 01 02 00 FC",
        "tx=ffffff0102f10b\nrx=ffffff010200fc\n",
        "[TX] 0xFF,0xFF,0xFF,0x01,0x02,0xF1,0x0B\n[RX] 0xFF,0xFF,0xFF,0x01,0x02,0x00,0xFC\n",
        (
            "[2026-11-20 22:55:06,001] Sent: ff-ff-ff-01-02-f1-0b (ping)\n"
            "[2026-11-20 22:55:06,003] Received: ff:ff:ff:01:02:00:fc\n"
        ),
        (
            "2026-11-20T22:55:06.001Z >> FF FF FF 01 02 F1 0B |.......|\n"
            "2026-11-20T22:55:06.003Z << FF FF FF 01 02 00 FC |.......|\n"
        ),
        "Send: FF FF FF 01 02 F1 0B   Recv: FF FF FF 01 02 00 FC\n",
        "1795215306.001216 write -> FFFFFF0102F10B\n1795215306.003 read <- FFFFFF010200FC\n",
        "[    0.001216] FF FF FF 01 02 F1 0B\n[    0.003216] FF FF FF 01 02 00 FC\n",
        f"TX: {ASKED!r}\nRX: {bytearray(SAID)!r}\n",
        "hello, this is a ping\n\n-> FF FF FF 01 02 F1 0B\n<- FF FF FF 01 02 00 FC\ndone\n",
    ],
)
def test_what_people_write_down_is_read(log: str) -> None:
    assert open_source(log.encode()).format == "labelled"
    assert read(log.encode()) == ASKED + SAID


@pytest.mark.parametrize(
    "log",
    [
        # rospy as arebgun/dynamixel_motor#50 has it, roscpp as reedhedges/AriaCoda#7, ROS 2 as
        # ROBOTIS-GIT/open_manipulator#333
        (
            "[DEBUG] [WallTime: 1455635115.944340] write: ff ff ff 01 02 f1 0b\n"
            "[DEBUG] [WallTime: 1455635115.946340] read: ff ff ff 01 02 00 fc\n"
        ),
        (
            "[ INFO] [1625177470.016575528]: RosAria: set port: [/dev/ttyUSB0]\n"
            "[DEBUG] [1625177470.116575528]: TX: FF FF FF 01 02 F1 0B\n"
            "[DEBUG] [1625177470.118575528, 12.250000]: RX: FF FF FF 01 02 00 FC\n"
        ),
        (
            "[servo_node-1] [INFO] [1752838413.863188435] [servo_bus]: TX FF FF FF 01 02 F1 0B\n"
            "[servo_node-1] [INFO] [1752838413.865188435] [servo_bus]: RX FF FF FF 01 02 00 FC\n"
        ),
        # Python's logging: its basic format, ljean/modbus-tk#182, its tutorial's format, loguru,
        # home-assistant/core#115039
        f"DEBUG:root:TX {ASKED.hex(' ')}\nDEBUG:root:RX {SAID.hex(' ')}\n",
        f"DEBUG:modbus_tk:-> {ASKED.hex('-')}\nDEBUG:modbus_tk:<- {SAID.hex('-')}\n",
        (
            f"2026-11-27 07:18:00,123 - servo.bus - DEBUG - write: {ASKED!r}\n"
            f"2026-11-27 07:18:00,125 - servo.bus - DEBUG - read: {SAID!r}\n"
        ),
        (
            f"2026-11-27 07:18:00.123 | DEBUG    | bus:send:42 - Sent 7 bytes: {ASKED.hex()}\n"
            f"2026-11-27 07:18:00.125 | DEBUG    | bus:recv:47 - Received 7 bytes: {SAID.hex()}\n"
        ),
        (
            "2024-04-07 22:26:30.764 DEBUG (MainThread) [bus] send: 0xff 0xff 0xff 0x1 0x2 0xf1 0xb"
            "\n2024-04-07 22:26:30.820 DEBUG (MainThread) [bus] recv: 0xff 0xff 0xff 0x1 0x2 0x0"
            " 0xfc\n"
        ),
        # TillFleisch/ESPHome-Philips-Smart-Coffee#10, ESP_LOG_BUFFER_HEX and .._HEXDUMP of ESP-IDF
        (
            "[21:57:15][D][uart_debug:114]: >>> FF:FF:FF:01:02:F1:0B\n"
            "[21:57:15][D][uart_debug:114]: <<< FF:FF:FF:01:02:00:FC\n"
        ),
        "I (1234) servo_tx: ff ff ff 01 02 f1 0b\nI (1236) servo_rx: ff ff ff 01 02 00 fc\n",
        (
            "W (195) bus: 0x3ffb4280   ff ff ff 01 02 f1 0b                           |.......|\n"
            "W (198) bus: 0x3ffb4290   ff ff ff 01 02 00 fc                           |.......|\n"
        ),
    ],
)
def test_the_heads_of_logging_frameworks_are_no_bytes(log: str) -> None:
    assert open_source(log.encode()).format == "labelled"
    assert read(log.encode()) == ASKED + SAID


@pytest.mark.parametrize(
    "log",
    [
        # pictures of packets in the manual of the DX-116, dumps of a driver for bioloid servos
        "->[Dynamixel]:FF FF FF 01 02 F1 0B (LEN:007)\n<-[Dynamixel]:FF FF FF 01 02 00 FC\n",
        "W: 0000: ff ff ff 01 02 f1 0b\nR: 0000: ff ff ff 01 02 00 fc\n",
        "TX packet: FF FF FF 01 02 F1 0B\nRX (7): FF FF FF 01 02 00 FC\n",
        # Serial.print(b, HEX), a print of a list in Python (huggingface/lerobot#526), of DEC
        "Sending packet: FF FF FF 1 2 F1 B\nReceived: FF FF FF 1 2 0 FC\n",
        f"TX {list(ASKED)}\nRX {list(SAID)}\n",
        f"TX: {' '.join(map(str, ASKED))}\nRX: {' '.join(map(str, SAID))}\n",
    ],
)
def test_bytes_are_read_as_programs_print_them(log: str) -> None:
    assert read(log.encode()) == ASKED + SAID


def test_numbers_whose_radix_nothing_proves_are_no_bytes() -> None:
    assert read(b"TX: [255, 160, 0, 32]\nRX: [0, 64]\n") == bytes.fromhex("FFA00020 0040")
    refusal(b"TX: [1, 64]\nRX: [0, 64]\n")
    refusal(b"22:55:06.001 -> 100 23\n22:55:06.101 -> 120 23\n")
    refusal(b"INFO: servo 3 answered ff ff ff 01 02 00 fc in 2 ms\n")
    line = b"TX: FF A0 0 20\n"
    _, message = until_damage(line * 9 + b"RX: 00 A4\n")
    assert "line 10" in message
    assert "'0' has one digit, '00' a zero in front" in message
    _, message = until_damage(b"TX: 10 20 30 40\n" * 9 + b"TX: 255 160 0 32\n")
    assert "line 10" in message
    assert "the lines before it are hex" in message


def test_milliseconds_since_it_was_switched_on_are_seconds() -> None:
    first, second = stamps("I (1234) bus: ff a0 00 20\nI (1240) bus: 00 a4 20 00\n")
    assert first == (1234 * MS, (coarse(4, MS),))
    assert second[0] == 1240 * MS


def test_what_is_refused_is_told_how_to_be_read() -> None:
    assert "sed" in refusal(b"\x1b[0;32mI (1234) bus: ff a0 00 20\x1b[0m\n")
    assert "(seconds.fraction)" in refusal(b"1234 TX FF A0 00 20\n1236 RX 00 A4\n")


@pytest.mark.parametrize(
    ("line", "why"),
    [
        ("22:55:06.000 TX frobnicated FF FF 01", "'frobnicated' is not hex"),
        ("TX: FF FF [POS_L] [POS_H]", "'POS_L' is not hex"),
        ("TX: FF FF ... 0B", "'...' is not hex"),
        ("TX: FF FF FF 01 02 O0", "'O0' is not hex"),
        ("TX: FF FF XX YY", "'XX' is not hex"),
        ("TX: FFh FFh FFh zz", "is not hex"),
        ("TX: ffffff0102f10", "has an odd number of hex digits"),
        ("TX <Buffer ff ff ff ... 12 more bytes>", "is not hex"),
        ("TX: FF FF 01  dead beef", "what stands apart from the bytes may be a note"),
        ("12 TX: FF FF 01", "nobody says whether they are times"),
        ("    0  TX FF FF 01", "a point behind numbers of lines"),
        ("1795215306000 TX FF FF 01", "nobody says whether they are times"),
        ("TX: FF FF 01\n    02 F1 0B", "bytes have nothing in front of them ('    02 F1 0B')"),
        ('{"t": 12, "dir": "TX", "data": "ff01"}', "write seconds with a fraction, a date, or"),
        ('{"t": 1.5, "dir": "up", "data": "ff01"}', "'up' is no direction: write TX or RX"),
        ("dir,data,n\nTX,0xFF,0x01,3", "it has 4 cells, and the head 3: put bytes in quotes"),
    ],
)
def test_a_refusal_names_the_word_that_stops_the_reading(line: str, why: str) -> None:
    assert why in refusal(f"{line}\n".encode())


def test_a_time_behind_a_direction_is_none_where_it_may_be_bytes() -> None:
    assert read(b"TX: 12:34:56\nRX: 12:34:56:AB  <- it\n") == bytes.fromhex("123456 123456AB")
    assert read(b"TX: [0x12,0x34]\nRX: 12:34:56 |4V.|\n") == bytes.fromhex("1234 123456")


def test_an_arrow_behind_a_time_is_a_direction_where_some_point_back() -> None:
    line = "22:55:06.00{} {} FF A0 00 20\n"
    log = line.format(1, "->") + line.format(2, "<-")
    got = LabelledLog("bus0").chunks(LineBlock(log.encode(), 1, 0, cut_off=False))
    assert [c.direction for c in got] == [TX, RX]


def test_an_object_that_breaks_off_is_damage_and_the_last_one_is_cut_off() -> None:
    line = b'{"t": 0.001, "dir": "TX", "data": "ffa00020"}\n'
    got, message = until_damage(line * 9 + line[:30] + b"\n" + line)
    assert got == bytes.fromhex("FFA00020") * 9
    assert "line 10" in message
    assert "no whole object in JSON" in message
    assert read(line * 9 + line[:30]) == got
    assert "cut off" in notes(line * 9 + line[:30])


def test_lines_may_end_as_on_old_computers() -> None:
    log = b"TX: FF A0 00 20\rRX: 00 A4\r"
    assert read(log) == read(log.replace(b"\r", b"\n"))
    assert open_source(b"#5QD\r*5QD10\r").format == "bin"


def test_lss_text_stands_as_it_is() -> None:
    assert read(b"TX: #5QD\nRX: *5QD1443\n") == b"#5QD\r*5QD1443\r"


@pytest.mark.parametrize("form", ["{}", "- {}", "1. {}", "    {}", "{}   // asked", "{} (1)"])
def test_lss_text_with_nothing_that_tells_a_direction_is_raw(form: str) -> None:
    text = "".join(f"{form.format(line)}\n" for line in ("#5QD", "*5QD1443", "#5QV"))
    assert open_source(text.encode()).format == "bin"


def sides(log: str) -> list[Direction]:
    return [c.direction for c in chunks(log.encode()) if c.data]


@pytest.mark.parametrize(("sent", "heard"), [("TX", "RX"), (">>", "<<"), ("out:", "in:")])
def test_the_controllers_side_is_told_by_the_frames(sent: str, heard: str) -> None:
    talk = f"{sent} FF FF FF 01 02 F1 0B\n{heard} FF FF FF 01 02 00 FC\n" * 3
    assert sides(talk) == [TX, RX] * 3
    swapped = f"{heard} FF FF FF 01 02 F1 0B\n{sent} FF FF FF 01 02 00 FC\n" * 3
    assert sides(swapped) == [TX, RX] * 3
    assert "comes from the controller: that is TX here" in notes(swapped.encode())


def stamps(log: str) -> list[tuple[int | None, tuple[Mark, ...]]]:
    return [(c.t_ns, c.marks) for c in chunks(log.encode()) if c.data]


def coarse(size: int, by_ns: int) -> Mark:
    return Mark(MarkKind.COARSE, 0, size, by_ns)


def test_a_time_is_as_good_as_its_last_digit() -> None:
    at = 1_795_215_306 * NS
    assert stamps("2026-11-20 22:55:06.001 RX FF A0 00 20\n") == [(at + MS, (coarse(4, MS),))]
    assert stamps("1795215306.001216 RX FF A0 00 20\n") == [(at + 1_216_000, ())]
    assert stamps("2026-11-20T23:55:06.001+01:00 -> FF A0 00 20\n") == [(at + MS, (coarse(4, MS),))]
    midnight = "23:59:59.900 -> FF A0 00 20\n00:00:00.100 -> 00 A4\n"
    first, second = (t for t, _ in stamps(midnight))
    assert (second or 0) - (first or 0) == 200 * MS


def test_what_is_not_known_of_its_times_is_said() -> None:
    log = b"22:55:06.001 -> FF A0 00 20\n22:55:06.003 -> 00 A4\n"
    assert "nobody says of which byte its times are" in notes(log)
    assert "controller's side" not in notes(log)
    assert {c.direction for c in chunks(log)} == {UNKNOWN}
    assert "no times" in notes(b"TX: FF A0 00 20\nRX: 00 A4\n")


def test_what_was_sent_was_handed_over_at_its_time() -> None:
    log = b"0.010000 TX FF A0 00 20\n0.012500 RX 00 A4\n"
    sent: Chunk = chunks(log)[0]
    assert Mark(MarkKind.SENT, 0, 4, 2_500_000) in sent.marks


def test_words_between_are_left_out_and_mistakes_are_damage() -> None:
    line = b"TX: FF A0 00 20\n"
    assert "2 lines between" in notes(line * 8 + b"moved\nready at 12\n")
    got, message = until_damage(line * 9 + b"TX: FF A0 00 2\n" + line)
    assert got == bytes.fromhex("FFA00020") * 9
    assert "line 10" in message
    assert "write each byte with two" in message
    assert "write each byte with two" in refusal(b"22:55:06.001 -> FF FF FF 01 2 F1 B\n")


def test_the_last_line_may_be_cut_off() -> None:
    log = b"TX: FF A0 00 20\n" * 9 + b"RX: 00 A"
    assert read(log) == bytes.fromhex("FFA00020") * 9
    assert "cut off" in notes(log)
