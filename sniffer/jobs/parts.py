"""One capture decoded by several processes, exactly as by one.

A part begins with a guess: it is told what servos were set to in what came before as far as that is
known, decodes 256 KiB before its own bytes, and throws those records away. Where its own bytes
begin it states what it knows; the part before it states the same when it gets there. If both are
equal, all that the part says is what one process would have said (``Decoder.state``). If not, the
part is decoded again from what the one before it knew. Nothing is taken on trust, and no protocol
is asked.
"""

from __future__ import annotations

import contextlib
import functools
import tempfile
from dataclasses import replace
from pathlib import Path
from typing import TYPE_CHECKING, Final

from sniffer.decoding.resuming import States, UnheardBusError
from sniffer.jobs.crew import Crew, LostWorkerError
from sniffer.jobs.part import CountTask, PartResult, PartTask, do_task, observed
from sniffer.jobs.session import Patience, run_source
from sniffer.sinks.pieces import WrittenElsewhere, advice_of, join, pieces_of, turn
from sniffer.sources.stretches import Sizes, stretches_of

if TYPE_CHECKING:
    from collections.abc import Callable, Iterable, Sequence

    from sniffer.decoding.options import Options
    from sniffer.decoding.resuming import ResumablePipeline
    from sniffer.decoding.sink import Sink
    from sniffer.decoding.summary import Summary
    from sniffer.ground.memory import Observed
    from sniffer.jobs.asked import Extract
    from sniffer.jobs.crew import TaskEnd
    from sniffer.jobs.session import Ending
    from sniffer.jobs.telling import Teller
    from sniffer.selection.selection import Selection
    from sniffer.sources import Source
    from sniffer.sources.logstretches import LogCount
    from sniffer.sources.stretches import FileStretch, Stretches

TRIES: Final = 3
"""So often a part is tried whose process is killed."""

AHEAD: Final = 2
"""JoinedParts a process that may be begun beyond those that are joined."""

LOOK_S: Final = 0.2
"""How often it is looked whether somebody interrupts, in seconds."""


