"""Running a recording: its files, what is shown beside it, signals, and what is told at its end."""

from __future__ import annotations

import contextlib
import functools
import gc
import os
import signal
import sys
import time
from collections.abc import Callable, Iterator, Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING, Final

import click

from sniffer.cli.session import open_outputs
from sniffer.cli.tapping import Tapping
from sniffer.cli.telling import Teller, result
from sniffer.decoding.detect import UndecidedError
from sniffer.decoding.pipeline import Pipeline
from sniffer.decoding.sink import Sink
from sniffer.ground.files import files_of, refuse_occupied
from sniffer.ground.model import DamagedInputError, OutputError, SnifferError
from sniffer.ground.needs import need_rerun
from sniffer.mcapfile.rotation import RotatingMcap
from sniffer.sinks import suffix_known
from sniffer.tap.recorder import DECODE_S, UNSEEN_S, Recorder, Wishes
from sniffer.tap.stops import Stops
from sniffer.viewers.board.board import Board
from sniffer.viewers.screen import LOG, Screen

if TYPE_CHECKING:
    from sniffer.tap.reader import Anchor
    from sniffer.viewers.companion.parent import LiveView

SWITCH_S: Final = 0.0005
"""How long a thread may keep the interpreter from the reader thread, in seconds."""

STOOD_S: Final = 0.5
"""A standstill of the program that is worth a word, in seconds."""

INTERRUPTED: Final = 130


@dataclass(frozen=True, slots=True)
class Shown:
    """Where it is shown: on the terminal, and in Rerun; None: not there."""

    mode: str | None
    view: str | None
    url: str | None
    window_s: float


@dataclass(frozen=True, slots=True)
class Files:
    """What is said about the files.

    ``rotate`` are the limits of a file by unit: ``bytes``, ``ns``; ``topics`` what the recording
    has beside the raw bytes, None for everything.
    """

    paths: Sequence[Path]
    rotate: Mapping[str, int]
    keep: int | None
    topics: Sequence[str] | None
    durable: bool
    force: bool

    @property
    def recording(self) -> Path | None:
        """The recording among them."""
        return next((path for path in self.paths if _is_recording(path)), None)

    @property
    def others(self) -> list[Path]:
        """The other outputs."""
        return [path for path in self.paths if not _is_recording(path)]


def _is_recording(path: Path) -> bool:
    return path.suffix.lower() == ".mcap"


def check_files(files: Files) -> None:
    """Refuse what cannot be meant, before a port is opened for it.

    Raises:
        OutputError: a file is there already, or its suffix is not known.
    """
    if sum(map(_is_recording, files.paths)) > 1:
        raise click.UsageError("one .mcap is enough: give -o only one of them")
    if (files.rotate or files.keep) and files.recording is None:
        raise click.UsageError("--rotate and --keep are about a recording: -o x.mcap")
    if files.topics is not None and files.recording is None:
        raise click.UsageError("--topics is about a recording: -o x.mcap")
    if files.keep and not files.rotate:
        raise click.UsageError("--keep goes with --rotate")
    for path in files.paths:
        suffix_known(path)
        numbered = _is_recording(path) and files.rotate  # their names are looked at later
        if not numbered and not files.force:
            refuse_occupied(files_of(path))


def open_files(files: Files, facts: Mapping[str, str]) -> tuple[RotatingMcap | None, list[Sink]]:
    """Open the outputs; where one cannot be opened, none is left behind."""
    recording: RotatingMcap | None = None
    if files.recording is not None:
        recording = RotatingMcap(
            files.recording,
            facts,
            rotate_bytes=files.rotate.get("bytes"),
            rotate_ns=files.rotate.get("ns"),
            keep=files.keep,
            durable=files.durable,
            topics=files.topics,
            overwrite=files.force,
        )
    try:
        others = open_outputs(files.others, facts, "", force=files.force)
    except OutputError:
        if recording is not None:
            recording.close()
            for path in recording.files:
                path.unlink(missing_ok=True)
        raise
    return recording, [*([recording] if recording is not None else []), *others]


