"""The figures of a servo and of a wire that a report shows and a check asks for."""

from __future__ import annotations

from collections import Counter
from dataclasses import dataclass, field
from typing import TYPE_CHECKING, Final, NamedTuple

import numpy as np

from sniffer.ground.heard import was_set
from sniffer.ground.model import Clock

if TYPE_CHECKING:
    from sniffer.decoding.pacing import Pace
    from sniffer.ground.model import I64, Mask

GOAL: Final = "goal_position"
POSITION: Final = "position"
ERROR: Final = "error"
"""Goal less position, where both are stated in one unit."""

LONGEST: Final = "reply_most"
SHORTEST: Final = "reply_least"
"""Response times in ms, as they are at most and at least."""

DRAWN: Final = (POSITION, GOAL, "load", "current", "voltage", "temperature")
"""Quantities that have a curve."""

BYTES, UNCLAIMED, MISSING, TROUBLE = "bytes", "unclaimed", "missing", "trouble"
"""Curves of a wire: all its bytes, those that no frame claims, answers that did not come, warnings
and errors."""


FATES: Final = ("acknowledged", "refused", "failed", "unanswered")
"""What may become of a goal. Refused: answered, and not accepted. Failed: an answer had to come,
and none that fits did. Unanswered: nobody has to answer it; it was sent to all, or the servo
acknowledges no writes."""


class Extreme(NamedTuple):
    """A value at the end of a range, and the frame that states it."""

    value: float
    t_ns: int
    offset: int


class AnswerHeard(NamedTuple):
    """When an answer ended, how uncertain that is (-1: there is no clock), and where it begins."""

    t_ns: int
    spread_ns: int
    offset: int


class PauseHeard(NamedTuple):
    """The time between two answers, how uncertain it is, and the first of them."""

    ns: int
    spread_ns: int
    behind: AnswerHeard

    @property
    def bounds(self) -> tuple[int, int]:
        """At least and at most."""
        return max(self.ns - self.spread_ns, 0), self.ns + self.spread_ns


@dataclass(slots=True)
class Presence:
    """When a servo was heard: its first and its last answer, and the longest pause between two."""

    first: AnswerHeard
    last: AnswerHeard
    pause: PauseHeard | None = None

    def hear(self, answers: AnswerColumns) -> None:
        """Take more answers, in the order of the wire."""
        before = AnswerColumns(*(np.append(a, b) for a, b in zip(self.last, answers, strict=True)))
        self.pause = longest_pause(before.t_ns, before, self.pause)
        self.last = answers.at(-1)


class AnswerColumns(NamedTuple):
    """Answers of one servo, as columns of what an ``AnswerHeard`` has."""

    t_ns: I64
    spread_ns: I64
    offset: I64

    def at(self, i: int) -> AnswerHeard:
        """Return one of them."""
        return AnswerHeard(*(int(column[i]) for column in self))


@dataclass(slots=True)
class BusSilence:
    """The longest time for which nothing was heard on a bus, frame or noise, between two of them.

    ``longest`` is from the end of the one to the begin of the other.
    """

    longest: PauseHeard | None = None
    _last: AnswerHeard | None = None

    def hear(self, begun: I64, said: AnswerColumns, is_frame: Mask) -> None:
        """Take what was said next, in the order of the wire; ``said`` are its ends.

        Stamps of noise are as uncertain as those of the frame before it, of none before: unknown.
        """
        if not len(begun):
            return
        before = -1 if self._last is None else self._last.spread_ns
        of = np.maximum.accumulate(np.where(is_frame, np.arange(len(begun)), -1))
        said = said._replace(spread_ns=np.where(of < 0, before, said.spread_ns[of]))
        if self._last is not None:
            said = AnswerColumns(*(np.append(a, b) for a, b in zip(self._last, said, strict=True)))
            begun = np.append(self._last.t_ns, begun)
        self.longest = longest_pause(begun, said, self.longest)
        self._last = said.at(-1)


def longest_pause(begun: I64, ended: AnswerColumns, known: PauseHeard | None) -> PauseHeard | None:
    """Return the longest time from an end to what began next, or a longer one that is known.

    Where there is no clock, or it was set meanwhile, nobody knows how long it was.
    """
    apart = begun[1:] - ended.t_ns[:-1]
    apart[(ended.spread_ns[1:] < 0) | (ended.spread_ns[:-1] < 0)] = -1
    apart[was_set(ended.t_ns[1:], int(ended.t_ns[0]))] = -1
    i = int(apart.argmax()) if len(apart) else -1
    if i < 0 or apart[i] < 0 or (known is not None and apart[i] <= known.ns):
        return known
    spread = int(ended.spread_ns[i] + ended.spread_ns[i + 1])
    return PauseHeard(int(apart[i]), spread, ended.at(i))


@dataclass(slots=True)
class Range:
    """All that is kept of one quantity of a servo in one unit; ``curve`` -1 has none."""

    count: int
    least: Extreme
    most: Extreme
    curve: int = -1

    def widen(self, other: Range) -> None:
        """Take more values in; of equal ones the first stays."""
        self.count += other.count
        if other.least.value < self.least.value:
            self.least = other.least
        if other.most.value > self.most.value:
            self.most = other.most


@dataclass(slots=True)
class ServoFigures:
    """One servo.

    ``responses`` are what it said itself, ``outcomes`` those of the requests to it, ``goals`` the
    fates (``FATES``) of those that carry a goal.
    """

    responses: int = 0
    presence: Presence | None = None
    outcomes: Counter[str] = field(default_factory=Counter)
    values: dict[tuple[str, str], Range] = field(default_factory=dict)
    """By quantity and unit."""
    goals: Counter[str] = field(default_factory=Counter)
    curves: dict[tuple[str, str], int] = field(default_factory=dict)
    """Curves that are no value on the wire, by name and unit."""

    def hear(self, answers: AnswerColumns) -> None:
        """Count answers in, the next ones."""
        self.responses += len(answers.t_ns)
        if self.presence is None:
            self.presence = Presence(answers.at(0), answers.at(0))
            answers = AnswerColumns(*(column[1:] for column in answers))
        if len(answers.t_ns):
            self.presence.hear(answers)

    @property
    def wanted(self) -> int:
        """Requests whose answer had to come."""
        return sum(n for o, n in self.outcomes.items() if o not in ("not_expected", "unsolicited"))

    @property
    def missing(self) -> int:
        """Those that nothing came for."""
        return self.outcomes["no_response"]

    @property
    def damaged(self) -> int:
        """Those whose answer came torn, or does not fit."""
        return self.outcomes["damaged"] + self.outcomes["mismatched"]

    def unit_of(self, quantity: str) -> str | None:
        """Return the unit in which a quantity was stated most often; None: it never was."""
        mine = [(r.count, unit) for (name, unit), r in self.values.items() if name == quantity]
        return max(mine)[1] if mine else None

    def range_of(self, quantity: str) -> Range | None:
        """Return the values of a quantity in that unit."""
        unit = self.unit_of(quantity)
        return None if unit is None else self.values[quantity, unit]


@dataclass(slots=True)
class WireFigures:
    """One bus: its curves by name, and what the tap remarked of it."""

    curves: dict[str, int]
    pace: Pace | None = None
    clock: Clock = Clock.NONE
    remarks: Counter[str] = field(default_factory=Counter)
    doubt_ns: int = -1
    """The greatest uncertainty of a frame's times; -1: nothing is known of them."""
