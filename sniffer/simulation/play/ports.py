"""Where something is played: a pseudo-terminal, or a device that is there.

This is the only place of the package that opens a terminal for writing; a test holds that.

A pseudo-terminal is a wire: what is said while nobody has it open is lost, as on a real bus.
Nobody's slave is open here meanwhile: that is how the kernel tells (the master hangs up) whether
somebody listens, and why whoever opens it hears no stale bytes.
"""

from __future__ import annotations

import contextlib
import errno
import fcntl
import os
import select
import struct
import sys
import termios
import time
import tty
from pathlib import Path
from typing import TYPE_CHECKING, Final, Protocol

from sniffer.ground.devices import is_pseudo
from sniffer.ground.model import OutputError
from sniffer.ground.wording import Sentence

if TYPE_CHECKING:
    from collections.abc import Iterator

READ_MOST: Final = 65536
SETTLE_S: Final = 0.002
"""How long bytes may be on their way between the two ends of a pseudo-terminal: the kernel moves
them in the background."""

FETCH_S: Final = 5.0
"""How long the end waits for a reader that has the port open and fetches nothing: one on a busy
machine may not be run for a second."""

_BOTHER: Final = 0o010000
_CBAUD: Final = 0o010017
_TCGETS2, _TCSETS2 = 0x802C542A, 0x402C542B
"""Any baud rate, not only those with a constant. Source: Linux, include/uapi/asm-generic."""

_TERMIOS2: Final = struct.Struct("4IB19s2I")


class PlayPort(Protocol):
    """Bytes out and in, never waiting."""

    name: str
    carries: bool
    """Bytes take their time in here: the line is a real one."""

    def fileno(self) -> int:
        """Return what becomes readable when somebody speaks."""
        ...

    def listened(self) -> bool:
        """Tell whether anybody has the other end open."""
        ...

    def write(self, data: bytes) -> int:
        """Write what there is room for; return how many bytes that was."""
        ...

    def read(self) -> bytes:
        """Return what has been said at the other end, nothing if nothing."""
        ...

    def forget(self) -> int:
        """Throw away what a reader that is gone has left unread; return how many bytes."""
        ...

    def drain(self) -> int:
        """Wait a little until everything is read; return how many bytes nobody took."""
        ...

    def close(self) -> None:
        """Give it up; the other end hangs up."""
        ...


class Pty:
    """The master of a raw pseudo-terminal; ``name`` is the other end."""

    carries = False

    def __init__(self) -> None:
        try:
            self._master, slave = os.openpty()
        except OSError as error:
            raise OutputError(f"no pseudo-terminal to be had ({error.strerror})") from None
        self.name = os.ttyname(slave)
        tty.setraw(slave)
        os.close(slave)
        os.set_blocking(self._master, False)
        self._poll = select.poll()
        self._poll.register(self._master, select.POLLIN)

    def fileno(self) -> int:
        """Return the master."""
        return self._master

    def listened(self) -> bool:
        """Tell whether anybody has the other end open."""
        events = self._poll.poll(0)
        return not events or not events[0][1] & select.POLLHUP

    def write(self, data: bytes) -> int:
        """Write what there is room for: some 12 to 20 KB that nobody has read."""
        return _write(self._master, data)

    def read(self) -> bytes:
        """Return what has been said at the other end."""
        return _read(self._master)

    def forget(self) -> int:
        """Read what is left over, and undo what the last reader set."""
        with self._slave() as slave:
            tty.setraw(slave)
            return _left(slave)

    def drain(self) -> int:
        """Wait a little: what is unread when the master closes is lost to the reader."""
        if not self.listened():
            return self.forget()
        deadline = time.monotonic() + FETCH_S
        empty, before = 0, b""
        with self._slave() as slave:
            while empty < 2 and time.monotonic() < deadline:
                time.sleep(SETTLE_S)
                # What was written may still be on its way to the reader's end, for long where the
                # machine is busy; who asks whether there is something to read waits for it (Linux,
                # n_tty_poll), who asks how much there is does not.
                select.select([slave], [], [], 0)
                waiting = fcntl.ioctl(slave, termios.FIONREAD, bytes(4))
                if waiting != before:  # it fetches, however slowly
                    deadline, before = time.monotonic() + FETCH_S, waiting
                empty = empty + 1 if waiting == bytes(4) else 0
            return 0 if empty == 2 else _left(slave)

    def close(self) -> None:
        """Let the other end hang up."""
        os.close(self._master)

    @contextlib.contextmanager
    def _slave(self) -> Iterator[int]:
        slave = os.open(self.name, os.O_RDWR | os.O_NOCTTY | os.O_NONBLOCK)
        try:
            yield slave
        finally:
            os.close(slave)


