"""Who answers whom, who does not, and who answers as well."""

from __future__ import annotations

from typing import Final

from sniffer.diagnosis.rules.pairing import (
    absences,
    alike,
    bare,
    bends,
    collisions,
    counting,
    outages,
    silent,
    unanswered,
    unasked,
    waking,
)

PARTS: Final = (
    absences,
    alike,
    bare,
    bends,
    collisions,
    counting,
    outages,
    silent,
    unanswered,
    unasked,
    waking,
)
