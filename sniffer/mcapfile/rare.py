"""What is rare, as messages: gaps, anomalies, and these once more for panels that show logs."""

from __future__ import annotations

import json
from typing import TYPE_CHECKING, Final

from google.protobuf.timestamp_pb2 import Timestamp

from sniffer.ground.model import NS
from sniffer.mcapfile.levels import LEVELS, SEVERITIES, whose
from sniffer.messages.log_pb2 import Log
from sniffer.messages.recording_pb2 import Anomaly, Gap

if TYPE_CHECKING:
    from collections.abc import Sequence

    from sniffer.ground import model
    from sniffer.ground.model import Batch

_NUMBERS: Final = json.JSONEncoder(default=repr).encode


def gap_messages(batch: Batch) -> list[Gap]:
    """Return the gaps of a batch."""
    return [
        Gap(
            t_ns=g.t_ns,
            offset=batch.base + g.start,
            length=g.length,
            reason=g.reason,
            detail=_NUMBERS(dict(g.detail)),
            data=batch.data[g.start : g.start + g.length],
        )
        for g in batch.gaps
    ]


def anomaly_messages(found: Sequence[model.Anomaly]) -> list[Anomaly]:
    """Return anomalies, but for what the catalogue says of them."""
    return [
        Anomaly(
            t_ns=a.t_ns,
            severity=SEVERITIES[a.severity],
            group=a.group,
            code=a.code,
            servo_id=a.servo_id,
            detail=a.detail,
            evidence=[Anomaly.Evidence(offset=at, length=n) for at, n in a.evidence],
        )
        for a in found
    ]


def log_messages(found: Sequence[model.Anomaly], bus: str) -> list[Log]:
    """Return anomalies as lines of a log."""
    return [
        Log(
            timestamp=Timestamp(seconds=a.t_ns // NS, nanos=a.t_ns % NS),
            level=LEVELS[a.severity],
            message=f"{whose(a)}{a.detail} [{a.code}]",
            name=bus,
        )
        for a in found
    ]