class Device:
    """A port that is there already, set to raw bytes at a baud rate.

    ``transmit``: it may be a serial port; without, only the slave of a pseudo-terminal is opened,
    and what is none is not even touched: opening a port can make its adapter speak.

    Raises:
        OutputError: it cannot be opened, is no serial port, or refuses the baud rate; or it is one,
            and nothing may be sent.
    """

    def __init__(self, path: str, baud: int, *, transmit: bool) -> None:
        self.name = path
        try:
            pseudo = is_pseudo(Path(path).stat())
            if not pseudo and not transmit:
                told = (
                    "{path} is no pseudo-terminal: what is played there is sent on a bus, and "
                    "servos may move; {transmit:True} if that is meant"
                )
                raise OutputError(Sentence(told, path=path))
            self._fd = os.open(path, os.O_RDWR | os.O_NOCTTY | os.O_NONBLOCK)
        except OSError as error:
            why = error.strerror or error
            raise OutputError(f"{path}: cannot be opened for writing ({why})") from None
        self.carries = not pseudo
        try:
            if pseudo and not is_pseudo(os.fstat(self._fd)):
                raise OSError(errno.ENOTTY, "it was another device a moment ago")
            _set_line(self._fd)
            _set_speed(self._fd, baud)
        except (termios.error, OSError) as error:
            os.close(self._fd)
            if error.args[0] == errno.ENOTTY:
                raise OutputError(f"{path} is no serial port: name one, as /dev/ttyUSB0") from None
            raise OutputError(f"{path}: does not take {baud} bit/s ({error.args[-1]})") from None

    def fileno(self) -> int:
        """Return the device."""
        return self._fd

    def listened(self) -> bool:
        """Tell nothing: a wire does not know who listens."""
        return True

    def write(self, data: bytes) -> int:
        """Write what there is room for."""
        try:
            return _write(self._fd, data)
        except OSError as error:
            raise OutputError(f"{self.name}: cannot be written ({error.strerror})") from None

    def read(self) -> bytes:
        """Return what has been heard."""
        try:
            data = os.read(self._fd, READ_MOST)
        except BlockingIOError:
            return b""
        except OSError as error:
            raise OutputError(f"{self.name}: cannot be read ({error.strerror})") from None
        if not data:  # else one that is there has nothing to read, which is told as above
            raise OutputError(f"{self.name} went away: its other end is closed, or unplugged")
        return data

    def forget(self) -> int:
        """Leave everything as it is."""
        return 0

    def drain(self) -> int:
        """Wait until everything is on the wire."""
        with contextlib.suppress(termios.error):  # it went away: there is no wire any more
            termios.tcdrain(self._fd)
        return 0

    def close(self) -> None:
        """Close the device."""
        os.close(self._fd)


def _write(fd: int, data: bytes) -> int:
    try:
        return os.write(fd, data)
    except BlockingIOError:
        return 0


def _read(fd: int) -> bytes:
    try:
        return os.read(fd, READ_MOST)
    except BlockingIOError:
        return b""
    except OSError as error:
        if error.errno == errno.EIO:  # nobody has the other end open
            return b""
        raise


def _left(slave: int) -> int:
    """Read everything that waits; return how many bytes that was."""
    total = empty = 0
    while empty < 2:
        size = len(_read(slave))
        total += size
        empty = 0 if size else empty + 1
        if not size:
            time.sleep(SETTLE_S)
    return total


def _set_line(fd: int) -> None:
    """Set raw bytes, one stop bit, and no heed of modem lines."""
    tty.setraw(fd)
    attributes = termios.tcgetattr(fd)
    attributes[2] |= termios.CLOCAL | termios.CREAD
    attributes[2] &= ~(termios.CSTOPB | termios.CRTSCTS)
    termios.tcsetattr(fd, termios.TCSANOW, attributes)


def _set_speed(fd: int, baud: int) -> None:
    known = getattr(termios, f"B{baud}", None)
    if known is not None:
        attributes = termios.tcgetattr(fd)
        attributes[4] = attributes[5] = known
        termios.tcsetattr(fd, termios.TCSANOW, attributes)
    elif sys.platform == "linux":
        held = fcntl.ioctl(fd, _TCGETS2, bytes(_TERMIOS2.size))
        iflag, oflag, cflag, lflag, line, characters, *_ = _TERMIOS2.unpack(held)
        cflag = cflag & ~_CBAUD | _BOTHER
        told = _TERMIOS2.pack(iflag, oflag, cflag, lflag, line, characters, baud, baud)
        fcntl.ioctl(fd, _TCSETS2, told)
    else:
        raise OSError(errno.EINVAL, "not a rate that this system names")
