"""Logs that people and programs of their own write: bytes behind a time, a direction, or both."""

from __future__ import annotations

import pytest

from sniffer.ground.model import MS, NS, Chunk, Direction, Mark, MarkKind
from sniffer.sources import open_source
from tests.inputs import chunks, notes, read, refusal, until_damage

TX, RX, UNKNOWN = Direction.TX, Direction.RX, Direction.UNKNOWN
ASKED = bytes.fromhex("FF FF FF 01 02 F1 0B")
SAID = bytes.fromhex("FF FF FF 01 02 00 FC")


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


def test_lss_text_stands_as_it_is() -> None:
    assert read(b"TX: #5QD\nRX: *5QD1443\n") == b"#5QD\r*5QD1443\r"


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
    assert "write each byte with two" in refusal(b"22:55:06.001 -> FF FF FF 1 2 F1 B\n")


def test_the_last_line_may_be_cut_off() -> None:
    log = b"TX: FF A0 00 20\n" * 9 + b"RX: 00 A"
    assert read(log) == bytes.fromhex("FFA00020") * 9
    assert "cut off" in notes(log)
