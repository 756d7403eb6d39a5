"""What stands beside the rows of a selection: so many lines before and behind each, as of grep.

A line is a frame or a gap of one bus, in the order of the wire. What is selected next may be near
the end of a pass that is over: a pass waits until so many lines are behind it, no longer.
"""

from __future__ import annotations

from dataclasses import dataclass, field, replace
from typing import TYPE_CHECKING

import numpy as np

from sniffer.anomalies.found import Anomalies
from sniffer.decoding.narrowing import meant
from sniffer.ground.gaps import Gaps

if TYPE_CHECKING:
    from collections.abc import Iterator, Sequence

    from sniffer.decoding.sink import Part
    from sniffer.ground.model import I64, Batch, Mask


@dataclass(slots=True)
class _Lines:
    """The lines of a pass, in the order of the wire.

    ``order`` sorts those of the parts behind each other; ``is_near`` and ``is_meant`` are in the
    order of the wire, ``behind`` is how many lines of the bus came since.
    """

    parts: Sequence[Part]
    order: I64
    is_meant: Mask
    is_near: Mask
    behind: int = 0

    @classmethod
    def of(cls, parts: Sequence[Part]) -> _Lines:
        """Return the lines of a pass: frames, gaps and the anomalies that are selected."""
        told = [each for _, batch in parts for each in _told(batch)]
        starts = np.concatenate([start for start, _ in told])
        order = np.argsort(starts, kind="stable")
        is_meant = np.concatenate([mask for _, mask in told])[order]
        return cls(parts, order, is_meant, np.zeros(len(order), bool))

    def with_near(self) -> list[Part]:
        """Return the parts, each with the rows with which those selected are shown."""
        near = np.empty(len(self.order), bool)
        near[self.order] = self.is_near
        out, begin = [], 0
        for protocol, batch in self.parts:
            sizes = [len(start) for start, _ in _told(batch)]
            frames = near[begin : begin + sizes[0]]
            gaps = near[begin + sizes[0] : begin + sizes[0] + sizes[1]]
            out.append((protocol, replace(batch, around=(frames, gaps))))
            begin += sum(sizes)
        return out


def _told(batch: Batch) -> Iterator[tuple[I64, Mask]]:
    """Yield where frames, gaps and selected anomalies stand, and which of them are selected."""
    yield batch.frames.start, meant(batch)
    gaps = Gaps.of(batch.gaps)
    yield gaps.start, batch.shows("gaps", len(gaps))
    found = Anomalies.of(batch.anomalies)
    at = found.known_at[batch.shows("anomalies", len(found))] - batch.base
    yield at, np.ones(len(at), bool)


@dataclass(slots=True)
class _AroundOnBus:
    """What waits of a bus, and how far behind the last line that is selected the next one is."""

    waiting: list[_Lines] = field(default_factory=list)
    since: int | None = None


class Surroundings:
    """Takes the passes of each bus, and gives them back with ``count`` lines around a selection."""

    def __init__(self, count: int) -> None:
        self._count = count
        self._buses: dict[str, _AroundOnBus] = {}

    @property
    def open_buses(self) -> set[str]:
        """Buses of which something waits."""
        return {bus for bus, one in self._buses.items() if one.waiting}

    def of(self, bus: str, parts: Sequence[Part]) -> list[list[Part]]:
        """Take a pass; return those that nothing behind them can change any more."""
        one = self._buses.setdefault(bus, _AroundOnBus())
        lines = _Lines.of(parts)
        size, rows = len(lines.order), np.flatnonzero(lines.is_meant)
        lines.is_near = self._near(size, rows)
        if one.since is not None:
            lines.is_near[: max(self._count + 1 - one.since, 0)] = True
            one.since += size
        for held in one.waiting:
            if len(rows):
                left = self._count - held.behind - int(rows[0])
                held.is_near[max(len(held.order) - max(left, 0), 0) :] = True
            held.behind += size
        if len(rows):
            one.since = size - int(rows[-1])
        one.waiting.append(lines)
        is_due = [held.behind >= self._count for held in one.waiting]
        due = one.waiting[: sum(is_due)]
        del one.waiting[: sum(is_due)]
        return [held.with_near() for held in due]

    def _near(self, size: int, rows: I64) -> Mask:
        """Return which of so many lines are near some rows of theirs."""
        steps = np.zeros(size + 1, np.int64)
        np.add.at(steps, np.maximum(rows - self._count, 0), 1)
        np.add.at(steps, np.minimum(rows + self._count + 1, size), -1)
        near: Mask = np.cumsum(steps[:-1]) > 0
        return near

    def rest(self) -> list[tuple[str, list[Part]]]:
        """Return what still waits: nothing more is said."""
        told = [(bus, held.with_near()) for bus, one in self._buses.items() for held in one.waiting]
        self._buses = {}
        return told
