"""The anomalies of late, one entry for all of a kind."""

from __future__ import annotations

from collections import Counter
from dataclasses import dataclass
from typing import TYPE_CHECKING, Any, Final

if TYPE_CHECKING:
    from collections.abc import Iterable, Iterator

    from sniffer.ground.model import Anomaly, Severity

KINDS_KEPT: Final = 64
"""Kinds of anomalies (bus, code, servo) that are remembered, the latest ones."""


@dataclass(slots=True)
class Trouble:
    """Anomalies of one kind, from one servo: the latest of them and how many there were."""

    bus: str
    last: Anomaly
    count: int = 1


class Troubles:
    """The last anomalies; one kind of one servo is one entry and stays in its place."""

    def __init__(self) -> None:
        self.severities: Counter[Severity] = Counter()
        self._held: dict[Any, Trouble] = {}

    def add(self, bus: str, anomalies: Iterable[Anomaly]) -> None:
        """Take anomalies of a bus."""
        for a in anomalies:
            self.severities[a.severity] += 1
            key = bus, a.code, a.servo_id
            known = self._held.get(key)
            if known is not None:
                known.last = a
                known.count += 1
                continue
            if len(self._held) >= KINDS_KEPT:
                del self._held[min(self._held, key=lambda k: self._held[k].last.t_ns)]
            self._held[key] = Trouble(bus, a)

    def __len__(self) -> int:
        return len(self._held)

    def __iter__(self) -> Iterator[Trouble]:
        """Yield them in the order in which they first happened."""
        return iter(self._held.values())


def latest(held: list[Trouble], n: int) -> list[Trouble]:
    """Return the ``n`` that happened last, in their order."""
    if n <= 0:
        return []
    if len(held) <= n:
        return held
    edge = sorted((e.last.t_ns for e in held), reverse=True)[n - 1]
    return [e for e in held if e.last.t_ns >= edge][-n:]
