"""A recording that speaks: who of it, on which ports, and what became of that."""

from __future__ import annotations

import enum
from dataclasses import dataclass
from typing import TYPE_CHECKING

if TYPE_CHECKING:
    from collections.abc import Callable, Mapping, Sequence
    from pathlib import Path

    from sniffer.jobs.session import Ending
    from sniffer.playback.controller import ServosHeard
    from sniffer.playback.line import Pacing
    from sniffer.playback.servos import ServoAnswers
    from sniffer.reports.differing import RunDifference
    from sniffer.simulation.play.outlet import FrameWriter


class PlayedRole(enum.Enum):
    """What of a recording speaks."""

    LINE = "line"
    """Everything, as it was heard."""
    SERVOS = "servos"
    CONTROLLER = "controller"


@dataclass(frozen=True, slots=True)
class PortUse:
    """What became of the bytes for one port: written, lost to nobody, too many for its reader."""

    bus: str
    name: str
    size: int
    lost: int
    overrun: int

    @classmethod
    def of(cls, bus: str, outlet: FrameWriter) -> PortUse:
        """Return the account of an outlet."""
        return cls(bus, outlet.port.name, outlet.size, outlet.lost, outlet.overrun)


@dataclass(frozen=True, slots=True)
class PlayedBack:
    """What was played: on which ports, and how the reading of the recording ended.

    ``pacing`` is there for a line, ``answers`` for servos; for a controller ``hearing``, and
    ``slower``, where response times differ from those of the recording.
    """

    ports: tuple[PortUse, ...]
    ending: Ending
    pacing: Pacing | None = None
    answers: ServoAnswers | None = None
    hearing: ServosHeard | None = None
    slower: tuple[RunDifference, ...] = ()

    @property
    def as_recorded(self) -> bool:
        """Whether nothing was asked that the recording does not know, and all was answered."""
        known = self.answers is None or not self.answers.unknown
        return known and (self.hearing is None or self.hearing.all_answered)


@dataclass(frozen=True, slots=True)
class PlayedPorts:
    """Where it is played.

    Args:
        to: a port for each bus, in the order in which they first speak: a path, or ``"pty"`` for a
            pseudo-terminal that is made for it; one ``"pty"`` is for all of them.
        links: symbolic links that lead to new pseudo-terminals meanwhile, one a bus.
        transmit: a serial port may be among them, and its servos may move.
        tap: with servos: a second port repeats both sides of the talk.
        tap_link: a link that leads there.
        ready: takes what each port is called (a bus, or ``"bus"`` and ``"tap"``) and its name.
    """

    to: Sequence[str]
    links: Sequence[Path] = ()
    transmit: bool = False
    tap: bool | None = None
    tap_link: Path | None = None
    ready: Callable[[Mapping[str, str]], None] = lambda names: None
