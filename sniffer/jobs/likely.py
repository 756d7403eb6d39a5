"""Buses whose protocol cannot be told: read at another rate, they are judged all the same.

Whose frames it is not is the same then: unless any begin well, they are taken for the first
protocol's, and what is wrong with them is told where something is.
"""

from __future__ import annotations

from dataclasses import replace
from typing import TYPE_CHECKING

from sniffer.jobs.derived import Derived
from sniffer.protocols import PROTOCOLS

if TYPE_CHECKING:
    from collections.abc import Iterable, Iterator, Sequence

    from sniffer.decoding.detect import UndecidedError
    from sniffer.decoding.options import Options
    from sniffer.diagnosis import Diagnosis
    from sniffer.ground.model import Chunk
    from sniffer.sources import Source


def as_likely(error: UndecidedError, others: Diagnosis, options: Options) -> Options:
    """Return options under which such buses are decoded; ``others`` are those that were told."""
    first = next(iter(PROTOCOLS))
    likely = {bus: name or first for bus, name in error.likely_of.items()}
    spoken = {**others.spoken(), **likely, **options.protocols}
    fallback = options.protocol if likely else error.likely or first
    return replace(options, protocol=fallback, protocols=spoken)


def without_undecided(opened: Source, error: UndecidedError) -> Source:
    """Return a source without the buses whose protocol cannot be told."""

    def known(groups: Iterable[Sequence[Chunk]]) -> Iterator[list[Chunk]]:
        for group in groups:
            yield [chunk for chunk in group if chunk.bus not in error.likely_of]

    return Derived(opened, known, opened.facts())


def is_explained(error: UndecidedError, diagnosis: Diagnosis) -> bool:
    """Tell whether a diagnosis of what was decoded so says what is wrong with each such bus."""
    told = {incident.bus for incident in diagnosis.incidents()}
    return bool(told) and not error.likely_of.keys() - told
