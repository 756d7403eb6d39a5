"""What a sink is: it takes raw chunks and decoded batches, and is closed once."""

from __future__ import annotations

from typing import TYPE_CHECKING, Protocol, runtime_checkable

if TYPE_CHECKING:
    from collections.abc import Sequence

    from sniffer.decoding.pacing import Pace
    from sniffer.ground.model import Batch, Chunk
    from sniffer.protocols.base import BusProtocol


class Sink(Protocol):
    """An output. Raises OutputError where it cannot write."""

    def raw(self, bus: str, chunks: Sequence[Chunk]) -> None:
        """Take chunks as they came, before they are decoded."""
        ...

    def write(self, bus: str, protocol: BusProtocol, batch: Batch) -> None:
        """Take what one pass decided."""
        ...

    def close(self) -> None:
        """Finish the output; called once, also after an interruption."""
        ...


@runtime_checkable
class Paced(Protocol):
    """A sink that wants to know by which rate and latency a bus is timed."""

    def pace(self, bus: str, told: Pace) -> None:
        """Take what a bus is timed by; called once, before its first record."""
        ...
