"""``sniffer.diagnose``: what is wrong in a capture, and why; what ``sniffer diagnose`` calls."""

from __future__ import annotations

import functools
from dataclasses import dataclass, field
from typing import TYPE_CHECKING, Any, Final

from sniffer.decoding.called import ServoNames
from sniffer.decoding.detect import UndecidedError
from sniffer.decoding.options import Options
from sniffer.diagnosis import Diagnosis
from sniffer.ground.wording import Sentence
from sniffer.jobs.likely import as_likely, is_explained
from sniffer.jobs.through import hear_part
from sniffer.sources.several import inputs_of, name_of

if TYPE_CHECKING:
    from collections.abc import Sequence
    from pathlib import Path

    from sniffer.diagnosis import Incident
    from sniffer.diagnosis.rest import Rest
    from sniffer.diagnosis.shared import Shared
    from sniffer.jobs.session import Ending, Patience
    from sniffer.jobs.telling import Teller
    from sniffer.selection.places import Window

_ONCE: Final = (
    "{told}; why nothing explains them takes a second reading, and standard input has one: "
    "diagnose a file of them"
)


@dataclass(frozen=True, slots=True)
class Diagnosed:
    """Incidents of a capture, on what it was judged (each bus, and in words), how it ended.

    ``rest``: anomalies of which no cause can be told, and what to do about them. ``has_clock``: the
    times of all buses are measured, not counted from the bytes.
    """

    incidents: tuple[Incident, ...]
    judged: list[dict[str, Any]]
    sentence: str
    rest: Rest
    has_clock: bool
    ending: Ending
    names: ServoNames = field(default_factory=ServoNames)
    """What servos are called, where they are shown to people."""
    shared: tuple[Shared, ...] = ()
    """Incidents of several buses that are likely one fault."""
    first_ns: int = 0
    """When the capture begins: times of another day are told with their date."""

    @property
    def is_one_bus(self) -> bool:
        """Whether all of it is of one bus, which nobody needs to name."""
        return len({each["bus"] for each in self.judged}) == 1

    def as_dict(self) -> dict[str, Any]:
        """Return it as ``schemas/diagnosis.schema.json`` has it."""
        told = [i.as_dict() for i in self.incidents]
        for incident in told if self.names else ():
            bus = incident["bus"]
            incident["findings"] = [self.names.beside(bus, each) for each in incident["findings"]]
        unexplained = [part.as_dict() for part in self.rest.parts]
        return {"incidents": told, "unexplained": unexplained, "judged": self.judged}


def diagnose(
    source: str | Path | Sequence[str | Path],
    options: Options | None = None,
    *,
    input_format: str = "auto",
    window: Window | None = None,
    patience: Patience | None = None,
    tell: Teller | None = None,
) -> Diagnosed:
    """Say what is wrong in a capture: incidents with their causes, the likeliest first.

    Args:
        source: a path, or ``"-"`` for standard input; several are one capture, read in the order
            of their times.
        options: how it is decoded; what a recording says of itself fills what is not said.
        input_format: ``"auto"`` or a name of ``sniffer.sources.SOURCES``.
        window: which part of it; all of it where None.
        patience: takes interruptions; what was read until then is judged.
        tell: takes what should be told; nothing is told without.

    Raises:
        InputError: the input cannot be read, its protocol cannot be told, or the window is empty.
        SnifferError: unknown protocol or model, or a number that cannot be.
    """
    options = options or Options()
    diagnosis = Diagnosis()
    hear = functools.partial(
        hear_part, source, input_format=input_format, window=window, patience=patience, tell=tell
    )
    try:
        done = hear(diagnosis, options)
    except UndecidedError as error:
        if name_of(source) == name_of("-"):
            raise error.telling(Sentence(_ONCE, told=error.args[0])) from error
        if error.is_tie:
            raise
        others, diagnosis = diagnosis, Diagnosis()
        done = hear(diagnosis, as_likely(error, others, options))
        if not is_explained(error, diagnosis):
            if not others.spoken():
                raise
            diagnosis = others  # those whose protocol is known are judged all the same
            if tell is not None:
                tell.warn(error.args[0])
    incidents = diagnosis.incidents()
    return Diagnosed(
        incidents,
        diagnosis.judged(),
        diagnosis.sentence(),
        diagnosis.rest(incidents).of(inputs_of(source), is_part=window is not None),
        diagnosis.has_clock,
        done.ending,
        done.summary.names,
        diagnosis.shared(incidents),
        diagnosis.first_ns,
    )
