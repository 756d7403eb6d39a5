"""Logs that hosts write, as chunks, and the truth beside them."""

from __future__ import annotations

from typing import TYPE_CHECKING, Final

from sniffer.ground.model import Chunk, Clock
from sniffer.simulation.hosts import delivered
from sniffer.simulation.talk import REQUEST, RESPONSE

if TYPE_CHECKING:
    from collections.abc import Sequence

    from sniffer.simulation.talk import TrueFrame

MS: Final = 1_000_000


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
