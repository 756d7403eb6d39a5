"""``sniffer.record``: ports are listened to, and every byte is recorded, decoded and shown."""

from __future__ import annotations

import contextlib
import functools
import gc
import sys
from dataclasses import dataclass, replace
from pathlib import Path
from typing import TYPE_CHECKING, Final

from sniffer.decoding.detect import UndecidedError
from sniffer.decoding.pipeline import AUTO, Options, Pipeline
from sniffer.ground.collecting import Promptly
from sniffer.ground.model import DamagedInputError, OutputError, SnifferError
from sniffer.ground.needs import need_foxglove, need_rerun
from sniffer.jobs.files import check_files, open_files
from sniffer.jobs.incidents import LiveIncidents
from sniffer.jobs.outputs import GONE, session_facts
from sniffer.jobs.outputs import gone as told_gone
from sniffer.jobs.reactions import Reactions, Waits
from sniffer.jobs.telling import Teller, result
from sniffer.mcapfile.flight import FlightRecorder
from sniffer.messages import INCIDENTS
from sniffer.protocols import PROTOCOLS
from sniffer.tap.listen import Listening, Tapping, listen
from sniffer.tap.recorder import DECODE_S, UNSEEN_S, Recorder, Wishes
from sniffer.tap.stops import Stops
from sniffer.viewers.board.board import Board
from sniffer.viewers.leaving import leaving
from sniffer.viewers.screen import LOG, Screen

if TYPE_CHECKING:
    from collections.abc import Callable, Sequence

    from sniffer.decoding.sink import Sink
    from sniffer.decoding.summary import Summary
    from sniffer.jobs.files import Files, RecordingFiles
    from sniffer.selection.selection import Selection
    from sniffer.tap.tap import PortSpec
    from sniffer.viewers.companion.parent import LiveView

SWITCH_S: Final = 0.0005
"""How long a thread may keep the interpreter from the reader thread, in seconds."""


@dataclass(frozen=True, slots=True)
class Shown:
    """Where a recording is shown while it is made; None: not there.

    ``mode`` is the terminal's (board, line or log, as ``sniffer.viewers.screen`` names them),
    ``view`` Rerun's (window, web, or connect with the ``url`` of a viewer), whose plots show the
    last ``window_s`` seconds, or foxglove (``url``: HOST:PORT where it is served). ``selection`` is
    which records a log shows, or what the board begins with; ``color`` whether both have colours,
    None: on a terminal.
    """

    mode: str | None = None
    view: str | None = None
    url: str | None = None
    window_s: float = 20.0
    selection: Selection | None = None
    color: bool | None = None


@dataclass(frozen=True, slots=True)
class Recorded:
    """What became of a recording.

    ``ended`` says in words what ended it; ``files`` are those of the recording itself, ``gone``
    outputs that were deleted or renamed meanwhile. ``failure`` is why an output could not be
    written to its end, None where all could; ``hurried`` that bytes are recorded which were not
    decoded, because whoever ended it did so twice.
    """

    ended: str
    bytes: int
    summary: Summary
    files: tuple[Path, ...] = ()
    gone: tuple[Path, ...] = ()
    failure: str | None = None
    hurried: bool = False


def live_view(
    show: Shown, tapping: Tapping, name: str, tell: Callable[[str], None]
) -> LiveView | None:
    """Open the viewer that was asked for."""
    if show.view is None:
        return None
    from sniffer.viewers.companion.parcels import FOXGLOVE
    from sniffer.viewers.companion.parent import LiveView

    if show.view == FOXGLOVE:
        need_foxglove()
    else:
        need_rerun()
    return LiveView(
        show.view,
        options=tapping.options,
        name=name,
        url=show.url,
        window_s=show.window_s,
        say=tell,
        buses=[*dict.fromkeys(tap.spec.bus for tap in tapping.taps)],
    )


