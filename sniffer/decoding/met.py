"""What a pass goes through: a block with its frames; and what is told where there is none."""

from __future__ import annotations

from typing import TYPE_CHECKING, NamedTuple

from sniffer.ground.model import Batch, Frames, Samples, Transactions

if TYPE_CHECKING:
    from sniffer.ground.framing import Block
    from sniffer.ground.model import I64, Clock, Remark


class Met(NamedTuple):
    """A block framed, described and paired; ``partner`` is as ``match`` returns it."""

    block: Block
    frames: Frames
    partner: I64
    decided: int


def empty_batch(base: int, clock: Clock, remarks: tuple[Remark, ...]) -> Batch:
    """Return a batch without bytes at an offset of the stream."""
    none = Frames.empty(), (), Transactions.empty(), Samples.empty(), ()
    return Batch(base, b"", clock, *none, remarks)
