"""RS30x: the bare byte that acknowledges a packet."""

from __future__ import annotations

import functools

import pytest

from sniffer.decoding.decoder import Decoder
from sniffer.ground.model import Chunk, Clock
from sniffer.protocols import PROTOCOLS
from sniffer.protocols.rs30x.grammar import NACK
from tests import heard
from tests.records import batches, records
from tests.streams.rs30x import (
    BLOCK,
    READ_BLOCK,
    TORQUE_ON,
    long,
    packet,
    reset_with_data,
    returned,
    write,
)

RS30X = PROTOCOLS["rs30x"]
ACK_BYTE, NACK_BYTE = b"\x07", b"\x08"
hear = functools.partial(heard.hear, "rs30x")


@pytest.mark.parametrize("cuts", [False, True])
@pytest.mark.parametrize("head", [TORQUE_ON, packet(1, 1)])
def test_07_behind_a_request_that_asked_for_it_is_its_ack(head: bytes, *, cuts: bool) -> None:
    told = hear(head, ACK_BYTE, READ_BLOCK, cuts=cuts)
    assert [f.kind for f in told.frames] == ["request", "response", "request"]
    assert told.frames[1].fields == {"ack": True, "answer": {"number": 7, "name": "ACK"}}
    assert told.frames[1].servo_id == 1  # that of the servo asked
    assert told.frames[1].op == told.frames[0].op
    assert told.outcomes[0] == "ok"
    assert not told.gaps


def test_08_is_a_nack_and_the_write_did_not_happen() -> None:
    told = hear(TORQUE_ON, NACK_BYTE)
    assert told.outcomes == ["ok"]
    assert told.frames[1].fields == {"ack": False, "answer": {"number": 8, "name": "NACK"}}
    assert RS30X.status_names(NACK) == ("nack",)
    assert not told.samples
    assert len(hear(TORQUE_ON, ACK_BYTE).samples) == 1


@pytest.mark.parametrize("byte", [0x00, 0x06, 0x09, 0xFF])
def test_any_other_byte_is_noise_where_the_ack_should_be(byte: int) -> None:
    told = hear(TORQUE_ON, bytes([byte]))
    assert told.outcomes == ["damaged"]
    assert [g.reason for g in told.gaps] == ["noise"]


@pytest.mark.parametrize(
    "head",
    [
        READ_BLOCK,
        write(1, 0x24, b"\x01"),
        write(255, 0x24, b"\x01", 1),
        long(0x24, (1, b"\x01"), flags=1),
        packet(1, 0x41, 0xFF),
        packet(1, 0x11, 0xFF),
        reset_with_data(1, flags=0x11),
    ],
)
@pytest.mark.parametrize("byte", [ACK_BYTE, NACK_BYTE])
def test_a_bare_byte_that_nobody_asked_for_is_noise(head: bytes, byte: bytes) -> None:
    told = hear(head, byte)
    assert len(told.frames) == 1
    assert [g.hex for g in told.gaps] == [byte.hex()]


def test_only_one_byte_and_only_the_next_one_is_the_ack() -> None:
    told = hear(TORQUE_ON, ACK_BYTE, ACK_BYTE)
    assert len(told.frames) == 2
    assert [g.hex for g in told.gaps] == ["07"]
    assert len(hear(TORQUE_ON, b"\x00", ACK_BYTE).frames) == 1


def test_no_ack_crosses_a_silence() -> None:
    t, after = 10**9, RS30X.tail_ns * 2
    chunks = [Chunk(TORQUE_ON, t, Clock.READ), Chunk(ACK_BYTE, t + after, Clock.READ)]
    for groups in ([chunks], [[c] for c in chunks]):
        got = records(batches(Decoder("rs30x"), groups))
        assert [f[1] for f in got.frames] == [len(TORQUE_ON)]


def test_a_return_where_an_ack_was_asked_for_does_not_fit() -> None:
    assert hear(TORQUE_ON, returned(1, 42, BLOCK)).outcomes == ["mismatched"]


def test_a_missing_ack_is_missed() -> None:
    assert hear(TORQUE_ON, READ_BLOCK, returned(1, 42, BLOCK)).outcomes == ["no_response", "ok"]
