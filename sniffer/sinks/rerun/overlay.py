"""Two runs in one picture: each curve of the second one beside that of the first, darker."""

from __future__ import annotations

from dataclasses import replace
from typing import TYPE_CHECKING, Final

from sniffer.decoding.sink import bus_of
from sniffer.sinks.rerun.layout import mixed
from sniffer.sinks.rerun.sink import RerunSink

if TYPE_CHECKING:
    from sniffer.ground.model import Batch
    from sniffer.protocols.base import BusProtocol
    from sniffer.sinks.rerun.gauges import Whose
    from sniffer.sinks.rerun.plots import Track

DARKER: Final = 0.45
"""How much black there is in the colours of the second run: paler ones are those of goals."""

_BLACK: Final = (0, 0, 0)


class OverlaidSink(RerunSink):
    """Writes a .rrd in which all runs share their views; a run is what is written as one bus."""

    _run = ""
    _first = ""

    def write(self, bus: str, protocol: BusProtocol, batch: Batch) -> None:
        """Take what one pass of a run decided."""
        self._run = bus_of(bus, protocol, batch)
        self._first = self._first or self._run
        super().write(bus, protocol, batch)

    def _who(self, bus: str, protocol: BusProtocol, servo: int) -> Whose:
        """Return whose a track is in which run, and its colour."""
        return self._of_run(super()._who(bus, protocol, servo))

    def _line_itself(self) -> Whose:
        """Return the same of a track that is nobody's."""
        return self._of_run(super()._line_itself())

    def _of_run(self, told: Whose) -> Whose:
        who, name, colour = told
        own = colour if self._run == self._first else mixed(colour, _BLACK, DARKER)
        return who, f"{name} {self._run}", own

    def _tracks(self) -> list[Track]:
        """Return what the layout shows, all of it in one place."""
        return [replace(track, bus="both") for track in super()._tracks()]
