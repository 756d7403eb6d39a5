"""What streams lead to; apart, for the command line needs it before anything else."""

from __future__ import annotations

import os
from typing import TYPE_CHECKING, Final

if TYPE_CHECKING:
    from typing import TextIO

UNFOLDED: Final = 1 << 14
"""Columns where no window is: more than any sentence has."""


def stated_columns() -> int:
    """Return how many columns ``COLUMNS`` states, for pipes, too; 0: it states none."""
    told = os.environ.get("COLUMNS", "")
    return int(told[:6]) if told.isdecimal() else 0


def silence(stream: TextIO) -> None:
    """Let what is written to a stream go nowhere: nobody reads it any more."""
    devnull = os.open(os.devnull, os.O_WRONLY)
    os.dup2(devnull, stream.fileno())
    os.close(devnull)
