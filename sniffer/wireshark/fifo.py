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
        path: the pipe; opening it waits for its reader.
        hung_up: called when the reader has gone: that is how a capture ends.

    Raises:
        OutputError: it cannot be opened.
    """

    def __init__(self, path: Path, hung_up: Callable[[], None]) -> None:
        with writing(path):
            self._pipe = path.open("wb", buffering=0)
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