def live_view(
    show: Shown, tapping: Tapping, name: str, tell: Callable[[str], None]
) -> LiveView | None:
    """Open the viewer that was asked for."""
    if show.view is None:
        return None
    need_rerun()
    from sniffer.viewers.companion.parent import LiveView

    return LiveView(
        show.view,
        options=tapping.options,
        name=name,
        url=show.url,
        window_s=show.window_s,
        say=tell,
    )


@contextlib.contextmanager
def signals(wishes: Wishes) -> Iterator[None]:
    """Take over the signals that end or steer a recording.

    The second Ctrl-C leaves out what is not decoded yet, the third ends the program at once.
    """

    def stop(number: int, frame: object) -> None:
        if not wishes.is_heard:
            raise KeyboardInterrupt  # ports are being opened, which may take long
        again, wishes.stop = wishes.stop, wishes.stop or signal.Signals(number).name
        if again is not None and number == signal.SIGINT:
            if wishes.hurry:
                raise KeyboardInterrupt
            wishes.hurry = True

    def rotate(number: int, frame: object) -> None:
        wishes.rotate = True

    def statistics(number: int, frame: object) -> None:
        wishes.statistics = True

    handlers = {"SIGINT": stop, "SIGTERM": stop, "SIGHUP": rotate, "SIGUSR1": statistics}
    numbers = {
        n: handler for name, handler in handlers.items() if (n := getattr(signal, name, None))
    }
    before = {number: signal.signal(number, handler) for number, handler in numbers.items()}
    try:
        yield
    finally:
        for number, handler in before.items():
            signal.signal(number, handler)


@contextlib.contextmanager
def leaving(screen: Screen | None) -> Iterator[None]:
    """Give the terminal back before a key stops the program (Ctrl-Z), or breaks it off."""

    def leave(number: int, frame: object) -> None:
        assert screen is not None
        began = time.monotonic()
        with screen.left():
            signal.signal(number, signal.SIG_DFL)
            os.kill(os.getpid(), number)  # comes back when the program goes on
        signal.signal(number, leave)
        if (stood_s := time.monotonic() - began) > STOOD_S:
            screen.say(
                f"the program was stopped for {stood_s:.1f} s (Ctrl-Z): what the ports could not "
                "keep meanwhile is not recorded"
            )

    wanted = () if screen is None else ("SIGTSTP", "SIGQUIT")
    numbers = [number for name in wanted if (number := getattr(signal, name, None))]
    mine = [number for number in numbers if signal.getsignal(number) == signal.SIG_DFL]
    for number in mine:
        signal.signal(number, leave)
    try:
        yield
    finally:
        for number in mine:
            signal.signal(number, signal.SIG_DFL)


