"""Hosts between a bus and a log: what a timer, packets and a program do to the stamps."""

from __future__ import annotations

import random
from typing import TYPE_CHECKING, Final, Protocol

from sniffer.ground.model import MS, NS
from sniffer.simulation.render import USB_PACKET

if TYPE_CHECKING:
    from collections.abc import Sequence

    from sniffer.simulation.render import Read

TIMER_NS: Final = 16 * MS
"""The latency timer that FTDI chips start with. Source: FTDI application note AN232B-04, 2.1."""


class OnWire(Protocol):
    """Bytes in a row on a wire, with the times at which the first begins and the last ends."""

    @property
    def t_start_ns(self) -> int:
        """When the first begins."""

    @property
    def t_end_ns(self) -> int:
        """When the last ends."""

    @property
    def wire(self) -> bytes:
        """The bytes."""


def delivered(
    frames: Sequence[OnWire], baud: int, *, timer_ns: int = TIMER_NS, seed: int = 0
) -> list[Read]:
    """Return what a host with a latency timer hands on, in order.

    The timer runs freely; a full packet is sent at once and starts it anew. USB and the program
    that reads add up to a millisecond.
    """
    rng = random.Random(seed)
    byte_ns = 10 * NS / baud
    arrivals = [
        (int(f.t_end_ns - (len(f.wire) - 1 - k) * byte_ns), f.wire[k])
        for f in frames
        for k in range(len(f.wire))
    ]
    tick = frames[0].t_start_ns + rng.randrange(timer_ns)
    out: list[Read] = []
    held = bytearray()
    at = 0
    while at < len(arrivals) or held:
        if not held and arrivals[at][0] > tick:  # nothing to send for a while
            tick += (arrivals[at][0] - tick) // timer_ns * timer_ns
        if at < len(arrivals) and arrivals[at][0] <= tick:
            held.append(arrivals[at][1])
            at += 1
            if len(held) < USB_PACKET:
                continue
            now = arrivals[at - 1][0]
            tick = now + timer_ns
        else:
            now, tick = tick, tick + timer_ns
        if held:
            late = rng.randrange(100_000, 1_100_000)
            stamp = max(now + late, out[-1][0] + 20_000 if out else 0)
            out.append((stamp, bytes(held)))
            held.clear()
    return out
