"""What servos do, measure and say against it."""

from __future__ import annotations

from typing import Final

from sniffer.diagnosis.rules.device import (
    complaints,
    identity,
    joints,
    jumps,
    lagging,
    refusing,
    restarts,
    scatter,
    supply,
    warmth,
)

PARTS: Final = (
    complaints,
    identity,
    joints,
    jumps,
    lagging,
    refusing,
    restarts,
    scatter,
    supply,
    warmth,
)
