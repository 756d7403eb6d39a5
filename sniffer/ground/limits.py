"""Which numbers can be reckoned with: times, rates and amounts that come from outside.

Times are 64-bit columns. The range of times leaves room for what is reckoned with them: the
difference of any two, a duration, and the bytes of a capture laid out at the slowest rate.
"""

from __future__ import annotations

from dataclasses import replace
from typing import TYPE_CHECKING, Any, Final, SupportsIndex

from sniffer.ground.model import NS, Chunk, Clock, Direction, Mark, MarkKind, SnifferError
from sniffer.ground.runs import ChunkRun

if TYPE_CHECKING:
    from collections.abc import Mapping, Sequence

DURATION_MOST_NS: Final = 1 << 55
"""The longest duration, more than a year."""

TIME_LEAST_NS: Final = -(1 << 55)
"""The earliest time: one that counts from a trigger may be negative."""

TIME_END_NS: Final = (1 << 63) - (1 << 57)
"""Times end before this one, in the year 2257."""

DATED_NS: Final = 366 * 86400 * NS
"""Times before this one, in 1971, count from something else than 1970: they tell no day."""

OFFSET_END: Final = 1 << 55
"""Offsets end before this one: a thousand years at 1 Mbit/s."""

FALLBACK_BAUD: Final = 115200
"""Where neither a baud rate nor a protocol is named: the default of three of the protocols."""

BAUDS: Final = (300, 10_000_000)
"""The slowest and the fastest rate: nothing slower or faster is sold for servos."""

GROUP: Final = 1 << 18
"""Payload of what is read in one go, in bytes."""

GROUP_CHUNKS: Final = 1 << 15
"""Chunks of it at most: those of a log may hold a byte each."""

IDS: Final = 256
"""Servo ids are a byte."""

OF_BUS: Final = ":"
"""Stands between a bus and the id of a servo on it: ``arm:3``."""

BUSES_MOST: Final = 256
"""Buses of one input: each has a decoder, some 200 kB; more names than that are no buses."""

_DIGITS: Final = 19
"""More decimal digits than this are beyond 64 bits, and ``int`` refuses thousands of them."""


def number_in(text: str, least: int, most: int) -> int | None:
    """Return the number that ``text`` states in decimal, None where there is none in the range."""
    if not text.isdecimal() or len(text) > _DIGITS:
        return None
    number = int(text)
    return number if least <= number <= most else None


def is_time(t_ns: int) -> bool:
    """Tell whether a time can be reckoned with."""
    return TIME_LEAST_NS <= t_ns < TIME_END_NS


def is_mark(mark: Mark) -> bool:
    """Tell whether a mark's numbers can be reckoned with."""
    return (
        -OFFSET_END < mark.start < OFFSET_END
        and 0 <= mark.length < OFFSET_END
        and 0 <= mark.count <= DURATION_MOST_NS
    )


def whole(what: str, value: SupportsIndex, least: int, most: int) -> int:
    """Return a whole number that a caller gave, numpy's included.

    Raises:
        SnifferError: it is none, or it lies outside of ``least`` to ``most``.
    """
    try:
        number = value.__index__()
    except (AttributeError, TypeError):
        raise SnifferError(f"{what} is a whole number, not {_told(value)}") from None
    if not least <= number <= most:
        raise SnifferError(f"{what} is a whole number from {least} to {most}, not {_told(value)}")
    return number


def model_ids(models: Mapping[int | None, str]) -> dict[int | None, str]:
    """Return register tables by servo id, None for all, as a caller gave them.

    Raises:
        SnifferError: an id is none.
    """
    if not hasattr(models, "items"):
        raise SnifferError(f"models are named by servo id, {{1: 'name'}}, not {_told(models)}")
    return {
        None if servo is None else whole("the servo id of a model", servo, 0, IDS - 1): model
        for servo, model in models.items()
    }


def chunks_of(given: Sequence[Any]) -> Sequence[Chunk]:
    """Return what a caller handed over as chunks; bytes are a chunk without a time.

    A run of chunks stands for itself, where it is all there is.

    Raises:
        SnifferError: something is neither, or a chunk says what cannot be.
    """
    if len(given) == 1 and type(run := given[0]) is ChunkRun:
        if run and (run.t_ns.min() < TIME_LEAST_NS or run.t_ns.max() >= TIME_END_NS):
            return chunks_of(list(run))
        return run
    return [
        k
        if type(k) is Chunk
        and type(k.data) is bytes
        and (k.t_ns is None or (type(k.t_ns) is int and TIME_LEAST_NS <= k.t_ns < TIME_END_NS))
        and type(k.clock) is Clock
        and type(k.direction) is Direction
        and (not k.marks or _are_marks(k.marks))
        else _chunk(k)
        for k in given
    ]


def _are_marks(marks: Any) -> bool:
    """Tell whether these are marks as they are to be: readers and taps make no others."""
    if type(marks) is not tuple:
        return False
    for mark in marks:
        if type(mark) is not Mark or type(mark.kind) is not MarkKind:
            return False
        if not (type(mark.start) is type(mark.length) is type(mark.count) is int and is_mark(mark)):
            return False
    return True


def _chunk(k: Any) -> Chunk:
    """Return one chunk after a closer look."""
    if not isinstance(k, Chunk):
        return Chunk(_bytes(k, "feed takes chunks, or bytes"))
    data = _bytes(k.data, "the data of a chunk is bytes")
    t_ns = k.t_ns
    if t_ns is not None:
        t_ns = whole("t_ns of a chunk", t_ns, TIME_LEAST_NS, TIME_END_NS - 1)
    try:
        clock, direction = Clock(k.clock), Direction(k.direction)
        marks = tuple(Mark(MarkKind(m[0]), *m[1:]) for m in k.marks)
        sound = all(is_mark(mark) for mark in marks)
    except (TypeError, ValueError, IndexError):
        sound = False
    if not sound:
        raise SnifferError("a chunk has a clock, a direction or a mark that cannot be")
    return replace(k, data=data, t_ns=t_ns, clock=clock, direction=direction, marks=marks)


def _bytes(data: Any, rule: str) -> bytes:
    if not isinstance(data, bytes | bytearray | memoryview):
        raise SnifferError(f"{rule}, not {_told(data)}")
    return bytes(data)


def _told(value: object) -> str:
    """Return a value as a message of one line shows it."""
    if isinstance(value, int) and value.bit_length() > 64:
        return "a number beyond 64 bits"
    text = repr(value) if isinstance(value, int | float | str | None) else type(value).__name__
    return text if len(text) <= 40 else f"{text[:40]}..."
