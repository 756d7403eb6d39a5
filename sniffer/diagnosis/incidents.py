"""Findings to incidents, by bus and in order."""

from __future__ import annotations

from dataclasses import replace
from typing import TYPE_CHECKING

from sniffer.diagnosis.rules import findings

if TYPE_CHECKING:
    from sniffer.diagnosis.case import Case
    from sniffer.diagnosis.model import Incident


def incidents(case: Case) -> list[Incident]:
    """Return the incidents of a bus, by their beginning; numbers count from 1."""
    found = case.once(findings)
    if not found:
        return []
    from sniffer.diagnosis.stories import told  # all weights and causes: a sound bus needs none

    out = sorted(told(case, found), key=lambda i: i.first_ns)
    return [replace(incident, number=n) for n, incident in enumerate(out, 1)]
