"""The far end of a serial line of the machine."""

from __future__ import annotations

import contextlib
import fcntl
import socket
import struct
import termios
import threading
import time
from typing import TYPE_CHECKING, Final

if TYPE_CHECKING:
    from collections.abc import Iterator, Sequence
    from pathlib import Path

PHRASE: Final = bytes.fromhex("ffffff0104f28c027affff")
"""What a bus says that never falls silent."""


class Wire:
    """What the guest sends is kept in ``sent``; what we say is paced.

    Args:
        path: the socket of QEMU's that stands for the line.
    """

    def __init__(self, path: Path) -> None:
        self.path = path
        self.sent = b""
        self._socket: socket.socket | None = None

    def plug(self) -> None:
        """Connect."""
        self._socket = line = socket.socket(socket.AF_UNIX)
        line.connect(str(self.path))
        threading.Thread(target=self._listen, args=(line,), daemon=True).start()

    def unplug(self) -> None:
        """Hang up; again is no error."""
        line, self._socket = self._socket, None
        if line is not None:
            line.shutdown(socket.SHUT_RDWR)
            line.close()

    def say(self, data: bytes) -> None:
        """Say bytes as fast as they are taken."""
        assert self._socket is not None
        self._socket.sendall(data)

    def utter(self, data: bytes) -> None:
        """Say bytes as a wire does: what nobody takes at once is lost."""
        assert self._socket is not None
        unsent = fcntl.ioctl(self._socket, termios.TIOCOUTQ, bytes(4))
        if not struct.unpack("i", unsent)[0]:
            self._socket.sendall(data)

    def play(self, said: Sequence[tuple[float, bytes]], *, lossy: bool = False) -> bytes:
        """Say bytes at their times, in seconds from now; return all of them.

        ``lossy``: what nobody takes at once is lost.
        """
        began = time.monotonic()
        for at, data in said:
            time.sleep(max(0.0, began + at - time.monotonic()))
            (self.utter if lossy else self.say)(data)
        return b"".join(data for _, data in said)

    @contextlib.contextmanager
    def chatter(self, baud: int = 57600) -> Iterator[None]:
        """Let the bus talk without an end meanwhile."""
        stop = threading.Event()

        def talk() -> None:
            while not stop.wait(len(PHRASE) * 10 / baud):
                self.utter(PHRASE)

        thread = threading.Thread(target=talk)
        thread.start()
        try:
            yield
        finally:
            stop.set()
            thread.join()

    def _listen(self, line: socket.socket) -> None:
        with contextlib.suppress(OSError):
            while data := line.recv(65536):
                self.sent += data
