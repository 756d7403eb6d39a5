"""Where a recording is played: a fresh pseudo-terminal, or a port that is there, for each bus."""

from __future__ import annotations

import contextlib
from typing import TYPE_CHECKING, Final

from sniffer.ground.model import SnifferError
from sniffer.ground.wording import Sentence
from sniffer.selection.places import FRESH
from sniffer.simulation.play.opening import opened_port
from sniffer.simulation.play.outlet import FrameWriter
from sniffer.simulation.play.player import LOOK_NS
from sniffer.simulation.talk import NOISE, TrueFrame

if TYPE_CHECKING:
    from collections.abc import Iterator, Mapping, Sequence
    from pathlib import Path

    from sniffer.simulation.play.player import Stop

SETTLE_NS: Final = 500_000_000
"""What a program that has opened a port gets until it is spoken to: many throw away what they find
in it, pySerial for one (``reset_input_buffer`` in ``Serial.open``)."""


def said(data: bytes) -> TrueFrame:
    """Return bytes as what is written to an outlet; what they mean is nobody's business there."""
    return TrueFrame(0, 0, b"", data, NOISE, -1, "")


def check_ports(to: Sequence[str], links: Sequence[Path], buses: Sequence[str]) -> None:
    """Refuse ports that are not one for each bus, before any is opened.

    Raises:
        SnifferError: the sentence says how many there must be.
    """
    n = len(buses)
    have = f"it has the bus{'es' * (n > 1)} {', '.join(buses)}"
    if [port.lower() for port in to] != [FRESH] and len(to) != n:
        told = "{have}: say {to} once for each, or {to:pty} for all of them"
        raise SnifferError(Sentence(told, have=have))
    if links and len(links) != n:
        told = "{have}: say {links} once for each"
        raise SnifferError(Sentence(told, have=have))
    if links and any(port.lower() != FRESH for port in to):
        raise SnifferError(Sentence("{to} names a port that has a name: {links} is for a new one"))


@contextlib.contextmanager
def opened_ports(
    to: Sequence[str], links: Sequence[Path], bauds: Mapping[str, int], *, transmit: bool
) -> Iterator[dict[str, FrameWriter]]:
    """Open a port for each bus, and close them all behind it; ``bauds`` are the buses' rates.

    Raises:
        OutputError: one cannot be had, or is a serial port that nothing may be sent to.
    """
    every = to if len(to) == len(bauds) else [FRESH] * len(bauds)
    leading: Sequence[Path | None] = links or [None] * len(bauds)
    with contextlib.ExitStack() as stack:
        out = {}
        for (bus, baud), where, link in zip(bauds.items(), every, leading, strict=True):
            path = None if where.lower() == FRESH else where
            port = stack.enter_context(opened_port(path, baud, link, transmit=transmit))
            out[bus] = FrameWriter(port)
        yield out


def await_listeners(outlets: Sequence[FrameWriter], stop: Stop) -> None:
    """Wait until somebody has every port open, and a little longer, so that nothing is missed.

    A port that is there already is not waited for: it does not tell.
    """
    waited = False
    while not stop.asked and not all(outlet.port.listened() for outlet in outlets):
        waited = True
        stop.sleep(LOOK_NS)
    if waited and not stop.asked:
        stop.sleep(SETTLE_NS)
