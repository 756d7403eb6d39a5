"""What the controller asks and writes that it should not, and how it waits."""

from __future__ import annotations

from typing import Final

from sniffer.diagnosis.rules.controller import (
    beyond,
    breaking,
    everybody,
    forms,
    goals,
    heads,
    interruptions,
    limited,
    mixups,
    ordered,
    patience,
    rivals,
    scans,
    storms,
    sums,
    texts,
    waits,
    writes,
)

PARTS: Final = (
    beyond,
    breaking,
    everybody,
    forms,
    goals,
    heads,
    interruptions,
    limited,
    mixups,
    ordered,
    patience,
    rivals,
    scans,
    storms,
    sums,
    texts,
    waits,
    writes,
)
