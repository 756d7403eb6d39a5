"""A part of a capture, decoded in a process of its own: what it is given, and what it returns."""

from __future__ import annotations

import contextlib
from dataclasses import dataclass
from typing import TYPE_CHECKING

from sniffer.decoding.first import FirstBytes
from sniffer.decoding.resuming import BusPlan, PartPipeline, States
from sniffer.decoding.slicing import Narrowing
from sniffer.decoding.summary import Summary
from sniffer.ground.model import DamagedInputError
from sniffer.selection.selection import Selection

if TYPE_CHECKING:
    from collections.abc import Mapping, Sequence
    from pathlib import Path

    from sniffer.decoding.options import Options
    from sniffer.ground.memory import Observed
    from sniffer.ground.model import Chunk
    from sniffer.sinks.pieces import PieceMaker
    from sniffer.sources.logstretches import LogCount, LogStretch
    from sniffer.sources.stretches import Seam


@dataclass(frozen=True, slots=True)
class PartTask:
    """A part to decode: from ``known`` where ``is_exact``, else with it as a guess."""

    number: int
    seam: Seam
    known: States
    is_exact: bool
    plans: Mapping[str, BusPlan]
    options: Options
    where: str | None
    pieces: Sequence[tuple[PieceMaker, Path]]
    unsure: frozenset[str] = frozenset()
    """The buses whose first bytes are wanted, as those before the parts are few."""
    tries: int = 1


@dataclass(frozen=True, slots=True)
class PartResult:
    """What a part said, and knew at its two ends; ``damage`` is what broke it off."""

    before: States
    after: States
    totals: Summary
    first: Mapping[str, Sequence[Chunk]]
    damage: DamagedInputError | None = None


@dataclass(frozen=True, slots=True)
class CountTask:
    """A stretch to count."""

    number: int
    stretch: LogStretch


def do_task(task: PartTask | CountTask) -> PartResult | LogCount:
    """Do what a process is given."""
    return decode_part(task) if isinstance(task, PartTask) else task.stretch.count()


def observed(states: States) -> dict[str, Observed]:
    """Return what of some states can still be told."""
    return {bus: state.observable() for bus, state in states.items()}


def decode_part(task: PartTask) -> PartResult:
    """Decode a part, in whatever process.

    Raises:
        UnheardBusError: it has a bus of which nothing is known.
        OutputError: a piece cannot be written.
    """
    seam = task.seam
    warm, own = seam.warm, seam.own
    pipeline = PartPipeline(
        task.options, task.plans, task.known, own.bases if task.is_exact else warm.bases
    )
    if task.where is not None:
        pipeline.narrowing = Narrowing(
            None, Selection.parse(task.where).named(task.options.called).rows
        )
    if task.is_exact:
        pipeline.resume(task.plans, task.known)
    else:
        for group in warm:
            pipeline.feed(group)
    own.due.update(pipeline.heard())
    before = pipeline.states()
    pipeline.summary = Summary()
    pipeline.first = FirstBytes(task.unsure)
    damage = None
    with contextlib.ExitStack() as stack:
        for pieces, path in task.pieces:
            pipeline.add(pieces.open(path))
        stack.callback(pipeline.finish)
        try:
            for group in own:
                pipeline.feed(group)
        except DamagedInputError as error:
            damage = error
    if pipeline.failure is not None:
        raise pipeline.failure
    return PartResult(before, pipeline.states(), pipeline.summary, pipeline.first.kept, damage)
