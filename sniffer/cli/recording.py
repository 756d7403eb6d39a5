"""Running a recording: its files, what is shown beside it, signals, and what is told at its end."""

from __future__ import annotations

import contextlib
import functools
import signal
import sys
import time
from collections.abc import Callable, Iterator, Mapping, Sequence
from dataclasses import dataclass
from typing import TYPE_CHECKING, Final

import click

from sniffer.cli.screen import LOG, Screen
from sniffer.cli.session import open_outputs, say
from sniffer.cli.tapping import Tapping
from sniffer.detect import Detection, UndecidedError
from sniffer.model import NS, OutputError
from sniffer.pipeline import Pipeline
from sniffer.recording.recorder import Recorder, Wishes
from sniffer.recording.stops import Stops
from sniffer.sinks.base import Sink
from sniffer.sinks.board import Board
from sniffer.sinks.files import files_of
from sniffer.sinks.rotation import RotatingMcap

if TYPE_CHECKING:
    from pathlib import Path

    from sniffer.sources.listening import Anchor
    from sniffer.watching import LiveView

SWITCH_S: Final = 0.0005
"""How long a thread may keep the interpreter from the reader thread, in seconds."""

MISTAKES_S: Final = 5.0
"""How often it is looked whether a bus speaks another protocol than was said."""

STEP_NS: Final = NS // 10
"""A step of the system clock that is worth a word."""


@dataclass(frozen=True, slots=True)
class Shown:
    """Where it is shown: on the terminal, and in Rerun; None: not there."""

    mode: str | None
    view: str | None
    url: str | None
    window_s: float


@dataclass(frozen=True, slots=True)
class Limits:
    """What is said about the files."""

    rotate: Sequence[tuple[str, int]]
    keep: int | None
    durable: bool
    force: bool


def run_recording(
    tapping: Tapping,
    file: RotatingMcap | None,
    sinks: Sequence[Sink],
    stops: Stops,
    show: Shown,
) -> int:
    """Record until something ends it; tell what became of it."""
    talk: Callable[[str], None] = say if show.mode is not None else _nothing
    tell = _Teller(talk)
    pipeline = Pipeline(tapping.options, sinks, on_detection=tell.found, live=True)
    wishes = Wishes()
    beside: list[Callable[[Recorder], None]] = [tell.look]
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
    )
    screen: Screen | None = None
    view: LiveView | None = None
    before = sys.getswitchinterval()
    try:
        if show.view is not None:
            from sniffer.watching import LiveView

            name = file.path.stem if file is not None else "live"
            view = LiveView(
                show.view,
                options=tapping.options,
                name=name,
                url=show.url,
                window_s=show.window_s,
                say=tell,
            )
            pipeline.add(view)
            beside.append(functools.partial(_idle, view, tapping.anchor))
        if show.mode is not None:
            stream = sys.stdout if show.mode == LOG else sys.stderr
            screen = Screen(show.mode, recorder.status, stream=stream, board=Board())
            tell.say = screen.say
            pipeline.add(screen)
        beside.append(functools.partial(_statistics, screen))
        sys.setswitchinterval(SWITCH_S)
        with _signals(wishes):
            ended = _recorded(recorder, pipeline)
    finally:
        sys.setswitchinterval(before)
        tapping.listener.stop()
        if screen is not None:
            screen.close()
            tell.say = talk
    return _result(recorder, ended, file, tapping, screen, view, talk)


def _recorded(recorder: Recorder, pipeline: Pipeline) -> str:
    """Run the recorder and finish every output, whatever happens."""
    try:
        ended = recorder.run()
    finally:
        try:
            with contextlib.suppress(UndecidedError):
                pipeline.close()
        finally:
            pipeline.finish()
    return ended


@contextlib.contextmanager
def _signals(wishes: Wishes) -> Iterator[None]:
    """Take over the signals that end or steer a recording; the second Ctrl-C ends it at once."""

    def stop(number: int, frame: object) -> None:
        if wishes.stop is not None and number == signal.SIGINT:
            raise KeyboardInterrupt
        wishes.stop = signal.Signals(number).name

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


