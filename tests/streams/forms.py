"""Forms of packets that a declaration may have, and talk of each: small families of our own."""

from __future__ import annotations

from typing import Any, Final

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
    Int32sb,
    Struct,
    Terminated,
    this,
)

from sniffer.ground.checksums import COMPLEMENT_SUM, SUM8, SUM16, XOR8
from sniffer.ground.crc import Crc8, Crc16
from sniffer.ground.registers import RegisterMap
from sniffer.protocols.packets import (
    ANY,
    BY_CODE,
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
NAMED: Final = Struct("address" / Byte, Terminated)
NAMES_IT: Final = Struct("address" / Byte, "data" / GreedyBytes)
BYTE: Final = Struct("goal" / Byte, Terminated)
ALL: Final = Struct("data" / GreedyBytes)
ERROR: Final = "error" / FlagsEnum(Byte, hot=1, refused=2)
STATUS: Final = Struct("status" / Byte, Terminated)
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
# Answers with a header of their own, and the code of their request; the id behind the length, a
# sum of two bytes, the high one first.
HEADS: Final = member(
    "heads",
    Packet(
        HEAD,
        "code" / Byte,
        "length" / Byte * "id and parameters",
        Check((this.length >= 1) & (this.length <= 30)),
        "servo_id" / Byte,
        "params" / Bytes(this.length - 1),
        "checksum" / Seal(Int16ub, SUM16, "header", "code", "length", "servo_id", "params"),
    ),
    {
        1: Command("ping", EMPTY, MUST),
        2: Command("read", READ, MUST, feedback=Struct("data" / GreedyBytes)),
        3: Command("write", WRITE, MUST),
        4: Command("get", NAMED, MUST, answer=ANY, stride=0x10, feedback=NAMES_IT),
        5: Command("put", WRITE, MUST, stride=0x10),
        6: Command("move", BYTE, MUST, at=0x10, answer=4, answer_at=0x20, feedback=ALL),
        8: Command("stream", EMPTY, NEVER, answer=4, answer_at=0x20, feedback=ALL),
    },
    Struct(ERROR, Terminated),
    answer_header=b"\x05\x1c",
    silent=(255,),
    most=30,
)
# A check of the data that is not there without data, answers told by their count or by being the
# request once more, and registers both in what is asked and in what is answered.
SOME: Final = member(
    "some",
    Packet(
        "header" / Const(b"\x3e"),
        "code" / Byte,
        "servo_id" / Byte,
        "length" / Byte,
        Check(this.length <= 20),
        "front" / Seal(Byte, SUM8, "header", "code", "servo_id", "length"),
        "params" / Bytes(this.length),
        "sum" / Seal(Byte, SUM8, "params", some=True),
    ),
    {
        0x80: Command("off", EMPTY, MUST, repeats=True),
        0x31: Command("set", BYTE, MUST, at=0x10, repeats=True),
        0x9C: Command("state", EMPTY, MUST, answer=4, answer_at=0x20),
        0xA1: Command("move", BYTE, MUST, at=0x10, answer=4, answer_at=0x20),
        0xA2: Command("push", BYTE, NEVER, at=0x11),
    },
    ALL,
    echoes=True,
    silent=(0,),
    most=20,
)
# No length at all: only the code tells it, of requests and of answers, which have another header.
SIZED: Final = member(
    "sized",
    Packet(
        "header" / Const(b"\xfa"),
        "servo_id" / Byte,
        "code" / Byte,
        "params" / Bytes(BY_CODE),
        "sum" / Seal(Byte, SUM8, "header", "servo_id", "code", "params"),
    ),
    {
        0x30: Command("read_angles", EMPTY, MUST, answer=4, at=0x20),
        0xF3: Command("enable", BYTE, MUST, at=0x10, feedback=STATUS),
        0xF6: Command("move", Struct("goal" / Byte, "time" / Byte), MUST, at=0x10, feedback=STATUS),
        0xF7: Command("stop", EMPTY, NEVER),
        0xF8: Command("stream", EMPTY, NEVER, answer=4, answer_at=0x20),
        0xFD: Command("travel", BYTE, MUST, at=0x10, feedback=STATUS, later={"status": (2, 3)}),
        0xFE: Command(
            "seek",
            BYTE,
            MUST,
            at=0x10,
            answer=4,
            answer_at=0x20,
            feedback=Struct(ERROR, "data" / GreedyBytes),
            later={"error": (2,)},
        ),
    },
    ALL,
    answer_header=b"\xfb",
    silent=(0,),
)
# Motor controllers of the VESC kind (CubeMars AK in servo mode): no id, a CRC whose high byte is
# the first, and a byte behind it.
VESC: Final = member(
    "vesc",
    Packet(
        "header" / Const(b"\x02"),
        "length" / Byte,
        Check((this.length >= 1) & (this.length <= 40)),
        "code" / Byte,
        "params" / Bytes(this.length - 1),
        "crc" / Seal(Int16ub, Crc16(0x1021), "code", "params"),
        Const(b"\x03"),
    ),
    {
        0x04: Command("get_values", EMPTY, MUST, answer=4, at=0x20),
        0x09: Command("set_pos", Struct("angle" / Int32sb, Terminated), NEVER, at=0x10),
        0x0B: Command("set_detect", BYTE, NEVER),
        0x16: Command("rotor_position", EMPTY, NEVER, answer=4, answer_at=0x20),
    },
    ALL,
    echoes=True,
    sole_id=0,
    most=40,
)
# A CRC of eight bits, turned round, in front of what it covers; and one of the data that begins
# from a seed, has its high byte first, and is not there without data.
SEEDED: Final = member(
    "seeded",
    Packet(
        "header" / Const(b"\x05"),
        "small" / Seal(Byte, Crc8(0x31, reflected=True), "servo_id", "length", "code"),
        "servo_id" / Byte,
        "length" / Byte,
        Check(this.length <= 20),
        "code" / Byte,
        "params" / Bytes(this.length),
        "crc" / Seal(Int16ub, Crc16(0x8005, 0xFFFF, reflected=True), "params", some=True),
    ),
    {0x02: Command("read", READ, MUST), 0x03: Command("write", WRITE, NEVER)},
    Struct("code" / Const(b"\x80"), ERROR, "data" / GreedyBytes),
    most=20,
)
FORMS: Final[dict[str, Any]] = {
    "vesc": VESC,
    "seeded": SEEDED,
    "sized": SIZED,
    "some": SOME,
    "ubtech": UBTECH,
    "behind": BEHIND,
    "apart": APART,
    "heads": HEADS,
}


def said(name: str, code: int, params: bytes = b"", who: int = 1, *, back: bool = False) -> bytes:
    """Build a packet with the grammar."""
    more = {"apart": len(params) // 2 - len(params), "heads": 1, "vesc": 1}.get(name, 0)
    length = len(params) + more
    body = {"servo_id": who, "length": length, "code": code, "params": params, "spare": 9}
    family = FORMS[name].family
    return bytes((family.answering if back else family.packet).build(body))
