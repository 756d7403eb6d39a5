"""What simulated servos understand of a frame that is on the line, read with the real grammar."""

from __future__ import annotations

from typing import TYPE_CHECKING, Final

import numpy as np

from sniffer.ground.codes import REQUEST as ASKS
from sniffer.ground.codes import WHOLE
from sniffer.ground.framing import Block
from sniffer.ground.model import Spans
from sniffer.protocols.base import State
from sniffer.simulation.talk import USUAL, HeardFrame, Message

if TYPE_CHECKING:
    from collections.abc import Mapping

    from sniffer.protocols.base import BusProtocol

NO_BARRIERS: Final = np.empty(0, np.int64)


class Ears:
    """Reads frames of a protocol, one by one, as servos of these models do."""

    def __init__(self, protocol: BusProtocol, models: Mapping[int | None, str] = USUAL) -> None:
        self._protocol = protocol
        self._state = State(protocol, models)

    def read(self, raw: bytes, kind: int = ASKS, before: bytes = b"") -> tuple[HeardFrame, Message]:
        """Return a whole frame in plain numbers, and the message with the values it states.

        ``before`` is the request right before it, if that is what was heard last.
        """
        protocol = self._protocol
        data, behind = before + raw, len(before)
        spans = Spans(
            np.array([0, behind]),
            np.array([behind, len(data)]),
            np.array([ASKS, kind], np.uint8),
        )
        block = Block(np.frombuffer(data, np.uint8), NO_BARRIERS, True)
        frames = protocol.describe(block, spans if behind else spans.take([1]))
        row = len(frames) - 1
        heard = HeardFrame.of(frames, row, data)
        v = protocol.values(block, frames, np.array([row]), self._state)
        columns = (c.tolist() for c in (v.servo_id, v.register, v.raw, v.part))
        values = tuple(
            (servo_id, protocol.registers[index].name, value)
            for servo_id, index, value, part in zip(*columns, strict=True)
            if part == WHOLE
        )
        return heard, Message(raw, heard.servo_id, protocol.op_name(heard.op), values)
