"""Is this port fit to be recorded from? Listened to for a few seconds, and judged.

``examine`` opens a port and listens; everything else takes reads and facts, and gives verdicts.
"""

from __future__ import annotations

from sniffer.decoding.understanding import Understanding, understand, usual_bauds
from sniffer.doctor.adapter import about_echo
from sniffer.doctor.examine import Examined, examine, judged, prepare
from sniffer.doctor.records import Level, Listened, Observation, Trial
from sniffer.doctor.verdicts import diagnose, worst

__all__ = [
    "Examined",
    "Level",
    "Listened",
    "Observation",
    "Trial",
    "Understanding",
    "about_echo",
    "diagnose",
    "examine",
    "judged",
    "prepare",
    "understand",
    "usual_bauds",
    "worst",
]
