"""What is counted and measured of a capture, in bounded memory: figures and curves, no verdicts."""

from __future__ import annotations

from sniffer.statistics.sink import Statistics

__all__ = ["Statistics"]
