"""Captures diagnosed in memory: what the tests of findings and causes ask."""

from __future__ import annotations

from typing import TYPE_CHECKING, Any

from sniffer.decoding.pipeline import Options, Pipeline
from sniffer.diagnosis import Diagnosis
from sniffer.diagnosis.rules import findings
from sniffer.ground.model import Chunk, Clock, Severity

if TYPE_CHECKING:
    from collections.abc import Iterable, Sequence

    from sniffer.diagnosis import Finding, Incident
    from sniffer.protocols.base import BusProtocol
    from sniffer.simulation.talk import TrueFrame


def chunks_of(frames: Iterable[TrueFrame], clock: Clock = Clock.SAMPLE) -> list[Chunk]:
    """Return what a tap with an exact clock hears of a simulated bus, a chunk a frame."""
    return [Chunk(f.wire, f.t_end_ns, clock) for f in frames if f.wire]


def diagnosed(
    chunks: Sequence[Chunk], protocol: str | BusProtocol, group: int = 4096, **options: Any
) -> Diagnosis:
    """Return the diagnosis of a capture, fed in groups of chunks."""
    diagnosis = Diagnosis()
    # By what it is timed is found from its beginning, as a source is read ahead.
    pipeline = Pipeline(Options(protocol=protocol, **options), [diagnosis], ahead=chunks)
    for k in range(0, len(chunks), group):
        pipeline.feed(chunks[k : k + group])
    pipeline.close()
    pipeline.finish()
    return diagnosis


def found(diagnosis: Diagnosis) -> list[Finding]:
    """Return all findings of all buses."""
    return [finding for case in diagnosis.cases() for finding in case.once(findings)]


def codes(diagnosis: Diagnosis) -> set[str]:
    """Return the codes of all findings."""
    return {finding.code for finding in found(diagnosis)}


def verdicts(incidents: Iterable[Incident]) -> list[tuple[str, tuple[int, ...]]]:
    """Return the first cause and the servos of each incident."""
    return [(incident.cause, incident.servo_ids) for incident in incidents]


def alarms(diagnosis: Diagnosis) -> list[str]:
    """Return the causes of all incidents that are more than a note."""
    return [i.cause for i in diagnosis.incidents() if i.severity > Severity.NOTE]
