"""A capture heard to its end for what is told of it afterwards: figures, curves, incidents."""

from __future__ import annotations

from dataclasses import dataclass
from typing import TYPE_CHECKING

from sniffer.decoding.detect import UndecidedError
from sniffer.diagnosis import Diagnosis
from sniffer.jobs.asked import Extract
from sniffer.jobs.likely import as_likely, is_explained, without_undecided
from sniffer.jobs.session import run_source, undecided_of
from sniffer.statistics.collector import Collector

if TYPE_CHECKING:
    from sniffer.decoding.options import Options
    from sniffer.decoding.summary import Summary
    from sniffer.jobs.session import Ending, Patience
    from sniffer.jobs.telling import Teller
    from sniffer.selection.places import Window
    from sniffer.sources import Source


@dataclass(frozen=True, slots=True)
class HeardCapture:
    """What was heard, and under which options.

    ``damage`` says why the input was not read to its end (empty: it was).
    """

    summary: Summary
    collector: Collector
    diagnosis: Diagnosis
    ending: Ending
    damage: str
    options: Options


def hear(
    opened: Source,
    options: Options,
    *,
    name: str,
    tell: Teller,
    patience: Patience | None = None,
    window: Window | None = None,
) -> HeardCapture:
    """Decode a source, or a part of it, and keep what reports and checks ask for.

    The source may be read again: beside buses whose protocol is known those are judged, too, of
    which it cannot be told because something is wrong with them. Where nothing tells what that is
    they are left out, and it is said.

    Raises:
        InputError: there is nothing in it, or its protocol cannot be told.
    """

    def heard(opened: Source, options: Options, diagnosis: Diagnosis) -> HeardCapture:
        collector, damage = Collector(), list[str]()
        asked = Extract.of(None, window)
        if asked is not None:
            asked = asked.sought_in(opened, options)
        with undecided_of(name):
            summary, ending = run_source(
                opened,
                options,
                [collector, diagnosis],
                name=name,
                tell=tell,
                patience=patience,
                on_break=damage.append,
                asked=asked,
            )
        return HeardCapture(summary, collector, diagnosis, ending, "; ".join(damage), options)

    diagnosis = Diagnosis()
    try:
        return heard(opened, options, diagnosis)
    except UndecidedError as error:
        if error.is_tie or not diagnosis.spoken():
            raise
        again = heard(opened, as_likely(error, diagnosis, options), Diagnosis())
        if is_explained(error, again.diagnosis):
            return again
        if not error.likely_of:
            raise
        tell.warn(error.args[0])
        return heard(without_undecided(opened, error), options, Diagnosis())
