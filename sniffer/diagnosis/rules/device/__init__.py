"""What servos do, measure and say against it."""

from __future__ import annotations

from typing import Final

from sniffer.diagnosis.rules.device import (
    bare,
    complaints,
    identity,
    joints,
    jumps,
    refusing,
    restarts,
    scatter,
    supply,
    unasked,
    warmth,
)

PARTS: Final = (
    bare,
    complaints,
    identity,
    joints,
    jumps,
    refusing,
    restarts,
    scatter,
    supply,
    unasked,
    warmth,
)
