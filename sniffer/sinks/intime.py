"""What several buses say, in the order of time.

A decoder tells of one bus after the other. What one of them said waits here until no other can have
said anything before it, so the order is that of the times, however the capture was cut into passes.
"""

from __future__ import annotations

from bisect import bisect_left
from dataclasses import dataclass, field
from typing import TYPE_CHECKING, Final, Generic, NamedTuple, TypeVar

from sniffer.ground.limits import TIME_LEAST_NS
from sniffer.ground.model import NS

if TYPE_CHECKING:
    from collections.abc import Collection, Sequence

T = TypeVar("T")


class WaitTimes(NamedTuple):
    """How long something waits for what another bus may have said before it, in ns.

    ``behind_ns`` is by how much bytes may have been on the line before their stamp; ``open_ns`` how
    long bytes are waited for of which nobody knows yet what they are, None: as long as it takes.
    """

    behind_ns: int
    open_ns: int | None


READ: Final = WaitTimes(NS, None)
"""Of a capture that is read as fast as it can be."""

PLAYED: Final = WaitTimes(NS // 10, NS // 10)
"""Of one at which somebody looks in real time."""

LIVE: Final = WaitTimes(0, NS // 10)
"""Of a recording: its recorder has taken off already what its adapters may hold back."""

FIRST_NS: Final = NS // 10
"""All waits for so long at first: then it is known whether there are several buses."""

MOST: Final = 20_000
"""So many wait at most; then the oldest ones go, whatever may come."""


@dataclass(slots=True)
class _HeldLines(Generic[T]):
    """What waits of a bus. Times never fall in ``keys``: its order stays that of the wire."""

    keys: list[int] = field(default_factory=list)
    items: list[T] = field(default_factory=list)
    last: int = TIME_LEAST_NS


class InTime(Generic[T]):
    """Takes what buses say, each in wire order, and gives it back in the order of time."""

    def __init__(self, waits: WaitTimes) -> None:
        self._waits = waits
        self._buses: dict[str, _HeldLines[T]] = {}
        self._is_begun = False

    def add(self, bus: str, said: Sequence[tuple[int, T]]) -> None:
        """Take what a bus said next, with its times in ns."""
        held = self._buses.setdefault(bus, _HeldLines())
        last = held.last
        for t_ns, item in said:
            last = max(last, t_ns)
            held.keys.append(last)
            held.items.append(item)
        held.last = last

    def until(self, until_ns: int, open_buses: Collection[str]) -> list[tuple[str, T]]:
        """Return what is due, with its bus.

        All that was said before ``until_ns`` has been taken, but for what waits in ``open_buses``.
        """
        firsts = [held.keys[0] for held in self._buses.values() if held.keys]
        if not firsts:
            return []
        limit = until_ns - self._waits.behind_ns
        for bus in open_buses:
            said = self._buses[bus].last if bus in self._buses else TIME_LEAST_NS
            if self._waits.open_ns is not None:
                said = max(said, until_ns - self._waits.open_ns)
            limit = min(limit, said)
        if not self._is_begun:
            self._is_begun = limit >= min(firsts) + FIRST_NS
            limit = limit if self._is_begun else TIME_LEAST_NS
        due = self._before(limit)
        if (count := sum(len(held.keys) for held in self._buses.values())) > MOST:
            keys = sorted(key for held in self._buses.values() for key in held.keys)
            due += self._before(keys[count - MOST])
            self._is_begun = True
        return due

    def rest(self) -> list[tuple[str, T]]:
        """Return all that waits, in the order of time."""
        return self._before(None)

    def as_told(self) -> list[tuple[str, T]]:
        """Return all that waits, bus after bus, as it was told: there are no times."""
        buses, self._buses = self._buses, {}
        return [(bus, item) for bus, held in buses.items() for item in held.items]

    def _before(self, limit: int | None) -> list[tuple[str, T]]:
        due: list[tuple[int, str, T]] = []
        for bus, held in sorted(self._buses.items()):
            at = len(held.keys) if limit is None else bisect_left(held.keys, limit)
            due += zip(held.keys[:at], [bus] * at, held.items[:at], strict=True)
            del held.keys[:at], held.items[:at]
        if len(self._buses) > 1:
            due.sort(key=_key)
        return [(bus, item) for _, bus, item in due]


def _key(due: tuple[int, str, object]) -> int:
    return due[0]
