"""RS30x: values, status, explanations, and every length, count and flag against the reference."""

from __future__ import annotations

import functools
from typing import Any

import pytest
from hypothesis import given
from hypothesis import strategies as st

from sniffer.decoding.decoder import Decoder
from sniffer.decoding.reference import Reference
from sniffer.ground.model import Chunk
from sniffer.protocols import PROTOCOLS
from sniffer.protocols.base import view
from sniffer.protocols.rs30x.block import PLAN, RETURN_PLAN
from sniffer.protocols.rs30x.grammar import ACK, MOST_DATA, PACKET, RETURN
from tests import heard
from tests.lists import each_in_turn, thinned, walks_a_list
from tests.records import batches, records
from tests.streams.rs30x import TALK, long, packet, raw, reset_with_data, returned, write

RS30X = PROTOCOLS["rs30x"]
READ_BLOCK = packet(1, 9, 0, 0, 1)
BLOCK = bytes.fromhex("4EFB0000000006002D00E402000000000000")
TORQUE_ON = write(1, 0x24, b"\x01", flags=1)
ACK_BYTE, NACK_BYTE = b"\x07", b"\x08"
hear = functools.partial(heard.hear, "rs30x")


# ---- values


def test_a_long_packet_names_its_servos_inside() -> None:
    told = hear(bytes.fromhex("FAAF00001E030301640002640005F401ED"))
    goal = "goal_position"
    assert told.values == {(1, goal): 10.0, (2, goal): 10.0, (5, goal): 50.0}


def test_two_bytes_from_address_07_span_two_registers() -> None:
    told = hear(write(1, 7, b"\x12\x00"))
    assert [(s.register, s.part) for s in told.samples] == [
        ("return_delay", None),
        ("cw_angle_limit", "low byte"),
    ]


def test_the_dead_band_is_no_angle() -> None:
    told = hear(packet(1, 0xF, 0x2A, 2), returned(1, 0x2A, b"\xb3\x15"))
    assert told.samples[0].value is None
    assert told.samples[0].name == "dead_band"


@pytest.mark.parametrize(("number", "name"), [(0, "off"), (1, "on"), (2, "brake")])
def test_torque_is_shown_as_it_stands(number: int, name: str) -> None:
    sample = hear(packet(1, 0xF, 0x24, 1), returned(1, 0x24, bytes([number]))).samples[0]
    assert (sample.raw, sample.name) == (number, name)


def test_data_at_the_address_of_commands_is_no_value() -> None:
    assert not hear(write(1, 0xFF, b"\x84\x03", 0x40)).samples


@pytest.mark.parametrize(
    ("status", "names", "refused"),
    [
        (0x80, ("temperature_limit",), False),
        (0x20, ("temperature_alarm",), False),
        (0x08, ("flash_write_error",), True),
        (0x02, ("packet_not_processable",), True),
        (0x41, ("bit0", "bit6"), False),
    ],
)
def test_the_flags_of_a_return_packet_are_the_servos_status(
    status: int, names: tuple[str, ...], *, refused: bool
) -> None:
    told = hear(write(1, 0x1E, b"\x84\x03", 9), returned(1, 42, BLOCK, status))
    assert told.frames[1].fields["flags"] == {"number": status, "names": list(names)}
    assert ((1, "goal_position") not in told.values) == refused


def test_a_nack_is_reported_with_the_servo_that_was_asked() -> None:
    alarm = returned(1, 42, BLOCK, 0x20)
    parts = batches(Decoder("rs30x"), [[Chunk(READ_BLOCK + alarm + TORQUE_ON + NACK_BYTE)]])
    found = [(a.code, a.servo_id) for b in parts for a in b.anomalies]
    assert found == [("device-temperature-alarm", 1), ("device-nack", 1)]


# ---- what no packet claims


def test_a_damaged_packet_shows_its_sums_and_its_fields() -> None:
    bad = bytearray(write(3, 0x1E, b"\x84\x03", 1))
    bad[-1] ^= 1
    (gap,) = hear(READ_BLOCK, bytes(bad), READ_BLOCK).gaps
    assert gap.reason == "damaged"
    assert gap.detail["checksum_expected"] == bad[-1] ^ 1
    assert gap.detail["checksum_got"] == bad[-1]
    assert gap.detail["fields"] == {
        "servo_id": 3,
        "address": 0x1E,
        "length": 2,
        "count": 1,
        "flags": {"number": 1, "names": ["ack"]},
        "op": "write",
        "data": "8403",
    }


def test_the_manuals_voltage_return_is_short_and_has_another_examples_sum() -> None:
    printed = bytes.fromhex("FDDF01002A12014EFB00000006002D00E4020000000000A6")
    told = hear(READ_BLOCK, printed)
    assert told.outcomes == ["damaged"]
    (gap,) = told.gaps
    assert gap.reason == "idle_tail"
    assert (gap.detail["have"], gap.detail["need"]) == (24, 26)
    filled = bytes.fromhex("FDDF01002A12014EFB0000000006002D00E402000000000000A6")
    (gap,) = hear(READ_BLOCK, filled).gaps
    assert gap.reason == "damaged"
    assert gap.detail["checksum_expected"] == 0x40


def test_a_packet_cut_off_by_the_next_is_truncated() -> None:
    (gap,) = hear(returned(1, 42, BLOCK)[:12], READ_BLOCK).gaps
    assert (gap.reason, gap.detail["have"], gap.detail["need"]) == ("truncated", 12, 26)
    (gap,) = hear(READ_BLOCK[:5], READ_BLOCK).gaps
    assert (gap.reason, gap.detail["have"]) == ("truncated", 5)
    assert gap.detail["fields"]["servo_id"] == 1


