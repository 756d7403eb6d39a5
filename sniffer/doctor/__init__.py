"""Is this port fit to be recorded from? Verdicts on what was heard in a few seconds.

Each verdict has its numbers and, where something is wrong, what to do. Reads and facts in, verdicts
out: nothing here opens a port.
"""

from __future__ import annotations

from typing import TYPE_CHECKING

from sniffer.doctor.adapter import about_adapter, about_echo
from sniffer.doctor.line import about_bytes, about_line
from sniffer.doctor.reads import about_reads
from sniffer.doctor.records import Finding, Level, Listened, Trial
from sniffer.doctor.understanding import Understanding, understand, usual_bauds

if TYPE_CHECKING:
    from collections.abc import Sequence

__all__ = [
    "Finding",
    "Level",
    "Listened",
    "Trial",
    "Understanding",
    "about_echo",
    "diagnose",
    "understand",
    "usual_bauds",
    "worst",
]


def diagnose(heard: Listened) -> list[Finding]:
    """Return the verdicts, from the plug to the times."""
    found = understand(heard.chunks, heard.protocol, heard.line_baud)
    return [
        *about_adapter(heard),
        *about_bytes(heard, found),
        *about_line(heard, found),
        *about_reads(heard, found),
    ]


def worst(verdicts: Sequence[Finding]) -> Level:
    """Return the gravest level."""
    return max((v.level for v in verdicts), default=Level.OK)
