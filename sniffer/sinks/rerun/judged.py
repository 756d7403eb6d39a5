"""A plot of a capture that says what was wrong: incidents stand in it as in a live one."""

from __future__ import annotations

from typing import TYPE_CHECKING, Any

from sniffer.diagnosis import Diagnosis
from sniffer.ground.model import Severity
from sniffer.sinks.rerun.entities import LogLine
from sniffer.sinks.rerun.sink import RerunSink

if TYPE_CHECKING:
    from collections.abc import Mapping, Sequence
    from pathlib import Path

    from sniffer.decoding.pacing import Pace
    from sniffer.ground.model import Batch
    from sniffer.protocols.base import BusProtocol


class JudgedRerunSink(RerunSink):
    """Writes a file, and marks the incidents of the capture when all of it was heard.

    Each is a line of the log at the bus and at its servos, and a mark on their curves, at its first
    moment. Of a selection those are marked that have a servo which is shown, or none at all; of a
    part what was wrong in it.
    """

    def __init__(self, path: Path) -> None:
        super().__init__(path)
        self._diagnosis = Diagnosis()
        self._is_narrow = False

    def pace(self, bus: str, told: Pace) -> None:
        """Take what a bus is timed by: causes are judged by it."""
        self._diagnosis.pace(bus, told)

    def narrow(self, told: Mapping[str, Any]) -> None:
        """Learn that not all is shown."""
        self._is_narrow = "where" in told

    def write(self, bus: str, protocol: BusProtocol, batch: Batch) -> None:
        """Take what one pass decided."""
        self._diagnosis.write(bus, protocol, batch)
        super().write(bus, protocol, batch)

    def close(self) -> None:
        """Mark the incidents; finish the file."""
        marked = []
        for one in self._diagnosis.incidents():
            servos = [s for s in one.servo_ids if not self._is_narrow or self.shows(one.bus, s)]
            if servos or not one.servo_ids:
                sure = f"{one.causes[0].percent}%"
                told = f"incident {one.number}: {one.cause} ({sure}): {one.story}"
                line = LogLine(one.first_ns, one.severity, told)
                self.incident(one.bus, servos, line)
                marked.append(line)
        self._first_error = opening_ns(marked, self._first_error)
        super().close()


def opening_ns(incidents: Sequence[LogLine], error_ns: int | None) -> int | None:
    """Return at what the plots open, in ns: the first incident that is an error.

    Without one it is the first error (``error_ns``), without that the first incident.
    """
    grave = [line.t_ns for line in incidents if line.severity >= Severity.ERROR]
    others = [line.t_ns for line in incidents] if error_ns is None else [error_ns]
    return min(grave or others, default=None)
