"""Incidents as they come and go: told once when they open, change their cause, and are over."""

from __future__ import annotations

from dataclasses import replace
from typing import TYPE_CHECKING, Final

from sniffer.diagnosis.tracking import OVER_NS, Stage, Tracker
from sniffer.ground.model import NS
from tests.happenings import BEGIN_NS, finding, incident

if TYPE_CHECKING:
    from sniffer.diagnosis import Incident
    from sniffer.diagnosis.tracking import IncidentChange

NOW: Final = BEGIN_NS + NS


def told(changes: list[IncidentChange]) -> list[tuple[Stage, int, str]]:
    return [(c.stage, c.incident.number, c.incident.cause) for c in changes]


def on(second: int, cause: str = "servo-dead") -> Incident:
    """The same incident, gone on until a later second."""
    last_ns = BEGIN_NS + second * NS
    return incident(cause, last_ns=last_ns, findings=(finding(last_ns=last_ns),))


def test_an_incident_opens_once_and_keeps_its_number_while_it_goes_on() -> None:
    tracker = Tracker()
    assert told(tracker.update("bus0", [on(1)], NOW)) == [(Stage.OPENED, 1, "servo-dead")]
    for second in range(2, 30):
        assert tracker.update("bus0", [on(second)], NOW + second * NS) == []
    (known,) = tracker.now()
    assert (known.incident.number, known.incident.last_ns) == (1, BEGIN_NS + 29 * NS)


def test_another_first_cause_is_told_once_it_stays() -> None:
    tracker = Tracker()
    tracker.update("bus0", [on(1)], NOW)
    assert tracker.update("bus0", [on(2, "brownout")], NOW + NS) == []
    assert tracker.update("bus0", [on(3)], NOW + 2 * NS) == [], "it was a matter of a second"
    assert tracker.update("bus0", [on(4, "brownout")], NOW + 3 * NS) == []
    (change,) = tracker.update("bus0", [on(5, "brownout")], NOW + 4 * NS)
    assert (change.stage, change.before) == (Stage.CHANGED, "servo-dead")
    assert str(change).startswith("incident 1 on bus0 is brownout (87 %), not servo-dead: ")
    assert tracker.update("bus0", [on(6, "brownout")], NOW + 5 * NS) == []


def test_an_incident_of_more_servos_than_were_told_is_told_again_once() -> None:
    """A cable that came off is seen servo by servo: the first one alone misled whoever looked."""
    tracker = Tracker()

    def of(*servos: int) -> Incident:
        return replace(on(sum(servos)), servo_ids=servos)

    tracker.update("bus0", [of(3)], NOW)
    assert tracker.update("bus0", [of(2, 3)], NOW + NS) == []
    (change,) = tracker.update("bus0", [of(1, 2, 3)], NOW + 2 * NS)
    assert (change.stage, change.before) == (Stage.CHANGED, "servo-dead")
    assert str(change).startswith("incident 1 on bus0 is of 3 servos now: servo-dead (87 %): ")
    assert tracker.update("bus0", [of(1, 2, 3)], NOW + 3 * NS) == []
    assert tracker.update("bus0", [of(1, 2)], NOW + 4 * NS) == []


def test_what_does_not_go_on_is_over_and_opens_again_when_it_does() -> None:
    tracker = Tracker()
    tracker.update("bus0", [on(1)], NOW)
    assert tracker.update("bus0", [on(1)], NOW + OVER_NS) == []
    (over,) = tracker.update("bus0", [on(1)], NOW + OVER_NS + 1)
    assert str(over) == "incident 1 on bus0 is over: servo-dead, ×4 in 1.0 s"
    assert tracker.update("bus0", [on(1)], NOW + 2 * OVER_NS) == []
    assert [one.is_over for one in tracker.now()] == [True]
    again = tracker.update("bus0", [on(60)], NOW + 60 * NS)
    assert told(again) == [(Stage.OPENED, 1, "servo-dead")]


def test_what_another_incident_explains_is_withdrawn() -> None:
    tracker = Tracker()
    noise = incident("bus-noise", servo_ids=(), findings=(finding("noise", None),))
    assert len(tracker.update("bus0", [on(1), noise], NOW)) == 2
    both = incident(findings=(finding(), finding("noise", None)))
    assert tracker.update("bus0", [both], NOW + NS) == []
    (gone,) = tracker.update("bus0", [both], NOW + 2 * NS)
    assert (gone.stage, gone.incident.cause) == (Stage.WITHDRAWN, "bus-noise")
    assert [one.incident.number for one in tracker.now()] == [1]


def test_a_servo_that_is_back_ends_what_was_said_of_its_silence() -> None:
    tracker = Tracker()
    tracker.update("bus0", [on(1)], NOW)
    assert tracker.update("bus0", [], NOW + NS) == []
    (over,) = tracker.update("bus0", [], NOW + 2 * NS)
    assert (over.stage, over.incident.number) == (Stage.OVER, 1)
    assert tracker.update("bus0", [], NOW + 60 * NS) == []


def test_two_servos_and_two_buses_are_incidents_of_their_own() -> None:
    tracker = Tracker()
    other = incident(servo_ids=(4,), findings=(finding(servo_id=4),))
    changes = tracker.update("left", [on(1), other], NOW) + tracker.update("right", [on(1)], NOW)
    assert told(changes) == [(Stage.OPENED, n, "servo-dead") for n in (1, 2, 3)]
    assert tracker.update("left", [other, on(1)], NOW) == [], "their order tells nothing"
    assert told(tracker.end(NOW)) == [(Stage.ENDED, n, "servo-dead") for n in (1, 2, 3)]


def test_memory_is_bounded() -> None:
    tracker = Tracker()
    for n in range(1000):
        t_ns = BEGIN_NS + 60 * n * NS
        place = finding(f"code-{n}", n, first_ns=t_ns, last_ns=t_ns)
        every = [incident(first_ns=t_ns, last_ns=t_ns, findings=(place,))]
        tracker.update("bus0", every, t_ns)
        tracker.update("bus0", every, t_ns + 30 * NS)
    assert len(tracker.now()) < 300