class JoinedParts:
    """Decodes the parts of a capture, and joins them in order to a pipeline that has its head.

    Args:
        pipeline: what has decoded all before the parts; it goes on behind them.
        sinks: the pipeline's.
        plan: the parts, and what is to be counted first.
        options: how they are decoded.
        selection: which rows are shown.
        jobs: how many processes decode.
        patience: takes interruptions.
    """

    def __init__(
        self,
        pipeline: ResumablePipeline,
        sinks: Sequence[Sink],
        plan: Stretches,
        options: Options,
        *,
        selection: Selection | None,
        jobs: int,
        patience: Patience,
    ) -> None:
        self._pipeline = pipeline
        self._sinks = sinks
        self._plan = plan
        self._seams = plan.parts
        self.notes: list[str] = []
        """What is worth knowing of the input, if it was counted."""
        self._options = options
        self._where = None if selection is None else selection.text
        self._jobs = jobs
        self._patience = patience
        self._plans = pipeline.plans()
        self._known = self._guess = pipeline.states()
        self._unsure = pipeline.first.wanted
        self._done: dict[int, PartResult] = {}
        self._again: list[PartTask] = []
        self._failed: set[int] = set()
        self._joined = self._begun = 0
        self.repeated = 0
        """How many parts were decoded again, because they had begun with a wrong guess."""

    def run(self, folder: Path) -> None:
        """Decode them; ``folder`` is for what waits for its turn.

        Raises:
            DamagedInputError: the input breaks off; all before is joined.
            KeyboardInterrupt: somebody interrupted; some are joined.
            UnheardBusError: so does who knows nothing of a bus; all before that part is joined.
        """
        try:
            with Crew(min(self._jobs, len(self._seams)), do_task, preload=self._loaded()) as crew:
                self._count(crew)
                while self._joined < len(self._seams):
                    self._fill(crew, folder)
                    for outcome in crew.wait(LOOK_S):
                        self._take(outcome)
                    if self._patience.asked:
                        raise KeyboardInterrupt
                    self._join(folder)
        finally:
            self._pipeline.resume(self._plans, self._known)

    def _loaded(self) -> list[str]:
        """Return the modules that processes need: each is loaded once, and not by each of them."""
        makers = {type(pieces_of(sink)).__module__ for sink in self._sinks}
        return [do_task.__module__, *sorted(makers)]

    def _count(self, crew: Crew) -> None:
        """Have it counted what stands before the parts, where they do not tell themselves."""
        tally = self._plan.tally
        counts: dict[int, LogCount] = {}
        waiting = list(enumerate(tally))
        while len(counts) < len(tally):
            while waiting and crew.has_room:
                number, stretch = waiting.pop(0)
                crew.give(CountTask(number, stretch))
            for outcome in crew.wait(LOOK_S):
                if outcome.error is not None:
                    raise outcome.error
                counts[outcome.task.number] = outcome.result
            if self._patience.asked:
                raise KeyboardInterrupt
        if tally:
            self.notes = self._plan.counted([counts[number] for number in range(len(tally))])

    @property
    def joined(self) -> int:
        """How many parts are joined."""
        return self._joined

    def _fill(self, crew: Crew, folder: Path) -> None:
        """Give out parts, the first ones first, and few far ahead of what is joined."""
        while crew.has_room:
            if self._again:
                crew.give(self._again.pop(0))
            elif self._begun < len(self._seams) and self._begun - self._joined < AHEAD * self._jobs:
                number, self._begun = self._begun, self._begun + 1
                is_next = number == self._joined
                states = self._known if is_next else self._guess
                crew.give(self._task(number, states, folder, is_exact=is_next))
            else:
                return

    def _task(self, number: int, states: States, folder: Path, *, is_exact: bool) -> PartTask:
        known = states if is_exact else {bus: state.elsewhere() for bus, state in states.items()}
        pieces = [
            (pieces_of(sink), folder / _piece(number, nth)) for nth, sink in enumerate(self._sinks)
        ]
        return PartTask(
            number,
            self._seams[number],
            known,
            is_exact,
            self._plans,
            self._options,
            self._where,
            pieces,
            self._unsure,
        )

    def _take(self, outcome: TaskEnd) -> None:
        """Keep what a part said; what failed with a guess is tried with what is known."""
        task: PartTask = outcome.task
        if outcome.error is None:
            self._done[task.number] = outcome.result
            if task.number == max(self._done):
                self._guess = outcome.result.after
        elif isinstance(outcome.error, LostWorkerError) and task.tries < TRIES:
            self._again.append(replace(task, tries=task.tries + 1))
        elif task.known is self._known or isinstance(outcome.error, LostWorkerError):
            raise outcome.error
        else:
            self._failed.add(task.number)

    def _join(self, folder: Path) -> None:
        """Join what is certain; have decoded again what began with a wrong guess."""
        while (number := self._joined) < len(self._seams):
            if number in self._failed:
                self._failed.remove(number)
                self._again.insert(0, self._task(number, self._known, folder, is_exact=True))
                return
            found = self._done.get(number)
            if found is None:
                return
            if observed(found.before) != observed(self._known):
                self._repeat(folder)
                return
            self._write(number, found, folder)
            del self._done[number]
            self._joined, self._known = number + 1, found.after
            if found.damage is not None:
                raise found.damage

    def _repeat(self, folder: Path) -> None:
        """Have the next part decoded again, and with it those behind that were misled alike.

        What they changed is laid over what is known now: they may all be right the second time.
        """
        number, states = self._joined, self._known
        while (found := self._done.get(number)) is not None:
            if number > self._joined and self._observed(states) == observed(found.before):
                break
            del self._done[number]
            self._again.append(self._task(number, states, folder, is_exact=True))
            self.repeated += 1
            states = {
                bus: state.instead(found.before[bus], states[bus])
                if bus in found.before and bus in states
                else state
                for bus, state in found.after.items()
            }
            number += 1
        self._guess = states

    def _observed(self, states: States) -> dict[str, Observed]:
        """Return what could be told of states that nobody has come to."""
        decoders = {
            bus: self._plans[bus].decoder(self._options, bus, state=state)
            for bus, state in states.items()
        }
        return observed({bus: decoder.state() for bus, decoder in decoders.items()})

    def _write(self, number: int, found: PartResult, folder: Path) -> None:
        told = WrittenElsewhere(found.totals, self._pipeline.given)
        paths = {id(sink): folder / _piece(number, nth) for nth, sink in enumerate(self._sinks)}
        for bus, chunks in found.first.items():
            self._pipeline.first.keep(bus, chunks)
        self._pipeline.take(found.totals, lambda sink: join(sink, paths[id(sink)], told))
        for file in folder.glob(_piece(number, "*", "*")):
            file.unlink()


