"""``sniffer simulate --respond``: servos that answer a real controller."""

from __future__ import annotations

import signal
import time
from typing import TYPE_CHECKING, Final

import pytest
from hypothesis import given
from hypothesis import strategies as st

from sniffer.ground.model import NS
from sniffer.protocols import PROTOCOLS
from sniffer.simulation import BUSES
from sniffer.simulation.faults import read_fault
from sniffer.simulation.respond import Responder
from tests.lists import in_turn
from tests.simulations import ear, framed, heard, running, told
from tests.streams import stream
from tests.streams.mightyzap import packet as zap
from tests.streams.rs30x import long, packet, returned, write
from tests.streams.wck import command as wck

if TYPE_CHECKING:
    from pathlib import Path

EVERY_BUS = pytest.mark.parametrize("name", BUSES)


def asked(name: str, *requests: bytes, servo_ids: tuple[int, ...] | None = None) -> list[bytes]:
    """Return what servos answer to each request, one second apart."""
    responder, out = Responder(name, servo_ids=servo_ids), []
    for nth, request in enumerate(requests, 1):
        said = responder.hear(request, nth * NS)
        out.append(b"".join(s.frame.wire for s in said if s.ours))
    return out


def test_mightyzap_servos_answer_by_their_return_mode() -> None:
    read = zap(1, 0xF2, b"\x86\x02")
    assert asked(
        "mightyzap",
        zap(1, 0xF1),
        zap(1, 0xF3, b"\x86\x34\x02"),  # goal position 564
        read,
        zap(1, 0xF3, b"\x87\x01"),  # its upper half alone
        read,
        zap(1, 0xF3, b"\x86\xff\xff"),  # beyond the stroke
        zap(254, 0x73, b"\x86\x02\x01\x0a\x00\x02\x0b\x00"),
        read,
        zap(254, 0xF3, b"\x86\x07\x00"),
        zap(2, 0xF2, b"\x86\x02"),
        zap(1, 0xF4, b"\x86\x64\x00"),
        read,
        zap(1, 0xF5),
        read,
        zap(1, 0xF5),
        zap(1, 0xF3, b"\x10\x01"),
        zap(1, 0xF3, b"\x81\x01"),
        zap(9, 0xF1),
        zap(1, 0xF7),
    ) == [
        zap(1, 0),
        zap(1, 0),
        zap(1, 0, b"\x34\x02"),
        zap(1, 0),
        zap(1, 0, b"\x34\x01"),
        zap(1, 2),
        b"",
        zap(1, 0, b"\x0a\x00"),
        b"",
        zap(2, 0, b"\x07\x00"),
        zap(1, 0),
        zap(1, 0, b"\x07\x00"),
        zap(1, 0),
        zap(1, 0, b"\x64\x00"),
        zap(1, 0x40),  # nothing is staged
        zap(1, 0),  # by the mode in force when it came
        b"",
        b"",
        b"",
    ]


def test_lss_servos_answer_queries_only() -> None:
    assert asked(
        "lss",
        b"#5D300\r",
        b"#5QDT\r",
        b"#5qd\r",
        b"#5CSD900\r",
        b"#5QSD\r",
        b"#5QSD1\r",
        b"#5SD450\r",
        b"#5QSD\r",
        b"#5QMS\r",
        b"#254QID\r",
        b"#254L\r",
        b"#5Q\r",
        b"#5CID7\r",
        b"#5QID\r",
        b"#5RESET\r",
        b"#7QID\r",
        b"#5QID\r",
        b"#5XYZ\r",
        b"#5QXYZ\r",
        servo_ids=(1, 5),
    ) == [
        b"",
        b"*5QDT300\r",
        b"*5QD300\r",
        b"",
        b"*5QSD900\r",
        b"*5QSD900\r",
        b"",
        b"*5QSD450\r",
        b"*5QMSLSS-ST1\r",
        b"*1QID1\r*5QID5\r",
        b"",
        b"*5Q1\r",
        b"",
        b"*5QID7\r",
        b"",
        b"*7QID7\r",
        b"",
        b"",
        b"",
    ]


