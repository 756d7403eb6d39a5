"""Makerbase MKS talk, labelled: examples of the RS-485 manual, and the table."""

from __future__ import annotations

from typing import Final

from sniffer.ground.checksums import SUM8
from sniffer.testing import Exchange, Talk
from tests.talks import due, stated, unanswered

MODEL: Final = "examples/protocols/mks/servo42d.toml"
READS: Final = {  # command: name, whether the table has what is answered, that
    0x30: ("read_encoder", True, bytes.fromhex("FFFFFFFF2269")),
    0x31: ("read_axis", False, bytes.fromhex("FFFFFFFFFFF0")),
    0x32: ("read_speed", True, bytes.fromhex("FED4")),
    0x33: ("read_pulses", True, bytes.fromhex("00000C80")),
    0x35: ("read_raw_axis", False, bytes.fromhex("000000013FF0")),
    0x39: ("read_error", True, bytes.fromhex("FFFFFF72")),
    0x3A: ("read_enable", True, b"\1"),
    0x3B: ("read_zero_status", True, b"\1\2"),
    0x3E: ("read_stall", True, b"\0"),
    0xF1: ("read_status", True, b"\4"),
}
SETS: Final = {
    0x82: ("set_mode", b"\5"),
    0x84: ("set_subdivisions", b"\x10"),
    0x85: ("set_en_level", b"\2"),
    0x86: ("set_direction", b"\1"),
    0x88: ("set_stall_protection", b"\1"),
    0x8A: ("set_baud", b"\6"),
    0x8C: ("set_respond", b"\1\0"),
    0x9B: ("set_holding_current", b"\4"),
    0x9D: ("set_position_protection", bytes.fromhex("01001436B0")),
    0xF3: ("enable", b"\1"),
}
ACTS: Final = {
    0x3D: ("release_stall", b""),
    0x41: ("restart", b""),
    0x80: ("calibrate", b"\0"),
    0x92: ("set_zero", b""),
    0xF7: ("emergency_stop", b""),
}
MOVES: Final = {
    0xF4: ("move_axis_by", bytes.fromhex("02580200004000")),
    0xF5: ("move_axis_to", bytes.fromhex("02580200004000")),
    0xF6: ("run", bytes.fromhex("028002")),
    0xFD: ("move_pulses_by", bytes.fromhex("02800200001000")),
    0xFE: ("move_pulses_to", bytes.fromhex("02580200000C80")),
}


def packet(who: int, code: int, data: bytes = b"", head: int = 0xFA) -> bytes:
    """Put a packet together."""
    body = bytes([head, who, code]) + data
    return body + bytes([SUM8(body)])


def answer(who: int, code: int, data: bytes) -> bytes:
    """Put an answer together."""
    return packet(who, code, data, 0xFB)


def read(who: int, code: int, data: bytes | None = None) -> Exchange:
    """Ask for what a command is about."""
    name, is_known, usual = READS[code]
    told = usual if data is None else data
    values = stated(MODEL, code * 16, told) if is_known else {}
    return Exchange(name, packet(who, code), (answer(who, code, told),), values, ())


def set_(who: int, code: int) -> Exchange:
    """Bring a setting."""
    name, data = SETS[code]
    values = stated(MODEL, code * 16, data)
    return Exchange(name, packet(who, code, data), (answer(who, code, b"\1"),), values, ())


def act(who: int, code: int) -> Exchange:
    """Say a command about no register."""
    name, data = ACTS[code]
    return Exchange(name, packet(who, code, data), (answer(who, code, b"\1"),), {}, ())


def move(who: int, code: int, result: bytes = b"\2") -> Exchange:
    """Send a motor somewhere: it says that it begins, and that it is there, or at a limit (3)."""
    name, data = MOVES[code]
    done = (answer(who, code, result),)
    values = stated(MODEL, code * 16, data)
    request, begun = packet(who, code, data), (answer(who, code, b"\1"),)
    return Exchange(name, request, begun, values, (), later=done)


def to_all(code: int, name: str, data: bytes) -> Exchange:
    """Say it to all motors; none answers."""
    return Exchange(name, packet(0, code, data), (), stated(MODEL, code * 16, data, 0), ())


def renamed(who: int, new: int) -> Exchange:
    """Give a motor another address; it answers under that."""
    said = {"servo_id": new}
    request, told = packet(who, 0x8B, bytes([new])), answer(new, 0x8B, b"\1")
    return Exchange("set_address", request, (told,), said, ())


SAID: Final = [
    *(read(who, code) for who in (1, 2) for code in READS),
    *(set_(who, code) for who in (1, 2) for code in SETS),
    *(act(who, code) for who in (1, 2) for code in ACTS),
    *(move(1, code) for code in MOVES),
    *(move(2, code, b"\2" if code == 0xF6 else b"\3") for code in MOVES),
    to_all(0xF3, *SETS[0xF3]),
    to_all(0xFE, *MOVES[0xFE]),
    renamed(1, 3),
    Exchange("restore", packet(2, 0x3F), (answer(1, 0x3F, b"\1"),), {}, ()),
    read(3, 0x33, packet(1, 0x3E)),
    read(3, 0x30, b"\xfa\1\2\3\4\xfa"),
    read(3, 0x39, b"\0\0\xfa\xfa"),
]

TALK: Final = Talk(
    due(SAID, "read_*"),
    unanswered(SAID, "[!r]*", "run", "re[ls]*"),
    ambiguous={
        # The sum of that answer is FA: where it is cut off, the next request brings it.
        "answer cut: move_pulses_by": 1,
        # A packet within the data of one that is torn is a packet.
        "answer cut: read_pulses": 2,
        "answer damaged: read_pulses": 3,
        "silence inside: read_pulses": 4,
    },
    absent={
        "* one byte *": "the code tells how many bytes a packet has",
        "an unknown command": "nobody knows how many bytes it has",
        "a scene: staged, then released": "nothing is staged",
        "a reset that keeps the id": "there is none",
        "*, part": "no command is about half a number",
        "*, low byte": "no command is about half a number",
        "*, high byte": "no command is about half a number",
        "a write that *s b* servo_id": "no command is about more than the id",
    },
)
