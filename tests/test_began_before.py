"""Incidents that began before they are told: when they were is when they began."""

from __future__ import annotations

from typing import TYPE_CHECKING

import sniffer
from sniffer.diagnosis.tracking import IncidentChange, Stage
from sniffer.ground.model import NS, Chunk, Clock
from sniffer.mcapfile.flight import Around, FlightRecorder, Happening
from sniffer.mcapfile.source import chunks
from sniffer.tap.watching import ANY, Watch, awaited_in
from tests.happenings import BEGIN_NS, incident

if TYPE_CHECKING:
    from pathlib import Path


def test_what_is_waited_for_was_when_its_incident_began() -> None:
    watch = Watch([awaited_in(ANY)])
    told_ns = BEGIN_NS + 20 * NS
    watch.incidents([IncidentChange(Stage.OPENED, told_ns, incident(last_ns=told_ns))])
    (seen,) = watch.take()
    assert (seen.t_ns, seen.last_ns) == (BEGIN_NS, told_ns)


def test_a_file_for_what_began_long_ago_goes_on_behind_what_was_seen_last(tmp_path: Path) -> None:
    now_ns = BEGIN_NS + 100 * NS
    sink = FlightRecorder(
        tmp_path / "incident.mcap",
        {},
        sniffer.Options("rs30x"),
        Around(None, NS, 1 << 20),
        now=lambda: now_ns,
    )
    sink.happened(Happening(BEGIN_NS, "bus0", "a test", "any", last_ns=now_ns))
    sink.flush()
    for k in (0.5, 0.9):
        sink.raw("bus0", [Chunk(b"\x00", now_ns + round(k * NS), Clock.READ, "bus0")])
        sink.flush()
    sink.close()
    assert len([c for c in chunks(sink.files[0]) if c.data]) == 2
