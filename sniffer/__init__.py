"""Analyzer for robot-servo buses: decodes, checks, records and plots what is said on the wire."""

from __future__ import annotations

__version__ = "0.1.0"

from sniffer.api import Capture, decode, frames_table, records, samples_table
from sniffer.decoder import Decoder
from sniffer.model import (
    Anomaly,
    Batch,
    Chunk,
    Clock,
    DamagedInputError,
    Direction,
    Frames,
    Gap,
    InputError,
    OutputError,
    Samples,
    Severity,
    SnifferError,
    Transactions,
)
from sniffer.protocols import PROTOCOLS
from sniffer.rows import AnomalyRow, FrameRow, GapRow, SampleRow, TransactionRow

__all__ = [
    "PROTOCOLS",
    "Anomaly",
    "AnomalyRow",
    "Batch",
    "Capture",
    "Chunk",
    "Clock",
    "DamagedInputError",
    "Decoder",
    "Direction",
    "FrameRow",
    "Frames",
    "Gap",
    "GapRow",
    "InputError",
    "OutputError",
    "SampleRow",
    "Samples",
    "Severity",
    "SnifferError",
    "TransactionRow",
    "Transactions",
    "__version__",
    "decode",
    "frames_table",
    "records",
    "samples_table",
]
