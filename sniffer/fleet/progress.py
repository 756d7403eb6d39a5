"""How far a run is, and how long it will take."""

from __future__ import annotations

from typing import Final, NamedTuple

ALONE_BYTES: Final = 60_000
"""Bytes that are decoded in the time that a capture takes however small it is, some 7 ms."""


class FleetProgress(NamedTuple):
    """How far it is: captures and bytes of files, done and in all, and the time it took so far."""

    captures: int
    of_captures: int
    bytes: int
    of_bytes: int
    seconds: float

    @property
    def bytes_per_second(self) -> float:
        """Bytes of files a second, so far."""
        return self.bytes / self.seconds if self.seconds else 0.0

    @property
    def seconds_left(self) -> float | None:
        """How long it will take at that rate, None where that cannot be told yet."""
        done = self.bytes + self.captures * ALONE_BYTES
        left = self.of_bytes + self.of_captures * ALONE_BYTES - done
        return max(left, 0) * self.seconds / done if done else None  # captures may grow
