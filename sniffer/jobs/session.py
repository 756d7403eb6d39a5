"""Running a source through the pipeline for a command: what to do when something breaks off."""

from __future__ import annotations

import contextlib
import signal
import sys
import threading
from collections.abc import Iterable, Iterator, Sequence
from pathlib import Path

from sniffer.cli.statuses import DAMAGED, DONE, INTERRUPTED, MISTAKE
from sniffer.cli.streams import say, silence_stdout
from sniffer.decoding.detect import Detection, UndecidedError
from sniffer.decoding.pacing import Pace
from sniffer.decoding.pipeline import Options, Pipeline
from sniffer.decoding.sink import Paced, Part, Sink, written
from sniffer.ground.model import Batch, Chunk, DamagedInputError, InputError, OutputError
from sniffer.jobs.outputs import lost
from sniffer.merge.wires import in_order
from sniffer.protocols.base import BusProtocol
from sniffer.sources import MIXED, Source


class Standard:
    """The sink on standard output: when its reader goes away, it falls silent.

    The pipe's end is nobody's fault; decoding goes on if there are other outputs.
    """

    def __init__(self, sink: Sink, *, alone: bool) -> None:
        self._sink = sink
        self._alone = alone
        self._open = True

    def raw(self, bus: str, chunks: Sequence[Chunk]) -> None:
        """Pass chunks on."""
        self._sink.raw(bus, chunks)

    def pace(self, bus: str, told: Pace) -> None:
        """Pass on what a bus is timed by."""
        if isinstance(self._sink, Paced):
            self._sink.pace(bus, told)

    def write(self, bus: str, protocol: BusProtocol, batch: Batch) -> None:
        """Pass a batch on while somebody listens."""
        self.write_together(bus, [(protocol, batch)])

    def write_together(self, bus: str, parts: Sequence[Part]) -> None:
        """Pass on what several protocols said in one pass."""
        with self._listening():
            if self._open:
                written(self._sink, bus=bus, parts=parts)
                sys.stdout.flush()

    def close(self) -> None:
        """End the output while somebody listens."""
        with self._listening():
            if self._open:
                self._sink.close()

    @contextlib.contextmanager
    def _listening(self) -> Iterator[None]:
        try:
            yield
        except BrokenPipeError:
            self._open = False
            silence_stdout()
            if self._alone:
                raise
        except OSError as error:
            self._open = False
            silence_stdout()
            why = error.strerror or error
            raise OutputError(f"standard output: cannot be written ({why})") from None


def tell_lost(paths: Sequence[Path]) -> int:
    """Tell which outputs are gone although they were written; return the exit status."""
    files = lost(paths)
    for file in files:
        say(f"{file} is gone: it was deleted or renamed while it was written")
    return MISTAKE if files else DONE


class _Patience:
    """Ctrl-C ends the reading, never the decoding or writing of what has been read.

    The second one ends everything.
    """

    def __init__(self) -> None:
        self.asked = False
        self._reading = False

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

    @contextlib.contextmanager
    def installed(self) -> Iterator[None]:
        """Take Ctrl-C over; elsewhere than in the main thread it does not arrive anyway."""
        if threading.current_thread() is not threading.main_thread():
            yield
            return
        before = signal.signal(signal.SIGINT, self._interrupt)
        try:
            yield
        finally:
            signal.signal(signal.SIGINT, before)

    def _interrupt(self, number: int, frame: object) -> None:
        again, self.asked = self.asked, True
        if self._reading or again:
            raise KeyboardInterrupt


def merged(
    source: Source, groups: Iterable[Sequence[Chunk]], options: Options, *, quiet: bool = False
) -> Iterable[Sequence[Chunk]]:
    """Return the groups of a source; lines of two taps that their host mixed are merged."""
    if source.format not in MIXED:
        return groups

    return in_order(groups, options, (lambda message: None) if quiet else say)


def run_source(
    source: Source,
    options: Options,
    sinks: Sequence[Sink],
    *,
    name: str,
    quiet: bool = False,
    groups: Iterable[Sequence[Chunk]] | None = None,
    ahead: Iterable[Chunk] = (),
) -> tuple[Pipeline, int]:
    """Decode everything into the sinks; return the pipeline and the exit status.

    Damage further in, or an interruption, keeps what was decoded: the sinks are finished first.
    ``groups`` are the source's own where None, else what somebody made of them; then ``ahead`` are
    its first chunks, by which times are judged. A recording may break off: whoever records can be
    killed.

    Raises:
        InputError: there is nothing in it, or its protocol cannot be told.
        OutputError: an output failed; the others are whole.
        BrokenPipeError: the only output was a pipe, and nobody reads it any more.
    """

    def found(bus: str, detection: Detection) -> None:
        if not quiet:
            say(f"{bus}: {detection}")

    def heard(given: Iterable[Sequence[Chunk]]) -> Iterable[Sequence[Chunk]]:
        return merged(source, given, options, quiet=quiet) if groups is None else given

    def timed(bus: str, told: Pace) -> None:
        for remark in () if quiet else told.remarks:
            say(f"{bus}: {remark}")

    pipeline = Pipeline(options, sinks, on_detection=found, on_pace=timed, ahead=ahead)
    patience = _Patience()
    status, told = DONE, ""
    with patience.installed():
        try:
            try:
                for group in heard(patience.groups(source if groups is None else groups)):
                    pipeline.feed(group)
                pipeline.close()
            except DamagedInputError as error:
                pipeline.close()
                usable = source.format == "mcap" and pipeline.summary.buses
                status, told = (DONE if usable else DAMAGED), str(error)
                told += ": read as far as it goes" if usable else ""
            except KeyboardInterrupt:
                status, told = INTERRUPTED, _after_interruption(pipeline)
            if not pipeline.summary.buses and not status:
                raise InputError(f"{name} is empty: nothing to decode")
        finally:
            pipeline.finish()
    if patience.asked and not status:
        status, told = INTERRUPTED, "interrupted"
    for mistake in pipeline.mistaken():
        if not mistake.share:
            told = told or f"{mistake} is in there, name another protocol: {mistake.found}"
            status = status or MISTAKE
        elif not quiet:
            say(f"{mistake}: it looks like {mistake.found}")
    if told:
        say(told)
    elif not quiet:
        for note in source.notes:
            say(f"{name}: {note}")
    return pipeline, status


def _after_interruption(pipeline: Pipeline) -> str:
    """Decode what was read; say what became of it."""
    try:
        pipeline.close()
    except UndecidedError as error:
        return f"interrupted: {error}"
    kept = "what was decoded is kept" if pipeline.summary.buses else "nothing was decoded yet"
    return f"interrupted: {kept}"
