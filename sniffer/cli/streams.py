"""The standard streams: one line for the user, and what is done where nobody reads any more."""

from __future__ import annotations

import contextlib
import os
import sys
from collections.abc import Sequence
from pathlib import Path
from typing import Final

import click

from sniffer.ground.naming import worded
from sniffer.ground.streams import UNFOLDED, silence, stated_columns
from sniffer.ground.wording import and_, one_line

NAMED: Final = 6
"""So many files are named one by one."""


def silence_stdout() -> None:
    """Let nothing complain about an output that is gone when the interpreter flushes at its end."""
    silence(sys.stdout)


def say(message: str) -> None:
    """Talk to the user: one line on standard error; where that cannot be written, nobody hears."""
    with contextlib.suppress(OSError):
        click.echo(f"sniffer: {one_line(worded(message))}", err=True)


def wrote(files: Sequence[Path]) -> str:
    """Return what is said of files that are written; of many in a row the first and the last."""
    if len(files) > NAMED:
        return f"wrote {len(files)} files, {files[0]} to {files[-1]}"
    return f"wrote {and_([str(file) for file in files])}"


def width_of_terminal() -> int:
    """Return how many columns a line may have: those of ``COLUMNS``, or of the terminal.

    Into a pipe or a file sentences are not folded; 80 where a terminal does not tell its width.
    """
    if stated := stated_columns():
        return stated
    if not sys.stdout.isatty():
        return UNFOLDED
    with contextlib.suppress(OSError):
        return os.get_terminal_size(sys.stdout.fileno()).columns or 80
    return 80
