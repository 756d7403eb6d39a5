"""Live ports that are listened to and never spoken to: ``open_port(name, options)``.

Linux' own ports are opened without pySerial (``tty.py``), because it clears the flags that tell of
line errors, flushes, and opens for writing. Addresses on the network, and the ports of other
systems, are opened with it (``remote.py``).
"""

from __future__ import annotations

import os
import stat
import sys
from pathlib import Path
from typing import Final

from sniffer.ground.model import InputError
from sniffer.ports.base import (
    BAUD_MAX,
    Counters,
    Port,
    PortLostError,
    PortOptions,
    Retunable,
    forbidden,
    missing,
    no_port,
    shown,
)

__all__ = ["Counters", "Port", "PortLostError", "PortOptions", "Retunable", "open_port"]


def open_port(name: str, options: PortOptions) -> Port:
    """Open a port for listening.

    Args:
        name: a device such as ``/dev/ttyUSB0``, or an address such as ``socket://host:4000`` or
            ``rfc2217://host:4000``.
        options: baud rate, modem lines, latency.

    Raises:
        InputError: it cannot be opened; the message says what to do.
    """
    if not 0 < options.baud < BAUD_MAX:
        raise InputError(f"{options.baud} is no baud rate: give one above 0, such as 115200")
    if "://" in name:
        _refuse_what_is_no_address(name)
    elif os.name == "posix":
        _refuse_what_is_no_port(name)
        if sys.platform == "linux":
            from sniffer.ports import kernel, tty

            if kernel.is_known():
                return tty.TtyPort(name, options)
    from sniffer.ports.remote import SerialPort

    return SerialPort(name, options)


ADDRESSES: Final = ("socket", "rfc2217")
"""The kinds of addresses that are opened. pySerial has others, and those with a device behind them
(``spy``, ``alt``, ``hwgrep``) open it for writing, lock or no lock, as if it were nobody's."""


def _refuse_what_is_no_address(name: str) -> None:
    kind = name.partition("://")[0].lower()
    if kind not in ADDRESSES:
        raise InputError(
            f"{shown(name)}: no kind of address that is known to be listened to only; give "
            "socket://host:port, rfc2217://host:port, or the device itself"
        )


def _refuse_what_is_no_port(name: str) -> None:
    """Raise InputError for what is there and is no character device, or is not there."""
    try:
        mode = Path(name).stat().st_mode
    except PermissionError:
        raise forbidden(name) from None
    except (OSError, ValueError):
        raise missing(name) from None
    if stat.S_ISDIR(mode):
        advice = "give the port in it, or a capture to `sniffer decode`"
        raise InputError(f"{shown(name)} is a directory: {advice}")
    if stat.S_ISREG(mode) or stat.S_ISFIFO(mode):
        kind = "pipe" if stat.S_ISFIFO(mode) else "file"
        raise InputError(f"{shown(name)} is a {kind}, no port: `sniffer decode` reads it")
    if not stat.S_ISCHR(mode):
        raise no_port(name)
