"""What the tap does to a capture: what it loses, joins, swaps or takes for text."""

from __future__ import annotations

from typing import Final

from sniffer.diagnosis.rules.tap import (
    capture,
    losses,
    remains,
    splices,
    translated,
)

PARTS: Final = (
    capture,
    losses,
    remains,
    splices,
    translated,
)
