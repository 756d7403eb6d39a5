"""A protocol by hand that says no more than it must: packets without a header, as Kondo's B3M has.

    SIZE | COMMAND | OPTION or STATUS | ID | DATA ... | SUM

Source: users' libraries for the B3M, checked with each other (sizes, codes, sum, addresses).
"""

from __future__ import annotations

import io
from dataclasses import replace
from typing import TYPE_CHECKING, Any, Final

import numpy as np
import pytest
from construct import Byte, Bytes, Check, ConstructError, this
from hypothesis import given
from hypothesis import strategies as st

from sniffer.decoding.decoder import Decoder
from sniffer.ground.checksums import SUM8
from sniffer.ground.codes import MUST, NEVER, OUTCOMES, REQUEST, RESPONSE
from sniffer.ground.framing import Block, frame_by_plan
from sniffer.ground.model import Chunk, Frames, Spans
from sniffer.ground.plan import plan_of
from sniffer.ground.registers import RegisterMap
from sniffer.ground.timing import byte_time_ns
from sniffer.protocols import PluginError
from sniffer.protocols.base import SlowFrame, view
from sniffer.protocols.by_hand import ByHand
from sniffer.protocols.packets import Packet, Seal
from sniffer.protocols.shapes import Addressed
from tests.records import held_to_the_oracle
from tests.streams import chunked, damaged

if TYPE_CHECKING:
    from sniffer.ground.model import I64
    from sniffer.protocols.base import State, Values

TABLE: Final = """
model = "b3m"
protocol = "b3m"
title = "Kondo B3M"
source = "users' libraries"

[[register]]
name = "position"
address = 0x2C
type = "i16le"
unit = "deg"
scale = 0.01
quantity = "position"
role = "measured"
source = "B3M_SERVO_CURRENT_POSITION"
"""
PACKET: Final = Packet(
    "size" / Byte,
    Check((this.size >= 5) & (this.size <= 64)),
    "code" / Byte,
    Check(((this.code & 0x7F) >= 1) & ((this.code & 0x7F) <= 6)),
    "option" / Byte,
    "servo_id" / Byte,
    "data" / Bytes(this.size - 5),
    "sum" / Seal(Byte, SUM8, "size", "code", "option", "servo_id", "data"),
)
PLAN: Final = plan_of(PACKET)
READ: Final = 3
MODELS: tuple[RegisterMap, ...] = (RegisterMap.from_text(TABLE, "b3m.toml"),)
SHAPES: Final = Addressed(MODELS, first=0)


class B3m(ByHand):
    """Reads, and what answers them; of other commands who is asked."""

    name = "b3m"
    title = "Kondo B3M"
    bauds: tuple[int, ...] = (1500000,)
    baud = 1500000
    longest = 64
    reach = 256
    tail_ns = 20_000_000
    models = MODELS

    def frame(self, block: Block) -> tuple[Spans, int]:
        """Frame by the plan: there is no header, so every byte may begin a packet."""
        return frame_by_plan(PLAN, block)

    def describe(self, block: Block, spans: Spans) -> Frames:
        """Tell an answer by bit 7, and what a read asks for."""
        data, start = block.data, spans.start
        code = data[start + 1].astype(np.int64)
        asks = code < 0x80
        size = spans.end - start
        read = (code == READ) & (size == 7)
        address = np.where(read, data[np.minimum(start + 4, block.n - 1)].astype(np.int64), -1)
        due = np.where(read, data[np.minimum(start + 5, block.n - 1)], 0)
        return Frames.stating(
            start=start,
            length=size,
            kind=np.where(asks, np.uint8(REQUEST), np.uint8(RESPONSE)),
            servo_id=data[start + 3].astype(np.int16),
            op=code & 0x7F,
            address=address,
            data_start=start + 4,
            data_length=np.where(read, 0, size - 5),
            status=np.where(asks, -1, data[start + 2].astype(np.int16)),
            reply=np.where(asks, np.uint8(MUST), np.uint8(NEVER)),
            token=(code & 0x7F) << 8 | np.where(asks, due, size - 5),
        )

    def values(self, block: Block, frames: Frames, rows: I64, state: State) -> Values:
        """Read what answers bring, where their requests said."""
        address = np.where(frames.data_length[rows] > 0, frames.address[rows], -1)
        return SHAPES.values(block, frames, rows, address, 0 * rows, state)

    def slow_parse(self, data: bytes, at: int, limit: int) -> list[tuple[int, int, int]] | None:
        """Parse one packet."""
        stream = io.BytesIO(data[at:limit])
        try:
            code = PACKET.parse_stream(stream).code
        except ConstructError:
            return None
        return [(at, at + stream.tell(), REQUEST if code < 0x80 else RESPONSE)]

    def slow_describe(self, raw: bytes, kind: int, before: SlowFrame | None) -> SlowFrame:
        """Describe one packet."""
        del before
        packet = PACKET.parse(raw)
        out = SlowFrame(0, len(raw), kind, packet.servo_id, packet.code & 0x7F, raw)
        out.data_start, out.data, out.reply = 4, packet.data, NEVER
        out.token = out.op << 8
        if kind == RESPONSE:
            out.status = packet.option
            out.token |= len(packet.data)
            return out
        out.reply = MUST
        if out.op == READ and len(packet.data) == 2:
            out.address, out.data = packet.data[0], b""
            out.token |= packet.data[1]
        return out

    def op_name(self, op: int) -> str:
        """Return the command's name."""
        return {READ: "read"}.get(op, f"command_{op}")


