"""Times with few decimal places: what is written says how well a moment is known.

Each line is judged by its own digits, never by those of others: whoever reads a part of a file says
of it what the whole file says. Whether a logger cuts digits off or rounds them nobody knows, so a
time is left as it is written, and a moment may be away from it by one of its last digit.
"""

from __future__ import annotations

import functools
from typing import Final

from sniffer.ground.model import NS, Mark, MarkKind

FINE: Final = 6
"""Decimal places of seconds from which on times are as fine as any host stamps them."""


@functools.lru_cache(1 << 12)
def coarse(size: int, places: int) -> tuple[Mark, ...]:
    """Return what is said of the time of ``size`` bytes that is written with so many places."""
    if places >= FINE or not size:
        return ()
    return (Mark(MarkKind.COARSE, 0, size, NS // 10**places),)