def _piece(number: int, nth: int | str, suffix: str = "part") -> str:
    return f"{number}-{nth}.{suffix}"


def decode_in_parts(
    source: Source,
    options: Options,
    sinks: Sequence[Sink],
    *,
    jobs: int,
    name: str,
    tell: Teller,
    patience: Patience | None = None,
    asked: Extract | None = None,
    folder: Path | None = None,
    sizes: Sizes | None = None,
    plan: Stretches | str | None = None,
    on_break: Callable[[str], None] = lambda why: None,
) -> tuple[Summary, Ending]:
    """Decode everything into the sinks, stretch by stretch; else as ``run_source``.

    Sinks that are ``Joining`` have their parts written by the processes. The pipeline is given the
    same groups whoever decodes them: batches are the same, too, and what depends on where they end.
    Where the input cannot be read in parts, one process decodes it as a whole, and that is told.

    Args:
        source: what is decoded.
        options: how.
        sinks: the outputs, of one process: this one writes them.
        jobs: how many processes decode; one: this one.
        name: what the source is called.
        tell: takes what should be told.
        patience: takes interruptions.
        asked: which rows are shown; it may be no part of a capture.
        folder: where parts wait for their turn; where temporary files are, if None.
        sizes: of the parts, in bytes.
        plan: the stretches, or why there are none, where that is known (``stretches_of``).
        on_break: is told why an input was not read to its end.

    Raises:
        SnifferError: part of a capture is asked for, or a process was killed again and again.
    """
    sizes, patience = sizes or Sizes(), patience or Patience()
    stretches = stretches_of(source, sizes, jobs) if plan is None else plan
    run = functools.partial(
        run_source,
        source,
        options,
        sinks,
        name=name,
        tell=tell,
        patience=patience,
        asked=asked,
        on_break=on_break,
    )
    if isinstance(stretches, str):
        if stretches:
            tell.talk(f"decoded by one process: {stretches}")
        return run()
    selection = None if asked is None else asked.selection

    def feed(pipeline: ResumablePipeline) -> None:
        head = list(patience.groups(stretches.head))
        if not head or sum(len(chunk.data) for chunk in head[0]) < sizes.first:
            for group in patience.groups(source):
                pipeline.feed(group)
            return
        for group in head:
            pipeline.feed(group)
        try:
            behind(pipeline)
        finally:
            turn(sinks)  # what is told at the end is of no stretch

    def behind(pipeline: ResumablePipeline) -> None:
        rest: Iterable[FileStretch] = stretches.in_turn(source.notes)
        if pipeline.is_settled and jobs > 1:
            for line in advice_of(sinks):
                tell.talk(line)
            parts = JoinedParts(
                *(pipeline, sinks, stretches, options),
                selection=selection,
                jobs=jobs,
                patience=patience,
            )
            with (
                tempfile.TemporaryDirectory(prefix=".sniffer-parts-", dir=folder) as room,
                contextlib.suppress(UnheardBusError),  # one process goes on from there
            ):
                parts.run(Path(room))
            rest = [seam.own for seam in stretches.parts[parts.joined :]]
            source.notes[:] = parts.notes
        for stretch in rest:
            turn(sinks)
            stretch.due.update(pipeline.heard())
            for group in patience.groups(stretch):
                pipeline.feed(group)

    return run(feed=feed)
