"""What a port is, how one is opened, and why one is not."""

from __future__ import annotations

import stat
from dataclasses import dataclass, fields
from pathlib import Path
from typing import TYPE_CHECKING, Final, Literal, Protocol, runtime_checkable

from sniffer.ground.model import InputError, SnifferError

if TYPE_CHECKING:
    from sniffer.ground.model import Mark

READ_MAX: Final = 1 << 16
"""Bytes that one read returns at most."""

BAUD_MAX: Final = 1 << 32
"""A baud rate must be below this: the kernel and RFC 2217 have 32 bits for it."""


@dataclass(frozen=True, slots=True)
class PortOptions:
    """How to open a port; it is always 8N1 without flow control.

    ``modem``: Linux raises DTR and RTS when a port is opened, and many RS-485 adapters send while
    RTS is up. ``low`` lowers both at once; ``keep`` leaves them up, for adapters that are powered
    by these lines or listen while they are up. ``low_latency`` asks driver and adapter not to
    gather bytes. ``shared`` opens a port that another program has open without a lock: its settings
    are changed under that program.
    """

    baud: int
    modem: Literal["low", "keep"] = "low"
    low_latency: bool = True
    shared: bool = False


class PortLostError(SnifferError):
    """The port is gone: the adapter was pulled out, or the far end closed."""


@dataclass(frozen=True, slots=True)
class Counters:
    """What a driver has counted since it was loaded.

    ``overrun`` and ``buf_overrun`` are bytes lost on our side: in the UART, and in the driver.
    """

    frame: int = 0
    parity: int = 0
    overrun: int = 0
    brk: int = 0
    buf_overrun: int = 0

    def since(self, before: Counters) -> Counters:
        """Return what was counted after ``before``; the counters have 32 bits and wrap."""
        pairs = ((getattr(self, f.name), getattr(before, f.name)) for f in fields(Counters))
        return Counters(*((now - then) % (1 << 32) for now, then in pairs))


class Port(Protocol):
    """An open port.

    ``name`` is as the user gave it, ``path`` a name that is still right when the adapter is
    plugged in again. ``latency_ns`` is how long adapter and driver may hold bytes back, None where
    it is not known. ``marks_errors`` tells whether line errors come in the byte stream,
    ``pollable`` whether ``fileno()`` can be given to select, ``is_virtual`` that there is no line
    behind it whose rate must be right.
    """

    name: str
    path: str
    baud: int
    latency_ns: int | None
    marks_errors: bool | None
    counts_errors: bool | None
    usb: bool
    pollable: bool
    is_virtual: bool

    def fileno(self) -> int:
        """Return the descriptor to wait for; OSError where the port is not pollable."""

    def read(self) -> bytes:
        """Return what has come, up to ``READ_MAX`` bytes, still escaped.

        A pollable port never waits and returns nothing where nothing is; another one waits up to
        0.1 s.

        Raises:
            PortLostError: the port is gone.
        """

    def unmark(self, raw: bytes) -> tuple[bytes, tuple[Mark, ...]]:
        """Take the reads in order; return the bytes of the line and what is known of them."""

    def counters(self) -> Counters | None:
        """Return the driver's counters; None where it has none, or never counts."""

    def facts(self) -> dict[str, str]:
        """Return what a recording should say about the port."""

    def close(self) -> None:
        """Let go of the port, without a change on its lines."""


@runtime_checkable
class Retunable(Port, Protocol):
    """A port whose baud can be changed while it stays open: RTS and DTR stay as they are."""

    def retune(self, baud: int) -> None:
        """Listen at another baud; see ``TtyPort``."""


def shown(name: str) -> str:
    """Return a name so that it fits in a message of one line."""
    return name if name.isprintable() else ascii(name)


def missing(name: str) -> InputError:
    """Return the error for a port that is not there."""
    return InputError(
        f"{shown(name)}: there is no such port; `sniffer ports` lists those that are here"
    )


def no_port(name: str) -> InputError:
    """Return the error for a thing that is no serial port."""
    return InputError(f"{shown(name)} is no serial port; `sniffer ports` lists those that are here")


def forbidden(name: str) -> InputError:
    """Return the error for a port that we may not read."""
    why = f"{shown(name)}: no permission to read it"
    if group := _group_of(name):
        return InputError(
            f"{why}; join its group with `sudo usermod -aG {group} $USER`, and log in again"
        )
    return InputError(f"{why}; it is not open to your user")


def _group_of(name: str) -> str:
    """Return the group that may read a port, if one may that is not root's."""
    import grp  # there is none on Windows, where nothing is forbidden this way

    try:
        found = Path(name).stat()
        may_read = found.st_mode & stat.S_IRGRP and found.st_gid
        return grp.getgrgid(found.st_gid).gr_name if may_read else ""
    except (OSError, KeyError):
        return ""
