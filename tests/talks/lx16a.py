"""LX-16A talk, labelled: LewanSoul Bus Servo Communication Protocol, and the example's table."""

from __future__ import annotations

from typing import Final

from sniffer.ground.checksums import COMPLEMENT_SUM
from sniffer.testing import Exchange, Talk
from tests.talks import due, stated

MODEL: Final = "examples/protocols/lx16a/lx-16a.toml"
READS: Final = {  # command: name, what it is about, bytes of the answer
    2: ("move_time_read", 1, 4),
    8: ("move_time_wait_read", 8, 4),
    14: ("id_read", 13, 1),
    19: ("angle_offset_read", 17, 1),
    21: ("angle_limit_read", 20, 4),
    23: ("vin_limit_read", 22, 4),
    25: ("temp_max_limit_read", 24, 1),
    26: ("temp_read", 26, 1),
    27: ("vin_read", 27, 2),
    28: ("pos_read", 28, 2),
    30: ("servo_or_motor_mode_read", 29, 4),
    32: ("load_or_unload_read", 31, 1),
    34: ("led_ctrl_read", 33, 1),
    36: ("led_error_read", 35, 1),
}
WRITES: Final = {  # command: name, what it is about, parameters
    1: ("move_time_write", 1, b"\xf4\x01\xe8\x03"),
    7: ("move_time_wait_write", 1, b"\x58\x02\xd0\x07"),
    17: ("angle_offset_adjust", 17, b"\xec"),
    20: ("angle_limit_write", 20, b"\x32\x00\x84\x03"),
    22: ("vin_limit_write", 22, b"\x94\x11\xe0\x2e"),
    24: ("temp_max_limit_write", 24, b"\x50"),
    29: ("servo_or_motor_mode_write", 29, b"\x01\x00\x0c\xfe"),
    31: ("load_or_unload_write", 31, b"\x01"),
    33: ("led_ctrl_write", 33, b"\x01"),
    35: ("led_error_write", 35, b"\x05"),
}
BARE: Final = {11: "move_start", 12: "move_stop", 18: "angle_offset_write"}
HEADER: Final = b"\x55\x55"


def packet(who: int, code: int, params: bytes = b"") -> bytes:
    """Put a packet together."""
    body = bytes([who, len(params) + 3, code]) + params
    return HEADER + body + bytes([COMPLEMENT_SUM(body)])


def read(who: int, code: int, data: bytes) -> Exchange:
    """Ask for what a command is about."""
    name, about, _ = READS[code]
    return Exchange(
        name, packet(who, code), (packet(who, code, data),), stated(MODEL, about * 16, data), ()
    )


def write(who: int, code: int, data: bytes | None = None) -> Exchange:
    """Bring what a command is about; nobody answers."""
    name, about, usual = WRITES[code]
    params = usual if data is None else data
    return Exchange(name, packet(who, code, params), (), stated(MODEL, about * 16, params))


def odd(name: str, code: int, params: bytes) -> Exchange:
    """Say a command with too few or too many parameters."""
    return Exchange(name, packet(1, code, params), None)


TELLS: Final = [
    *(
        read(who, code, bytes(k * 7 + 3 * who for k in range(n)))
        for who in (1, 2)
        for code, (_, _, n) in READS.items()
    ),
    read(1, 28, b"\xce\xff"),
    read(1, 26, b"\x8b"),  # the checksum is 55
    read(3, 28, HEADER),
    read(3, 2, b"\x01" + HEADER + b"\x01"),
    read(3, 2, b"\x01\x02" + HEADER),
    read(3, 2, HEADER + b"\x01\x03"),
    Exchange("id_read", packet(254, 14), (packet(4, 14, b"\x04"),), {(4, "servo_id"): 4}, ()),
]
BRINGS: Final = [
    *(write(who, code) for who in (1, 254) for code in WRITES),
    *(Exchange(name, packet(who, code), (), {}) for who in (1, 254) for code, name in BARE.items()),
    Exchange("id_write", packet(1, 13, b"\x05"), (), {"servo_id": 5}),
    Exchange("unknown_e5", packet(1, 0xE5, b"\x01"), None),
]
ODD: Final = [
    *(
        odd(name, code, b"\x01" * count)
        for code, (name, _, size) in (READS | WRITES | {13: ("id_write", 13, b"\x05")}).items()
        for right in (size if isinstance(size, int) else len(size),)
        for count in {right - 1, right + 1} - {0 if code in READS else -1}
        if count <= 4
    ),
    *(odd(name, code, b"\x01") for code, name in BARE.items()),
]
SCENES: Final = [[write(1, 7), Exchange("move_start", packet(1, 11), (), {})]]

TALK: Final = Talk(
    due([*TELLS, *BRINGS, *ODD], "*"),
    SCENES,
    # A checksum of 55 that is missing is what the next packet begins with: it is taken from there.
    ambiguous={"answer cut: temp_read": 1},
    absent={
        "*_read one byte *": "a read with as many bytes as its answer is the answer",
        "*_write one byte *": "no packet has more than four parameters, or it has none",
        "move_* one byte less": "it has no parameters",
        "*, low byte": "no command is about half a number",
        "*, high byte": "no command is about half a number",
        "a write that * servo_id": "the id has a command of its own",
        "data that hold a whole request": "no data are as long as one",
        "an answer with no data": "the data are what makes it an answer",
        "a reset that *": "there is none",
    },
)
