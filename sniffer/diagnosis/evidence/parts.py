"""In which of several equal parts of the time something was: what grows is told part by part."""

from __future__ import annotations

from typing import TYPE_CHECKING

import numpy as np

if TYPE_CHECKING:
    from sniffer.ground.model import I64


def part_of(t_ns: I64, first_ns: int, last_ns: int, count: int) -> I64:
    """Return the number of the part that each moment is in; one outside is in the nearest."""
    found: I64 = (t_ns - first_ns) * count // max(last_ns + 1 - first_ns, 1)
    return np.clip(found, 0, count - 1)
