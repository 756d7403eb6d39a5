"""Incidents made by hand: what tests of those who show and keep them need."""

from __future__ import annotations

from dataclasses import replace
from typing import Any, Final

from sniffer.diagnosis import Finding, Incident, Place, Ranked
from sniffer.ground.model import NS, Severity

BEGIN_NS: Final = 1_795_000_000 * NS


def finding(code: str = "no-response", servo_id: int | None = 3, **more: Any) -> Finding:
    """Return a finding of the first second."""
    place = Place(120, 9, BEGIN_NS, "a request without an answer")
    made = Finding(code, servo_id, BEGIN_NS, BEGIN_NS + NS, 4, f"4 x {code}", (place,))
    return replace(made, **more)


def incident(cause: str = "servo-dead", **more: Any) -> Incident:
    """Return an incident of servo 3 whose likeliest cause is given."""
    made = Incident(
        1,
        Severity.ERROR,
        "bus0",
        (3,),
        BEGIN_NS,
        BEGIN_NS + NS,
        4,
        (Ranked(cause, 0.87, "it answered and never again"), Ranked("brownout", 0.05, "")),
        (finding(),),
        "a servo that stopped answering (servo 3): silent since",
        "against brownout: no voltage-sag",
        "Ping it alone on the bus.",
    )
    return replace(made, **more)
