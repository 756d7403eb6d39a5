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

from sniffer.diagnosis.physics.uart import BITS, HIGH, LOW, received, sent

REACH: Final = 3
"""Bytes at an end that a driver may take: who takes more leaves too little to know the frame by."""

HEAD: Final = 8
"""First bytes in which a receiver that took a bit for a start bit finds a true one again."""

WITHIN: Final = 0.25
"""Where in a bit a driver comes on: later in it the bit is not seen, which is as on in the next."""

DATA_BITS: Final = BITS - 2


def with_begin(got: bytes, known: bytes) -> frozenset[bytes]:
    """Return what was meant if bytes lack the first bits of a frame that begins as a known one."""
    return frozenset(
        known[:n] + got[len(heard) :]
        for heard, n in _begun_late(known[:HEAD], is_whole=len(known) <= HEAD)
        if got.startswith(heard)
    )


@functools.lru_cache(maxsize=1 << 12)
def _begun_late(head: bytes, *, is_whole: bool) -> frozenset[tuple[bytes, int]]:
    """Return what is heard, up to where it is right again, of bytes that are driven from a bit on.

    With each goes how many of the bytes that is. ``is_whole``: nothing is sent behind them, so that
    what never is right again is known, too.
    """
    edges = sent(head)
    out = set[tuple[bytes, int]]()
    for k in range(BITS * min(REACH, len(head) - 1)):
        since = k + WITHIN
        before = [level for t, level in edges if t <= since]
        if not before or before[-1] == HIGH:
            continue
        driven = [(since, LOW), *(edge for edge in edges if edge[0] > since)]
        bytes_heard = received(driven)
        right = next((n for n, b in enumerate(bytes_heard) if not b.t % BITS), None)
        heard = bytes(b.value for b in bytes_heard[:right])
        if right is not None:
            out.add((heard, round(bytes_heard[right].t) // BITS))
        elif is_whole:
            out.add((heard, len(head)))
    # up to where the line is high anyway
    out.update((b"", n) for n in range(1, min(REACH, len(head) - 1) + 1))
    return frozenset(out)


def lacks_end(got: bytes, meant: bytes) -> bool:
    """Tell whether bytes are what is heard of a frame whose last bits nobody drives."""
    whole = len(got) - 1
    is_end = len(meant) - REACH < len(got) <= len(meant)
    return is_end and got[:whole] == meant[:whole] and got[whole] in let_go(meant[whole])


def lacks_bytes(got: bytes, meant: bytes) -> bool:
    """Tell whether the last few bytes of a frame are missing, and nothing else."""
    return 0 < len(meant) - len(got) <= REACH and meant.startswith(got)


@functools.lru_cache(maxsize=256)
def let_go(byte: int) -> frozenset[int]:
    """Return what is heard of a byte from one of whose bits on nobody drives the line."""
    return frozenset((byte | 0xFF << k) & 0xFF for k in range(DATA_BITS)) - {byte}


@functools.lru_cache(maxsize=256)
def before_let_go(byte: int) -> frozenset[int]:
    """Return what a checksum may have been from one of whose bits on nobody drove the line.

    Its last bit alone says nothing: the last bit of any byte before it makes a sum wrong so.
    """
    may_be = (one for one in range(byte) if (one ^ byte).bit_count() > 1)
    return frozenset(one for one in may_be if byte in let_go(one))
