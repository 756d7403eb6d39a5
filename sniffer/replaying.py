"""A recording again in real time: groups of chunks handed out when their moment has come."""

from __future__ import annotations

import time
from dataclasses import dataclass, replace
from typing import TYPE_CHECKING, Final

from sniffer.model import NS, Chunk
from sniffer.timing import byte_time_ns

if TYPE_CHECKING:
    from collections.abc import Callable, Iterable, Iterator, Sequence

STEP_NS: Final = 50_000_000
"""Chunks within 50 ms of the recording go out together: a decoder pass costs about the same for
one chunk as for all of them, and eyes see no more."""


@dataclass(frozen=True, slots=True)
class Window:
    """Which part of a recording is played, in seconds from its start; ``stop`` None: to its end."""

    start: float = 0.0
    stop: float | None = None


def timed(groups: Iterable[Sequence[Chunk]], baud: int) -> Iterator[Chunk]:
    """Yield chunks that all have a time: where there is no clock, the wire's own pace."""
    byte_ns = byte_time_ns(baud)
    last = 0
    for group in groups:
        for chunk in group:
            last = chunk.t_ns if chunk.t_ns is not None else last + len(chunk.data) * byte_ns
            yield chunk if chunk.t_ns is not None else replace(chunk, t_ns=last)


def within(chunks: Iterable[Chunk], window: Window) -> Iterator[Chunk]:
    """Yield the chunks of a window."""
    first: int | None = None
    for chunk in chunks:
        t = chunk.t_ns or 0
        first = t if first is None else first
        at = (t - first) / NS
        if window.stop is not None and at > window.stop:
            return
        if at >= window.start:
            yield chunk


def steps(chunks: Iterable[Chunk]) -> Iterator[list[Chunk]]:
    """Group chunks into steps of the recording's time."""
    group: list[Chunk] = []
    for chunk in chunks:
        if group and (chunk.t_ns or 0) - (group[0].t_ns or 0) >= STEP_NS:
            yield group
            group = []
        group.append(chunk)
    if group:
        yield group


def paced(
    groups: Iterable[list[Chunk]],
    speed: float,
    *,
    now: Callable[[], int] = time.monotonic_ns,
    sleep: Callable[[float], None] = time.sleep,
) -> Iterator[list[Chunk]]:
    """Yield each group at its own moment; ``speed`` 0 does not wait at all.

    Deadlines are absolute, counted from the first group: what one step is late does not delay the
    next, so a replay does not drift.
    """
    began: int | None = None
    first = 0
    for group in groups:
        t = group[-1].t_ns or 0
        if began is None:
            began, first = now(), t
        elif speed > 0:
            wait = began + (t - first) / speed - now()
            if wait > 0:
                sleep(wait / NS)
        yield group
