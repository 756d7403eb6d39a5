"""A source run through the pipeline into sinks: what to do when something breaks off."""

from __future__ import annotations

import contextlib
import enum
from typing import TYPE_CHECKING

from sniffer.decoding.called import names_in
from sniffer.decoding.detect import UndecidedError
from sniffer.decoding.lagging import LaggingPipeline
from sniffer.decoding.pipeline import Options, Pipeline
from sniffer.decoding.resuming import ResumablePipeline
from sniffer.ground.model import DamagedInputError, InputError
from sniffer.ground.wording import Sentence, and_
from sniffer.jobs.order import merged
from sniffer.sources.several import STANDARD_INPUT

if TYPE_CHECKING:
    from collections.abc import Callable, Iterable, Iterator, Sequence

    from sniffer.decoding.pacing import Pace
    from sniffer.decoding.sink import Sink
    from sniffer.decoding.slicing import Slice
    from sniffer.decoding.summary import Summary
    from sniffer.ground.model import Chunk
    from sniffer.jobs.asked import Extract
    from sniffer.jobs.telling import Teller
    from sniffer.sources import Source


class Ending(enum.Enum):
    """How the decoding of a source ended; what could be read is decoded and written each time."""

    DONE = enum.auto()
    MISTAKEN = enum.auto()
    """It speaks another protocol than was said."""
    DAMAGED = enum.auto()
    """It broke off."""
    INTERRUPTED = enum.auto()

    @classmethod
    def worst(cls, endings: Iterable[Ending]) -> Ending:
        """Return the one of several that matters most: those further down do."""
        return max(endings, key=[*cls].index)


@contextlib.contextmanager
def undecided_of(name: str, *, leads: bool = False) -> Iterator[None]:
    """Let the complaint that a protocol cannot be told say whose bytes these are.

    The name is worked into the sentence, that of the standard input is not: who typed it knows. Of
    one file among several it ``leads``, as before any other complaint about a file.
    """
    try:
        yield
    except UndecidedError as error:
        if leads:
            told = Sentence("{name}: {told}", name=name, told=error.of("").args[0])
            raise error.telling(told) from error
        if name == STANDARD_INPUT:
            raise
        raise error.of(name) from error


class Patience:
    """An interruption ends the reading, never the decoding or writing of what has been read.

    The second one ends everything. A signal handler calls ``interrupt``.
    """

    def __init__(self) -> None:
        self.asked = False
        self._decoding = False
        self._reading = False

    @contextlib.contextmanager
    def decoding(self) -> Iterator[None]:
        """Be patient as long as this lasts; before and after it every interruption ends all."""
        self._decoding = True
        try:
            yield
        finally:
            self._decoding = False

    def groups(self, source: Iterable[Sequence[Chunk]]) -> Iterator[Sequence[Chunk]]:
        """Yield the groups of a source; KeyboardInterrupt stands between two of them."""
        groups = iter(source)
        while True:
            self._reading = True
            try:
                if self.asked:
                    raise KeyboardInterrupt
                group = next(groups, None)
            finally:
                self._reading = False
            if group is None:
                return
            yield group

    def interrupt(self) -> None:
        """Take an interruption.

        Raises:
            KeyboardInterrupt: something is being read, nothing is decoded, or this is the second.
        """
        again, self.asked = self.asked, True
        if again or self._reading or not self._decoding:
            raise KeyboardInterrupt


def reads_on(source: Source, summary: Summary) -> bool:
    """Tell whether an input that broke off is as whole as it can be: a recorder was killed."""
    return source.format == "mcap" and bool(summary.buses)


def nothing_in(name: str, part: Slice | None, notes: Sequence[str]) -> str:
    """Return what is said where nothing of an input was decoded; ``notes``: of its reader."""
    if part is not None and part.seconds is not None:
        least = "at least " if part.is_over else ""  # it may not be read to its end
        return f"nothing was said {part}: {name} has {least}{part.seconds:.3f} s"
    if notes:
        return f"{name} has no bytes to decode: {'; '.join(notes)}"
    return f"{name} is empty: nothing to decode"


