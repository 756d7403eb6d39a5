"""RS30x: each rule of the protocol, and each contradiction of its manual, as a sentence."""

from __future__ import annotations

import functools

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from sniffer.decoding.decoder import Decoder
from sniffer.ground.framing import Block
from sniffer.ground.model import RESETS, Chunk
from sniffer.protocols import PROTOCOLS
from sniffer.protocols.rs30x.block import REACH
from sniffer.protocols.rs30x.grammar import REPLIES
from tests import heard
from tests.records import batches
from tests.streams.rs30x import (
    BLOCK,
    READ_BLOCK,
    TORQUE_ON,
    long,
    packet,
    raw,
    reset_with_data,
    returned,
    write,
)

RS30X = PROTOCOLS["rs30x"]
hear = functools.partial(heard.hear, "rs30x")


# ---- length and checksum alone decide what is a packet


def test_headers_inside_data_are_data() -> None:
    inner = write(2, 0x1E, b"\x01\x02")
    told = hear(write(1, 0x1E, inner), returned(1, 0, inner))
    assert [f.length for f in told.frames] == [18, 18]
    assert not told.gaps


def test_lengths_are_believed_up_to_the_cap() -> None:
    assert hear(packet(1, 0, 0, 254, 1)).ops == ["write"]
    assert hear(packet(1, 0, 0, 127, 2)).ops == ["write"]
    assert hear(raw(1, 0, 0, 255, 1, data=bytes(255))).ops == []
    assert hear(raw(1, 0, 0, 85, 3, data=bytes(255))).ops == []


def test_the_longest_packets_are_whole() -> None:
    told = hear(returned(1, 0, bytes(255)), long(0x1E, *((k, bytes(4)) for k in range(1, 32))))
    assert [f.length for f in told.frames] == [REACH, 163]


@pytest.mark.parametrize(
    ("held", "decided"),
    [
        (returned(1, 42, BLOCK)[:12], 0),
        (returned(1, 42, BLOCK)[:-1], 0),
        (write(1, 0x1E, b"\x00\x00")[:7], 0),
        (reset_with_data(1)[:8], 0),  # the ninth byte decides
        (packet(0x10, 0x10, 0xFF), 8),  # it holds with eight, though the eighth is FF
        (TORQUE_ON, 0),  # an acknowledgement may follow
        (TORQUE_ON + b"\x07", 10),
        (READ_BLOCK, 8),
    ],
)
def test_an_open_end_is_judged_when_all_of_a_packet_is_there(held: bytes, decided: int) -> None:
    data, none = np.frombuffer(held, np.uint8), np.empty(0, np.int64)
    assert RS30X.frame(Block(data, none, final=False))[1] == decided
    assert RS30X.frame(Block(data, none, final=True))[1] == len(held)


@pytest.mark.parametrize("servo_id", [128, 200, 254])
def test_ids_128_to_254_are_no_ids(servo_id: int) -> None:
    assert hear(raw(servo_id, 0, 0x24, 1, 1, data=b"\x01")).ops == []
    assert hear(raw(servo_id, 0, 0x24, 1, 1, data=b"\x01", header=b"\xfd\xdf")).ops == []


@pytest.mark.parametrize("count", [0, 2, 255])
def test_a_return_packet_has_count_1(count: int) -> None:
    told = hear(raw(1, 0, 0x2A, 2, count, data=b"\x00\x00", header=b"\xfd\xdf"))
    assert told.ops == []
    assert told.gaps[0].detail["count_expected"] == 1


def test_the_length_of_a_return_packet_counts_its_data_bytes() -> None:
    told = hear(packet(1, 0xF, 0x2A, 2), returned(1, 0x2A, b"\x84\x03"))
    assert told.frames[1].length == 8 + 2
    assert told.values == {(1, "present_position"): 90.0}


# ---- what a request commands


@pytest.mark.parametrize("nibble", REPLIES)
@pytest.mark.parametrize(("address", "length", "count"), [(0, 0, 1), (0, 0, 0), (255, 0, 0)])
def test_address_length_and_count_of_a_read_vary(
    nibble: int, address: int, length: int, count: int
) -> None:
    told = hear(packet(1, nibble, address, length, count))
    assert told.ops == ["read"]
    assert told.flags == [()]
    fields = told.frames[0].fields
    assert (fields["address"], fields["length"], fields["count"]) == (address, length, count)
    assert fields["flags"] == {"number": nibble, "names": [REPLIES[nibble].name]}


@pytest.mark.parametrize("nibble", [0, *REPLIES])
def test_data_makes_it_a_write_whatever_reply_is_asked_for(nibble: int) -> None:
    told = hear(write(1, 0x1E, b"\x84\x03", nibble))
    assert told.ops == ["write"]
    assert told.values == {(1, "goal_position"): 90.0}
    assert told.outcomes == ["no_response" if nibble else "not_expected"]


def test_asking_for_address_and_length_belongs_to_count_0() -> None:
    assert hear(write(1, 0x1E, b"\x84\x03", 0xF)).flags == [("unusual",)]


