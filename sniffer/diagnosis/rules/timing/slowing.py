"""A control loop that takes longer and longer, though it says what it always said."""

from __future__ import annotations

from typing import TYPE_CHECKING, Final

import numpy as np

from sniffer.diagnosis.case import BUCKET_NS
from sniffer.diagnosis.catalogue import FindingCode
from sniffer.diagnosis.evidence.cycles import CYCLES, is_by_hand
from sniffer.diagnosis.evidence.parts import grows, part_of
from sniffer.diagnosis.model import Finding, Place
from sniffer.ground.distinct import numbers, within
from sniffer.ground.medians import median
from sniffer.ground.model import NS

if TYPE_CHECKING:
    from collections.abc import Iterator

    from sniffer.diagnosis.case import Case, Table
    from sniffer.diagnosis.rules import Rule
    from sniffer.ground.model import F64, I64, Mask

FINDINGS: Final = (
    FindingCode(
        "loop-slows",
        "The controller's loop takes longer and longer, and says what it always said.",
        "Of ten parts of the time, in whole quarter seconds, the time from request to request grows in at "
        "least seven of nine steps by three hundredths and more and falls by as much in none, to one and a "
        "half times what it was; nearly all of that is rest of the line, in each part the servos have their "
        "share of the requests, and hardly anything fails. Programs that do one thing, then another, change "
        "in steps.",
    ),
)

PARTS: Final = 10
"""So many parts that a program which changes its pace three times has no more than six steps."""

RISE: Final = 0.03
"""By which part of itself a cycle grows from one part to the next: counted over so many requests it
is known as well as that, however late each of them was stamped."""

TIMES: Final = 1.5
"""How many times what it was a cycle becomes that is worth a word."""

RESTS: Final = 0.8
"""Part of what a cycle grows by that must be rest: what servos take to answer is not the program's."""

APART: Final = 0.1
"""Part of the requests that may go to other servos than usual: who asks more servos takes longer."""

FAILS: Final = 0.05
"""Failures for each request: a controller that waits in vain is not slow by itself."""


def loop_slows(case: Case) -> Iterator[Finding]:
    """Find a loop whose cycles grow longer from part to part of the time."""
    quarters = case.line["bucket"]
    if not case.has_clock or len(quarters) < 2 or is_by_hand(case):
        return
    first, last = int(quarters[0]) + 1, int(quarters[-1]) - 1  # it begins and ends within one
    if last - first < PARTS:
        return
    parts = _Parts(case, first, last)
    if parts.asked.min() < CYCLES or not parts.is_one_task() or parts.failed.max() > FAILS:
        return
    every, rest = parts.every_ns, parts.rest_ns
    grown = every[-1] - every[0]
    if not grows(every, RISE, 0.0) or every[-1] < TIMES * every[0]:
        return
    if rest[-1] - rest[0] < RESTS * grown:
        return
    first_s, last_s = NS / every[0], NS / every[-1]
    slow = int(np.argmax(every >= TIMES * every[0]))
    at, t_ns = parts.begin(slow)
    yield Finding(
        "loop-slows",
        None,
        t_ns,
        case.last_ns,
        1,
        f"the controller makes {first_s:.3g} requests a second in the first tenth of the time and "
        f"{last_s:.3g} in the last, fewer from tenth to tenth, to the same servos: the line rests for "
        f"{rest[0] / 1e6:.3g} ms behind each of them, then for {rest[-1] / 1e6:.3g} ms",
        (Place(at, 1, t_ns, f"from here on {NS / every[slow]:.3g} requests a second"),),
        strength=min(0.6 + every[-1] / every[0] / 10, 1.0),
        brief=f"from {first_s:.3g} to {last_s:.3g} requests a second",
        values=(("first_ns", every[0]), ("last_ns", every[-1])),
    )


class _Parts:
    """What a bus did in each of several parts of the time, by whole quarter seconds.

    Args:
        case: the bus.
        first: its first quarter second that counts.
        last: its last one.
    """

    def __init__(self, case: Case, first: int, last: int) -> None:
        self._case, self._first, self._last = case, first, last
        self.asked = self._sums(case.traffic, "requests")
        """Requests."""
        every = np.arange(first, last + 1)
        span_ns = BUCKET_NS * np.bincount(part_of(every, first, last, PARTS), minlength=PARTS)
        asked = np.maximum(self.asked, 1)
        self.every_ns: F64 = span_ns / asked
        """From request to request, on average."""
        said = case.ledger.byte_ns * self._sums(case.line, "bytes")
        waited = self._sums(case.answers, "took_sum")
        self.rest_ns: F64 = (span_ns - said - waited) / asked
        """What of that nobody speaks, and no answer is waited for that comes."""
        awaited = within(case.answers["servo_id"], case.answering)
        missed = self._sums(case.answers, "asked", awaited) - self._sums(
            case.answers, "ok", awaited
        )
        self.failed: F64 = (np.maximum(missed, 0) + self._sums(case.line, "gaps")) / asked
        """What failed, for each request."""

    def _sums(self, table: Table, column: str, rows: Mask | None = None) -> I64:
        within: Mask = (table["bucket"] >= self._first) & (table["bucket"] <= self._last)
        mine = np.flatnonzero(within if rows is None else within & rows)
        part = part_of(table["bucket"][mine], self._first, self._last, PARTS)
        return np.bincount(part, table[column][mine], PARTS).astype(np.int64)

    def is_one_task(self) -> bool:
        """Tell whether the servos have the same share of the requests in each part."""
        t = self._case.traffic
        to = [self._sums(t, "requests", t["servo_id"] == i) for i in numbers(t["servo_id"])]
        shares = np.array(to) / np.maximum(self.asked, 1)
        usual = median(shares, axis=1, keepdims=True)
        return bool((np.abs(shares - usual).sum(axis=0) <= 2 * APART).all())

    def begin(self, part: int) -> tuple[int, int]:
        """Return where and when a part begins."""
        t = self._case.traffic
        row = int(np.argmax(part_of(t["bucket"], self._first, self._last, PARTS) >= part))
        return int(t["at"][row]), int(t["t_first"][row])


RULES: Final[tuple[Rule, ...]] = (loop_slows,)
"""The rules of this file."""
