"""wCK: times, gaps and their reasons, every byte of a frame, and the edge list."""

from __future__ import annotations

import functools

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from sniffer.decoding.decoder import Decoder
from sniffer.decoding.reference import Reference
from sniffer.ground.model import Chunk
from sniffer.protocols import PROTOCOLS
from sniffer.protocols.base import view
from tests import heard
from tests.lists import in_turn, thinned, walks_a_list
from tests.records import batches, records
from tests.streams.wck import any_command, command

WCK = PROTOCOLS["wck"]
hear = functools.partial(heard.hear, "wck")

MOVE = command(0x23, 100)
READ = command(0xA3, 0)
WHEEL = command(0xC3, 0x3F)
IO_WRITE = command(0xE3, 0x64, b"\xff\xff")
IO_READ = command(0xE3, 0x65, b"\0\0")
REPLY = bytes([17, 99])


def test_set_commands_have_the_time_that_an_eeprom_takes() -> None:
    def window(asked: bytes) -> int:
        frames = Decoder("wck").feed(Chunk(asked + b"\x01\x01")).frames
        return int(WCK.window_ns(frames)[0]) // 1_000_000

    assert [window(x) for x in (MOVE, READ, WHEEL, IO_WRITE, IO_READ)] == [5] * 5
    assert [window(command(0xE3, code, b"\x01\x01")) for code in (8, 9, 0x0C, 0x0D, 0x11)] == [
        200
    ] * 5
    assert window(command(0xE3, 0x96, b"\x00")) == 200
    assert WCK.tail_ns > 2 * 136_144_000  # the slowest answer of the manual's table


def test_a_command_whose_checksum_fails_is_damaged() -> None:
    told = hear(READ, REPLY, b"\xff\xa3\x00\x00", REPLY, READ, REPLY)
    assert [(g.offset, g.length, g.reason) for g in told.gaps] == [
        (6, 4, "damaged"),
        (10, 2, "noise"),
    ]
    assert told.gaps[0].detail == {
        "checksum_expected": 0x23,
        "checksum_got": 0,
        "fields": {"servo_id": 3, "op": "status_read", "data": "00"},
    }


def test_a_command_cut_off_by_the_next_is_truncated() -> None:
    told = hear(command(0xE0, 0xC8, b"\x64\x00\x03\x10")[:-2], READ, REPLY)
    assert [(g.offset, g.length, g.reason) for g in told.gaps] == [(0, 6, "truncated")]
    detail = told.gaps[0].detail
    assert (detail["have"], detail["need"]) == (6, 8)
    assert detail["fields"]["servo_id"] == 100


def test_a_command_cut_off_by_the_end_is_an_idle_tail() -> None:
    assert [g.reason for g in hear(command(0x1F, 4, b"\1\2\3\4")[:5]).gaps] == ["idle_tail"]


def test_a_muddle_is_one_piece_of_noise() -> None:
    assert [g.length for g in hear(b"\xff" * 1000).gaps] == [1000]
    assert len(hear(b"\xff\x00" * 500).gaps) <= 3


@given(run=st.binary(min_size=1, max_size=60).map(lambda b: b.replace(b"\x01", b"\xff")))
def test_explanations_join_to_the_bytes_they_explain(run: bytes) -> None:
    at = 7
    for gap in WCK.explain(run, 7):
        assert gap.start == at
        assert gap.length > 0
        at += gap.length
    assert at == 7 + len(run)


@given(made=any_command(), reply=st.binary(min_size=2, max_size=2))
def test_a_dissection_names_every_byte_of_a_frame(made: tuple[int, bytes], reply: bytes) -> None:
    told = batches(Decoder("wck"), [[Chunk(made[1] + reply)]])
    for batch in told:
        for i in range(len(batch.frames)):
            start, length = int(batch.frames.start[i]), int(batch.frames.length[i])
            raw = batch.data[start : start + length]
            spans = WCK.dissect(raw, view(batch.frames, i))
            assert [s.offset for s in spans] == [0, *np.cumsum([s.length for s in spans])[:-1]]
            assert sum(s.length for s in spans) == length
            found = WCK.checksum_of(raw)
            assert found is None or found[0](found[1]) == found[2]


def edge(data1: int, data2: int, fill: int) -> bytes:
    """Build a command by hand, with the length of its mode, and put a reply behind it."""
    many = {0x96: 1 + 2 * 4, 0xC8: 4}.get(data2, 2) if data1 >> 5 == 7 else 0
    if data1 >> 5 < 5 and data1 & 31 == 31:
        many = data2 & 31
    rest = bytearray([fill]) * many
    if data1 >> 5 == 7 and data2 == 0x96:
        rest[0] = 4
    return command(data1, data2, bytes(rest)) + bytes([fill, 1])


@in_turn(2)
@walks_a_list
@pytest.mark.parametrize("mode", range(8))
@pytest.mark.parametrize("fill", [0, 0xFF])
def test_every_data1_and_data2_decodes_as_the_reference_says(mode: int, fill: int) -> None:
    # the filling matters in set commands; elsewhere some ids stand for all
    modules = range(32) if mode == 7 or not fill else (0, 8, 9, 30, 31)
    # in mode 7 each second byte is a command of its own
    second = list(range(256)) if mode == 7 else thinned(range(256), 11)
    for data1 in (mode << 5 | module for module in thinned(modules, 3, ends=3)):
        part = [Chunk(b"".join(edge(data1, data2, fill) for data2 in second))]
        got = records(batches(Decoder("wck"), [part]))
        want = Reference(WCK).decode(part)
        assert got.frames == want.frames
        assert got.transactions == want.transactions
        assert got.samples == want.samples
