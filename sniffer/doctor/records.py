"""What is known after listening, and what is said of it."""

from __future__ import annotations

import enum
from dataclasses import dataclass, field
from typing import TYPE_CHECKING, Any, Protocol

from sniffer.ground.model import Mark, MarkKind
from sniffer.protocols import is_file

if TYPE_CHECKING:
    from collections.abc import Iterable, Mapping, Sequence

    from sniffer.decoding.understanding import Understanding
    from sniffer.ground.model import Chunk
    from sniffer.ports.listing import PortInfo


class Level(enum.IntEnum):
    """How bad it is."""

    OK = 0
    NOTE = 1
    WARN = 2
    BAD = 3


@dataclass(frozen=True, slots=True)
class Observation:
    """One finding. ``commands`` are to be typed, or put into a file, as they are."""

    level: Level
    about: str
    text: str
    advice: str = ""
    commands: tuple[str, ...] = ()
    numbers: Mapping[str, Any] = field(default_factory=dict)

    def as_dict(self) -> dict[str, Any]:
        """Return the verdict as one JSON object."""
        return {
            "type": "verdict",
            "level": self.level.name.lower(),
            "about": self.about,
            "text": self.text,
            "advice": self.advice or None,
            "commands": list(self.commands),
            **self.numbers,
        }


class Risen(Protocol):
    """By how much the driver's counters have risen."""

    @property
    def frame(self) -> int:
        """Bytes without a stop bit."""

    @property
    def parity(self) -> int:
        """Bytes with a wrong parity."""

    @property
    def overrun(self) -> int:
        """Times that the UART was not read in time."""

    @property
    def brk(self) -> int:
        """Breaks."""

    @property
    def buf_overrun(self) -> int:
        """Times that the driver's buffer was full."""


@dataclass(frozen=True, slots=True)
class Trial:
    """Another baud that was listened at."""

    baud: int
    found: Understanding


@dataclass(frozen=True, slots=True)
class Listened:
    """What is known about a port after listening.

    Args:
        path: its name.
        chunks: the reads.
        seconds: how long it was listened to.
        baud: bits per second.
        protocol: what was said to be spoken there, or ``auto``.
        marks_errors: whether bytes with errors are marked in the stream; None: not known.
        risen: the driver's counters; None where it has none.
        latency_ns: how long the adapter may hold bytes back, the port being open; None: not known.
        facts: what the open port tells about itself.
        info: what the system told before it was opened.
        trials: other bauds that were listened at.
        gone_s: when the port went away, in seconds since the beginning.
        has_line: whether there is a UART that keeps the baud; a pseudo terminal has none.
        counts_errors: whether the driver's counters, if it has some, rise; None: not known.
    """

    path: str
    chunks: Sequence[Chunk]
    seconds: float
    baud: int
    protocol: str = "auto"
    marks_errors: bool | None = False
    risen: Risen | None = None
    latency_ns: int | None = None
    facts: Mapping[str, str] = field(default_factory=dict)
    info: PortInfo | None = None
    trials: tuple[Trial, ...] = ()
    gone_s: float | None = None
    has_line: bool = True
    counts_errors: bool | None = True

    @property
    def size(self) -> int:
        """Bytes heard."""
        return sum(len(chunk.data) for chunk in self.chunks)

    @property
    def line_baud(self) -> int | None:
        """The rate that the line was heard at; None where there is no line."""
        return self.baud if self.has_line else None

    def named(self, found: str | None) -> str:
        """Return how a command names what is spoken; ``found`` is what the bytes are."""
        return self.protocol if found is None or is_file(self.protocol) else found

    def marked(self, *kinds: MarkKind) -> int:
        """Return how many errors of these kinds the stream tells."""
        return sum(m.count for m in self._marks() if m.kind in kinds)

    @property
    def line_errors(self) -> int:
        """Framing and parity errors and breaks; the counters know best, where there are some.

        An adapter on USB repeats a mark for each byte of a packet.
        """
        told = self.marked(MarkKind.FRAMING, MarkKind.PARITY, MarkKind.BREAK)
        if self.risen is None:
            return told
        return (self.risen.frame + self.risen.parity + self.risen.brk) or told

    def _marks(self) -> Iterable[Mark]:
        return (mark for chunk in self.chunks for mark in chunk.marks)
