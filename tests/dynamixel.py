"""DYNAMIXEL 1.0, the example package's, as a further protocol whose frames others contain.

    FF FF | ID | LENGTH | INSTRUCTION or ERROR | PARAMETER ... | CHECKSUM

A mightyZAP frame less its first FF is one of these, checksum and all.
"""

from __future__ import annotations

import itertools
from typing import TYPE_CHECKING, Final

from hypothesis import strategies as st

from sniffer.protocols.packets import Member
from tests.streams.members import example

if TYPE_CHECKING:
    from collections.abc import Sequence

BROADCAST: Final = 254
PING, READ, WRITE = 1, 2, 3


def packet(servo_id: int, code: int, params: bytes = b"") -> bytes:
    """Return a packet of either direction."""
    body = bytes([servo_id, len(params) + 2, code]) + params
    return b"\xff\xff" + body + bytes([~sum(body) & 255])


class Dynamixel1(Member):
    """The example package's protocol, one more of it each time."""

    def __init__(self) -> None:
        super().__init__(example("dynamixel1").PROTOCOL.family)


def said(exchanges: int, servos: Sequence[int] = (1, 2, 3)) -> bytes:
    """Return reads of some servos with their answers."""
    return b"".join(
        packet(who, READ, b"\x24\x02") + packet(who, 0, (n * 7 % 1024).to_bytes(2, "little"))
        for n, who in zip(range(exchanges), itertools.cycle(servos))
    )


TALK: Final = st.tuples(st.integers(0, 253), st.binary(max_size=6)).map(
    lambda e: packet(e[0], READ, b"\x24\x02") + packet(e[0], 0, e[1])
)
"""One exchange."""
