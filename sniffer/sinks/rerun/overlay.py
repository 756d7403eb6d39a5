"""Two runs in one picture: each curve of the second one beside that of the first, darker."""

from __future__ import annotations

from dataclasses import replace
from typing import TYPE_CHECKING, Final

from sniffer.sinks.rerun.layout import mixed
from sniffer.sinks.rerun.sink import RerunSink

if TYPE_CHECKING:
    from sniffer.ground.colours import Rgb
    from sniffer.protocols.base import BusProtocol
    from sniffer.sinks.rerun.entities import Curve, Strip
    from sniffer.sinks.rerun.plots import Track

DARKER: Final = 0.45
"""How much black there is in the colours of the second run: paler ones are those of goals."""

_BLACK: Final = (0, 0, 0)


class OverlaidSink(RerunSink):
    """Writes a .rrd in which all runs share their views; a run is what is written as one bus."""

    _run = ""
    _first = ""

    def _line(self, bus: str, protocol: BusProtocol, servo: int, number: int) -> Curve:
        self._run, self._first = bus, self._first or bus
        return super()._line(bus, protocol, servo, number)

    def _lane(self, bus: str, protocol: BusProtocol, servo: int, number: int) -> Strip:
        self._run, self._first = bus, self._first or bus
        return super()._lane(bus, protocol, servo, number)

    def _who(self, protocol: BusProtocol, servo: int) -> tuple[int, str, Rgb]:
        """Return whose a track is in which run, and its colour."""
        who, name, colour = super()._who(protocol, servo)
        own = colour if self._run == self._first else mixed(colour, _BLACK, DARKER)
        return who, f"{name} {self._run}", own

    def _tracks(self) -> list[Track]:
        """Return what the layout shows, all of it in one place."""
        return [replace(track, bus="both") for track in super()._tracks()]
