"""Streams that nobody reads any more; apart, for the command line needs it before anything else."""

from __future__ import annotations

import os
from typing import TYPE_CHECKING

if TYPE_CHECKING:
    from typing import TextIO


def silence(stream: TextIO) -> None:
    """Let what is written to a stream go nowhere: nobody reads it any more."""
    devnull = os.open(os.devnull, os.O_WRONLY)
    os.dup2(devnull, stream.fileno())
    os.close(devnull)