def open_files(
    paths: Sequence[Path], limits: Limits, facts: Mapping[str, str]
) -> tuple[RotatingMcap | None, list[Sink]]:
    """Open the outputs; the first .mcap is the recording."""
    recordings = [path for path in paths if path.suffix.lower() == ".mcap"]
    if len(recordings) > 1:
        raise click.UsageError("one .mcap is enough: give -o only one of them")
    if (limits.rotate or limits.keep) and not recordings:
        raise click.UsageError("--rotate and --keep are about a recording: -o x.mcap")
    if limits.keep and not limits.rotate:
        raise click.UsageError("--keep goes with --rotate")
    others = [path for path in paths if path not in recordings]
    for file in (file for path in others for file in files_of(path)):
        if file.exists() and not limits.force and not file.is_char_device():
            raise OutputError(f"{file} is there already: choose another name, or --force")
    sinks: list[Sink] = []
    recording: RotatingMcap | None = None
    if recordings:
        bounds = dict(limits.rotate)
        recording = RotatingMcap(
            recordings[0],
            facts,
            rotate_bytes=bounds.get("bytes"),
            rotate_ns=bounds.get("ns"),
            keep=limits.keep,
            durable=limits.durable,
            overwrite=limits.force,
        )
        sinks.append(recording)
    try:
        sinks += open_outputs(others, facts, "")
    except OutputError:
        for sink in sinks:
            sink.close()
        raise
    return recording, sinks


def _all(acts: Sequence[Callable[[Recorder], None]], recorder: Recorder) -> None:
    for act in acts:
        act(recorder)


def _idle(view: LiveView, anchor: Anchor, recorder: Recorder) -> None:
    view.idle(anchor.now())


def _nothing(message: str) -> None:
    """Keep quiet."""


class _Teller:
    """What is told while it runs; once a screen is there, above it."""

    def __init__(self, say: Callable[[str], None]) -> None:
        self.say = say
        self._told: set[str] = set()
        self._look_at = time.monotonic() + MISTAKES_S

    def __call__(self, message: str) -> None:
        self.say(message)

    def found(self, bus: str, detection: Detection) -> None:
        """Tell which protocol a bus was found to speak."""
        self.say(f"{bus}: {detection}")

    def once(self, message: str) -> None:
        """Tell something that will not change."""
        if message not in self._told:
            self._told.add(message)
            self.say(message)

    def look(self, recorder: Recorder) -> None:
        """Tell what has gone wrong since the last look, once each."""
        if time.monotonic() < self._look_at:
            return
        self._look_at = time.monotonic() + MISTAKES_S
        if recorder.pipeline.failure is not None:
            self.once(f"{recorder.pipeline.failure}; the recording goes on")
        for bus, other in recorder.pipeline.mistaken():
            named = recorder.pipeline.speaks(bus)
            if bus not in self._told:
                self._told.add(bus)
                self.say(f"{bus}: no frame of {named} so far, it looks like {other}")


def _statistics(screen: Screen | None, recorder: Recorder) -> None:
    """Print statistics where a signal asked for them."""
    if not recorder.wishes.statistics:
        return
    recorder.wishes.statistics = False
    if screen is not None:
        screen.ask()
        return
    status = recorder.status()
    buses = "; ".join(f"{b.bus}: {b.bytes} bytes, {b.state}" for b in status.buses)
    say(f"{status.elapsed_s:.0f} s, {status.size} bytes in {status.file}; {buses}")


def _result(
    recorder: Recorder,
    ended: str,
    file: RotatingMcap | None,
    tapping: Tapping,
    screen: Screen | None,
    view: LiveView | None,
    talk: Callable[[str], None],
) -> int:
    """Say what there is now; what went wrong is said also where quiet was asked for."""
    buses = recorder.pipeline.summary.buses
    frames = sum(sum(b.kinds.values()) for b in buses.values())
    gaps = sum(b.bytes_in_gaps for b in buses.values())
    anomalies = sum(sum(b.codes.values()) for b in buses.values())
    size = sum(tap.bytes for tap in recorder.taps)
    where = "nothing but what -o named"
    if file is not None:
        where = ", ".join(str(path) for path in file.files[-3:])
        if len(file.files) > 3:
            where = f"{len(file.files)} files, the last {where}"
    talk(f"stopped: {ended}")
    talk(
        f"{size} bytes recorded, {frames} frames, {gaps} bytes in no frame, "
        f"{anomalies} anomalies: {where}"
    )
    for tap in recorder.taps:
        spec = tap.spec
        if not tap.bytes:
            talk(f"{spec.bus}: no byte was heard; `sniffer doctor {spec.port}` tells more")
        elif recorder.pipeline.speaks(spec.bus) is None:
            say(
                f"{spec.bus}: its protocol could not be told from {tap.bytes} bytes: they are "
                "recorded; decode them with --protocol, or see `sniffer doctor`"
            )
    if recorder.skipped:
        say(
            f"{recorder.skipped} bytes were recorded but not decoded, this machine was too slow: "
            "decode the recording again"
        )
    step = tapping.anchor.step_ns()
    if abs(step) > STEP_NS:
        talk(f"the system clock moved by {step / NS:+.1f} s meanwhile; the stamps did not follow")
    if screen is not None and screen.dropped:
        talk(f"the screen left out {screen.dropped} frames; the recording has them")
    if view is not None and view.dropped_bytes:
        talk(f"Rerun was too slow for {view.dropped_bytes} bytes; the recording has them")
    return 0
