"""Pseudo terminals that stand for serial ports: tests speak on the master, a tap hears the slave.

A pseudo terminal has no modem lines, no line errors and no baud rate that matters; all else, from
the escaping to the hang-up, is the kernel's own.
"""

from __future__ import annotations

import contextlib
import os
import select
import sys
import time
from typing import TYPE_CHECKING, Final

import pytest

from sniffer.ground.model import InputError
from sniffer.ports import PortOptions, open_port

if TYPE_CHECKING:
    import threading
    from collections.abc import Callable
    from pathlib import Path

    from sniffer.ground.model import Mark
    from sniffer.ports import Port

LINUX_ONLY: Final = pytest.mark.skipif(
    sys.platform != "linux", reason="ports are opened in Linux' own way only there"
)

AT_115200: Final = PortOptions(115200)
EVERY_BYTE: Final = bytes(range(256))
HEADERS: Final = bytes.fromhex("ffffff0105f3ff00") * 40
"""Frames' worth of what is doubled under way."""

PATIENCE_S: Final = 180.0
"""How long anything is waited for before a test fails, in seconds: the machines are shared, and
nothing waits so long where all is well."""

SETTLES_S: Final = 0.1
"""What a tap is given from the moment its settings hold until it is spoken to, in seconds."""


def say_until(master: int, data: bytes, over: threading.Event) -> None:
    """Put bytes on a line, or give up: it holds 4 KiB that nobody may read any more."""
    os.set_blocking(master, False)
    view = memoryview(data)
    while view and not over.is_set():
        try:
            view = view[os.write(master, view) :]
        except BlockingIOError:
            over.wait(0.005)


def heard(end: int, length: int) -> bytes:
    """Read so many bytes: the kernel hands on in pieces what was written in one."""
    out = b""
    while len(out) < length:
        assert select.select([end], [], [], PATIENCE_S)[0], out
        out += os.read(end, length - len(out))
    return out


class Terminal:
    """One line: ``path`` is what a tap opens. Use it with ``with``."""

    def __init__(self) -> None:
        self._master, slave = os.openpty()
        self.path = os.ttyname(slave)
        os.close(slave)  # held open, it would keep a tap from being the only one

    def say(self, data: bytes) -> None:
        """Put bytes on the line; a tap must have it open, and hears only what comes from now on."""
        view = memoryview(data)
        while view:
            view = view[os.write(self._master, view) :]

    def answers(self) -> bytes:
        """Return what was sent into the line by whoever has it open."""
        out = b""
        os.set_blocking(self._master, False)  # "nobody has it open" may be over before it is read
        with contextlib.suppress(OSError):  # nothing more, or nobody has it open
            while data := os.read(self._master, 1 << 16):
                out += data
        os.set_blocking(self._master, True)
        return out

    def settings(self) -> list[int]:
        """Return the slave's iflag, oflag, cflag and lflag."""
        import termios

        return [int(word) for word in termios.tcgetattr(self._master)[:4]]

    def wait_for_tap(self) -> None:
        """Wait until a tap of another process has set the line up, and can hear."""
        import termios

        wait(lambda: bool(self.settings()[0] & termios.PARMRK), "nobody listens")
        # the tap now drops what it heard before; nothing out here shows when it has
        time.sleep(SETTLES_S)

    def plug_in_at(self, link: Path) -> None:
        """Make ``link`` lead here, as udev does when an adapter is plugged in again."""
        link.unlink(missing_ok=True)
        link.symlink_to(self.path)

    def hang_up(self) -> None:
        """Pull the line out; again is no error."""
        master, self._master = self._master, -1
        if master >= 0:
            os.close(master)

    def __enter__(self) -> Terminal:
        return self

    def __exit__(self, *_: object) -> None:
        self.hang_up()


def wait(until: Callable[[], bool], why: str) -> None:
    """Wait until something is so; fail with ``why`` if it does not become so.

    To look may be to read a whole recording, and who is waited for needs the machine as well: three
    quarters of the time nobody looks.
    """
    looked = time.monotonic()
    end = looked + PATIENCE_S
    while not until():
        now = time.monotonic()
        assert now < end, why
        time.sleep(max(0.005, 3 * (now - looked)))
        looked = time.monotonic()


def listen(port: Port, size: int) -> tuple[bytes, list[Mark]]:
    """Return at least ``size`` bytes of the line and their marks, counted from the first byte."""
    heard = b""
    marks: list[Mark] = []
    end = time.monotonic() + PATIENCE_S
    while len(heard) < size:
        assert time.monotonic() < end, f"{len(heard)} of {size} bytes came"
        if port.pollable:
            select.select([port.fileno()], [], [], 0.1)
        data, found = port.unmark(port.read())
        marks += [mark._replace(start=mark.start + len(heard)) for mark in found]
        heard += data
    return heard, marks


def refusal(name: object, options: PortOptions = AT_115200) -> str:
    """Return the one line that a port is refused with."""
    with pytest.raises(InputError) as caught:
        open_port(str(name), options).close()
    message = str(caught.value)
    assert "\n" not in message
    return message
