"""What is damaged on the line, by whom and when, and what else is said there."""

from __future__ import annotations

from typing import Final

from sniffer.diagnosis.rules.line import (
    bits,
    crossings,
    damaged,
    drift,
    ends,
    foreign,
    held,
    masters,
    motors,
    rates,
    rhythms,
    strays,
    streams,
    unknown,
)

PARTS: Final = (
    bits,
    crossings,
    damaged,
    drift,
    ends,
    foreign,
    held,
    masters,
    motors,
    rates,
    rhythms,
    strays,
    streams,
    unknown,
)
