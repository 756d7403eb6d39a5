"""When things are said: cycles, stalls, slow answers, and lines that were not free yet."""

from __future__ import annotations

from typing import Final

from sniffer.diagnosis.rules.timing import (
    pace,
    slowness,
    soonest,
    timeouts,
)

PARTS: Final = (
    pace,
    slowness,
    soonest,
    timeouts,
)
