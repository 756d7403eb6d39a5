"""The baud rates at which somebody may speak: those in common use, and those of the protocols."""

from __future__ import annotations

from typing import Final

from sniffer.protocols import PROTOCOLS

COMMON: Final = (
    1200, 2400, 4800, 9600, 19200, 38400, 57600, 115200, 230400, 250000, 460800, 500000, 921600,
    1000000,
)  # fmt: skip
"""Rates of serial ports."""


def rates_in_use() -> list[int]:
    """Return the rates, from the slowest on."""
    return sorted({*COMMON, *(b for name in PROTOCOLS.built_in for b in PROTOCOLS[name].bauds)})
