"""What one servo lost of its answers and had again, moment by moment."""

from __future__ import annotations

from typing import TYPE_CHECKING, Final

import numpy as np

from sniffer.diagnosis.evidence.jumping import altered
from sniffer.ground.model import NEVER_NS, NS
from sniffer.ground.wording import counted

if TYPE_CHECKING:
    from sniffer.diagnosis.case import Case
    from sniffer.ground.model import I64, Mask

IN_A_ROW: Final = 2.5
"""Losses of a servo that are no further apart than so many of its turns are of one moment."""

SOON: Final = 1 / 8
"""Part of a turn in vain within which the torn answer comes that ended a silence."""

NEAR_NS: Final = NS // 8
"""Losses that are closer than that are of one moment: servos are asked one after the other."""


class LostAnswers:
    """What one servo lost and had again."""

    def __init__(self, case: Case, servo: int) -> None:
        a = case.answers
        mine = np.flatnonzero(a["servo_id"] == servo)
        spells = case.ledger.silences.of(servo)
        until = spells[-1].first_ns if spells and spells[-1].back_ns is None else case.last_ns + 1
        events = case.anomalies("no-response", "damaged-response", servo_id=servo)
        # what it never came back from is another matter, and so is what was before it came
        late = case.ledger.silences.late(servo)
        begun = late.back_ns or 0 if late else 0
        events = events.take((events.t_ns < until) & (events.t_ns >= begun))
        self.servo = servo
        bits = altered(case).get(servo, ())
        self.ok = int(a["ok"][mine].sum()) - len(bits)
        self.torn = int(a["damaged"][mine].sum()) + len(bits)
        self.missing = int(a["missing"][mine].sum()) - (late.missed if late else 0)
        self.bad = min(self.missing + self.torn, len(events) + len(bits))
        times = np.concatenate([events.t_ns, np.array([s.t_ns for s in bits], np.int64)])
        order = np.argsort(times, kind="stable")
        self.times: I64 = times[order]
        self.at: I64 = np.concatenate([events.at, np.array([s.at for s in bits], np.int64)])[order]
        # Losses in a row are one moment: it was not asked between them.
        asked = max(self.ok + self.bad, 1)
        self.turn_ns = (case.last_ns - case.first_ns) / asked
        runs = case.ledger.silences.runs(servo)
        rows = [(s.first_ns, s.back_ns or NEVER_NS, s.missed) for s in runs]
        self._silences = np.array(rows, np.int64)
        self._times_away = sum(case.ledger.silences.lengths(servo))
        self.to_the_end = spells[-1].missed if until <= case.last_ns else 0
        """How many requests it left unanswered until the end."""

    @property
    def share(self) -> float:
        """The part of its answers that it lost."""
        return self.bad / max(self.bad + self.ok, 1)

    @property
    def moments(self) -> int:
        """How many times it was away."""
        return 1 + int(self.apart(self.times).sum()) if len(self.times) else 0

    @property
    def outages(self) -> int:
        """How often it lost something: of who misses all that it loses, stretches of requests."""
        return self._times_away if self._is_away else self.moments

    @property
    def told(self) -> str:
        """The same in words."""
        return counted(self.outages, "outage" if self._is_away else "moment")

    @property
    def _is_away(self) -> bool:
        """Whether all that it loses is missing, and not for the question that it does not know."""
        return self._times_away > 0 and not self.torn

    def apart(self, times: I64) -> Mask:
        """Tell of losses (sorted) which are not of the same moment as the one before.

        Who asks in vain waits longer than behind an answer: a silence is one moment, however long.
        What is lost behind it, and not right when it ended, is another one: it answered between.
        """
        far: Mask = np.diff(times) > IN_A_ROW * self.turn_ns
        if len(self._silences):
            which = np.searchsorted(self._silences[:, 0], times, "right") - 1
            first, back, missed = self._silences[np.maximum(which, 0)].T
            within = (which >= 0) & (times < back)
            is_same = (which[1:] == which[:-1]) & within[1:]
            turn = (back - first) / missed
            far = (far & ~is_same) | (within[:-1] & (times[1:] > (back + SOON * turn)[:-1]))
        return far

    def within(self, times: I64) -> float:
        """Return the part of its losses that are near some moments (sorted)."""
        if not len(self.times) or not len(times):
            return 0.0
        behind = times[np.minimum(np.searchsorted(times, self.times), len(times) - 1)]
        before = times[np.maximum(np.searchsorted(times, self.times) - 1, 0)]
        near = np.minimum(abs(behind - self.times), abs(self.times - before)) <= NEAR_NS
        return float(near.mean())