def test_wck_modules_answer_with_two_bytes() -> None:
    status = wck(0xA0, 0)
    answers = asked(
        "wck",
        wck(0x00, 200),
        status,
        wck(0x1F, 2, bytes([40, 90])),
        status,
        wck(0xE0, 0x11, bytes([10, 250])),
        wck(0xE0, 0x12, b"\0\0"),
        wck(0xE0, 0x17, bytes([9, 60])),
        wck(0xE0, 0xC8, bytes([0, 1, 3, 6])),
        wck(0xE0, 0xC9, b"\0\0"),
        wck(0xC0, 0x10),
        wck(0xDF, 0x20),
        wck(0xE0, 0x0C, bytes([9, 9])),
        wck(0xA9, 0),
        status,
        wck(0xE1, 0x77, b"\0\0"),
        servo_ids=(0, 1),
    )
    assert [len(a) for a in answers] == [2, 2, 0, 2, 2, 2, 0, 2, 2, 2, 2, 2, 2, 0, 0]
    assert answers[1][1] == 200
    assert answers[3][1] == 40
    assert answers[4] == answers[5] == bytes([10, 250])
    assert answers[8] == bytes([3, 6])
    assert answers[9][0] == 0x10
    assert answers[10][0] == 0
    assert answers[11] == bytes([9, 9])


def test_rs30x_servos_answer_what_the_flags_ask_for() -> None:
    assert asked(
        "rs30x",
        write(1, 0x24, b"\x01", 1),
        packet(1, 0x0F, 0x24, 1, 0),
        write(1, 0x1E, b"\x2c\x01"),
        packet(1, 0x0F, 0x1E, 2, 0, b""),
        long(0x1E, (1, b"\x0a\x00"), (2, b"\x0b\x00")),
        packet(2, 0x0F, 0x1E, 2, 0, b""),
        write(255, 0x1E, b"\x05\x00", 1),
        packet(5, 0x0F, 0x1E, 2, 0, b""),
        write(1, 4, b"\x09", 1),
        packet(9, 0x0F, 0x04, 1, 0, b""),
        packet(1, 0x0F, 0x04, 1, 0, b""),
        packet(1, 0x20, 0xFF, 0, 0),
        packet(9, 0x05, 0, 0, 1),
    )[:-1] == [
        b"\x07",
        returned(1, 0x24, b"\x01"),
        b"",
        returned(1, 0x1E, b"\x2c\x01"),
        b"",
        returned(2, 0x1E, b"\x0b\x00"),
        b"",
        returned(5, 0x1E, b"\x05\x00"),
        b"\x07",
        returned(9, 0x04, b"\x09"),
        b"",
        b"",
    ]


@in_turn(4)
@EVERY_BUS
@given(st.data())
def test_however_requests_are_split_the_talk_is_the_same_and_nothing_is_lost(
    name: str, data: st.DataObject
) -> None:
    talk = data.draw(stream(name))
    cuts = sorted(data.draw(st.lists(st.integers(0, len(talk)), max_size=8)))
    over = NS + PROTOCOLS[name].tail_ns + 1
    whole, split = Responder(name), Responder(name)
    all_at_once = whole.hear(talk, NS) + whole.idle(over)
    pieces = [talk[a:b] for a, b in zip([0, *cuts], [*cuts, len(talk)], strict=True)]
    in_pieces = [s for piece in pieces for s in split.hear(piece, NS)] + split.idle(over)
    assert b"".join(s.frame.wire for s in all_at_once if not s.ours) == talk
    known = [s for s in all_at_once if s.ours or s.frame.kind != "noise"]
    assert [s.frame.wire for s in known] == [
        s.frame.wire for s in in_pieces if s.ours or s.frame.kind != "noise"
    ]
    end = 0
    for said in all_at_once:
        assert said.frame.t_start_ns >= end
        end = said.frame.t_end_ns


