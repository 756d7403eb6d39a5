"""What frames change about servos: a mode, a return mode, an id, everything back to the defaults.

Changes are rare. They are found for all rows at once and applied between rows, in order.
"""

from __future__ import annotations

from typing import TYPE_CHECKING, Any, Final

import numpy as np

from sniffer.anomalies.learned import Change
from sniffer.ground.codes import OK, REQUEST, WHOLE
from sniffer.ground.columns import columns_of
from sniffer.ground.memory import Remembering
from sniffer.ground.model import I64, RELEASES, RESETS, STAGED, Frames, Mask, Transactions

if TYPE_CHECKING:
    from collections.abc import Mapping

    from sniffer.protocols.base import BusProtocol, Values

SET, FEEDBACK, RENUMBER, RESET, RELEASE = range(5)
"""A mode register was set, a return mode became known, a servo has a new id, or its defaults (and,
where the protocol says so, the id ``value``); or what is staged takes effect."""

EVERY: Final = -1
"""In place of a servo id: all of them."""

FEW: Final = 16
"""Fewer changes than these are taken as they come; more, and repetitions are left out."""


def new_id(change: Change) -> int:
    """Return the id a servo has from a change on, -1 for none: of all at once, nobody can say."""
    moves = change.what == RENUMBER or (change.what == RESET and change.servo != EVERY)
    return change.value if moves and 0 <= change.value <= 255 else -1


