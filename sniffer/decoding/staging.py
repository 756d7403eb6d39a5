"""Under which id an execution is answered, where a new id was staged before.

A staged write is acknowledged under the old id. What executes it takes the new one into force, and
the answer to that already bears it. Any number of frames may stand between the two, so this is
carried from block to block; frames alone decide, in wire order.
"""

from __future__ import annotations

from dataclasses import replace
from typing import TYPE_CHECKING

import numpy as np

from sniffer.ground.codes import REQUEST
from sniffer.ground.memory import Remembering
from sniffer.ground.model import NO_ALT, RELEASES, STAGED

if TYPE_CHECKING:
    from collections.abc import Sequence

    from sniffer.ground.model import Frames
    from sniffer.protocols.base import BusProtocol, SlowFrame


class StagedIds(Remembering):
    """Remembers the ids that wait for their execution, block after block."""

    LASTING = ("_known",)

    def __init__(self, protocol: BusProtocol) -> None:
        self._everyone = protocol.everyone
        self._known: dict[int, int] = {}

    def mark(self, frames: Frames) -> Frames:
        """Return the frames; executions have the id that they bring as ``alt_id``."""
        found = self._walk(frames, dict(self._known))
        if not found:
            return frames
        alt = frames.alt_id.copy()
        alt[list(found)] = list(found.values())
        return replace(frames, alt_id=alt)

    def forget(self, kept: Frames) -> None:
        """Keep what holds behind these frames, which are done with."""
        self._walk(kept, self._known)

    def _walk(self, frames: Frames, known: dict[int, int]) -> dict[int, int]:
        """Return the new ids of executions by row; ``known`` becomes what holds in the end."""
        staged = (frames.flags & STAGED > 0) & (frames.alt_id >= 0)
        if not known and not staged.any():
            return {}
        executes = (frames.flags & RELEASES > 0) & (frames.kind == REQUEST)
        # Id 2 is staged for servo 1 and acknowledged, another servo is polled, then it is executed:
        #
        #     row        0         1    2     3    4          5
        #     frame      stage 2   ok   Q3    A3   execute    ok
        #     servo_id   1         1    3     3    1          2
        #     staged     1         0    0     0    0          0
        #     executes   0         0    0     0    1          0
        #     known      {1: 2}                    {}
        #     out                                  {4: 2}     the answer may bear id 2
        #
        # Columns find the rows; only those are walked, as each depends on what is known by then.
        out: dict[int, int] = {}
        for row in np.flatnonzero(staged | executes).tolist():
            servo = int(frames.servo_id[row])
            if staged[row]:
                known[servo] = int(frames.alt_id[row])
            elif servo in self._everyone:
                known.clear()
            elif servo in known:
                out[row] = known.pop(servo)
        return out


def slow_staged_ids(
    frames: Sequence[SlowFrame], known: dict[int, int], everyone: Sequence[int]
) -> None:
    """Do the same, one frame after the other; ``known`` goes on with the next stretch."""
    for f in frames:
        if f.flags & STAGED and f.alt_id >= 0:
            known[f.servo_id] = f.alt_id
        elif f.flags & RELEASES and f.kind == REQUEST:
            if f.servo_id in everyone:
                known.clear()
            elif f.servo_id in known:
                new = known.pop(f.servo_id)
                f.alt_id = new if f.alt_id == NO_ALT else f.alt_id
