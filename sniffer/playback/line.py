"""A line as it was: every byte again, each piece at its moment."""

from __future__ import annotations

import time
from typing import TYPE_CHECKING, Final, NamedTuple

from sniffer.ground.model import NS
from sniffer.ground.schedule import Schedule
from sniffer.playback.outlets import said
from sniffer.simulation.play.player import LOOK_NS

if TYPE_CHECKING:
    from collections.abc import Callable, Iterable, Mapping

    from sniffer.ground.model import Chunk
    from sniffer.simulation.play.outlet import FrameWriter
    from sniffer.simulation.play.player import Stop

PIECE_NS: Final = NS // 1000
"""Where the input has no times, bytes of so much time go together: no reader could tell more."""


class Pacing(NamedTuple):
    """How well the moments were met: writings, and by how much they came late, in ns."""

    pieces: int
    mean_ns: int
    worst_ns: int
    last_ns: int


class Lateness:
    """Counts by how much moments were missed."""

    def __init__(self) -> None:
        self._pieces = self._total = self._worst = self._last = 0

    @property
    def pacing(self) -> Pacing:
        """How well the moments were met so far."""
        mean = self._total // max(self._pieces, 1)
        return Pacing(self._pieces, mean, self._worst, self._last)

    def note(self, late_ns: int) -> None:
        """Count a moment."""
        self._pieces += 1
        self._total += late_ns
        self._worst, self._last = max(self._worst, late_ns), late_ns


class LinePlayer:
    """Writes the chunks of a recording to ports, in the recording's time.

    Moments are absolute, counted from the first chunk: what is late does not make the next one
    late, so nothing drifts. A machine that was held up catches up.
    """

    def __init__(
        self,
        outlets: Mapping[str, FrameWriter],
        stop: Stop,
        now: Callable[[], int] = time.monotonic_ns,
    ) -> None:
        self._outlets = outlets
        self._stop = stop
        self._now = now
        self._late = Lateness()

    @property
    def pacing(self) -> Pacing:
        """How well the moments were met so far."""
        return self._late.pacing

    def play(self, chunks: Iterable[Chunk], speed: float = 1.0) -> None:
        """Play chunks that all have times; ``speed`` 0: as fast as they are read."""
        schedule = Schedule(speed)
        for chunk in chunks:
            if self._stop.asked:
                return
            if not chunk.data:
                continue
            outlet = self._outlets[chunk.bus]
            if speed > 0:
                due = schedule.due_ns(chunk.t_ns or 0, self._now())
                self._rest(due)
                self._late.note(max(self._now() - due, 0))
            for one in self._outlets.values():
                one.port.read()  # nobody's business here, but it must not pile up
            if not self._stop.asked:
                outlet.say([said(chunk.data)])
            while not speed and outlet.waits and not self._stop.asked:
                self._stop.sleep(LOOK_NS)
                outlet.flush()

    def finish(self) -> None:
        """Give readers the time to take the rest."""
        for outlet in self._outlets.values():
            outlet.finish()

    def _rest(self, due: int) -> None:
        while not self._stop.asked and (left := due - self._now()) > 0:
            waiting = [one for one in self._outlets.values() if one.waits]
            for one in waiting:
                one.flush()
            self._stop.sleep(min(left, LOOK_NS) if waiting else left)
