"""What a protocol's clients and servos are asked for here: requests in bytes, and answers."""

from __future__ import annotations

import abc
from typing import TYPE_CHECKING, ClassVar, Final, NamedTuple

if TYPE_CHECKING:
    import random
    from collections.abc import Mapping, Sequence

    from bench.diagnosis.bodies import Body

MS: Final = 1_000_000
US: Final = 1000


class Asked(NamedTuple):
    """A request: its bytes, and how long the controller waits for an answer; 0: not at all."""

    data: bytes
    patience_ns: int = 0


class Dialect(abc.ABC):
    """One protocol: requests of usual clients, and what servos of it answer."""

    name: ClassVar[str]
    baud: ClassVar[int]
    bauds: ClassVar[tuple[int, ...]]
    ids: ClassVar[Sequence[int]]
    volt: ClassVar[float]
    patience_ns: ClassVar[int]
    delay_ns: ClassVar[tuple[int, int]]
    """How long servos take to answer: the range that a servo's own time is drawn from."""

    def fit(self, body: Body, rng: random.Random) -> None:
        """Set a servo up before it is used."""
        del rng
        body.settings.clear()

    @abc.abstractmethod
    def ping(self, servo_id: int) -> Asked:
        """Ask whether it is there."""

    @abc.abstractmethod
    def state(self, servo_id: int) -> Asked:
        """Ask for all that it measures, as far as one request does it."""

    @abc.abstractmethod
    def position(self, servo_id: int) -> Asked:
        """Ask where it is."""

    @abc.abstractmethod
    def health(self, servo_id: int) -> Asked:
        """Ask for something else than its position."""

    @abc.abstractmethod
    def move(self, body: Body, place: float) -> Asked:
        """Send it to a place, 0..1."""

    @abc.abstractmethod
    def move_all(self, places: Mapping[int, float]) -> Sequence[Asked]:
        """Send several at once, with as few requests as the protocol has for it."""

    @abc.abstractmethod
    def switch_on(self, body: Body) -> Asked:
        """Let it hold its place."""

    @abc.abstractmethod
    def switch_off(self, body: Body) -> Asked:
        """Let it go limp."""

    @abc.abstractmethod
    def whom(self, request: bytes) -> int | None:
        """Return whom a whole request is for, None for all; -1: it is no whole request."""

    @abc.abstractmethod
    def answer(self, body: Body, request: bytes) -> bytes:
        """Obey; return the answer, or nothing. The body has been moved on."""
