"""What a pass goes through: a block with its frames; and what is told where there is none."""

from __future__ import annotations

from typing import TYPE_CHECKING, NamedTuple

from sniffer.ground.limits import IDS
from sniffer.ground.model import Batch, Frames, Samples, Transactions
from sniffer.protocols import PluginError

if TYPE_CHECKING:
    from sniffer.ground.framing import Block
    from sniffer.ground.model import I64, Clock, Remark, Spans
    from sniffer.protocols.base import BusProtocol


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


def described(protocol: BusProtocol, block: Block, spans: Spans, base: int) -> Frames:
    """Return the frames of a block as its protocol describes them.

    Raises:
        PluginError: a protocol that is written by hand names a servo that there cannot be.
    """
    frames = protocol.describe(block, spans)
    if len(frames) and frames.servo_id.max() >= IDS:
        row = int((frames.servo_id >= IDS).argmax())
        at, who = base + int(frames.start[row]), int(frames.servo_id[row])
        told = f"the frame at byte {at} names servo {who}: ids are 0 to {IDS - 1}"
        raise PluginError(f"{protocol.name}: {told}")
    return frames