@pytest.mark.parametrize(
    ("flags", "op"), [(0x40, "flash_write"), (0x20, "reboot"), (0x10, "factory_reset")]
)
@pytest.mark.parametrize("count", [0, 1])
def test_the_flag_bits_command_whatever_the_count(flags: int, op: str, count: int) -> None:
    told = hear(packet(1, flags, 0xFF, 0, count))
    assert told.ops == [op]
    assert "unusual" not in told.flags[0]
    assert told.outcomes == ["not_expected"]
    assert told.frames[0].fields["flags"]["names"] == [op]


@pytest.mark.parametrize(
    ("flags", "op"),
    [(0x60, "flash_write"), (0x30, "reboot"), (0x50, "flash_write"), (0x70, "flash_write")],
)
def test_two_commands_in_one_packet_are_decoded_and_marked(flags: int, op: str) -> None:
    told = hear(packet(1, flags, 0xFF))
    assert told.ops == [op]
    assert "unusual" in told.flags[0]
    assert len(told.frames[0].fields["flags"]["names"]) == flags.bit_count()


@pytest.mark.parametrize(
    "odd",
    [
        packet(1, 0x41, 0xFF),  # a reply to a command
        packet(1, 0x80, 0x1E, 2, 1),  # bit 7
        packet(1, 0x40, 0),  # not the address of commands
        write(1, 0xFF, b"\x00\x00", 0x40),  # data and command together
        long(0x1E, (1, b"\x00\x00"), flags=1),  # long packets have no flags
        packet(255, 9),  # all are asked
        write(1, 0x24, b"\x01", 2),  # a reply nibble without meaning
    ],
)
def test_what_the_manual_excludes_is_decoded_and_marked(odd: bytes) -> None:
    assert hear(odd).flags == [("unusual",)]


@pytest.mark.parametrize(
    ("servo_id", "detail"),
    [(0, {"servo_id_least": 1}), (128, {"servo_id_most": 127}), (255, {"servo_id_most": 127})],
)
def test_a_return_under_an_id_that_no_servo_has_is_a_gap_that_says_so(
    servo_id: int, detail: dict[str, int]
) -> None:
    told = hear(raw(servo_id, 0, 0x2A, 0, 1, header=b"\xfd\xdf"))
    assert told.frames == []
    assert [g.reason for g in told.gaps] == ["damaged"]
    assert detail.items() <= told.gaps[0].detail.items()
    assert told.gaps[0].detail["fields"]["servo_id"] == servo_id


def test_registers_behind_flag_bits_are_written_and_named() -> None:
    told = hear(write(1, 0x07, b"\x26", 0x60))
    assert told.ops == ["flash_write"]
    assert told.frames[0].fields["return_delay"] == {"raw": 0x26}
    assert told.frames[0].fields["address"] == 7
    assert [(s.register, s.raw) for s in told.samples] == [("return_delay", 0x26)]


def test_a_new_id_behind_flag_bits_is_told_as_one() -> None:
    found = batches(Decoder("rs30x"), [[Chunk(write(1, 0x04, b"\x05", 0x40))]])
    assert "id-changed" in [a.code for b in found for a in b.anomalies]


@pytest.mark.parametrize(
    "other",
    [
        packet(1, 0x40, 0x07, 1, 2, b"\x26\x26"),  # of two blocks: whose?
        packet(0, 0x40, 0x1E, 3, 1, b"\x01\x00\x00"),  # of a long packet
        write(1, 0xFF, b"\x00\x00", 0x40),  # at the address of commands
    ],
)
def test_other_data_behind_flag_bits_is_shown_and_not_read(other: bytes) -> None:
    told = hear(other)
    assert told.samples == []
    assert told.frames[0].fields["data"] == other[7:-1].hex()


@pytest.mark.parametrize("nibble", sorted({*range(1, 16)} - {*REPLIES}))
def test_a_read_by_an_undefined_nibble_is_unknown_and_nothing_is_expected(nibble: int) -> None:
    told = hear(packet(1, nibble))
    assert told.ops == ["read"]
    assert told.flags == [("unknown",)]
    assert told.frames[0].fields["flags"]["names"] == [f"undefined_{nibble:x}"]
    assert told.outcomes == ["not_expected"]


@pytest.mark.parametrize(
    "body",
    [
        packet(1, 0, 0x24, 0, 1),  # a write of nothing
        packet(1, 0, 0x24, 1, 2),  # a short packet of two blocks
        packet(0, 0, 0x1E, 1, 3),  # a long packet of ids alone
        packet(0, 0, 0x1E, 0, 3),
        packet(0, 0, 0x1E, 3, 0),
    ],
)
def test_a_body_that_cannot_be_is_flagged_not_dropped(body: bytes) -> None:
    told = hear(body)
    assert told.flags == [("malformed",)]
    assert not told.samples
    assert not told.gaps


# ---- the factory reset of eight or nine bytes


