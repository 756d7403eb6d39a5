"""Dongbu Robot HerkuleX (DRS-0101 and DRS-0201): every packet of both directions, declared once.

    FF FF | SIZE | ID | CMD | CHECKSUM 1 | CHECKSUM 2 | DATA ...

The checksums stand before the data; the second is the first one inverted. An answer (ACK) has the
command of its request plus 40 (hex), and its last two bytes are the servo's state. A read is
answered with address and length once more. There are two spaces of registers that both begin at 0:
here those of EEP have 100 (hex) added. Source: DRS-0101 / DRS-0201 user manual: 4-1 (packet), 5
(commands), 6 (examples), Status Error and Status Detail.
"""

from __future__ import annotations

from pathlib import Path
from typing import Final

from construct import (
    Byte,
    Bytes,
    Check,
    Const,
    FlagsEnum,
    GreedyRange,
    Int16ul,
    Struct,
    Terminated,
    this,
)

from sniffer.ground.checksums import COMPLEMENT_EVEN, XOR_EVEN
from sniffer.ground.registers import RegisterMap
from sniffer.protocols.packets import (
    IF_ALL,
    IF_READ,
    MANY,
    MUST,
    RESETS,
    Command,
    Member,
    Packet,
    PacketFamily,
    Seal,
)

BROADCAST: Final = 0xFE
EEP: Final = 0x100
"""Added to the addresses of the EEP space, which begin at 0 as those of RAM do."""

JOGS: Final = 0x200
"""The address here of what a JOG brings; the wire knows none."""

MOST: Final = 223
"""A longer packet may not be recognised. Source: 4-1, Packet Size."""

PACKET: Final = Packet(
    "header" / Const(b"\xff\xff"),
    "size" / Byte * "bytes of the packet, from the header on",
    Check((this.size >= 7) & (this.size <= MOST)),
    "servo_id" / Byte * "0..253 a servo, 254 all of them",
    Check(this.servo_id != 255),
    "code" / Byte * "command; an answer has that of its request plus 40",
    "checksum1" / Seal(Byte, XOR_EVEN, "size", "servo_id", "code", "data"),
    "checksum2" / Seal(Byte, COMPLEMENT_EVEN, "checksum1"),
    "data" / Bytes(this.size - 7),
)

ERROR: Final = FlagsEnum(
    Byte,
    input_voltage=1 << 0,
    allowed_pot=1 << 1,
    temperature=1 << 2,
    invalid_packet=1 << 3,
    overload=1 << 4,
    driver_fault=1 << 5,
    eep_distorted=1 << 6,
)
DETAIL: Final = FlagsEnum(
    Byte,
    moving=1 << 0,
    in_position=1 << 1,
    checksum=1 << 2,
    unknown_command=1 << 3,
    register_range=1 << 4,
    garbage=1 << 5,
    motor_on=1 << 6,
)
STATE: Final = ("error" / ERROR, "detail" / DETAIL)

ACK: Final = Struct(*STATE, Terminated)
READ_ACK: Final = Struct(
    "address" / Byte, "length" / Byte, "data" / Bytes(this.length), *STATE, Terminated
)

EMPTY: Final = Struct(Terminated)
READ: Final = Struct("address" / Byte, "length" / Byte, Terminated)
WRITE: Final = Struct(
    "address" / Byte, "length" / Byte, "data" / Bytes(this.length), Check(this.data), Terminated
)
JOG: Final = ("jog" / Int16ul, "set" / Byte, "servo_id" / Byte)
I_JOG: Final = Struct(
    "targets" / GreedyRange(Struct(*JOG, "play_time" / Byte)), Check(this.targets), Terminated
)
S_JOG: Final = Struct(
    "play_time" / Byte, "targets" / GreedyRange(Struct(*JOG)), Check(this.targets), Terminated
)
ROLLBACK: Final = Struct("id_skip" / Byte, "baud_skip" / Byte, Terminated)

FAMILY: Final = PacketFamily(
    name="herkulex",
    title="Dongbu Robot HerkuleX",
    bauds=(57600, 115200, 200000, 250000, 400000, 500000, 666666),
    baud=115200,
    packet=PACKET,
    # Replies follow the ACK policy (0: STAT only, 1: also reads, 2: all).
    commands={
        0x01: Command("eep_write", WRITE, IF_ALL, space=EEP),
        0x02: Command("eep_read", READ, IF_READ, space=EEP, feedback=READ_ACK),
        0x03: Command("ram_write", WRITE, IF_ALL),
        0x04: Command("ram_read", READ, IF_READ, feedback=READ_ACK),
        0x05: Command("i_jog", I_JOG, IF_ALL, at=JOGS),
        0x06: Command("s_jog", S_JOG, IF_ALL, at=JOGS),
        0x07: Command("stat", EMPTY, MUST, to_all=MANY),
        0x08: Command("rollback", ROLLBACK, IF_ALL),
        0x09: Command("reboot", EMPTY, IF_ALL, RESETS),
    },
    feedback=ACK,
    answer_code=lambda code: code + 0x40,
    models=(RegisterMap.from_toml(Path(__file__).with_name("drs-0101.toml")),),
    # No source states how long an answer may take; clients wait some milliseconds.
    window_ns=10_000_000,
    most=MOST,
    silent=(BROADCAST,),
    refusals=1 << 3,
    words=("command", "command", "ACK"),
    reports={
        "temperature": "overheating",
        "allowed_pot": "stroke_limit",
        "invalid_packet": "packet_not_processable",
    },
)

PROTOCOL: Final = Member(FAMILY)
