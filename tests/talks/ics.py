"""ICS talk, labelled: users' libraries for Kondo ICS 3.5, and the example's table."""

from __future__ import annotations

from typing import Final

from sniffer.testing import Exchange, Talk
from tests.talks import due

READS: Final = {1: "stretch", 2: "speed", 3: "current", 4: "temperature"}
WRITES: Final = {1: "stretch", 2: "speed", 3: "current_limit", 4: "temperature_limit"}


def _wide(value: int) -> bytes:
    return bytes([value >> 7, value & 0x7F])


def position(who: int, goal: int, now: int) -> Exchange:
    """Move a servo; it answers where it is."""
    said, told = bytes([0x80 | who]) + _wide(goal), bytes([who]) + _wide(now)
    return Exchange("position", said, (told,), {"goal_position": goal, "position": now}, ())


def read(who: int, sub: int, value: int) -> Exchange:
    """Read a parameter."""
    told = bytes([0x20 | who, sub, value])
    return Exchange("read", bytes([0xA0 | who, sub]), (told,), {READS[sub]: value}, ())


def write(who: int, sub: int, value: int) -> Exchange:
    """Write a parameter; the answer repeats it."""
    told = bytes([0x40 | who, sub, value])
    return Exchange("write", bytes([0xC0 | who, sub, value]), (told,), {WRITES[sub]: value}, ())


SAID: Final = [
    *(position(who, 7500 + 70 * who, 7499 - who) for who in (1, 2, 31)),
    *(read(who, sub, 9 * sub + who) for who in (1, 2) for sub in READS),
    *(write(who, sub, 7 * sub + who) for who in (1, 2) for sub in WRITES),
    Exchange("read", b"\xa1\x00", (b"\x21\x00" + bytes(k % 16 for k in range(64)),), {}, ()),
    Exchange("read", b"\xa2\x00", (b"\x22\x00" + bytes(64),), {}, ()),
    Exchange("write", b"\xc1\x00" + bytes(k % 16 for k in range(64)), (b"\x41\x00",), {}, ()),
    Exchange("write", b"\xc2\x00" + bytes(64), (b"\x42\x00",), {}, ()),
    Exchange("id", b"\xff\x00\x00\x00", (b"\x65",), {}, ()),
    Exchange("id", b"\xe7\x01\x01\x01", (b"\x67",), {}, ()),
    Exchange("read", b"\xa1\x09", None),
]

TALK: Final = Talk(
    due(SAID, "*"),
    commands=("position", "read", "write", "id"),
    model="krs",
    absent={
        "* one byte less": "a command ends where the next one begins: a shorter one is none",
        "* one byte more": "what stands behind a command is no part of it",
        "a scene: staged, then released": "nothing is staged",
        "a reset that *": "there is none",
        "arranged: answer *": "a reply is one by standing right behind its command",
        "arranged: two in flight": "as above",
        "arranged: a stray byte": "as above",
        "arranged: request damaged": "there is no checksum",
    },
    harmless={
        f"{name}: any {what}": "only what fits stands right behind a command as its reply"
        for name in ("position", "read", "write")
        for what in ("id may answer", "answer fits")
        if (name, what) != ("read", "answer fits")
    },
)
