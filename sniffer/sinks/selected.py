"""Files of bytes that have the frames which a selection shows, and nothing else."""

from __future__ import annotations

from typing import TYPE_CHECKING, Final

import numpy as np

from sniffer.decoding.narrowing import meant
from sniffer.ground.model import Chunk, Clock, Direction

if TYPE_CHECKING:
    from collections.abc import Sequence

    from sniffer.decoding.sink import Part
    from sniffer.ground.model import Batch
    from sniffer.protocols.base import BusProtocol
    from sniffer.sinks.raw import RawFile

LEFT_OUT: Final = (
    "has the selected frames only, with those that selected transactions and samples are of: "
    "decoded again, what is between them was never said"
)
"""What is told of such a file."""


UNFRAMED: Final = frozenset({"gaps", "anomalies"})
"""Tables whose rows are of no frame: a selection of these alone has nothing for such a file."""


class SelectedBytes:
    """A sink that hands the selected frames to a file of bytes, a chunk a frame."""

    def __init__(self, file: RawFile) -> None:
        self._file = file

    def raw(self, bus: str, chunks: Sequence[Chunk]) -> None:
        """Take nothing: which bytes are selected is known when they are decoded."""

    def write(self, bus: str, protocol: BusProtocol, batch: Batch) -> None:
        """Write the selected frames of a batch."""
        self.write_together(bus, [(protocol, batch)])

    def write_together(self, bus: str, parts: Sequence[Part]) -> None:
        """Write the selected frames of several protocols, in wire order."""
        found = [told for _, batch in parts for told in _chunks(bus, batch)]
        self._file.take(chunk for _, chunk in sorted(found, key=lambda told: told[0]))

    def close(self) -> None:
        """Finish the file."""
        self._file.close()


def _chunks(bus: str, batch: Batch) -> list[tuple[int, Chunk]]:
    f, clock = batch.frames, Clock(batch.clock)
    out = []
    for row in np.flatnonzero(meant(batch)).tolist():
        at, t_ns = int(f.start[row]), None if clock is Clock.NONE else int(f.t_end[row])
        data = batch.data[at : at + int(f.length[row])]
        wire = Direction(int(f.direction[row]))
        out.append((batch.base + at, Chunk(data, t_ns, clock, bus, wire)))
    return out
