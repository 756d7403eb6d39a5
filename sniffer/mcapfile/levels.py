"""How much something matters, and whom it concerns, as the messages of a recording have it."""

from __future__ import annotations

import functools
import re
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


def named(servo_id: int, detail: str) -> str:
    """Return the servo (-1: nobody), unless an anomaly's detail begins with it or names it."""
    if servo_id < 0:
        return ""
    who = f"servo {servo_id}"
    return "" if who in detail and _word(who).search(detail) else f"{who}: "


@functools.cache  # there are some 250 servos; ``re`` itself takes longer to find it than to search
def _word(text: str) -> re.Pattern[str]:
    return re.compile(rf"\b{text}\b")