def record(
    ports: Sequence[PortSpec],
    files: Files,
    options: Options | None = None,
    *,
    listening: Listening | None = None,
    stops: Stops | None = None,
    shown: Shown | None = None,
    commands: Sequence[tuple[str, str]] = (),
    sinks: Sequence[Sink] = (),
    wishes: Wishes | None = None,
    tell: Teller | None = None,
) -> Recorded:
    """Listen to ports and record every byte, with all that can be made of it.

    Nothing is written to a port. The call returns when one of ``stops`` is met, or when another
    thread (or a signal handler) sets ``wishes.stop``.

    Args:
        ports: what is listened to; each is a bus, or two of them are (``listening.pair``).
        files: where the recording goes.
        options: how it is decoded: protocol, baud rate, models.
        listening: how the ports are opened.
        stops: what ends the recording.
        shown: where it is shown meanwhile.
        commands: what is run when something happens: a code, a cause, a rule or ``any``, and a
            command of the shell.
        sinks: what takes all of it beside the files.
        wishes: what may be asked of it while it runs.
        tell: takes what should be told; nothing is told without.

    Raises:
        InputError: a port cannot be opened; the message says what to do.
        DamagedInputError: the ports could not be read any more; what was read is recorded.
        OutputError: the recording, or the last output, cannot be written any more.
        SnifferError: things that do not go together were asked for.
    """
    options, shown = options or Options(), shown or Shown()
    tell, wishes = tell or Teller(lambda line: None, quiet=True), wishes or Wishes()
    check_files(files)
    stops = stops or Stops()
    waits = Waits.of(stops, files, commands)
    options = waits.judged(options)
    options.check([spec.protocol for spec in ports if spec.protocol is not None])
    options.check_called()
    selection = shown.selection and shown.selection.named(options.called)
    if any((spec.protocol or options.protocol) == AUTO for spec in ports):
        PROTOCOLS.candidates()  # plug-ins take their time to be imported: not while ports are read
    tapping = listen(ports, options, listening or Listening())
    view = None
    try:
        first = files.recording or next(iter(files.others), Path("recording"))
        view = live_view(shown, tapping, first.stem, tell.talk)
        source = ", ".join(spec.port for spec in ports)
        facts = {**session_facts(source, options, tapping.facts), **tapping.facts}
        file, opened = open_files(
            files, facts, tapping.options, now=tapping.anchor.now, tell=tell.talk
        )
    except BaseException:
        tapping.listener.stop()
        if view is not None:
            view.close()
        raise
    recorded = run_recording(
        tapping,
        file,
        [*opened, *sinks],
        stops,
        tell=tell,
        mode=shown.mode,
        selection=selection,
        color=shown.color,
        wishes=wishes,
        view=view,
        waits=waits,
        diagnoses=files.topics is None or INCIDENTS in files.topics,
    )
    return replace(recorded, gone=(*recorded.gone, *told_gone(files.others, tell)))


