"""Opening what is played on: a port that is there, or a pseudo-terminal that is made for it."""

from __future__ import annotations

import contextlib
from typing import TYPE_CHECKING

from sniffer.ground.model import OutputError
from sniffer.simulation.play.link import linked

if TYPE_CHECKING:
    from collections.abc import Iterator
    from pathlib import Path

    from sniffer.simulation.play.ports import PlayPort


@contextlib.contextmanager
def opened_port(
    path: str | None, baud: int, link: Path | None, *, transmit: bool
) -> Iterator[PlayPort]:
    """Open a port, close it behind; None: a pseudo-terminal, to which ``link`` leads meanwhile.

    ``transmit``: the path may be that of a serial port.

    Raises:
        OutputError: the port or the link cannot be had, or nothing may be sent there.
    """
    try:
        from sniffer.simulation.play import ports
    except ImportError:
        raise OutputError("this system has no pseudo-terminals: use Linux or macOS") from None
    port: PlayPort = ports.Pty() if path is None else ports.Device(path, baud, transmit=transmit)
    with contextlib.closing(port), linked(link, port.name):
        yield port