def test_an_answer_takes_the_turnaround_and_the_time_of_its_bytes() -> None:
    request = zap(1, 0xF2, b"\x86\x02")
    byte_ns = 10 * NS // 57600
    for carried in (False, True):
        asks, answer = Responder("mightyzap", carried=carried).hear(request, NS)
        began = NS - (len(request) * byte_ns if carried else 0)
        assert asks.frame.t_start_ns == pytest.approx(began, abs=1000)
        turnaround = answer.frame.t_start_ns - asks.frame.t_end_ns
        assert 250_000 <= turnaround < 300_000
        assert answer.frame.t_end_ns - answer.frame.t_start_ns == pytest.approx(
            len(answer.frame.wire) * byte_ns, abs=1000
        )


def test_faults_strike_answers_too() -> None:
    request = b"#5QD\r"

    def wires(*faults: str) -> list[tuple[str | None, bytes]]:
        responder = Responder("lss", faults=[read_fault(f) for f in faults])
        return [(s.frame.fault, s.frame.wire) for s in responder.hear(request, NS)][1:]

    good = wires()
    assert good[0][0] is None
    assert wires("drop-reply:5:100%") == [("drop", b"")]
    assert wires("drop-reply:1:100%") == good
    ((fault, wire),) = wires("cut:100%")
    assert fault == "cut"
    assert good[0][1].startswith(wire)
    assert [f for f, _ in wires("duplicate-id:5")] == [None, "duplicate"]


PING: Final = {
    "mightyzap": (zap(2, 0xF1), zap(2, 0)),
    "lss": (b"#5QMS\r", b"*5QMSLSS-ST1\r"),
    "wck": (wck(0xE1, 0x12, b"\0\0"), bytes([1, 254])),
    "rs30x": (packet(2, 0x0F, 4, 1, 0, b""), returned(2, 4, b"\x02")),
}
"""A question of each protocol, and the answer that a servo as shipped gives."""


@EVERY_BUS
def test_a_controller_talks_with_servos_and_the_tap_hears_both(name: str, tmp_path: Path) -> None:
    truth, link, tap_link = (tmp_path / n for n in ("truth.jsonl", "bus", "tap"))
    request, answer = PING[name]
    wishes = ("--link", link, "--tap-link", tap_link, "--truth", truth)
    with (
        running(name, "--respond", *wishes, ports=2) as it,
        ear(str(tap_link)) as tap,
        ear(str(link)) as me,
    ):
        assert [link.readlink().as_posix(), tap_link.readlink().as_posix()] == it.ports
        time.sleep(0.05)  # it looks every 5 ms whether somebody came
        assert me.ask(request, answer=len(answer)) == answer
        assert me.ask(request[:3], request[3:], answer=len(answer)) == answer
        both = tap.listen(until=2 * len(request + answer))
        err = it.end(signal.SIGTERM)
    assert both == (request + answer) * 2
    rows = framed(truth)
    assert heard(rows) == both
    assert [row["kind"] for row in rows] == ["request", "response"] * 2
    assert rows[1]["t_start_ns"] >= rows[0]["t_end_ns"]
    assert rows[0]["op"] == rows[1]["op"]
    assert told(truth)[0]["respond"]
    assert f"tap: {len(both)} bytes written" in err
    assert not link.is_symlink()
    assert not tap_link.is_symlink()


def test_without_a_tap_the_truth_knows_what_was_heard(tmp_path: Path) -> None:
    truth = tmp_path / "truth.jsonl"
    request, answer = PING["lss"]
    with (
        running("lss", "--respond", "--no-tap", "--truth", truth) as it,
        ear(it.ports[0]) as me,
    ):
        time.sleep(0.05)
        assert me.ask(b"xy" + request, answer=len(answer)) == answer
        it.end(signal.SIGINT)
    assert [(row["kind"], row["offset"]) for row in framed(truth)] == [
        ("noise", None),
        ("request", None),
        ("response", 0),
    ]
