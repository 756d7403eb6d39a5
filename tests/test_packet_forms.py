"""Forms of packets that a declaration may have: what none of the examples shows.

Each form is a small family whose columns are held to the oracle on damaged talk of its own.
"""

from __future__ import annotations

import itertools
import json
from typing import Any, Final

import numpy as np
import pytest
from construct import (
    Byte,
    Bytes,
    Check,
    Const,
    FlagsEnum,
    GreedyBytes,
    GreedyRange,
    Int16ub,
    Int16ul,
    Struct,
    Terminated,
    this,
)
from hypothesis import given
from hypothesis import strategies as st

from sniffer.decoding.decoder import Decoder
from sniffer.decoding.reference import Reference
from sniffer.ground.checksums import COMPLEMENT_SUM, SUM8, XOR8
from sniffer.ground.codes import OUTCOMES
from sniffer.ground.crc import Crc16
from sniffer.ground.model import Chunk
from sniffer.ground.registers import RegisterMap
from sniffer.ground.timing import byte_time_ns
from sniffer.protocols.base import view
from sniffer.protocols.explaining import pieces
from sniffer.protocols.packets import (
    IF_READ,
    MUST,
    NEVER,
    AllBut,
    Command,
    Member,
    Packet,
    PacketFamily,
    Seal,
)
from tests.records import batches, gaps, records
from tests.streams import chunked, damaged

MODEL: Final = """
model = "{name}"
protocol = "{name}"
title = "Made up"
source = "none"

[[register]]
name = "goal"
address = 0x10
type = "u8"
source = "none"

[[register]]
name = "time"
address = 0x11
type = "u8"
source = "none"

[[register]]
name = "target_angle"
address = 0x20
type = "u16be"
source = "none"

[[register]]
name = "actual_angle"
address = 0x22
type = "u16be"
source = "none"

[[register]]
name = "far"
address = 0x110
type = "u8"
source = "none"
"""

EMPTY: Final = Struct(Terminated)
READ: Final = Struct("address" / Byte, "length" / Byte, Terminated)
WRITE: Final = Struct("address" / Byte, "data" / GreedyBytes, Check(this.data))
COUNTED: Final = Struct("address" / Byte, "length" / Byte, "data" / Bytes(this.length), Terminated)
ERROR: Final = "error" / FlagsEnum(Byte, hot=1, refused=2)
HEAD: Final = "header" / Const(b"\xfa\xaf")


def member(name: str, packet: Any, commands: dict[int, Command], feedback: Any, **more: Any) -> Any:
    model = RegisterMap.from_text(MODEL.format(name=name), f"{name}.toml")
    return Member(
        PacketFamily(
            **{
                "name": name,
                "title": name,
                "bauds": (115200,),
                "baud": 115200,
                "packet": packet,
                "commands": commands,
                "feedback": feedback,
                "models": (model,),
                "window_ns": 5_000_000,
                **more,
            }
        )
    )


# UBTech: FA AF | id | command | four bytes | sum | ED, without a length. An angle is read with 02,
# and AA answers; 01 moves and is acknowledged by a bare byte that no header tells, left as noise.
UBTECH: Final = member(
    "ubtech",
    Packet(
        HEAD,
        "servo_id" / Byte,
        "code" / Byte,
        "params" / Bytes(4),
        "checksum" / Seal(Byte, SUM8, "servo_id", "code", "params"),
        Const(b"\xed"),
    ),
    {
        0x01: Command(
            "move",
            Struct("angle" / Byte, "time" / Byte, "lock" / Int16ub, Terminated),
            NEVER,
            at=0x10,
        ),
        0x02: Command("read", Struct(Const(bytes(4)), Terminated), MUST, answer=4, at=0x20),
    },
    Struct("data" / GreedyBytes),
    answer_code={0x01: None, 0x02: 0xAA}.get,
    silent=(0,),
)
# An error behind the data, a checksum at the front that covers what stands behind it, no id.
BEHIND: Final = member(
    "behind",
    Packet(
        HEAD,
        "sum" / Seal(Int16ul, Crc16(0x8005), "length", "code", "params"),
        "length" / Byte,
        Check(this.length <= 40),
        "code" / Byte,
        "params" / Bytes(this.length),
        "spare" / Byte,
    ),
    {2: Command("read", READ, IF_READ, space=0x100), 3: Command("write", COUNTED, MUST)},
    Struct("code" / Const(b"\x80"), "detail" / Byte, "data" / AllBut(1), ERROR),
    sole_id=7,
    refusals=2,
    most=40,
)
# Answers by a bit of the code, a sum over parts that stand apart, and targets without an address.
APART: Final = member(
    "apart",
    Packet(
        HEAD,
        "servo_id" / Byte,
        "length" / Byte,
        Check(this.length <= 20),
        "code" / Byte,
        "sum" / Seal(Byte, COMPLEMENT_SUM, "servo_id", "code", "params"),
        "params" / Bytes(this.length * 2),
        "xor" / Seal(Byte, XOR8, "header", "servo_id", "length", "code", "sum", "params"),
    ),
    {
        0x82: Command("read", READ, IF_READ, feedback=Struct(ERROR, "data" / GreedyBytes)),
        0x83: Command("write", WRITE, MUST),
        0x84: Command("move", Struct("targets" / GreedyRange(
            Struct("goal" / Byte, "servo_id" / Byte))), MUST, at=0x10),
        0x85: Command("ping", EMPTY, MUST),
    },
    Struct(ERROR, "note" / Int16ul, "spare" / Byte, Terminated),
    answer_code=lambda code: code & 0x7F,
    silent=(0,),
    most=20,
)  # fmt: skip
# Answers with a header of their own, and the code of their request; the id behind the length.
HEADS: Final = member(
    "heads",
    Packet(
        HEAD,
        "code" / Byte,
        "length" / Byte * "id and parameters",
        Check((this.length >= 1) & (this.length <= 30)),
        "servo_id" / Byte,
        "params" / Bytes(this.length - 1),
        "checksum" / Seal(Byte, SUM8, "header", "code", "length", "servo_id", "params"),
    ),
    {
        1: Command("ping", EMPTY, MUST),
        2: Command("read", READ, MUST, feedback=Struct("data" / GreedyBytes)),
        3: Command("write", WRITE, MUST),
    },
    Struct(ERROR, Terminated),
    answer_header=b"\x05\x1c",
    silent=(255,),
    most=30,
)
FORMS: Final[dict[str, Any]] = {
    "ubtech": UBTECH,
    "behind": BEHIND,
    "apart": APART,
    "heads": HEADS,
}


