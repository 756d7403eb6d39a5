"""What a tap hears, as four hosts hand it on: with an exact clock, late and merged, as text, bare.

| host | clock | what is lost |
|---|---|---|
| `exact` | a logic analyser's: a chunk a row of bytes | nothing |
| `usb16` | an adapter with a 16 ms timer, read live | up to 17 ms; which byte a line error was in |
| `log` | a line a row of bytes, as `candump -L` writes it | line errors; the rate, the host |
| `raw` | none | all times, line errors |

A row without bytes says that the driver counted a loss there (``bytes-lost``).
"""

from __future__ import annotations

import itertools
from bisect import bisect_left
from collections import deque
from collections.abc import Callable, Sequence
from dataclasses import dataclass
from types import MappingProxyType
from typing import TYPE_CHECKING, Final

from bench.diagnosis.scenario import Heard, Scenario
from sniffer.decoding.pipeline import Options
from sniffer.ground.model import NS, Chunk, Clock, Direction, Mark, MarkKind
from sniffer.simulation.hosts import TIMER_NS, delivered
from sniffer.simulation.render import candump
from sniffer.sources import open_source

if TYPE_CHECKING:
    from collections.abc import Iterable, Mapping

START_NS: Final = 1_795_215_306 * NS
"""An afternoon in November 2026."""

CHUNK: Final = 4096
"""Bytes of a read of a bare file."""


@dataclass(frozen=True, slots=True)
class TwoWires(Scenario):
    """A scenario whose tap tells the wires apart: ``Heard.tx`` is what its log says."""


@dataclass(frozen=True, slots=True)
class Capture:
    """What a host hands on, what is stated beside it, and its own times of moments."""

    chunks: Sequence[Chunk]
    options: Options
    moments: Callable[[float], int]


def _marks(errors: Iterable[int], data: bytes) -> tuple[Mark, ...]:
    return tuple(Mark(MarkKind.FRAMING if data[k] else MarkKind.BREAK, k, 1) for k in errors)


def exact(scenario: Scenario, heard: Sequence[Heard], seed: int) -> Capture:
    """Stamp each row of bytes when its last byte ended."""
    del seed
    sides = isinstance(scenario, TwoWires)
    chunks = []
    for h in heard:
        marks = _marks(h.line_errors, h.wire) or (() if h.wire else (Mark(MarkKind.OVERRUN, 0),))
        side = (Direction.TX if h.tx else Direction.RX) if sides else Direction.UNKNOWN
        chunks.append(
            Chunk(h.wire, START_NS + h.t_end_ns, Clock.SAMPLE, direction=side, marks=marks)
        )
    options = Options(scenario.protocol, baud=scenario.baud)
    return Capture(chunks, options, _clocked(heard))


def usb16(scenario: Scenario, heard: Sequence[Heard], seed: int) -> Capture:
    """Let an adapter hold the bytes until its timer, or a full packet, sends them."""
    rows = [h for h in heard if h.wire]
    begins = list(itertools.accumulate((len(h.wire) for h in heard), initial=0))
    errors = deque(
        (begin + k, MarkKind.FRAMING if h.wire[k] else MarkKind.BREAK)
        for h, begin in zip(heard, begins, strict=False)
        for k in h.line_errors
    )
    losses = [begin for h, begin in zip(heard, begins, strict=False) if not h.wire]
    chunks = []
    at = 0
    for stamp, data in delivered(rows, scenario.baud, timer_ns=TIMER_NS, seed=seed):
        end = at + len(data)
        # the driver repeats an error for the whole packet: which byte it was nobody knows
        kinds = []
        while errors and errors[0][0] < end:
            kinds.append(errors.popleft()[1])
        marks = [Mark(kind, 0, len(data)) for kind in dict.fromkeys(kinds)]
        marks += (Mark(MarkKind.OVERRUN, 0, len(data)) for k in losses if at < k <= end)
        chunks.append(Chunk(data, START_NS + stamp, Clock.READ, marks=tuple(marks)))
        at = end
    options = Options(scenario.protocol, baud=scenario.baud, latency_ns=TIMER_NS)
    return Capture(chunks, options, _clocked(heard))


def written(scenario: Scenario, heard: Sequence[Heard]) -> str:
    """Return the log that has a line a row of bytes."""
    text = candump((START_NS + h.t_end_ns, h.wire) for h in heard if h.wire)
    if isinstance(scenario, TwoWires):
        sides = ["TX#" if h.tx else "RX#" for h in heard if h.wire]
        lines = zip(text.splitlines(), sides, strict=True)
        text = "".join(line.replace("#", side, 1) + "\n" for line, side in lines)
    return text


def log(scenario: Scenario, heard: Sequence[Heard], seed: int) -> Capture:
    """Read the text of such a log as the command line does."""
    del seed
    text = written(scenario, heard)
    chunks = [chunk for group in open_source(text.encode()) for chunk in group]
    return Capture(chunks, Options(scenario.protocol), _clocked(heard))


def raw(scenario: Scenario, heard: Sequence[Heard], seed: int) -> Capture:
    """Write the bytes down, and nothing else."""
    del seed
    data = b"".join(h.wire for h in heard)
    chunks = [Chunk(data[a : a + CHUNK]) for a in range(0, len(data), CHUNK)]
    return Capture(
        chunks, Options(scenario.protocol, baud=scenario.baud), _nominal(scenario, heard)
    )


def _clocked(heard: Sequence[Heard]) -> Callable[[float], int]:
    begin = START_NS + heard[0].t_start_ns
    return lambda s: begin + round(s * NS)


def _nominal(scenario: Scenario, heard: Sequence[Heard]) -> Callable[[float], int]:
    """Return where a moment is in a capture whose times are counted from its bytes."""
    byte_ns = 10 * NS // scenario.baud
    ends = [h.t_end_ns - heard[0].t_start_ns for h in heard]
    sizes = list(itertools.accumulate(len(h.wire) for h in heard))

    def at(s: float) -> int:
        k = bisect_left(ends, round(s * NS))
        return byte_ns * (sizes[min(k, len(sizes) - 1)] if sizes else 0)

    return at


Host = Callable[[Scenario, Sequence[Heard], int], Capture]

HOSTS: Final[Mapping[str, Host]] = MappingProxyType(
    {"exact": exact, "usb16": usb16, "log": log, "raw": raw}
)
