"""How much something matters, as the messages of a recording have it."""

from __future__ import annotations

from typing import Final

from sniffer.ground.model import Severity
from sniffer.messages.log_pb2 import Log
from sniffer.messages.recording_pb2 import Anomaly

LEVELS: Final = {
    Severity.NOTE: Log.Level.INFO,
    Severity.WARN: Log.Level.WARNING,
    Severity.ERROR: Log.Level.ERROR,
}
SEVERITIES: Final = {
    Severity.NOTE: Anomaly.Severity.NOTE,
    Severity.WARN: Anomaly.Severity.WARN,
    Severity.ERROR: Anomaly.Severity.ERROR,
}
