"""What a controller says to servos of a protocol: in the words of one client or of another."""

from __future__ import annotations

import abc
from typing import TYPE_CHECKING, ClassVar, Final, NamedTuple

from sniffer.ground.model import MS

if TYPE_CHECKING:
    import random
    from collections.abc import Iterator, Mapping

    from bench.diagnosis.played.stage import Stage


KEEPS_NS: Final = 400 * MS
"""How long clients wait for an answer to what is kept: a wCK module takes 120 ms for it."""


class Say(NamedTuple):
    """A request, whether the controller waits for an answer, and how long if not as usual."""

    raw: bytes
    is_answered: bool = True
    patience_ns: int = 0


class Tongue(abc.ABC):
    """The words of one client; what it has a choice about is drawn once, from ``rng``."""

    patience_ns: ClassVar[tuple[int, int]]
    """Between what bounds clients choose how long they wait for an answer."""

    def __init__(self, stage: Stage, rng: random.Random) -> None:
        self.stage = stage
        self.rng = rng
        self.patience = rng.randint(*self.patience_ns)
        self.together = rng.random() < 0.5
        """Goals go to all servos at once, where the protocol has a word for it."""

    def keep(self, servo_id: int, turn: int) -> Say:
        """Write something that the servo keeps without power."""
        delivery = self.stage.bus.keep(servo_id, turn)
        return Say(delivery.request.data, delivery.patience_ns > 0, KEEPS_NS)

    @abc.abstractmethod
    def identify(self, servo_id: int) -> Say:
        """Ask what the servo is."""

    @abc.abstractmethod
    def hello(self, servo_id: int) -> Iterator[Say]:
        """Ask who is there, and for limits."""

    @abc.abstractmethod
    def switch(self, servo_id: int, *, on: bool) -> Iterator[Say]:
        """Switch the torque, in the protocols that have a word for it."""

    @abc.abstractmethod
    def raw(self, servo_id: int, place: float) -> int:
        """Return the number for a place 0..1."""

    @abc.abstractmethod
    def goals(self, raws: Mapping[int, int]) -> Iterator[Say]:
        """Send goals."""

    @abc.abstractmethod
    def look(self, servo_id: int, turn: int) -> Iterator[Say]:
        """Read the state, or in turn what there is of it."""

    @abc.abstractmethod
    def rename(self, servo_id: int, new: int) -> Iterator[Say]:
        """Give a servo another id, in force at once."""

    @abc.abstractmethod
    def retune(self, servo_id: int, baud: int) -> Iterator[Say]:
        """Tell a servo another baud rate, and let it take effect."""

    @abc.abstractmethod
    def restart(self, servo_id: int) -> Iterator[Say]:
        """Restart a servo, in the protocols that have a word for it."""