def said(name: str, code: int, params: bytes = b"", who: int = 1, *, back: bool = False) -> bytes:
    """Build a packet with the grammar."""
    length = {"apart": len(params) // 2, "heads": len(params) + 1}.get(name, len(params))
    body = {"servo_id": who, "length": length, "code": code, "params": params, "spare": 9}
    family = FORMS[name].family
    return bytes((family.answering if back else family.packet).build(body))


TALK: Final[dict[str, list[bytes]]] = {
    "ubtech": [
        said("ubtech", 1, b"\x78\x64\x00\x00", 5),
        said("ubtech", 1, b"\x78\x64\x00\x01", 0),
        b"\xaf",
        said("ubtech", 2, bytes(4), 3) + said("ubtech", 0xAA, b"\x00\x5a\x00\x5b", 3),
        said("ubtech", 2, b"\x00\x00\x00\x01", 3),
        said("ubtech", 9, bytes(4), 3),
        said("ubtech", 1, b"\xfa\xaf\xed\xfa", 3),
    ],
    "behind": [
        said("behind", 2, b"\x10\x01") + said("behind", 0x80, b"\x05\x2a\x00"),
        said("behind", 2, b"\x10\x01") + said("behind", 0x80, b"\x05\x01"),
        said("behind", 3, b"\x10\x02\x07\x08") + said("behind", 0x80, b"\x05\x00"),
        said("behind", 3, b"\x10\x02\x07\x08") + said("behind", 0x80, b"\x05\x02"),
        said("behind", 3, b"\x10\x03\x07\x08"),
        said("behind", 0x80, b"\x05"),
        said("behind", 3, b"\x10\x02\xfa\xaf") + said("behind", 0x80, b"\x00" * 38),
    ],
    "apart": [
        said("apart", 0x82, b"\x10\x01") + said("apart", 0x02, b"\x00\x2a"),
        said("apart", 0x82, b"\x10\x03") + said("apart", 0x02, b"\x01\x2a\x2b\x2c"),
        said("apart", 0x83, b"\x10\x07") + said("apart", 0x03, b"\x00\x01\x02\x03"),
        said("apart", 0x84, b"\x07\x01\x08\x02", 0),
        said("apart", 0x84, b"\x07\x01") + said("apart", 0x04, b"\x02\x01\x02\x03"),
        said("apart", 0x85) + said("apart", 0x05, b"\x00\x01\x02\x03"),
        said("apart", 0x85) + said("apart", 0x05, b"\x00\x01"),
        said("apart", 0x83, b"\x10\x07\x08\x09", 2) + said("apart", 0x02, b""),
    ],
    "heads": [
        said("heads", 2, b"\x10\x02") + said("heads", 2, b"\x07\x09", back=True),
        said("heads", 2, b"\x10\x02", 255) + said("heads", 2, b"\x07\x09", back=True),
        said("heads", 3, b"\x10\x05\x1c") + said("heads", 3, b"\x02", back=True),
        said("heads", 3, b"\x10\xfa\xaf") + said("heads", 3, b"\x00", back=True),
        said("heads", 3, b"\x10\x08") + said("heads", 3, b"", back=True),
        said("heads", 1) + said("heads", 1, b"\x00", back=True),
        said("heads", 1, b"\x01") + said("heads", 9, b"\x00", back=True),
        said("heads", 9, b"\x01") + b"\x05\x1c\x05",
    ],
}


@pytest.mark.parametrize("name", FORMS)
@given(data=st.data())
def test_columns_say_what_the_oracle_says_of_every_form(name: str, data: st.DataObject) -> None:
    protocol = FORMS[name]
    talk = data.draw(st.lists(st.sampled_from(TALK[name]), max_size=8).map(b"".join))
    talk = data.draw(st.one_of(st.just(talk), damaged(talk)))
    chunks = data.draw(chunked(talk, byte_time_ns(115200), protocol.tail_ns))
    parts = batches(Decoder(protocol), [chunks])
    got, want = records(parts), Reference(protocol).decode(chunks)
    assert got.frames == want.frames
    assert got.transactions == want.transactions
    assert got.samples == want.samples
    one = batches(Decoder(protocol), [[c] for c in chunks])
    assert records(one) == got
    assert gaps(one) == gaps(parts)
    for b in parts:
        for i in range(len(b.frames)):
            raw, row = b.data[int(b.frames.start[i]) : int(b.frames.end[i])], view(b.frames, i)
            json.dumps(protocol.fields(raw, row))
            ends = [*itertools.accumulate(s.length for s in protocol.dissect(raw, row))]
            assert ends[-1] == len(raw)
            for checksum, covered, sent in [protocol.checksum_of(raw)]:
                assert checksum(covered) == sent


def heard(name: str, data: bytes) -> Any:
    decoder = Decoder(FORMS[name])
    return decoder.feed(Chunk(data)), decoder.close()


def told(name: str, data: bytes) -> tuple[list[str], list[tuple[int, str, int]]]:
    """Return the outcomes of exchanges, and (servo, register, raw) of what became true."""
    out, values = [], []
    for b in heard(name, data):
        out += [OUTCOMES[k] for k in b.transactions.outcome]
        rows = zip(b.values.servo_id, b.values.register, b.values.raw, strict=True)
        values += [(int(s), FORMS[name].registers[r].name, int(x)) for s, r, x in rows]
    return out, values


def test_a_packet_without_a_length_is_as_long_as_all_others() -> None:
    # move 5 to 120 degrees in 2 s, then read 3: users' notes of the serial protocol
    move, ask = bytes.fromhex("FAAF0501786400 00E2ED"), bytes.fromhex("FAAF03020000000005ED")
    answer = said("ubtech", 0xAA, b"\x00\x5a\x00\x5a", 3)
    assert told("ubtech", move + ask + answer) == (
        ["not_expected", "ok"],
        [(5, "goal", 120), (5, "time", 100), (3, "target_angle", 90), (3, "actual_angle", 90)],
    )
    (gap,) = UBTECH.explain(ask[:-1] + b"\xee", 0)
    assert (gap.reason, gap.length) == ("damaged", 10)


def test_an_answer_may_have_its_error_behind_the_data_and_a_space_of_its_own() -> None:
    outcomes, values = told("behind", TALK["behind"][0] + TALK["behind"][3])
    assert outcomes == ["ok", "ok"]
    assert values[0] == (7, "far", 0x2A)
    frames = heard("behind", TALK["behind"][3])[0].frames
    assert frames.status.tolist() == [-1, 2]


def test_a_code_with_a_bit_less_answers_and_each_target_is_read_as_it_stands() -> None:
    outcomes, values = told("apart", b"".join(TALK["apart"][:1]) + TALK["apart"][3])
    assert outcomes == ["ok", "not_expected"]
    assert values == [
        (1, "goal", 0x2A), (1, "goal", 7), (1, "time", 1), (2, "goal", 8), (2, "time", 2),
    ]  # fmt: skip


def test_a_header_of_their_own_tells_answers_and_torn_ones_are_told_by_it() -> None:
    ask, answer = said("heads", 2, b"\x10\x02"), said("heads", 2, b"\x07\x09", back=True)
    outcomes, values = told("heads", ask + answer)
    assert (outcomes, values) == (["ok"], [(1, "goal", 7), (1, "time", 9)])
    (gap,) = HEADS.explain(answer[:-1] + b"\x00", 0)
    assert (gap.reason, gap.length, gap.detail["fields"]["op"]) == ("damaged", len(answer), "read")


@pytest.mark.parametrize("name", FORMS)
@given(data=st.data())
def test_damage_of_every_form_is_told_alike_in_columns_and_in_words(
    name: str, data: st.DataObject
) -> None:
    protocol = FORMS[name]
    torn = st.builds(lambda raw, n: raw[:n], st.sampled_from(TALK[name]), st.integers(1, 20))
    run = data.draw(st.lists(torn, min_size=1, max_size=5).map(b"".join).flatmap(damaged))
    if not run:
        return
    whole = np.frombuffer(run, np.uint8)
    got = pieces(protocol, whole, np.array([0]), np.array([len(run)]))
    told = [(g.start, g.length, g.detail.get("fields", {})) for g in protocol.explain(run, 0)]
    assert [*zip(got.start, got.end - got.start, strict=True)] == [(s, n) for s, n, _ in told]
    assert [max(int(s), -1) for s in got.servo_id] == [f.get("servo_id", -1) for _, _, f in told]
