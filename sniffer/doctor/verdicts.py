"""Verdicts on what was heard in a few seconds: each has its numbers, and what to do.

Reads and facts in, verdicts out: nothing here opens a port.
"""

from __future__ import annotations

from typing import TYPE_CHECKING

from sniffer.decoding.understanding import understand
from sniffer.doctor.adapter import about_adapter
from sniffer.doctor.line import about_bytes, about_line
from sniffer.doctor.reads import about_reads
from sniffer.doctor.records import Level, Listened, Observation

if TYPE_CHECKING:
    from collections.abc import Sequence


def diagnose(heard: Listened) -> list[Observation]:
    """Return the verdicts, from the plug to the times."""
    found = understand(heard.chunks, heard.protocol, heard.line_baud)
    return [
        *about_adapter(heard),
        *about_bytes(heard),
        *about_line(heard, found),
        *about_reads(heard, found),
    ]


def worst(verdicts: Sequence[Observation]) -> Level:
    """Return the gravest level."""
    return max((v.level for v in verdicts), default=Level.OK)
