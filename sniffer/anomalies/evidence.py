"""Which model each servo is: what the user said, else what the wire has shown, else the default.

Carried from pass to pass and applied between rows, as mode registers are. Clues are counted once a
servo; a model is taken where it is ``SURE`` points ahead of every other.
"""

from __future__ import annotations

from typing import TYPE_CHECKING, Final, NamedTuple

import numpy as np

from sniffer.ground.clues import SURE
from sniffer.ground.codes import ASSUMED, OBSERVED, PROFILE
from sniffer.ground.memory import Remembering
from sniffer.protocols.base import Turn

if TYPE_CHECKING:
    from collections.abc import Iterable, Mapping

    from sniffer.ground.clues import Clue
    from sniffer.ground.model import I64, Mask
    from sniffer.protocols.base import BusProtocol, State

WORTH_TELLING: Final = 2
"""Points ahead from which a model is named to the user: a single default is no reason to."""

LIKELY, TAKEN, GIVEN_UP, AGAINST = range(1, 5)
"""What is told: a model is likely, is taken, is no longer sure, or contradicts the user's."""


class Verdict(NamedTuple):
    """Something to tell about a servo's model: the models' row numbers, and the points of all."""

    what: int
    servo: int
    model: int
    instead_of: int
    points: tuple[int, ...]


class Evidence(Remembering):
    """Counts what speaks for each model, and decides; the decision stands in ``state``."""

    LASTING = ("_counted", "_points", "_told", "_top", "_lead")
    PASSING = ("_stale",)

    def __init__(self, protocol: BusProtocol, state: State) -> None:
        self.state = state
        self._everyone = np.array(protocol.everyone, np.int64)
        count = len(protocol.models)
        self._points = np.zeros((256, count), np.int64)
        self._keys: dict[tuple[int, int, tuple[int, ...]], int] = {}
        self._known = np.zeros((256, 64), bool)
        self._told = np.zeros(256, np.int64)
        self._top = np.zeros(256, np.int64)
        self._lead = np.zeros(256, np.int64)
        self._stale: set[int] = set()
        if state.chosen.any():  # else every servo is the default, as the state has it
            self._decide(np.arange(256))

    @property
    def _counted(self) -> Mapping[tuple[int, int, tuple[int, ...]], Mask]:
        """Which servos each clue was counted for, in whatever order they came."""
        return {key: self._known[:, column] for key, column in self._keys.items()}

    @_counted.setter
    def _counted(self, told: Mapping[tuple[int, int, tuple[int, ...]], Mask]) -> None:
        self._keys = {key: column for column, key in enumerate(told)}
        self._known = np.zeros((256, max(64, len(told))), bool)
        for column, servos in enumerate(told.values()):
            self._known[:, column] = servos

    def is_news(self, servo: int, clue: Clue, *, to_all: bool) -> bool:
        """Whether a clue has not been counted yet for a servo, or for one of them all."""
        column = self._keys.get(clue.key)
        if column is None:
            return True
        who = slice(None) if to_all else slice(servo & 255, (servo & 255) + 1)
        return not self._known[who, column].all()

    def weigh(self, servo: int, clue: Clue, *, to_all: bool) -> bool:
        """Count a clue; what is told to all counts for each. Return whether it was a new one."""
        column = self._keys.setdefault(clue.key, len(self._keys))
        if column == self._known.shape[1]:
            self._known = np.pad(self._known, ((0, 0), (0, column)))
        who = np.arange(256) if to_all else np.array([servo & 255])
        who = who[~self._known[who, column]]
        self._known[who, column] = True
        self._points[who] += np.array(clue.points)
        self._stale.update(who.tolist())
        return bool(len(who))

    @property
    def knows(self) -> bool:
        """Whether anything is known of any servo."""
        return bool(self._keys) or bool(self.state.chosen.any())

    def move(self, old: int, new: int) -> None:
        """A servo took a new id: what is known about it goes along, unless the user named that."""
        old &= 255
        state = self.state
        if not state.named[new]:
            state.chosen[new], state.choice[new] = state.chosen[old], state.choice[old]
        for known in (self._points, self._known, self._told):
            known[new] = known[old]
        self._stale.add(new)

    def settle(self, row: int, servos: Iterable[int]) -> tuple[list[Turn], list[Verdict]]:
        """Decide anew: return what changes from ``row`` on, and what there is to tell of whom."""
        state = self.state
        who = np.array(sorted({*self._stale, *self._everyone}), np.int64)
        self._stale.clear()
        model, origin = state.model.copy(), state.origin[who]
        self._decide(who)
        turned = who[(model[who] != state.model[who]) | (origin != state.origin[who])]
        turns = [Turn(row, s, int(state.model[s]), int(state.origin[s])) for s in turned.tolist()]
        verdicts = []
        for servo in dict.fromkeys(s & 255 for s in servos):
            best, ahead, was = int(self._top[servo]), int(self._lead[servo]), int(model[servo])
            what = self._verdict(servo, best, ahead, was)
            if what:
                self._told[servo] = what
                points = tuple(self._points[servo].tolist())
                verdicts.append(Verdict(what, servo, best, was, points))
        return turns, verdicts

    def _verdict(self, servo: int, best: int, ahead: int, was: int) -> int:
        told = self._told[servo]
        if self.state.chosen[servo]:
            differs = ahead >= WORTH_TELLING and best != was
            return AGAINST if differs and told != AGAINST else 0
        if ahead >= SURE:
            return TAKEN if best != was or told in (LIKELY, GIVEN_UP) else 0
        if told == TAKEN:
            return GIVEN_UP
        likely = ahead >= WORTH_TELLING and best != was
        return LIKELY if likely and not told else 0

    def _decide(self, who: I64) -> None:
        """Decide anew which models the servos ``who`` are."""
        state, points = self.state, self._points[who]
        top = self._top[who] = points.argmax(axis=1)
        if points.shape[1] > 1:
            ranked = np.sort(points, axis=1)
            self._lead[who] = ranked[:, -1] - ranked[:, -2]
        chosen, sure = state.chosen[who], self._lead[who] >= SURE
        state.model[who] = np.where(chosen, state.choice[who], np.where(sure, top, 0))
        state.origin[who] = np.where(chosen, PROFILE, np.where(sure, OBSERVED, ASSUMED))
        # What is told to all is read by the table of all, if they have one.
        of_all = self._everyone[state.origin[self._everyone] == ASSUMED]
        if len(of_all):
            settled = state.origin != ASSUMED
            settled[self._everyone] = False
            models = state.model[settled]
            one = len(models) and models.min() == models.max()
            state.model[of_all] = models[0] if one else 0


def loose_counts(origin: int) -> bool:
    """Whether a register that selects a scale is believed from bytes that no one table names.

    A write across them is for another model, and never counts. A read may be a dump of the whole
    map: it counts if the model is known.
    """
    return origin != ASSUMED
