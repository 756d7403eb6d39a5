"""A frame of which nobody drives the first bits, or the last ones, as a UART hears it.

A line that nobody drives is high. A driver that is on too late takes the beginning: where a start
bit is gone, the next low bit is taken for it. One that is off too early leaves ones at the end::

    meant                    FD DF 04 00     2A 34 51 44 31 0D
    first bit missing        7F 47 00
    first byte missing       DF 04 00
    last four bits missing                   2A 34 51 44 31 FD
"""

from __future__ import annotations

import functools
from typing import Final

from sniffer.diagnosis.physics.uart import BITS, HIGH, received, sent

REACH: Final = 3
"""Bytes at an end that a driver may take: who takes more leaves too little to know the frame by."""

FINE: Final = 4
"""Parts of a bit by which a driver may be on later."""

DATA_BITS: Final = BITS - 2


def lacks_begin(got: bytes, meant: bytes) -> bool:
    """Tell whether bytes are what is heard of a frame whose first bits nobody drives."""
    head = meant[: REACH + 1]
    size = len(got) - (len(meant) - len(head))
    return size >= 0 and got[size:] == meant[len(head) :] and got[:size] in _begun_late(head)


@functools.lru_cache(maxsize=1 << 10)
def _begun_late(head: bytes) -> frozenset[bytes]:
    """Return what is heard of first bytes that are driven from some bit on, but as they are."""
    edges = sent(head)
    out = set[bytes]()
    for k in range(1, FINE * BITS * min(REACH, len(head)) + 1):
        since = k / FINE
        before = [level for t, level in edges if t <= since]
        behind = [edge for edge in edges if edge[0] > since]
        level = before[-1] if before else HIGH
        out.add(bytes(byte.value for byte in received([(since, level), *behind])))
    return frozenset(out - {head})


def lacks_end(got: bytes, meant: bytes) -> bool:
    """Tell whether bytes are what is heard of a frame whose last bits nobody drives."""
    whole = len(got) - 1
    if whole >= 0 and len(got) > len(meant) - REACH and got[:whole] == meant[:whole]:
        return got != meant[: len(got)] and got[whole] in let_go(meant[whole])
    return False


def lacks_bytes(got: bytes, meant: bytes) -> bool:
    """Tell whether the last few bytes of a frame are missing, and nothing else."""
    return 0 < len(meant) - len(got) <= REACH and meant.startswith(got)


def let_go(byte: int) -> frozenset[int]:
    """Return what is heard of a byte from one of whose bits on nobody drives the line."""
    return frozenset((byte | 0xFF << k) & 0xFF for k in range(DATA_BITS)) - {byte}


def before_let_go(byte: int) -> frozenset[int]:
    """Return what a byte may have been from one of whose bits on nobody drove the line."""
    return frozenset(one for one in range(byte) if byte in let_go(one))
