"""A seeded generator of plausible bus traffic whose truth is known, damage included.

``simulate`` yields timed frames and does no I/O; ``render`` writes them down as recording tools do;
``python -m sniffer.simulation.captures`` makes the sample captures.
"""

from __future__ import annotations

from sniffer.simulation.buses import BUSES, simulate
from sniffer.simulation.faults import FAULTS, LINE_FAULTS, Fault
from sniffer.simulation.talk import TrueFrame

__all__ = ["BUSES", "FAULTS", "LINE_FAULTS", "Fault", "TrueFrame", "simulate"]
