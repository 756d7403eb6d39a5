"""Faults on demand: what goes wrong on a bus, how often, and to whom.

All of it is drawn from a generator of its own, so the same seed moves the servos alike with and
without faults.
"""

from __future__ import annotations

import difflib
import re
from dataclasses import dataclass
from types import MappingProxyType
from typing import TYPE_CHECKING, Final

from sniffer.ground.model import NS, SnifferError

if TYPE_CHECKING:
    import random
    from collections.abc import Mapping, Sequence

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

SPELLED: Final[Mapping[str, str]] = MappingProxyType(
    {"drop-reply": DROP, "duplicate-id": DUPLICATE, **{kind: kind for kind in FAULTS}}
)
"""Names that people write, and the kinds they mean."""

USUAL: Final[Mapping[str, float]] = MappingProxyType(
    {DROP: 0.02, FLIP: 0.005, CUT: 0.01, LATE: 0.02, NOISE: 0.01, BROWNOUT: 0.003, DUPLICATE: 1.0}
)
"""How probable a fault is at each chance where nobody says it: enough to be seen within a minute.
Of two servos with one id, both answer every time."""

_FAULT: Final = re.compile(
    r"(?P<kind>[a-z-]+)(?::(?P<servo>\d{1,3}))?(?::(?P<rate>\d+(?:\.\d+)?)%)?"
)


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


def spelled(kind: str) -> str:
    """Return the name that people write for a kind."""
    return next(name for name, meant in SPELLED.items() if meant == kind)


def read_fault(text: str) -> Fault:
    """Read ``KIND[:SERVO][:RATE%]``: ``drop-reply:3:5%``, ``flip:0.1%``, ``late:2``, ``brownout``.

    Raises:
        SnifferError: it is none of these.
    """
    match = _FAULT.fullmatch(text.strip().lower())
    if match is None or match["kind"] not in SPELLED:
        raise SnifferError(f"{text!r}: {_mistaken(text.strip().lower())}")
    kind = SPELLED[match["kind"]]
    rate = USUAL[kind] if match["rate"] is None else float(match["rate"]) / 100
    if not 0 < rate <= 1:
        raise SnifferError(f"{text!r}: the rate is above 0 and at most 100%")
    return Fault(kind, rate, None if match["servo"] is None else int(match["servo"]))


def _mistaken(text: str) -> str:
    """Say what to write instead of a fault that cannot be read."""
    kind, *rest = (part.strip() for part in text.split(":"))
    if kind not in SPELLED:
        near = difflib.get_close_matches(kind, SPELLED, 1)
        known = ", ".join(spelled(kind) for kind in FAULTS)
        meant = f"did you mean {near[0]}? " if near else ""
        return f"{meant}write KIND[:SERVO][:RATE%], KIND one of {known}"
    said = [part for part in rest if part]
    numbers = [re.fullmatch(r"\d+(?:\.\d+)?%?", part) for part in said]
    if said and len(said) <= 2 and all(numbers):
        # a rate is told from a servo by its sign alone
        *servo, last = (part.rstrip("%") for part in sorted(said, key=lambda part: "%" in part))
        asked = ":".join([kind, *servo, f"{last}%"])
        if len(said) == 2 and said[0].endswith("%"):
            return f"the servo comes first: write {asked}"
        if len(said) < len(rest):
            return f"leave a servo that is not named out with its colon: write {asked}"
        return f"a rate ends in %: write {asked}"
    return f"write {kind}, {kind}:2 (of servo 2), {kind}:1% (how often) or {kind}:2:1%"


class Mischief:
    """Draws which faults strike, and what they do to bytes."""

    def __init__(self, faults: Sequence[Fault], rng: random.Random) -> None:
        self._faults = {kind: [f for f in faults if f.kind == kind] for kind in FAULTS}
        self.rng = rng

    def strikes(self, kind: str, servo_id: int) -> bool:
        """Draw whether a fault happens at this chance."""
        faults = self._faults[kind]
        if not faults:
            return False
        mine = [f for f in faults if f.servo_id in (None, servo_id)]
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
