"""``sniffer open``: a file or a port looked into; what the command calls."""

from __future__ import annotations

import contextlib
import stat
import sys
import time
from pathlib import Path
from typing import TYPE_CHECKING, Final

from sniffer.decoding.options import Options
from sniffer.ground.collecting import Promptly
from sniffer.ground.model import InputError, OutputError
from sniffer.ground.needs import need_textual
from sniffer.inside.index import CaptureIndex
from sniffer.inside.marks import into_recording
from sniffer.inside.reading import LOOK_S, Reading, has_begun
from sniffer.inside.recorder import BesideRecorder
from sniffer.sources.several import inputs_of, open_capture

if TYPE_CHECKING:
    from collections.abc import Callable, Iterator, Sequence

    from sniffer.selection.selection import Selection

SWITCH_S: Final = 0.001
"""How long what reads and decodes may keep the screen waiting at a time, in seconds."""


def look_inside(
    source: str | Sequence[str],
    options: Options | None = None,
    *,
    input_format: str = "auto",
    follow: bool = False,
    recorder: BesideRecorder | None = None,
    selection: Selection | None = None,
    start: str = "",
    tell: Callable[[str], None] = lambda line: None,
) -> Reading:
    """Show a capture on the terminal; return what was read when the user quits.

    Args:
        source: a path; several are one capture, whose marks are not kept.
        options: how it is decoded; what a recording says of itself fills what is not said.
        input_format: ``"auto"`` or a name of ``sniffer.sources.SOURCES``.
        follow: the file is being written: show what comes, from its first line on.
        recorder: what writes it, where a port is shown.
        selection: which lines are shown until another filter is asked for.
        start: the place where it begins (``selection.places``); empty: the first line.
        tell: takes what there is to say before there is a screen.

    Raises:
        InputError: the input cannot be read, or its protocol cannot be told; there is no terminal.
        OutputError: Textual is not installed.
    """
    need_textual()
    inputs = inputs_of(source)
    need_terminal(*map(str, inputs))
    options = options or Options()
    options.check()
    if follow and recorder is None:
        _wait_for_a_line(Path(inputs[0]), tell)
    with open_capture(inputs, input_format, wiring=options.wired) as opened:
        if selection is not None:
            selection = selection.named(options.called_with(opened.facts()))
        path = Path(inputs[0])
        kept = path if len(inputs) == 1 else None
        reading = Reading(opened, options, CaptureIndex(), growing=path if follow else None)
        before = sys.getswitchinterval()
        sys.setswitchinterval(SWITCH_S)
        reading.start(first=True)
        try:
            # loaded while the file is read: it takes as long as the first page
            from sniffer.inside.app import LookingGlass

            glass = LookingGlass(
                reading,
                name=path.name if kept else opened.name,
                marks=kept,
                follow=follow,
                recorder=recorder,
                wanted="" if selection is None else selection.text,
                start=start,
            )
            with Promptly(), _drawn_on_terminal():
                glass.run()
        finally:
            sys.setswitchinterval(before)
            reading.stop()
            reading.index.discard()
            if recorder is not None:
                recorder.stop()  # it writes the end of the file, before which nothing can be added
            if kept is not None:
                with contextlib.suppress(InputError, OutputError):  # then they stay beside it
                    into_recording(kept)
    if glass.return_code:  # its trace is on the terminal
        raise RuntimeError("the screen broke off")
    if reading.failure is not None and not len(reading.index.lines):
        raise reading.failure
    return reading


def look_at_port(
    arguments: Sequence[str], path: Path, options: Options, selection: Selection | None = None
) -> Reading:
    """Record a port into a file beside, and show it; return when the user quits.

    Args:
        arguments: what ``sniffer record`` is called with.
        path: of the recording, as they say it; it must not be there yet.
        options: how it is shown.
        selection: which lines are shown until another filter is asked for.

    Raises:
        InputError: the port cannot be recorded, or there is no terminal.
        OutputError: Textual is not installed.
    """
    need_textual()
    need_terminal(str(path))
    recorder = BesideRecorder(arguments, path)
    try:
        return look_inside(
            str(path),
            options,
            input_format="mcap",
            follow=True,
            recorder=recorder,
            selection=selection,
        )
    finally:
        recorder.stop()


def _wait_for_a_line(path: Path, tell: Callable[[str], None]) -> None:
    """Wait until a file that somebody writes has a line: by that it is known what it is."""
    if path.is_file() and not has_begun(path):
        tell(f"{path}: waiting for its first line")
        while path.is_file() and not has_begun(path):
            time.sleep(LOOK_S)


def need_terminal(*sources: str) -> None:
    """Do nothing where keys can be read and a picture drawn.

    Raises:
        InputError: there is no terminal, or a source is what keys are read from.
    """
    if "-" in sources:
        raise InputError("keys are read from standard input: save the capture and give its name")
    if not (sys.stdin and sys.stdin.isatty() and sys.stdout and sys.stdout.isatty()):
        raise InputError("this draws on a terminal, and there is none: `sniffer decode` prints")


@contextlib.contextmanager
def _drawn_on_terminal() -> Iterator[None]:
    """Let Textual, which draws on standard error, draw on standard output where that is a file."""
    errors = sys.__stderr__
    if errors is None or not errors.isatty():
        sys.__stderr__ = sys.__stdout__  # type: ignore[misc]
    try:
        yield
    finally:
        sys.__stderr__ = errors  # type: ignore[misc]


def is_port(source: str) -> bool:
    """Tell whether a source names a port rather than a file."""
    if "://" in source:
        return True
    try:
        return stat.S_ISCHR(Path(source.partition("@")[0].partition("=")[0]).stat().st_mode)
    except OSError:
        return False
