"""Faults on demand: what goes wrong on a bus, how often, and to whom.

All of it is drawn from a generator of its own, so the same seed moves the servos alike with and
without faults.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import TYPE_CHECKING, Final

from sniffer.model import NS, SnifferError

if TYPE_CHECKING:
    import random
    from collections.abc import Sequence

DROP, FLIP, CUT, LATE = "drop", "flip", "cut", "late"
NOISE, DUPLICATE, BROWNOUT = "noise", "duplicate", "brownout"

FAULTS: Final = {
    DROP: "a servo does not answer",
    FLIP: "one byte of a frame is altered on the line",
    CUT: "an answer breaks off",
    LATE: "an answer comes later than the manual promises",
    NOISE: "bytes of nobody on the line, before a request",
    DUPLICATE: "a second servo of the same id answers as well",
    BROWNOUT: "the supply of a servo sags, it complains, then it restarts",
}
"""The kinds of faults."""


@dataclass(frozen=True, slots=True)
class Fault:
    """One thing that goes wrong: its kind, how probable it is at each chance, and to which servo.

    A chance is a frame (flip), an answer (drop, cut, late, duplicate), a request (noise, brownout).
    ``servo_id`` None stands for anybody; frames to all servos are nobody's.
    """

    kind: str
    rate: float
    servo_id: int | None = None

    def __post_init__(self) -> None:
        if self.kind not in FAULTS:
            raise SnifferError(f"no fault {self.kind!r}: one of {', '.join(FAULTS)}")


class Mischief:
    """Draws which faults strike, and what they do to bytes."""

    def __init__(self, faults: Sequence[Fault], rng: random.Random) -> None:
        self._faults = faults
        self.rng = rng

    def strikes(self, kind: str, servo_id: int) -> bool:
        """Draw whether a fault happens at this chance."""
        mine = [f for f in self._faults if f.kind == kind and f.servo_id in (None, servo_id)]
        return any(self.rng.random() < f.rate for f in mine)

    def flip(self, data: bytes) -> bytes:
        """Alter one byte."""
        at = self.rng.randrange(len(data))
        return data[:at] + bytes([data[at] ^ self.rng.randint(1, 255)]) + data[at + 1 :]

    def cut(self, data: bytes) -> bytes:
        """Keep the beginning; a reply of one byte cannot be cut."""
        return data[: self.rng.randint(1, len(data) - 1)] if len(data) > 1 else data

    def noise(self) -> bytes:
        """Return up to five bytes; a line that floats or rings gives mostly 00 and FF."""
        usual = self.rng.choices((0x00, 0xFF, -1), (3, 4, 5), k=self.rng.randint(1, 5))
        return bytes(b if b >= 0 else self.rng.randrange(256) for b in usual)

    def brownout(self) -> tuple[float, int, int]:
        """Return the part of the voltage that is lost, for how long, and how long a restart takes.

        The restart time is a figure of the simulation: no manual but wCK's (65 ms) gives one.
        """
        low_ns = int(self.rng.uniform(0.25, 0.6) * NS)
        return self.rng.uniform(0.3, 0.45), low_ns, int(self.rng.uniform(0.15, 0.3) * NS)