def run_recording(
    tapping: Tapping,
    file: RecordingFiles | None,
    sinks: Sequence[Sink],
    stops: Stops,
    *,
    tell: Teller,
    mode: str | None,
    wishes: Wishes | None = None,
    view: LiveView | None = None,
    waits: Waits | None = None,
    diagnoses: bool = True,
    selection: Selection | None = None,
    color: bool | None = None,
) -> Recorded:
    """Record from ports that are listened to until something ends it; tell what became of it.

    ``diagnoses``: the recording has incidents; else there are some only where somebody looks on.
    ``selection`` is which records a log shows, ``color`` whether it has colours.

    Raises:
        DamagedInputError: the ports could not be read any more; what was read is recorded.
        OutputError: the recording, or the last output, cannot be written any more.
    """
    wishes = wishes or Wishes()
    beside: list[Callable[[Recorder], None]] = [tell.look]
    pipeline = Pipeline(tapping.options, sinks, on_detection=tell.found, live=True)
    # who follows a recording, or ends it by what it says, waits no longer than eyes do
    reactions = Reactions(waits, file, tell) if waits is not None and waits.every else None
    is_followed = mode is not None or list(sinks) != [file] or stops.frames or reactions
    is_cut = isinstance(file, FlightRecorder) or (file is not None and file.rotates)
    recorder = Recorder(
        tapping.listener,
        tapping.taps,
        tapping.anchor,
        pipeline,
        file,
        stops,
        mergers=tapping.mergers,
        searches=tapping.searches,
        on_rate=tell.tuned,
        wishes=wishes,
        on_round=lambda recorder: _all(beside, recorder),
        latency_ns=max(tapping.options.latencies.values(), default=0),
        decode_s=DECODE_S if is_followed or is_cut else UNSEEN_S,
    )
    beside.append(functools.partial(_has_outputs, sinks))
    board = Board() if mode is not None else None
    live: LiveIncidents | None = None
    if diagnoses or board is not None or view is not None or reactions is not None:
        watch = None if reactions is None else reactions.watch
        live = LiveIncidents(
            tapping.anchor,
            file,
            tell,
            board=board,
            view=view,
            watch=watch,
            is_followed=bool(is_followed) or view is not None,
        )
        pipeline.add(live.sink)
        beside.append(live.look)
    if reactions is not None:
        pipeline.add(reactions.watch)
        beside.append(reactions.look)
    if file is not None:
        beside.append(functools.partial(_deleted, file, tell))
    if view is not None:
        view.hold(tapping.searches)
        pipeline.add(view)
        beside.append(functools.partial(_keep_up, view))
    for note in tapping.notes:
        tell.talk(note)
    for warning in tapping.warnings:
        tell.warn(warning)
    screen: Screen | None = None
    before = sys.getswitchinterval()
    try:
        if mode is not None:
            stream = sys.stdout if mode == LOG else sys.stderr
            buses = [tap.spec.bus for tap in recorder.taps]
            shown = functools.partial(Screen, board=board, selection=selection, color=color)
            screen = tell.screen = shown(mode, recorder.status, stream=stream, buses=buses)
            pipeline.add(screen)
        beside.append(functools.partial(_statistics, screen, tell))
        sys.setswitchinterval(SWITCH_S)
        # What is there by now stays: looking through all of it again would keep the reader waiting.
        gc.collect()
        gc.freeze()
        with Promptly(), leaving(screen):
            ended, failure = _recorded(recorder, pipeline, file, live, reactions)
    finally:
        gc.unfreeze()
        sys.setswitchinterval(before)
        tapping.listener.stop()
        if screen is not None:
            screen.close()
            tell.screen = None
        if reactions is not None:
            reactions.close()
    if failure is not None and not isinstance(failure, DamagedInputError):
        raise failure
    result(recorder, ended, file, tapping.anchor, tell)
    for line in () if file is None else file.remarks:
        tell.talk(line)
    if screen is not None and screen.dropped:
        tell.talk(f"the screen left out {screen.dropped} frames; the recording has them")
    if screen is not None and screen.failure is not None:
        tell.warn(f"the screen stopped by itself: {screen.failure!r}; the recording went on")
    if view is not None and view.dropped_bytes:
        tell.talk(
            f"{view.where} was too slow for {view.dropped_bytes} bytes; the recording has them"
        )
    if failure is not None:
        raise failure
    if pipeline.failure is not None:
        tell.once(str(pipeline.failure))
    gone: list[Path] = []
    if file is not None:
        _deleted(file, tell, recorder)
        gone += file.deleted
        if file.is_lost and file.path not in file.deleted:
            tell.warn(GONE.format(file.path))
            gone.append(file.path)
    return Recorded(
        ended,
        sum(tap.bytes for tap in tapping.taps),
        pipeline.summary,
        () if file is None else tuple(file.files),
        tuple(gone),
        None if pipeline.failure is None else str(pipeline.failure),
        wishes.hurry,
    )


def _recorded(
    recorder: Recorder,
    pipeline: Pipeline,
    file: RecordingFiles | None,
    live: LiveIncidents | None,
    reactions: Reactions | None,
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
        try:
            if live is not None:
                live.finish(recorder)
            if reactions is not None:
                reactions.look(recorder)
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


def _keep_up(view: LiveView, recorder: Recorder) -> None:
    view.keep_up()


def _deleted(file: RecordingFiles, tell: Teller, recorder: Recorder) -> None:
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
    buses = "; ".join(f"{b.bus} ({b.port}): {b.bytes} bytes, {b.state}" for b in status.buses)
    tell.warn(f"{status.elapsed_s:.0f} s, {status.size} bytes in {status.file}; {buses}")
