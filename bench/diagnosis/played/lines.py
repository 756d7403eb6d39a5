"""The words of LSS clients: lines of text. See ``tongue``."""

from __future__ import annotations

from typing import TYPE_CHECKING, Final

from bench.diagnosis.played.tongue import Say, Tongue
from sniffer.ground.model import MS
from sniffer.protocols.lss.grammar import command
from sniffer.simulation.lss_servo import TRAVEL_DEG

if TYPE_CHECKING:
    import random
    from collections.abc import Iterator, Mapping

    from bench.diagnosis.played.stage import Stage

ALL_WORDS: Final = ("Q", "QV", "QC", "QT", "QWD")
TURNS: Final = (
    ("QV", "QT", "QC", "Q"),
    ("Q", "QC"),
    ALL_WORDS,
)
"""What is asked for in turn, beside the position."""


class LssTongue(Tongue):
    """A goal to each servo, the position of each, the other values in turn."""

    patience_ns = (20 * MS, 110 * MS)

    def __init__(self, stage: Stage, rng: random.Random) -> None:
        super().__init__(stage, rng)
        self.together = False
        self.turn = rng.choice(TURNS)
        self._timed = rng.random() < 0.3
        self.by_pulse = False

    def query(self, servo_id: int, word: str, selector: int | None = None) -> Say:
        """Ask for something."""
        return Say(command(servo_id, word, selector))

    def tell(self, servo_id: int, word: str, value: int | None = None) -> Say:
        """Say something that is not answered."""
        return Say(command(servo_id, word, value), False)

    def identify(self, servo_id: int) -> Say:
        """Ask for the firmware."""
        return self.query(servo_id, "QF")

    def hello(self, servo_id: int) -> Iterator[Say]:
        """Ask for the model and the origin, or not."""
        if self.rng.random() < 0.7:
            yield self.query(servo_id, "QMS")
            yield self.query(servo_id, "QO")

    def switch(self, servo_id: int, *, on: bool) -> Iterator[Say]:
        """Hold, or let go."""
        yield self.tell(servo_id, "H" if on else "L")

    def raw(self, servo_id: int, place: float) -> int:
        """Return tenths of a degree, or microseconds."""
        del servo_id
        if self.by_pulse:
            return round(500 + 2000 * place)
        return round((place - 0.5) * TRAVEL_DEG * 10)

    def goals(self, raws: Mapping[int, int]) -> Iterator[Say]:
        """Send each its own."""
        word = "P" if self.by_pulse else "D"
        modifiers = {"T": 40} if self._timed else {}
        for servo_id, raw in raws.items():
            yield Say(command(servo_id, word, raw, modifiers), False)

    def look(self, servo_id: int, turn: int) -> Iterator[Say]:
        """Ask for the position, and in turn for one of the rest."""
        yield self.query(servo_id, "QD")
        yield self.query(servo_id, self.turn[turn % len(self.turn)])

    def rename(self, servo_id: int, new: int) -> Iterator[Say]:
        """Configure the id and reset."""
        yield self.tell(servo_id, "CID", new)
        yield from self.restart(servo_id)

    def retune(self, servo_id: int, baud: int) -> Iterator[Say]:
        """Configure the rate and reset."""
        yield self.tell(servo_id, "CB", baud)
        yield from self.restart(servo_id)

    def restart(self, servo_id: int) -> Iterator[Say]:
        """Reset."""
        yield self.tell(servo_id, "RESET")
