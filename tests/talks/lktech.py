"""LK-TECH talk, labelled: packets of the RMD-L manual, of captures and drivers, and the table."""

from __future__ import annotations

from typing import Final

from sniffer.ground.checksums import SUM8
from sniffer.testing import Exchange, Talk
from tests.talks import due, stated

MODEL: Final = "examples/protocols/lktech/lk-mg.toml"
STATE: Final = 0x9C0
MEASURED: Final = bytes.fromhex("19F5FF000026EF")  # as it was captured
READS: Final = {  # command: name, where its answer stands, what is answered
    0x12: ("read_model", -1, bytes(range(58))),
    0x30: ("read_pid", 0x300, b"\x64\x32\x28\x0a\x1e\x0f"),
    0x92: ("read_multi_turn_angle", 0x920, b"\xf0\xd8\xff\xff\xff\xff\xff\xff"),
    0x94: ("read_single_turn_angle", 0x940, b"\x28\x23\x00\x00"),
    0x9C: ("read_state", STATE, MEASURED),
}
AGAIN: Final = {  # command: name, where its data stand, data
    0x31: ("write_pid_ram", 0x300, b"\x64\x32\x28\x0a\x1e\x0f"),
    0x32: ("write_pid_rom", 0x300, b"\x3e\x32\x28\x0a\x1e\x10"),
    0x80: ("motor_off", -1, b""),
    0x81: ("motor_stop", -1, b""),
    0x88: ("motor_run", -1, b""),
}
MOVES: Final = {
    0xA1: ("torque_control", 0xA10, b"\x41\x03"),
    0xA2: ("speed_control", 0xA20, b"\xf0\xd8\xff\xff"),
    0xA3: ("multi_turn_control", 0xA30, b"\xb0\xb9\xff\xff\xff\xff\xff\xff"),
    0xA4: ("multi_turn_control_2", 0xA30, b"\x28\x23\x00\x00\x00\x00\x00\x00\xa0\x8c\x00\x00"),
    0xA5: ("single_turn_control", 0xA50, b"\x01\x28\x23\x00"),
    0xA6: ("single_turn_control_2", 0xA50, b"\x00\x50\x46\x00\xa0\x8c\x00\x00"),
    0xA7: ("increment_control", 0xA70, b"\x18\xfc\xff\xff"),
    0xA8: ("increment_control_2", 0xA70, b"\xe8\x03\x00\x00\xa0\x8c\x00\x00"),
}


def packet(who: int, code: int, data: bytes = b"") -> bytes:
    """Put a packet together."""
    head = bytes([0x3E, code, who, len(data)])
    return head + bytes([SUM8(head)]) + (data + bytes([SUM8(data)]) if data else b"")


def read(who: int, code: int, data: bytes | None = None) -> Exchange:
    """Ask for what a command is about."""
    name, at, usual = READS[code]
    told = usual if data is None else data
    values = stated(MODEL, at, told) if at >= 0 else {}
    return Exchange(name, packet(who, code), (packet(who, code, told),), values, ())


def again(who: int, code: int) -> Exchange:
    """Say what comes back as it was said."""
    name, at, data = AGAIN[code]
    said = packet(who, code, data)
    return Exchange(name, said, (said,), stated(MODEL, at, data) if at >= 0 else {}, ())


def move(who: int, code: int, told: bytes = MEASURED) -> Exchange:
    """Give a goal; what is measured answers."""
    name, at, data = MOVES[code]
    values = stated(MODEL, at, data) | stated(MODEL, STATE, told)
    return Exchange(name, packet(who, code, data), (packet(who, code, told),), values, ())


def odd(code: int, name: str, data: bytes) -> Exchange:
    """Say a command with too few or too many data."""
    return Exchange(name, packet(1, code, data), None)


TELLS: Final = [
    *(read(who, code) for who in (1, 2) for code in READS),
    *(again(who, code) for who in (1, 2) for code in AGAIN),
    *(move(who, code) for who in (1, 2) for code in MOVES),
    read(3, 0x94, b"\x3e\x94\x03\x00"),
    read(3, 0x9C, b"\x00\x3e\x9c\x03\x00\xdd\x3e"),
    move(3, 0xA1, b"\x01\x02\x03\x04\x05\x06\x3e"),
    Exchange("set_origin", packet(1, 0x19), None),
    Exchange("unknown_1f", packet(1, 0x1F), None),
]
ODD: Final = [
    *(
        odd(code, name, data[:-1])
        for code, (name, _, data) in (AGAIN | MOVES).items()
        if data and (len(data) != 8 or code not in MOVES)  # seven data are an answer
    ),
    *(odd(code, name, data + b"\1") for code, (name, _, data) in (AGAIN | MOVES).items()),
    *(odd(code, name, b"\1") for code, (name, _, _) in READS.items()),
    odd(0x19, "set_origin", b"\1"),
]

# A packet that is its own answer is told as one right behind its request, and nowhere else: not
# where another one stands between, nor where the request is torn; of three alike the second is it.
ALONE: Final = {
    "repeated": 2,
    "repeated twice": 2,
    "repeated, lost": 2,
    "answered twice": 2,
    "answer to another command": 4,
    "two in flight": 8,
    "answer late": 2,
    "request damaged": 8,
}
INSIDE: Final = {"write_pid_ram": 24, "write_pid_rom": 24}  # at each byte, a silence

TALK: Final = Talk(
    due([*TELLS, *ODD], "*"),
    ambiguous={f"{what}: {name}": n for what, n in ALONE.items() for name, _, _ in AGAIN.values()}
    | {f"silence inside: {name}": INSIDE.get(name, 10) for name, _, _ in AGAIN.values()}
    # A packet within the data of one that is torn is a packet.
    | {
        "answer cut: read_state": 2,
        "answer damaged: read_single_turn_angle": 2,
        "answer damaged: read_state": 3,
        "silence inside: read_single_turn_angle": 5,
        "silence inside: read_state": 8,
    },
    absent={
        "read_* one byte *": "one byte of data brings its sum, two are more",
        "motor_* one byte *": "one byte of data brings its sum, two are more",
        "set_origin *": "one byte of data brings its sum; what answers it is not known",
        "*_control* one byte less": "seven data are an answer",
        "an answer under another id": "no id addresses others",
        "an answer with one byte of data": "no answer has one",
        "a frame as long as any may be": "no command has 64 data",
        "a frame that ends as the header begins": "no sum here is 3E",
        "a scene: staged, then released": "nothing is staged",
        "a reset that *": "there is none",
        "*, part": "no command is about half a number",
        "*, low byte": "no command is about half a number",
        "*, high byte": "no command is about half a number",
    },
    harmless={
        "motor_off: any id may answer": "its answer is the same packet, and has its id",
        "motor_run: any id may answer": "its answer is the same packet, and has its id",
    },
)