@pytest.mark.parametrize(
    ("bad", "why"),
    [
        (raw(200, 0, 0x24, 1, 1, data=b"\x01"), "servo_id_most"),
        (raw(1, 0, 0, 85, 3, data=bytes(255)), "data_bytes_most"),
        (raw(1, 0, 0, 2, 3, data=bytes(2), header=b"\xfd\xdf"), "count_expected"),
    ],
)
def test_a_packet_that_cannot_be_says_why_though_its_sum_holds(bad: bytes, why: str) -> None:
    (gap,) = hear(READ_BLOCK, bad, READ_BLOCK).gaps
    assert gap.reason == "damaged"
    assert why in gap.detail
    assert "checksum_got" not in gap.detail


def test_a_nine_byte_reset_with_a_wrong_sum_is_damaged_as_a_whole() -> None:
    (gap,) = hear(reset_with_data(1)[:-1] + b"\x00").gaps
    assert (gap.reason, gap.length) == ("damaged", 9)
    assert gap.detail["checksum_expected"] == 0xEE


@pytest.mark.parametrize("unit", [b"\xfa\xaf", b"\xfa", b"\xfd\xdf", b"\xfa\xaf\x01", b"\xff"])
def test_a_run_of_headers_is_a_few_gaps(unit: bytes) -> None:
    n = 64 * 1024
    told = hear(unit * (n // len(unit)))
    assert len(told.gaps) <= 4 * n // 1024


@given(st.lists(st.one_of(TALK, st.binary(max_size=20)), max_size=6).map(b"".join))
def test_explanations_join_to_the_whole_run(run: bytes) -> None:
    at = 100
    for gap in RS30X.explain(run, 100):
        assert gap.start == at
        assert gap.length > 0
        at += gap.length
    assert at == 100 + len(run)


# ---- the rest of the interface


def test_the_window_is_that_of_the_greatest_return_delay() -> None:
    (batch, _) = batches(Decoder("rs30x"), [[Chunk(READ_BLOCK + returned(1, 42, BLOCK))]])
    assert set(RS30X.window_ns(batch.frames).tolist()) == {12_850_000}


@given(TALK)
def test_dissection_covers_every_byte_once(talk: bytes) -> None:
    for batch in batches(Decoder("rs30x"), [[Chunk(talk)]]):
        for i in range(len(batch.frames)):
            start, length = int(batch.frames.start[i]), int(batch.frames.length[i])
            at = 0
            for span in RS30X.dissect(batch.data[start : start + length], view(batch.frames, i)):
                assert span.offset == at
                at += span.length
            assert at == length


@pytest.mark.parametrize(
    ("grammar", "built"),
    [
        (PACKET, write(1, 0x1E, b"\x84\x03")),
        (PACKET, long(0x1E, (1, b"\x64\x00"), (2, b"\x64\x00"))),
        (RETURN, returned(1, 42, BLOCK)),
        (ACK, ACK_BYTE),
        (ACK, NACK_BYTE),
    ],
)
def test_what_a_grammar_parses_it_builds_again(grammar: Any, built: bytes) -> None:
    assert grammar.build(grammar.parse(built)) == built


# ---- every length, count and flag: the block decoder equals the reference


def same(stream: bytes) -> None:
    chunks = [Chunk(stream)]
    got = records(batches(Decoder("rs30x"), [chunks]))
    want = Reference(RS30X).decode(chunks)
    assert got.frames == want.frames
    assert got.transactions == want.transactions
    assert got.samples == want.samples


def edge(plan_header: bytes, *fields: int, data_bytes: int) -> bytes:
    """Build a packet of these fields whose sum holds; far beyond the cap it has little data."""
    kept = data_bytes if data_bytes <= MOST_DATA + 4 else 4
    data = bytes((7 * k + 3) & 0x7F for k in range(kept))
    return raw(*fields, data=data, header=plan_header)


@walks_a_list
@each_in_turn(2, "flags", [*range(16), 0x10, 0x20, 0x40])
def test_every_request_length_and_count_is_decoded_as_the_reference_does(flags: int) -> None:
    stream = b""
    for count in (0, 1, 2, 3, 31):
        for length in thinned(range(256), 11):
            n = length * count
            stream += edge(PLAN.header, 1, flags, 0xFF, length, count, data_bytes=n)
            stream += (b"", ACK_BYTE, NACK_BYTE, b"\xff")[length % 4]
    same(stream)


@walks_a_list
@each_in_turn(2, "servo_id", [0, 1, 127, 128, 254, 255])
def test_every_return_length_is_decoded_as_the_reference_does(servo_id: int) -> None:
    stream = b""
    for length in thinned(range(256), 11):
        for count in (1,) if length % 16 else (0, 1, 2):
            stream += packet(1, 0xF, 4, length) if length % 2 else b""
            stream += edge(RETURN_PLAN.header, servo_id, 0, 4, length, count, data_bytes=length)
    same(stream)


@walks_a_list
@each_in_turn(2, "servo_id", [0, 1, 127, 128, 254, 255])
def test_every_flag_byte_is_decoded_as_the_reference_does(servo_id: int) -> None:
    stream = b""
    for flags in thinned(range(256), 11):
        for address, length, count in (
            (0xFF, 0, 0),
            (0xFF, 255, 0),
            (4, 1, 1),
            (3, 1, 1),
            (3, 3, 1),
            (4, 3, 2),
        ):
            stream += edge(
                PLAN.header, servo_id, flags, address, length, count, data_bytes=length * count
            )
            stream += ACK_BYTE if flags % 3 else returned(1, 4, b"\x05")
        stream += raw(servo_id, flags, 0xFF, 255, 0, data=b"\xff")  # a reset's ninth byte
        stream += raw(servo_id, flags, 0xFF, 1, 1, data=b"\xff")
    same(stream)