class Changes(Remembering):
    """Finds the changes of a pass; remembers what is staged and waits for its execution."""

    LASTING = ("_staged",)

    def __init__(self, protocol: BusProtocol) -> None:
        self._protocol = protocol
        known = columns_of(protocol.registers)
        effects = [known.selects_mode, known.effect == "feedback", known.effect == "servo_id"]
        self._what = np.select(effects, [SET, FEEDBACK, RENUMBER], -1)
        self.traits = self._what >= 0
        self._staged: list[Change] = []

    def matters(self, at: int) -> Mapping[str, Any]:
        """Return what is staged, in order; the row of a pass that is over says nothing."""
        del at
        return {"staged": [staged._replace(at=0, row=0) for staged in self._staged]}

    def find(
        self,
        frames: Frames,
        transactions: Transactions,
        v: Values,
        hits: I64,
        accepted: Mask,
        trusted: Mask | None = None,
        each: bool = False,
    ) -> tuple[list[Change], list[Change]]:
        """Return the changes in order, and what is staged behind them; nothing is remembered.

        ``hits`` are the values (row numbers of ``v``) that may change something, ``accepted`` tells
        by frame whether what it states became true, ``trusted`` by value whether a loose one counts
        (None: none does). ``each``: repetitions matter, too.
        """
        # A mode is staged (row 2) and executed (row 6) between polls; rows 3 and 7 acknowledge:
        #
        #     row of the frame     0     1     2        4     5     6        8     9
        #     says                 read  1000  mode=2   read  1000  execute  read  1000
        #     flags                0     0     STAGED   0     0     RELEASES 0     0
        #     number in ``v``            0     1              2                    3
        #     hits                             1
        #     special                                               6
        #     found                            SET at 2             RELEASE at 3
        #     in effect                                             SET at 3
        #
        # ``at`` is a place between values: a change holds from ``v[at]`` on. For a value that is
        # the one behind it (a mode does not scale what its own frame said before), for a frame
        # without values the first of a later frame. ``row`` orders what has the same ``at``.
        flags = np.where(accepted, frames.flags & (RESETS | RELEASES | STAGED), 0)
        asked = frames.kind[v.row[hits]] == REQUEST
        counts = accepted[v.row[hits]] & (v.part[hits] == WHOLE)
        is_id = asked & (v.raw[hits] >= 0) & (v.raw[hits] <= 255)
        counts &= is_id | (self._what[v.register[hits]] != RENUMBER)
        if v.loose is not None:
            counts &= ~v.loose[hits] if trusted is None else ~v.loose[hits] | trusted[hits]
        hits = hits[counts]
        special = np.flatnonzero(flags & (RESETS | RELEASES))
        staging = bool(self._staged) or bool((flags & STAGED).any())
        # Each change costs a Python object, and a poll of the mode register would make one a poll.
        # To drop repetitions is right only where nothing else moves a mode in between: a reset, a
        # release or a misfit may, and then the value that looks like a repetition sets it again.
        if len(hits) > FEW and not (each or staging or len(special)):
            hits = self._news(frames, v, hits)
        if not len(hits) and not len(special):
            return [], self._staged
        found = [self._of_value(frames, transactions, v, i) for i in hits.tolist()]
        for row in special.tolist():
            at = int(np.searchsorted(v.row, row, "right"))
            servo = int(frames.servo_id[row])
            who = EVERY if servo in self._protocol.everyone else servo
            what = RESET if flags[row] & RESETS else RELEASE
            found.append(Change(at, row, what, who, int(frames.alt_id[row]), servo))
        found.sort(key=lambda c: c[:2])
        return self._in_effect(found, flags)

    def keep(self, staged: list[Change]) -> None:
        """Remember what is staged."""
        self._staged = staged

    def _in_effect(self, found: list[Change], flags: I64) -> tuple[list[Change], list[Change]]:
        """Put what is staged behind the frame that releases it."""
        staged, out = list(self._staged), []
        for change in found:
            if change.what == RELEASE:
                due = [s for s in staged if change.servo == EVERY or change.named == s.named]
                out += [s._replace(at=change.at, row=change.row) for s in due]
                staged = [s for s in staged if s not in due]
            elif change.what != RESET and flags[change.row] & STAGED:
                # a later one to the same register stands in its place
                key = change.what, change.named, change.name
                staged = [s for s in staged if (s.what, s.named, s.name) != key]
                staged.append(change)
            else:
                out.append(change)
        return out, staged

    def _of_value(self, frames: Frames, transactions: Transactions, v: Values, i: int) -> Change:
        row, register, servo = int(v.row[i]), int(v.register[i]), int(v.servo_id[i])
        what, raw = int(self._what[register]), int(v.raw[i])
        to_all = int(frames.kind[row]) == REQUEST and servo in self._protocol.everyone
        if what == RENUMBER:
            named = servo
            if to_all:
                servo = self._answerer(frames, transactions, row, raw, servo)
            return Change(i + 1, row, what, servo, raw, named)
        name = self._protocol.registers[register].name if what == SET else ""
        return Change(i + 1, row, what, EVERY if to_all else servo, raw, servo, name)

    def _answerer(
        self, frames: Frames, transactions: Transactions, row: int, new: int, servo: int
    ) -> int:
        """Return who took an id that was given to all: it answers under the old one, if at all."""
        t = transactions
        answers = t.response[(t.request == row) & (t.outcome == OK)]
        answers = answers[(answers >= 0) & (answers < len(frames))]
        for who in frames.servo_id[answers].tolist():
            if who >= 0 and who != new and who not in self._protocol.everyone:
                return int(who)
        return servo

    def _news(self, frames: Frames, v: Values, hits: I64) -> I64:
        """Drop what repeats what is known already (a controller polling the register)."""
        # Sorted by servo and register, what repeats stands beside what it repeats. Seven polls of
        # one register, three times over; the first seven of servo 1 and the first three of servo 2:
        #
        #     order   0  2  3  5  6  7  9  ...  1  4  8     numbers of the hits
        #     s       1  1  1  1  1  1  1       2  2  2
        #     x       1  1  2  2  1  1  1       1  1  1
        #     same    0  1  0  1  0  1  1       0  1  1
        #     kept    0     3     6             1           of 21 hits: 0 1 3 6 10 13 17 20
        #
        # lexsort has the hit's number as its last key, so each servo's are still in wire order and
        # the first of each run is kept. A set of (servo, register, raw) would be wrong: 1, 2, 1 are
        # three changes. A new id, or a value told to all, concerns other servos' runs: then nothing
        # is dropped.
        servo, register, raw = v.servo_id[hits], v.register[hits], v.raw[hits]
        told_all = np.isin(servo, self._protocol.everyone)
        told_all &= frames.kind[v.row[hits]] == REQUEST
        if (told_all | (self._what[register] == RENUMBER)).any():
            return hits
        order = np.lexsort((hits, register, servo))
        s, r, x = servo[order], register[order], raw[order]
        same = np.zeros(len(order), bool)
        same[1:] = (s[1:] == s[:-1]) & (r[1:] == r[:-1]) & (x[1:] == x[:-1])
        return np.sort(hits[order[~same]])
