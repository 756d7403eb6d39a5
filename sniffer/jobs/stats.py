"""``sniffer.stats``: figures of a capture; what ``sniffer stats`` calls."""

from __future__ import annotations

from dataclasses import dataclass
from typing import TYPE_CHECKING, Any, Final

from sniffer.decoding.options import Options
from sniffer.decoding.summary import UNTIMED
from sniffer.ground.model import SnifferError
from sniffer.ground.wording import Sentence
from sniffer.jobs.through import hear_part
from sniffer.sources.several import name_of
from sniffer.statistics import Statistics
from sniffer.statistics.slices import FINEST_NS
from sniffer.statistics.told import as_dict

if TYPE_CHECKING:
    from collections.abc import Sequence
    from pathlib import Path

    from sniffer.decoding.summary import Summary
    from sniffer.jobs.session import Ending, Patience
    from sniffer.jobs.telling import Teller
    from sniffer.selection.places import Window
    from sniffer.selection.selection import Selection


_BY_ANSWER: Final = frozenset(
    ("outcome", "response_time_ns", "uncertainty_ns", "response_offset", "status")
)
"""Columns that say what came of a request: of what they select, shares of missing answers say
nothing of the bus."""


@dataclass(frozen=True, slots=True)
class Tallied:
    """The figures of a capture, and how its reading ended; ``source`` is its name.

    ``summary`` has the totals of all of it, and what was asked for where that is not all.
    """

    source: str
    statistics: Statistics
    ending: Ending
    summary: Summary

    def as_dict(self) -> dict[str, Any]:
        """Return it as ``schemas/stats.schema.json`` has it."""
        asked = self.summary.asked()
        told = {"selection": asked} if asked else {}
        figures = as_dict(self.statistics, selected="tables" in asked)
        return {"source": self.source, **told, **figures}


def stats(
    source: str | Path | Sequence[str | Path],
    options: Options | None = None,
    *,
    input_format: str = "auto",
    window: Window | None = None,
    selection: Selection | None = None,
    every_ns: int | None = None,
    patience: Patience | None = None,
    tell: Teller | None = None,
) -> Tallied:
    """Count and measure a capture: load, rates, response times, errors, anomalies.

    Args:
        source: a path, or ``"-"`` for standard input; several are one capture, read in the order
            of their times.
        options: how it is decoded; what a recording says of itself fills what is not said. How
            long servos met the rules of ``options.alarms`` is told, too.
        input_format: ``"auto"`` or a name of ``sniffer.sources.SOURCES``.
        window: which part of it; all of it where None.
        selection: which records are counted; all of them where None.
        every_ns: the width of the slices of time in which load, missing answers and anomalies are
            counted; where None, load alone, in slices that fit a line.
        patience: takes interruptions; what was read until then is counted.
        tell: takes what should be told; nothing is told without.

    Raises:
        InputError: the input cannot be read, its protocol cannot be told, or the window is empty.
        SnifferError: unknown protocol or model, or a number that cannot be.
    """
    options = options or Options()
    if every_ns is not None and every_ns < FINEST_NS:
        raise SnifferError(Sentence("{every_ns} of less than 10 ms: a frame may take half of that"))
    by_answer = selection is not None and not _BY_ANSWER.isdisjoint(selection.columns)
    told = Statistics(every_ns=every_ns, by_answer=by_answer)
    done = hear_part(
        source,
        told,
        options,
        input_format=input_format,
        window=window,
        selection=selection,
        patience=patience,
        tell=tell,
    )
    if tell is not None:
        if every_ns is not None and done.summary.untimed() is not None:
            tell.warn(Sentence("{told}: {every_ns} has no time to count by", told=UNTIMED))
        for rule in told.unjudged():
            tell.warn(f"the rule {str(rule)!r} judges nothing: no value of that kind was told")
    return Tallied(name_of(source), told, done.ending, done.summary)
