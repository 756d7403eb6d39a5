"""A body that is not as the grammar has it: what can be read of it all the same is shown."""

from __future__ import annotations

from typing import Any

import pytest

from sniffer.decoding.decoder import Decoder
from sniffer.ground.model import Chunk
from sniffer.protocols import PROTOCOLS
from sniffer.protocols.base import view
from tests import heard
from tests.records import batches

MALFORMED: dict[str, tuple[str, str, dict[str, Any]]] = {
    "symmetric_store of half a servo": (
        "mightyzap",
        "FFFFFFFE0873860201FF0302F9",
        {"address": 134, "length": 2},
    ),
    "load_data with a byte too many": (
        "mightyzap",
        "FFFFFF0105F28602037C",
        {"address": 134, "length": 2},
    ),
    "factory_reset with two options": (
        "mightyzap",
        "FFFFFF0104F6010201",
        {"option": {"number": 1, "names": ["servo_id"]}},
    ),
    "long packet of one byte a servo": ("rs30x", "FAAF00001E01020102 1E", {"address": 30}),
}


@pytest.mark.parametrize("name", MALFORMED)
def test_what_a_malformed_body_begins_with_is_read(name: str) -> None:
    protocol, raw, told = MALFORMED[name]
    (row,) = heard.hear(protocol, bytes.fromhex(raw)).frames
    assert "malformed" in row.flags
    assert {k: row.fields.get(k) for k in told} == told


@pytest.mark.parametrize("name", MALFORMED)
def test_every_byte_of_a_malformed_body_stands_in_one_field(name: str) -> None:
    protocol, raw = PROTOCOLS[MALFORMED[name][0]], bytes.fromhex(MALFORMED[name][1])
    (batch,) = (b for b in batches(Decoder(protocol.name), [[Chunk(raw)]]) if len(b.frames))
    spans = protocol.dissect(raw, view(batch.frames, 0))
    assert sorted(k for s in spans for k in range(s.offset, s.offset + s.length)) == [
        *range(len(raw))
    ]


def test_data_of_a_reply_is_no_address_and_length() -> None:
    raw = bytes.fromhex("FFFFFF010400FF07F4")
    asked = bytes.fromhex("FFFFFF0104F286027F")
    asked = asked[:-1] + bytes([~sum(asked[3:-1]) & 0xFF])
    answered = Decoder("mightyzap").feed(Chunk(asked + raw)).frames
    spans = PROTOCOLS["mightyzap"].dissect(raw, view(answered, 1))
    assert [s.name for s in spans if s.offset in (6, 7)] == ["data"]


def test_a_motion_with_more_words_than_there_are_is_damaged_though_its_sum_holds() -> None:
    body = bytes.fromhex("E09609") + bytes(range(18))
    summed = 0
    for byte in body:
        summed ^= byte
    (gap,) = heard.hear("wck", b"\xff" + body + bytes([summed & 0x7F])).gaps
    assert gap.reason == "damaged"
    assert gap.detail["motion_count"] == 9
    assert gap.detail["motion_count_most"] == 8
    assert gap.detail["fields"]["op"] == "motion_data_write"
