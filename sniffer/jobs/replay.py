"""A recording again in real time: groups of chunks handed out when their moment has come."""

from __future__ import annotations

import time
from dataclasses import dataclass, replace
from typing import TYPE_CHECKING, Final

from sniffer.ground.model import NS, Chunk, Clock, DamagedInputError, InputError, Mark, MarkKind
from sniffer.ground.timing import byte_time_ns

if TYPE_CHECKING:
    from collections.abc import Callable, Iterable, Iterator

STEP_NS: Final = 50_000_000
"""Chunks within 50 ms of the recording go out together: a decoder pass costs about the same for
one chunk as for all of them, and eyes see no more."""


@dataclass(frozen=True, slots=True)
class Window:
    """Which part of a recording is played, in seconds from its start; ``stop`` None: to its end."""

    start: float = 0.0
    stop: float | None = None


def peek(chunks: Iterable[Chunk], size: int) -> tuple[list[Chunk], Iterator[Chunk]]:
    """Return the first chunks, ``size`` bytes or a little more, and all of them again."""
    rest, head, damage = iter(chunks), list[Chunk](), None
    try:
        while sum(len(chunk.data) for chunk in head) < size:
            head.append(next(rest))
    except StopIteration:
        pass
    except DamagedInputError as error:  # it comes again, behind what could be read
        damage = error

    def again() -> Iterator[Chunk]:
        yield from head
        if damage is not None:
            raise damage
        yield from rest

    return head, again()


def timed(chunks: Iterable[Chunk], baud: int) -> Iterator[Chunk]:
    """Yield chunks that all have a time: where there is no clock, the wire's own pace.

    Such chunks may be large: they come in pieces no longer than a step.
    """
    byte_ns = byte_time_ns(baud)
    piece = max(1, STEP_NS // byte_ns)
    last = 0
    for chunk in chunks:
        if chunk.t_ns is not None:
            last = chunk.t_ns
            yield chunk
            continue
        for at in range(0, len(chunk.data), piece):
            data = chunk.data[at : at + piece]
            last += len(data) * byte_ns
            yield replace(chunk, data=data, t_ns=last)


def within(chunks: Iterable[Chunk], window: Window, *, ends: bool = False) -> Iterator[Chunk]:
    """Yield the chunks of a window; ``ends``: also, where it ends before them all, that it does.

    Raises:
        InputError: there are none in it.
    """
    first: int | None = None
    at = 0.0
    heard: dict[str, Chunk] = {}
    for chunk in chunks:
        t = chunk.t_ns or 0
        first = t if first is None else first
        at = (t - first) / NS
        if window.stop is not None and at > window.stop:
            # nothing else was said until then: who had time enough to answer is silent, not cut
            end = first + int(window.stop * NS)
            yield from (
                replace(last, data=b"", t_ns=end, marks=(Mark(MarkKind.ENDED, 0, count=0),))
                for last in (heard.values() if ends else ())
            )
            break
        if at >= window.start:
            heard[chunk.bus] = chunk
            yield chunk
    if first is not None and not heard:
        until = "" if window.stop is None else f" to {window.stop:g}"
        raise InputError(
            f"nothing was said from second {window.start:g}{until}: the recording has {at:.3f} s"
        )


def steps(chunks: Iterable[Chunk]) -> Iterator[list[Chunk]]:
    """Group chunks into steps of the recording's time; what came before damage is not lost."""
    group: list[Chunk] = []
    try:
        for chunk in chunks:
            if group and (chunk.t_ns or 0) - (group[0].t_ns or 0) >= STEP_NS:
                yield group
                group = []
            group.append(chunk)
    except DamagedInputError:
        if group:
            yield group
        raise
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
        # a pace given for want of a clock is no time to be decoded
        yield [replace(k, t_ns=None) if k.clock == Clock.NONE else k for k in group]
