"""What becomes of incidents, as messages of the topic ``/incidents``."""

from __future__ import annotations

from typing import TYPE_CHECKING, Final

from sniffer.diagnosis.tracking import Stage
from sniffer.mcapfile.levels import SEVERITIES
from sniffer.messages.recording_pb2 import Incident

if TYPE_CHECKING:
    from sniffer.decoding.called import ServoNames
    from sniffer.diagnosis.tracking import IncidentChange

_STAGES: Final = {
    Stage.OPENED: Incident.Stage.OPENED,
    Stage.CHANGED: Incident.Stage.CHANGED,
    Stage.OVER: Incident.Stage.OVER,
    Stage.WITHDRAWN: Incident.Stage.WITHDRAWN,
    Stage.ENDED: Incident.Stage.ENDED,
}


def message_of(change: IncidentChange, names: ServoNames) -> Incident:
    """Return a change with all that is known of its incident then; sentences name the servos."""
    i = change.incident.named(names)
    places = sorted({p for f in i.findings for p in f.places})
    return Incident(
        t_ns=change.t_ns,
        stage=_STAGES[change.stage],
        id=str(i.number),
        severity=SEVERITIES[i.severity],
        bus=i.bus,
        servo_ids=i.servo_ids,
        first_t_ns=i.first_ns,
        last_t_ns=i.last_ns,
        count=i.count,
        story=i.story,
        causes=[
            Incident.Cause(cause=c.cause, confidence=c.confidence, why=c.why) for c in i.causes
        ],
        findings=[
            Incident.Finding(
                code=f.code,
                count=f.count,
                servo_id=f.servo_id,
                first_t_ns=f.first_ns,
                last_t_ns=f.last_ns,
                what=f.what,
            )
            for f in i.findings
        ],
        evidence=[
            Incident.Evidence(offset=p.offset, length=p.length, t_ns=p.t_ns, what=p.what)
            for p in places
        ],
        against=i.against,
        next=i.next,
    )