def run_recording(
    tapping: Tapping,
    file: RotatingMcap | None,
    sinks: Sequence[Sink],
    stops: Stops,
    *,
    tell: Teller,
    mode: str | None,
    wishes: Wishes | None = None,
    view: LiveView | None = None,
) -> int:
    """Record until something ends it; tell what became of it.

    Raises:
        DamagedInputError: the ports could not be read any more; what was read is recorded.
        OutputError: the recording, or the last output, cannot be written any more.
    """
    wishes = wishes or Wishes()
    beside: list[Callable[[Recorder], None]] = [tell.look]
    pipeline = Pipeline(tapping.options, sinks, on_detection=tell.found, live=True)
    # who follows a recording, or ends it by what it says, waits no longer than eyes do
    is_followed = mode is not None or list(sinks) != [file] or stops.frames or stops.until
    is_cut = file is not None and file.rotates
    recorder = Recorder(
        tapping.listener,
        tapping.taps,
        tapping.anchor,
        pipeline,
        file,
        stops,
        mergers=tapping.mergers,
        wishes=wishes,
        on_round=lambda recorder: _all(beside, recorder),
        latency_ns=max(tapping.options.latencies.values(), default=0),
        decode_s=DECODE_S if is_followed or is_cut else UNSEEN_S,
    )
    beside.append(functools.partial(_has_outputs, sinks))
    if file is not None:
        beside.append(functools.partial(_deleted, file, tell))
    if view is not None:
        pipeline.add(view)
        beside.append(functools.partial(_idle, view, tapping.anchor))
    for note in tapping.notes:
        tell.talk(note)
    for warning in tapping.warnings:
        tell.warn(warning)
    screen: Screen | None = None
    before = sys.getswitchinterval()
    try:
        if mode is not None:
            stream = sys.stdout if mode == LOG else sys.stderr
            screen = tell.screen = Screen(mode, recorder.status, stream=stream, board=Board())
            pipeline.add(screen)
        beside.append(functools.partial(_statistics, screen, tell))
        sys.setswitchinterval(SWITCH_S)
        # What is there by now stays: looking through all of it again would keep the reader waiting.
        gc.collect()
        gc.freeze()
        with leaving(screen):
            ended, failure = _recorded(recorder, pipeline, file)
    finally:
        gc.unfreeze()
        sys.setswitchinterval(before)
        tapping.listener.stop()
        if screen is not None:
            screen.close()
            tell.screen = None
    if failure is not None and not isinstance(failure, DamagedInputError):
        raise failure
    result(recorder, ended, file, tapping.anchor, tell)
    if screen is not None and screen.dropped:
        tell.talk(f"the screen left out {screen.dropped} frames; the recording has them")
    if screen is not None and screen.failure is not None:
        tell.warn(f"the screen stopped by itself: {screen.failure!r}; the recording went on")
    if view is not None and view.dropped_bytes:
        tell.talk(f"Rerun was too slow for {view.dropped_bytes} bytes; the recording has them")
    if failure is not None:
        raise failure
    if pipeline.failure is not None:
        tell.once(str(pipeline.failure))
        return 2
    if file is not None:
        _deleted(file, tell, recorder)
        if file.is_lost and file.path not in file.deleted:
            tell.warn(f"{file.path} is gone: it was deleted or renamed while it was written")
        if file.is_lost or file.deleted:
            return 2
    return INTERRUPTED if wishes.hurry else 0


def _recorded(
    recorder: Recorder, pipeline: Pipeline, file: RotatingMcap | None
) -> tuple[str, SnifferError | None]:
    """Run the recorder and finish every output, whatever happens; return what ended it."""
    ended, failure = "", None
    try:
        try:
            ended = recorder.run()
        except (DamagedInputError, OutputError) as error:
            failure = error
        try:
            pipeline.close()
        except UndecidedError:
            pass  # its bytes are recorded; the result tells
        except OutputError as error:
            failure = failure or error
        if file is not None and pipeline.has(file):
            try:
                file.close()  # alone, because it is no recording without its end
            except OutputError as error:
                failure = failure or error
    finally:
        with contextlib.suppress(OutputError):  # told by the pipeline
            pipeline.finish()
    return ended, failure


def _all(acts: Sequence[Callable[[Recorder], None]], recorder: Recorder) -> None:
    for act in acts:
        act(recorder)


def _idle(view: LiveView, anchor: Anchor, recorder: Recorder) -> None:
    view.idle(anchor.now())


def _deleted(file: RotatingMcap, tell: Teller, recorder: Recorder) -> None:
    """Tell which files somebody has deleted while they were written."""
    for path in file.deleted:
        tell.once(f"{path} was deleted while it was written: what it held is lost")


def _has_outputs(sinks: Sequence[Sink], recorder: Recorder) -> None:
    """Stop where every output has failed: what is shown is none."""
    pipeline = recorder.pipeline
    if pipeline.failure is not None and not any(pipeline.has(sink) for sink in sinks):
        raise pipeline.failure


def _statistics(screen: Screen | None, tell: Teller, recorder: Recorder) -> None:
    """Print statistics where a signal asked for them."""
    if not recorder.wishes.statistics:
        return
    recorder.wishes.statistics = False
    if screen is not None:
        screen.ask()
        return
    status = recorder.status()
    buses = "; ".join(f"{b.bus}: {b.bytes} bytes, {b.state}" for b in status.buses)
    tell.warn(f"{status.elapsed_s:.0f} s, {status.size} bytes in {status.file}; {buses}")
