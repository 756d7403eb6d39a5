"""Whose the id 0 is where it may address all: mightyZAPs leave the factory with it, too."""

from __future__ import annotations

from typing import TYPE_CHECKING

import numpy as np

from sniffer.ground.codes import RESPONSE
from sniffer.ground.memory import Remembering

if TYPE_CHECKING:
    from sniffer.ground.model import Frames
    from sniffer.protocols.base import BusProtocol


class ZeroId(Remembering):
    """Tells from which frame on id 0 is a servo's own: until one answers so, it addresses all."""

    LASTING = ("_is_all",)

    def __init__(self, protocol: BusProtocol) -> None:
        self._is_all = 0 in protocol.everyone

    def until(self, f: Frames) -> int:
        """Return the row before which id 0 addresses all; every batch is to be asked for once."""
        if not self._is_all:
            return 0
        answers = np.flatnonzero((f.servo_id == 0) & (f.kind == RESPONSE))
        self._is_all = not len(answers)
        return int(answers[0]) if len(answers) else len(f)