PROTOCOL: Final = B3m()


def said(code: int, data: bytes = b"", who: int = 1) -> bytes:
    body = {"size": len(data) + 5, "code": code, "option": 0, "servo_id": who, "data": data}
    return bytes(PACKET.build(body))


TALK: Final = [
    said(READ, b"\x2c\x02") + said(0x83, b"\x10\x27"),
    said(READ, b"\x2c\x02", 2) + said(0x83, b"\xf0\xd8", 2),
    said(READ, b"\x2c\x02") + said(0x83, b"\x07\x03"),
    said(READ, b"\x2c"),
    said(4, b"\x10\x27\x2a\x01") + said(0x84),
    said(6, b"\x05\x04\x01\x00") + said(0x86, b"\x07\x03"),
    b"\x07\x03\x00",
]


def heard(data: bytes) -> Any:
    decoder = Decoder(PROTOCOL)
    return decoder.feed(Chunk(data)), decoder.close()


def test_packets_without_a_header_pair_and_state_what_was_asked_for() -> None:
    both = heard(TALK[0] + TALK[1])
    assert [OUTCOMES[k] for b in both for k in b.transactions.outcome] == ["ok", "ok"]
    assert np.concatenate([b.values.servo_id for b in both]).tolist() == [1, 2]
    assert np.concatenate([b.values.value for b in both]).tolist() == [100.0, -100.0]


@given(data=st.data())
def test_columns_say_what_the_oracle_says_of_packets_without_a_header(data: st.DataObject) -> None:
    talk = data.draw(st.lists(st.sampled_from(TALK), max_size=8).map(b"".join))
    talk = data.draw(st.one_of(st.just(talk), damaged(talk)))
    chunks = data.draw(chunked(talk, byte_time_ns(PROTOCOL.baud), PROTOCOL.tail_ns))
    held_to_the_oracle(PROTOCOL, chunks)


def test_what_a_protocol_does_not_say_itself_is_said_for_it() -> None:
    first = heard(TALK[0])[0]
    raw, row = TALK[0][:7], view(first.frames, 0)
    assert [span.name for span in PROTOCOL.dissect(raw, row)] == ["head", "tail"]
    assert PROTOCOL.fields(TALK[0][7:], view(first.frames, 1)) == {"data": "1027"}
    assert PROTOCOL.window_ns(first.frames).tolist() == [PROTOCOL.tail_ns] * 2
    assert (PROTOCOL.status_names(1), PROTOCOL.checksum_of(raw)) == ((), None)
    assert not PROTOCOL.refused(first.frames.status).any()
    (torn,), (noise,) = PROTOCOL.explain(b"\x07\x83", 3, awaited=True), PROTOCOL.explain(b"\x01", 0)
    assert (torn.reason, torn.start, torn.detail["have"]) == ("truncated", 3, 2)
    assert (noise.reason, noise.length) == ("noise", 1)


def test_a_servo_that_there_cannot_be_is_refused_with_its_place(
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    describe = PROTOCOL.describe

    def wide(block: Block, spans: Spans) -> Frames:
        frames = describe(block, spans)
        return replace(frames, servo_id=frames.servo_id + np.int16(255))

    monkeypatch.setattr(PROTOCOL, "describe", wide)
    with pytest.raises(PluginError, match="b3m: the frame at byte 0 names servo 256: ids are 0 to"):
        heard(TALK[0])