def run_source(
    source: Source,
    options: Options,
    sinks: Sequence[Sink],
    *,
    name: str,
    tell: Teller,
    patience: Patience | None = None,
    groups: Iterable[Sequence[Chunk]] | None = None,
    ahead: Iterable[Chunk] = (),
    on_break: Callable[[str], None] = lambda why: None,
    asked: Extract | None = None,
    feed: Callable[[ResumablePipeline], None] | None = None,
    lags: bool = False,
) -> tuple[Summary, Ending]:
    """Decode everything into the sinks; return the totals, and how it ended.

    Damage further in, or an interruption, keeps what was decoded: the sinks are finished first.
    ``groups`` are the source's own where None, else what somebody made of them; then ``ahead`` are
    its first chunks, by which times are judged. A recording may break off: whoever records can be
    killed. ``on_break`` is told why an input was not read to its end. ``asked`` is what of it is
    shown. ``feed`` has a pipeline decode all of the source, in its own way. Where it
    ``lags`` the last group is decoded with the end: for sinks that do not show what came in a pass.

    Raises:
        InputError: there is nothing in it, or its protocol cannot be told.
        OutputError: an output failed; the others are whole.
        BrokenPipeError: the only output was a pipe, and nobody reads it any more.
    """

    def heard(given: Iterable[Sequence[Chunk]]) -> Iterable[Sequence[Chunk]]:
        return merged(source, given, options, tell) if groups is None else given

    def timed(bus: str, told: Pace) -> None:
        for remark in told.remarks:
            tell.talk(f"{bus}: {remark}")

    kind: type[Pipeline] = LaggingPipeline if lags else Pipeline
    kind = kind if feed is None else ResumablePipeline
    pipeline = kind(options, sinks, on_detection=tell.found, on_pace=timed, ahead=ahead)
    part = None
    if asked is not None:
        pipeline.narrowing = asked.narrowing([*sinks, pipeline.summary], tell)
        part = pipeline.narrowing.part
    patience = patience or Patience()
    ending, told = Ending.DONE, ""
    with patience.decoding():
        try:
            try:
                if feed is not None:
                    assert isinstance(pipeline, ResumablePipeline)
                    feed(pipeline)
                    groups = ()
                for group in heard(patience.groups(source if groups is None else groups)):
                    pipeline.feed(group)
                    if part is not None and part.is_over:
                        break
                pipeline.close()
            except DamagedInputError as error:
                pipeline.close()
                usable = reads_on(source, pipeline.summary)
                ending = Ending.DONE if usable else Ending.DAMAGED
                told = f"{error}: read as far as it goes" if usable else str(error)
                on_break(Sentence("{error}", error=error))
            except KeyboardInterrupt:
                ending, told = Ending.INTERRUPTED, _after_interruption(pipeline)
                on_break("reading it was interrupted")
            if not pipeline.summary.buses and ending == Ending.DONE:
                raise InputError(nothing_in(name, part, source.notes))
        finally:
            pipeline.finish()
    if patience.asked and ending == Ending.DONE:
        ending, told = Ending.INTERRUPTED, "interrupted"
    for mistake in pipeline.mistaken():
        if not mistake.share:
            told = told or f"{mistake} is in there, name another protocol: {mistake.found}"
            ending = Ending.MISTAKEN if ending == Ending.DONE else ending
        else:
            told_of = "{mistake}: it looks like {found}: decode it with {protocol:{name}}"
            name = mistake.found.protocol
            tell.talk(Sentence(told_of, mistake=mistake, found=mistake.found, name=name))
    for rule in pipeline.unmet(is_over=True):
        tell.warn(rule)
    if part is None and pipeline.summary.buses:
        lost = options.called.astray(pipeline.summary.buses, names_in(source.facts()))
        if lost is not None:
            tell.warn(lost)
        if (nobody := _of_nobody(options, source, pipeline.summary)) is not None:
            tell.warn(nobody)
    if told:
        tell.warn(told)
    else:
        for note in source.notes:
            tell.talk(f"{name}: {note}")
    return pipeline.summary, ending


def _of_nobody(options: Options, source: Source, summary: Summary) -> str | None:
    """Return that a model was told of a servo which is not there; None: none was."""
    recorded = Options().with_facts(source.facts(), source.tables).models
    told = {who for who in options.models if who is not None} - {*recorded}
    met = {servo for bus in summary.buses.values() for servo, _, _ in bus.by_command if servo >= 0}
    if not met or not told - met:
        return None
    whose, there = ([str(servo) for servo in sorted(some)] for some in (told - met, met))
    servos = f"servo{'s' * (len(whose) > 1)} {and_(whose)}"
    return f"a model was told of {servos}, of which nothing is in it: one of {', '.join(there)}"


def _after_interruption(pipeline: Pipeline) -> str:
    """Decode what was read; say what became of it."""
    try:
        pipeline.close()
    except UndecidedError as error:
        return Sentence("interrupted: {error}", error=error)
    kept = "what was decoded is kept" if pipeline.summary.buses else "nothing was decoded yet"
    return f"interrupted: {kept}"
