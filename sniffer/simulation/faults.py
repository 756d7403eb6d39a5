"""Faults on demand: what goes wrong on a bus, how often, and to whom.

All of it is drawn from a generator of its own, so the same seed moves the servos alike with and
without faults.
"""

from __future__ import annotations

import difflib
import math
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
LIMP, STALL, OVERHEAT, OVERLOAD = "limp", "stall", "overheat", "overload"
DEAD, ABSENT, SLOW, RESETS = "dead", "absent", "slow", "reset-loop"
REFUSE, CHATTY = "refuse", "chatty"
HANG, JITTER, IMPATIENT, WEAR = "hang", "jitter", "impatient", "nv-wear"

LINE_FAULTS: Final = {
    DROP: "a servo does not answer",
    FLIP: "one byte of a frame is altered on the line",
    CUT: "an answer breaks off",
    LATE: "an answer comes later than the manual promises",
    NOISE: "bytes of nobody on the line, before a request",
    DUPLICATE: "a second servo of the same id answers as well",
    BROWNOUT: "the supply of a servo sags, it complains, then it restarts",
}
"""What strikes one frame, or passes by itself within a second."""

LASTING_FAULTS: Final = {
    LIMP: "a servo lets go of its joint and follows no goal",
    STALL: "a joint is held fast: its motor pushes and it does not move",
    OVERHEAT: "a motor grows hot until the servo protects itself",
    OVERLOAD: "a joint bears more than its motor can hold for long",
    DEAD: "a servo falls silent for ever",
    ABSENT: "a servo that is asked was never there",
    SLOW: "a servo takes longer for its answers than the others",
    RESETS: "a servo restarts again and again",
}
"""What holds on for a while, or for ever, once it has begun."""

SPOKEN_FAULTS: Final = {
    REFUSE: "a servo refuses what it is told",
    CHATTY: "a servo says its last answer again, unasked",
}
"""What a servo says that it should not."""

CONTROLLER_FAULTS: Final = {
    HANG: "the controller stops for 50 to 500 ms",
    JITTER: "a cycle of the controller begins too early or too late",
    IMPATIENT: "the controller speaks while a servo answers: both are lost",
    WEAR: "the controller writes a setting that is kept without power, in every cycle",
}
"""What only the controller of the simulation does: where another one asks there are none."""

FAULTS: Final = LINE_FAULTS | LASTING_FAULTS | SPOKEN_FAULTS | CONTROLLER_FAULTS
"""The kinds of faults."""

SPELLED: Final[Mapping[str, str]] = MappingProxyType(
    {"drop-reply": DROP, "duplicate-id": DUPLICATE, **{kind: kind for kind in FAULTS}}
)
"""Names that people write, and the kinds they mean."""

USUAL: Final[Mapping[str, float]] = MappingProxyType(
    {DROP: 0.02, FLIP: 0.005, CUT: 0.01, LATE: 0.02, NOISE: 0.01, BROWNOUT: 0.003, DUPLICATE: 1.0}
    | dict.fromkeys((LIMP, STALL, OVERHEAT, OVERLOAD, DEAD), 0.005)
    | {ABSENT: 1.0, SLOW: 1.0, RESETS: 0.005, REFUSE: 1.0, CHATTY: 0.01}
    | {HANG: 0.01, JITTER: 1.0, IMPATIENT: 0.02, WEAR: 1.0}
)
"""How probable a fault is at each chance where nobody says it: enough to be seen within a minute.
Of two servos with one id, both answer every time."""

_TIME: Final = r"(\d+(?:\.\d+)?)(ms|s)?"

_FAULT: Final = re.compile(
    r"(?P<kind>[a-z-]+)(?::(?P<servo>\d{1,3}))?(?::(?P<rate>\d+(?:\.\d+)?)%)?"
    rf"(?:@(?P<first>{_TIME})(?:\+(?P<lasts>{_TIME}))?)?"
)


@dataclass(frozen=True, slots=True)
class Fault:
    """One thing that goes wrong: its kind, how probable it is at each chance, and to which servo.

    A chance is a frame (flip), an answer (drop, cut, late, duplicate, impatient), a write that is
    answered (refuse), a cycle of the controller (hang, jitter, nv-wear), a request (all others).
    ``servo_id`` None stands for anybody; frames to all servos are nobody's. There are chances from
    ``first_s`` on, before ``last_s``: seconds since the bus was switched on.
    """

    kind: str
    rate: float
    servo_id: int | None = None
    first_s: float = 0.0
    last_s: float = math.inf

    def __post_init__(self) -> None:
        if self.kind not in FAULTS:
            raise SnifferError(f"no fault {self.kind!r}: one of {', '.join(FAULTS)}")

    def may(self, servo_id: int, now_ns: int) -> bool:
        """Tell whether there is a chance for it, with this servo and at this time."""
        return self.servo_id in (None, servo_id) and self.first_s * NS <= now_ns < self.last_s * NS


def spelled(kind: str) -> str:
    """Return the name that people write for a kind."""
    return next(name for name, meant in SPELLED.items() if meant == kind)


def read_fault(text: str) -> Fault:
    """Read ``KIND[:SERVO][:RATE%][@FROM[+FOR]]``: ``drop-reply:3:5%``, ``stall:2@5s+3s``.

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
    servo_id = None if match["servo"] is None else int(match["servo"])
    if servo_id is not None and kind in (HANG, JITTER):
        raise SnifferError(f"{text!r}: that is the controller's, name no servo")
    if match["first"] is None:
        return Fault(kind, rate, servo_id)
    if match["rate"] is None and kind in LASTING_FAULTS:
        rate = 1.0  # who says when it begins leaves nothing to chance
    first_s = _seconds(match["first"])
    lasts_s = math.inf if match["lasts"] is None else _seconds(match["lasts"])
    if not lasts_s:
        raise SnifferError(f"{text!r}: it lasts no time: leave +FOR out, or make it longer")
    return Fault(kind, rate, servo_id, first_s, first_s + lasts_s)


def _seconds(text: str) -> float:
    """Return ``5s``, ``500ms`` or ``5`` in seconds."""
    return float(text[:-2]) / 1000 if text.endswith("ms") else float(text.removesuffix("s"))


def _mistaken(text: str) -> str:
    """Say what to write instead of a fault that cannot be read."""
    text, at, when = text.partition("@")
    if at and not re.fullmatch(rf"{_TIME}(\+{_TIME})?", when):
        return f"write when as {text}@5s (from then on) or {text}@5s+2s (for so long)"
    kind, *rest = (part.strip() for part in text.split(":"))
    if kind not in SPELLED:
        near = difflib.get_close_matches(kind, SPELLED, 1)
        known = ", ".join(spelled(kind) for kind in FAULTS)
        meant = f"did you mean {near[0]}? " if near else ""
        return f"{meant}write KIND[:SERVO][:RATE%][@FROM[+FOR]], KIND one of {known}"
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

    def struck(self, kind: str, servo_id: int, now_ns: int) -> Fault | None:
        """Draw whether a fault happens at this chance; return which."""
        for fault in self._faults[kind]:
            if fault.may(servo_id, now_ns) and self.rng.random() < fault.rate:
                return fault
        return None

    def strikes(self, kind: str, servo_id: int, now_ns: int) -> bool:
        """Draw whether a fault happens at this chance."""
        return self.struck(kind, servo_id, now_ns) is not None

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
