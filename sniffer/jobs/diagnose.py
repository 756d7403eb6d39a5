"""``sniffer.diagnose``: what is wrong in a capture, and why; what ``sniffer diagnose`` calls."""

from __future__ import annotations

from dataclasses import dataclass
from typing import TYPE_CHECKING, Any

from sniffer.diagnosis import Diagnosis
from sniffer.jobs.convert import convert

if TYPE_CHECKING:
    from pathlib import Path

    from sniffer.decoding.options import Options
    from sniffer.diagnosis import Incident
    from sniffer.jobs.session import Ending, Patience
    from sniffer.jobs.telling import Teller


@dataclass(frozen=True, slots=True)
class Diagnosed:
    """Incidents of a capture, on what it was judged (each bus, and in words), how it ended.

    ``has_clock``: the times of all buses are measured, not counted from the bytes.
    """

    incidents: tuple[Incident, ...]
    judged: list[dict[str, Any]]
    sentence: str
    has_clock: bool
    ending: Ending

    def as_dict(self) -> dict[str, Any]:
        """Return it as ``schemas/diagnosis.schema.json`` has it."""
        return {"incidents": [i.as_dict() for i in self.incidents], "judged": self.judged}


def diagnose(
    source: str | Path,
    options: Options | None = None,
    *,
    input_format: str = "auto",
    patience: Patience | None = None,
    tell: Teller | None = None,
) -> Diagnosed:
    """Say what is wrong in a capture: incidents with their causes, the likeliest first.

    Args:
        source: a path, or ``"-"`` for standard input.
        options: how it is decoded; what a recording says of itself fills what is not said.
        input_format: ``"auto"`` or a name of ``sniffer.sources.SOURCES``.
        patience: takes interruptions; what was read until then is judged.
        tell: takes what should be told; nothing is told without.

    Raises:
        InputError: the input cannot be read, or its protocol cannot be told.
        SnifferError: unknown protocol or model, or a number that cannot be.
    """
    diagnosis = Diagnosis()
    done = convert(
        source,
        (),
        options,
        input_format=input_format,
        sinks=[diagnosis],
        patience=patience,
        tell=tell,
    )
    return Diagnosed(
        diagnosis.incidents(),
        diagnosis.judged(),
        diagnosis.sentence(),
        diagnosis.has_clock,
        done.ending,
    )
