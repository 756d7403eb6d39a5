"""Hosts between a bus and a log: what a timer, packets and a program do to the stamps."""

from __future__ import annotations

import random
from typing import TYPE_CHECKING, Final

from sniffer.ground.model import NS, Chunk, Clock
from sniffer.simulation.talk import REQUEST, RESPONSE

if TYPE_CHECKING:
    from collections.abc import Sequence

    from sniffer.simulation.talk import TrueFrame

MS: Final = 1_000_000
PACKET: Final = 62
"""Bytes of a full USB packet of an FTDI chip."""


def delivered(
    frames: Sequence[TrueFrame], baud: int, *, timer_ns: int = 16 * MS, seed: int = 0
) -> list[tuple[int, bytes]]:
    """Return what a host with a latency timer hands on: (time, bytes), in order.

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
    out: list[tuple[int, bytes]] = []
    held = bytearray()
    at = 0
    while at < len(arrivals) or held:
        if at < len(arrivals) and arrivals[at][0] <= tick:
            held.append(arrivals[at][1])
            at += 1
            if len(held) < PACKET:
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


def reads(frames: Sequence[TrueFrame], baud: int, **host: int) -> list[Chunk]:
    """Return a log that has a line a read."""
    return [Chunk(data, t, Clock.FILE) for t, data in delivered(frames, baud, **host)]


def lines(frames: Sequence[TrueFrame], baud: int, **host: int) -> list[Chunk]:
    """Return a log that has a line a frame: stamped when the read that completes it is printed."""
    out: list[Chunk] = []
    due = [f for f in frames if f.wire]
    have = 0
    for t, data in delivered(frames, baud, **host):
        have += len(data)
        while due and len(due[0].wire) <= have:
            frame = due.pop(0)
            have -= len(frame.wire)
            last = out[-1].t_ns or 0 if out else 0
            out.append(Chunk(frame.wire, max(t, last + 15_000), Clock.FILE))
    return out


def truths(frames: Sequence[TrueFrame]) -> dict[int, int]:
    """Return the true response times by the offset of the answer."""
    out, at = {}, 0
    asked: TrueFrame | None = None
    for f in frames:
        if not f.wire:
            continue
        if f.kind == REQUEST:
            asked = f
        elif f.kind == RESPONSE and asked is not None:
            out[at] = f.t_start_ns - asked.t_end_ns
        at += len(f.wire)
    return out
