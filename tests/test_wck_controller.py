"""RoboBuilder's controller on a wCK line: its packets, and the command that leaves it alone."""

from __future__ import annotations

import functools
import itertools

import numpy as np
import pytest

from sniffer.decoding.decoder import Decoder
from sniffer.decoding.detect import detect
from sniffer.decoding.reference import Reference
from sniffer.ground.framing import Block
from sniffer.ground.model import Chunk
from sniffer.protocols import PROTOCOLS
from sniffer.protocols.base import view
from sniffer.protocols.wck.controller import CONTENTS_MOST, HEADER, TYPES
from tests import heard
from tests.records import batches, records
from tests.streams.wck import command, rbc

WCK = PROTOCOLS["wck"]
hear = functools.partial(heard.hear, "wck")

BEGIN = bytes.fromhex("FFFFAA55AA5537BA 10 00 00000001 01 01")
"""What a client sends to speak wCK through the controller, and ..."""
END = bytes.fromhex("FFE0FB01001A")
"""... to end that. Source: PCremote of philleveridge, setDCmode."""

MOVE, REPLY = command(0x23, 100), bytes([17, 99])


def codes(*parts: bytes) -> list[str]:
    found = batches(Decoder("wck"), [[Chunk(p) for p in parts]])
    return [a.code for b in found for a in b.anomalies]


def test_a_session_through_the_controller_is_frames_only_and_nothing_is_wrong() -> None:
    talk = [BEGIN, rbc(0x10, b"\x01", platform=1), MOVE, REPLY, END]
    told = hear(*talk)
    assert told.ops == [
        *["rbc_direct_control_begin"] * 2,
        *["position_move"] * 2,
        "rbc_direct_control_end",
    ]
    assert [f.kind for f in told.frames] == [
        *["request", "response"] * 2,
        "request",
    ]
    assert told.gaps == []
    assert codes(*talk) == []
    assert told.outcomes == ["ok", "ok", "not_expected"]


def test_the_end_of_direct_control_is_for_no_servo_and_waits_for_nothing() -> None:
    told = hear(END)
    assert (told.frames[0].servo_id, told.frames[0].flags) == (None, ())
    assert told.frames[0].fields == {"data": "0100"}
    assert codes(END) == []
    assert codes(END, MOVE, REPLY) == []


def test_the_same_code_to_another_module_is_an_unknown_command() -> None:
    assert hear(command(0xE1, 0xFB, b"\x01\x00")).flags == [("unknown",)]


def test_a_packet_shows_its_head_and_contents() -> None:
    frame = hear(rbc(0x1A, b"\x01", platform=3)).frames[0]
    assert frame.op == "rbc_read_acceleration"
    assert frame.fields == {"type": 26, "platform": 3, "length": 1, "contents": "01"}
    assert (frame.servo_id, frame.checksum) == (None, "ok")


def test_a_packet_nobody_answers_raises_no_alarm() -> None:
    assert codes(BEGIN, MOVE, REPLY) == []
    assert codes(BEGIN) == []


def test_of_equal_packets_in_a_row_each_second_one_answers() -> None:
    ask, answer = rbc(0x12, b"\x01"), rbc(0x12, b"\x02\x0d", platform=1)
    told = hear(ask, answer, ask, answer)
    assert [f.kind for f in told.frames] == ["request", "response"] * 2
    assert told.outcomes == ["ok", "ok"]
    assert [f.kind for f in hear(ask, rbc(0x16, b"\x01")).frames] == ["request", "request"]


def test_an_event_that_comes_later_is_not_taken_for_an_answer_of_another_packet() -> None:
    told = hear(rbc(0x18, b"\x01"), MOVE, REPLY, rbc(0x18, b"\x05\x00", platform=1))
    assert [f.kind for f in told.frames] == ["request", "request", "response", "request"]


@pytest.mark.parametrize("kind", [0, 0x77, 255])
def test_a_type_no_client_knows_is_named_by_its_number(kind: int) -> None:
    assert kind not in TYPES
    assert hear(rbc(kind, b"")).ops == [f"rbc_{kind:02x}"]


def test_a_packet_whose_sum_fails_is_damaged_and_one_cut_short_truncated() -> None:
    told = hear(MOVE, REPLY, BEGIN[:-1] + b"\x02", MOVE, REPLY, BEGIN[:9], MOVE, REPLY)
    assert [(g.reason, g.length) for g in told.gaps] == [("damaged", 16), ("truncated", 9)]
    assert told.gaps[0].detail["checksum_expected"] == 1
    assert told.gaps[0].detail["fields"]["op"] == "rbc_direct_control_begin"
    assert told.gaps[1].detail["have"] == 9


def test_contents_longer_than_any_known_are_not_believed_and_hold_nothing_up() -> None:
    long = HEADER + bytes([0x0E, 0, 0, 0, 1, 0])
    told = hear(long, MOVE, REPLY)
    assert told.ops == ["position_move"] * 2
    assert told.gaps[0].detail["contents_bytes_most"] == CONTENTS_MOST
    assert hear(rbc(0x0E, bytes(CONTENTS_MOST))).ops == ["rbc_set_zero_positions"]


def test_bytes_that_may_begin_a_packet_wait_and_no_others() -> None:
    def decided(held: bytes) -> int:
        block = Block(np.frombuffer(held, np.uint8), np.empty(0, np.int64), final=False)
        return WCK.frame(block)[1]

    for n in range(1, len(BEGIN)):
        assert decided(MOVE + REPLY + BEGIN[:n]) == len(MOVE + REPLY)
    assert decided(MOVE + REPLY + BEGIN[:5] + b"\x00") > len(MOVE + REPLY)


def test_a_reply_that_may_hold_ff_ends_where_a_packet_begins() -> None:
    wheel = command(0xC3, 0x3F)
    assert hear(wheel, BEGIN).ops == ["wheel", "rbc_direct_control_begin"]
    assert hear(wheel, b"\xff\x63", BEGIN).ops == ["wheel"] * 2 + ["rbc_direct_control_begin"]


def test_a_line_of_the_controller_alone_is_told_by_its_bytes() -> None:
    talk = b"".join(rbc(0x1A, bytes([n]), platform=n % 2) for n in range(40))
    assert detect([Chunk(talk)]).protocol == "wck"


def test_every_byte_of_a_packet_stands_in_one_field() -> None:
    batch = Decoder("wck").feed(Chunk(rbc(0x12, b"\x02\x0d") + MOVE + REPLY))
    spans = WCK.dissect(batch.data[:17], view(batch.frames, 0))
    assert b"".join(batch.data[s.offset : s.offset + s.length] for s in spans) == batch.data[:17]


def test_block_and_reference_agree_on_every_size_and_type() -> None:
    talk = b""
    for kind, size in itertools.product([0x10, 0x12], [0, 1, 2, CONTENTS_MOST, CONTENTS_MOST + 1]):
        talk += rbc(kind, bytes([0xFF] * size)) + rbc(kind, bytes(size), platform=1) + MOVE + REPLY
    chunks = [Chunk(talk)]
    got = records(batches(Decoder("wck"), [chunks]))
    want = Reference(WCK).decode(chunks)
    assert got.frames == want.frames
    assert got.transactions == want.transactions
    assert got.samples == want.samples
