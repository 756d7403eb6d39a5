"""The named pipe that Wireshark reads from a capture interface."""

from __future__ import annotations

import io
from typing import TYPE_CHECKING

from sniffer.ground.files import writing

if TYPE_CHECKING:
    from collections.abc import Callable
    from pathlib import Path

    from _typeshed import ReadableBuffer


class Fifo(io.RawIOBase):
    """A stream that tells once that nobody reads it any more, and takes no offence at that.

    Args:
        pipe: the pipe, open.
        hung_up: called when the reader has gone: that is how a capture ends.
    """

    def __init__(self, pipe: io.FileIO, hung_up: Callable[[], None]) -> None:
        self._pipe = pipe
        self._hung_up = hung_up
        self._is_heard = True

    def writable(self) -> bool:
        """Tell that it takes bytes."""
        return True

    def write(self, data: ReadableBuffer, /) -> int:
        """Write all of it, nothing once the reader has gone."""
        left = memoryview(data).cast("B")
        size = len(left)
        while self._is_heard and len(left):
            try:
                left = left[self._pipe.write(left) :]
            except BrokenPipeError:
                self._is_heard = False
                self._hung_up()
        return size

    def close(self) -> None:
        """Close the pipe: its reader comes to the end."""
        self._pipe.close()
        super().close()


def opened(path: Path, hung_up: Callable[[], None]) -> Fifo:
    """Return the pipe at ``path``; opening it waits for its reader.

    Raises:
        OutputError: it cannot be opened.
    """
    with writing(path):
        pipe = path.open("wb", buffering=0)
    return Fifo(pipe, hung_up)