@pytest.mark.parametrize(
    "reset",
    [
        packet(1, 0x10, 0xFF, 0xFF, 0),
        packet(1, 0x10, 0xFF, 0, 0),
        packet(1, 0x10, 0xFF, 1, 1, b"\xff"),
        reset_with_data(1, 0xFF, 0),
        reset_with_data(1, 0, 0),
        reset_with_data(255, 0xFF, 0),
    ],
)
def test_a_factory_reset_has_data_or_has_none(reset: bytes) -> None:
    told = hear(reset, READ_BLOCK)
    assert told.ops == ["factory_reset", "read"]
    assert told.frames[0].hex == reset.hex()
    assert told.flags[0] == ()
    assert told.outcomes[0] == "not_expected"
    parts = batches(Decoder("rs30x"), [[Chunk(reset)]])
    assert [f for b in parts for f in b.frames.flags.tolist()] == [RESETS]


def test_eight_bytes_are_tried_before_nine() -> None:
    both = packet(0x10, 0x10, 0xFF, 0, 0)  # its sum is FF, and FF ^ FF is the 00 behind it
    assert both[-1] == 0xFF
    assert [f.length for f in hear(both, b"\x00").frames] == [8]


def test_only_a_reset_may_have_a_byte_more() -> None:
    reboot = raw(1, 0x20, 0xFF, 0, 0, data=b"\xff")
    assert hear(reboot).ops == []


def test_a_reset_waits_for_its_ninth_byte() -> None:
    nine = reset_with_data(1)
    told = hear(nine[:8], nine[8:], cuts=True)
    assert [f.length for f in told.frames] == [9]


def test_a_reset_with_the_sum_of_the_data_it_lacks_is_damaged() -> None:
    told = hear(bytes.fromhex("FAAF0110FFFF00EE"))
    assert told.frames == []
    assert told.gaps[0].detail["checksum_expected"] == 0x11
    assert told.gaps[0].detail["checksum_got"] == 0xEE


# ---- replies


@pytest.mark.parametrize("nibble", [k for k in REPLIES if REPLIES[k].address >= 0])
@pytest.mark.parametrize("data", [b"", b"\x01"])
def test_each_nibble_has_its_return(nibble: int, data: bytes) -> None:
    reply = REPLIES[nibble]
    head = packet(5, nibble, 0x24, len(data), 1, data)
    assert hear(head, returned(5, reply.address, bytes(reply.length))).outcomes == ["ok"]
    wrong = returned(5, reply.address, bytes(reply.length - 1))
    assert hear(head, wrong).outcomes == ["mismatched"]
    wrong = returned(5, reply.address + 1, bytes(reply.length))
    assert hear(head, wrong).outcomes == ["mismatched"]
    wrong = returned(6, reply.address, bytes(reply.length))
    assert hear(head, wrong).outcomes == ["mismatched"]


@given(address=st.integers(0, 255), length=st.integers(0, 255))
def test_nibble_f_returns_what_address_and_length_say(address: int, length: int) -> None:
    answer = returned(1, address, bytes(length))
    assert hear(packet(1, 0xF, address, length), answer).outcomes == ["ok"]


@pytest.mark.parametrize(
    "head",
    [
        packet(255, 9),
        long(0x1E, (1, b"\x00\x00")),
        packet(1, 0x40, 0xFF),
        packet(1, 0x20, 0xFF),
        packet(1, 0x10, 0xFF),
        packet(1, 0x49, 0xFF),
        write(1, 0x24, b"\x01"),
    ],
)
def test_broadcasts_long_packets_and_commands_are_never_answered(head: bytes) -> None:
    told = hear(head, returned(1, 42, BLOCK))
    assert told.outcomes == ["not_expected", "unsolicited"]
    assert told.ops[1] == "return"
    assert told.values[1, "present_position"] == -120.2  # it says itself what it states


def test_a_response_carries_the_op_of_its_request_and_its_own_address() -> None:
    told = hear(write(1, 0x1E, b"\x84\x03", 9), returned(1, 42, BLOCK))
    assert told.ops == ["write", "write"]
    assert told.values[1, "present_position"] == -120.2
    assert told.values[1, "present_voltage"] == 7.4


@pytest.mark.parametrize("who", [1, 5])
@pytest.mark.parametrize("head", [(4, b"\x05"), (3, b"\x00\x05\x00")])
def test_a_renumbered_servo_answers_under_either_id(who: int, head: tuple[int, bytes]) -> None:
    told = hear(write(1, *head, flags=9), returned(who, 42, BLOCK))
    assert told.outcomes == ["ok"]
    assert hear(write(1, *head, flags=9), returned(6, 42, BLOCK)).outcomes == ["mismatched"]


def test_no_60_to_127_are_accepted_though_the_map_ends_before() -> None:
    told = hear(packet(1, 0xD), returned(1, 60, bytes(range(68))))
    assert told.outcomes == ["ok"]
    assert not told.samples
    assert told.frames[1].fields["data"] == bytes(range(68)).hex()
