"""``sniffer open``: a file or a port looked into; what the command calls."""

from __future__ import annotations

import stat
import sys
from pathlib import Path

from sniffer.decoding.options import Options
from sniffer.ground.model import InputError
from sniffer.ground.needs import need_textual
from sniffer.inside.index import CaptureIndex
from sniffer.inside.reading import Reading
from sniffer.sources import open_source


def look_inside(
    source: str,
    options: Options | None = None,
    *,
    input_format: str = "auto",
    follow: bool = False,
) -> Reading:
    """Show a capture on the terminal; return what was read when the user quits.

    Args:
        source: a path.
        options: how it is decoded; what a recording says of itself fills what is not said.
        input_format: ``"auto"`` or a name of ``sniffer.sources.SOURCES``.
        follow: the file is being written: show what comes.

    Raises:
        InputError: the input cannot be read, or its protocol cannot be told; there is no terminal.
        OutputError: Textual is not installed.
    """
    need_terminal(source)
    options = options or Options()
    options.check()
    with open_source(source, input_format) as opened:
        path = Path(source)
        reading = Reading(opened, options, CaptureIndex(), growing=path if follow else None)
        reading.start()
        try:
            # loaded while the file is read: it takes as long as the first page
            need_textual()
            from sniffer.inside.app import LookingGlass

            LookingGlass(reading, name=path.name, marks=path, follow=follow).run()
        finally:
            reading.stop()
    if reading.failure is not None and not len(reading.index.lines):
        raise reading.failure
    return reading


def need_terminal(source: str) -> None:
    """Do nothing where keys can be read and a picture drawn.

    Raises:
        InputError: there is no terminal, or the source is what keys are read from.
    """
    if source == "-":
        raise InputError("keys are read from standard input: save the capture and give its name")
    if not (sys.stdin and sys.stdin.isatty() and sys.stdout and sys.stdout.isatty()):
        raise InputError("this draws on a terminal, and there is none: `sniffer decode` prints")


def is_port(source: str) -> bool:
    """Tell whether a source names a port rather than a file."""
    if "://" in source:
        return True
    try:
        return stat.S_ISCHR(Path(source.partition("@")[0].partition("=")[0]).stat().st_mode)
    except OSError:
        return False
