"""Positions that are here with one answer and there with the next, all the time: who says so?

A bare answer holds whatever its bytes are. Where the clock of its servo is off, the one place is
the other one's bits, a bit early or late; where two servos answer at once, it is no such thing.
"""

from __future__ import annotations

from typing import TYPE_CHECKING, Final

import numpy as np

from sniffer.diagnosis.catalogue import FindingCode
from sniffer.diagnosis.evidence.tracks import in_force
from sniffer.diagnosis.ledger.damage import IN_REQUEST, STRAYS
from sniffer.diagnosis.ledger.returns import Returned
from sniffer.diagnosis.model import Finding, Place
from sniffer.ground.distinct import within
from sniffer.ground.milli import MILLI
from sniffer.ground.model import NS

if TYPE_CHECKING:
    from collections.abc import Callable, Iterator, Sequence

    from sniffer.diagnosis.case import Case, Table
    from sniffer.diagnosis.ledger.returns import Return
    from sniffer.diagnosis.rules import Rule

FINDINGS: Final = (
    FindingCode(
        "places-scatter",
        "The bare answers of a servo state a place here and a place far from it by turns, as no joint "
        "moves, and as no misread bit makes it.",
        "One in ten of its positions at least, and six, is so far from the one before it and from the one "
        "behind it, on the same side, that the fastest servo could not get there and back (500 degrees "
        "a second, 20 ms of doubt), and one in four of these where no goal lies; three times as often as "
        "with others, twice as often as requests are torn or second answers come, and as stray bytes with "
        "exchanges of others. Of those that are kept fewer than three in four differ in one bit, and fewer "
        "are the other's last bits read early, or late; the more do, the less it counts.",
    ),
)

LEAST: Final = 6
"""Positions that must be so."""

LEAST_UNTIMED: Final = 24
"""The same where nobody knows how fast that would be: times are counted from the bytes."""

SHARE: Final = 0.1
"""Part of its positions that must be so: a pulse spoils a few, and a contact."""

AHEAD: Final = 3.0
"""How many times the others' share that must be."""

PLAIN: Final = 0.75
"""Part of them that one misread bit, or a clock that is off, explains: of two answers at once some
look so, too."""

BY_TWO: Final = 0.5
"""Part that two answers at once mostly leave at most (of eight captures with two that speak at once six
are below it): it counts in full, and the less the more is explained."""

WITHIN_NS: Final = NS
"""A joint may be on its way to a goal that was stated so long before."""

SOME: Final = 0.05
"""Part of the first bytes that end with a high bit if that is the stop bit."""

DISPLACED: Final = 0.5
"""How many answers out of place there may be for each position that is far away."""

NEARLY: Final = 0.8
"""How far on the way to a place a goal must lie to send a joint there."""

TOLD: Final = 0.75
"""Part of them that may be where a goal of the last moments was: it may be faster than is thought."""

NEAR: Final = 2
"""How far a joint may be from where it was said to be a moment before."""

APART: Final = 24
"""Places that are further from each other say nothing of what is between them."""

MISSED: Final = range(1, 8)
"""How many bits may be over when a fast clock takes one for the start."""

LAST: Final = range(4, 8)
"""Which bit may be the first one that is read early or late, by how far a clock is off."""


def scatter(case: Case) -> Iterator[Finding]:
    """Find servos whose places are here and there."""
    if case.has_checksum:
        return
    least = LEAST if case.has_clock else LEAST_UNTIMED
    found = {servo: _most(case, servo) for servo in case.servos}
    values = {servo: _values(case, servo) for servo in case.servos}
    far, all_of = sum(r.n for r in found.values()), sum(values.values())
    displaced = _displaced(case)
    for servo, returned in found.items():
        rest = (far - returned.n) / max(all_of - values[servo], 1)
        if returned.n < max(least, SHARE * returned.of, AHEAD * rest * returned.of):
            continue
        if displaced > DISPLACED * returned.n:
            continue
        if _strays_of_others(case, servo, returned) * returned.of > DISPLACED * returned.n:
            continue
        told = sum(_was_told(case, servo, r) for r in returned.kept)
        if told > TOLD * len(returned.kept):
            continue
        plain = max(_share(returned.kept, is_so) for is_so in _readings(returned.kept))
        if plain < PLAIN:
            yield _told(servo, returned, min((PLAIN - plain) / (PLAIN - BY_TWO), 1.0))


def _most(case: Case, servo: int) -> Returned:
    """Return what is known of the position that is there and back most often."""
    all_of = [case.ledger.returns.of(servo, p.index) for p in case.every(servo, "position")]
    return max(all_of, key=lambda r: r.n, default=Returned())


def _values(case: Case, servo: int) -> int:
    return sum(int(p.n.sum()) for p in case.every(servo, "position"))


def _displaced(case: Case) -> int:
    """Return how often an answer stands where it should not: over a request, or behind an answer.

    Who is asked meanwhile seems to say then what another one says.
    """
    torn = int(case.damage["n"][case.damage["turn"] == IN_REQUEST].sum())
    return torn + case.count("duplicate-response")


def _strays_of_others(case: Case, servo: int, returned: Returned) -> float:
    """Return how many stray bytes came with an exchange of the other servos meanwhile.

    A bare answer takes the stray before it for its first byte, and its own first one, or what a
    pulse left of it, for its place. Who answers second does so to its own requests alone.
    """
    kept = [x for x in case.damages if x.turn in STRAYS]
    of_others = sum(x.asked_id not in (servo, -1) for x in kept) / max(len(kept), 1)
    d, a = _meanwhile(case.damage, returned), _meanwhile(case.answers, returned)
    strays = int(d["n"][within(d["turn"], STRAYS)].sum())
    return of_others * strays / max(int(a["ok"][a["servo_id"] != servo].sum()), 1)


def _meanwhile(table: Table, returned: Returned) -> Table:
    """Return the rows that overlap the time in which places were far away."""
    mine = (table["t_first"] <= returned.last_ns) & (table["t_last"] >= returned.first_ns)
    return {name: column[mine] for name, column in table.items()}


def _was_told(case: Case, servo: int, r: Return) -> bool:
    """Tell whether a goal of the last moments lies where it was, or nearly, or behind it."""
    since, until = np.array([r.t_ns - WITHIN_NS]), np.array([r.t_ns])
    told = [in_force(goal, since, until) for goal in case.every(servo, "goal_position")]
    lows, highs = ([float(bounds[k][0]) for bounds in told] for k in (0, 1))
    low, high = MILLI * np.fmin.reduce([np.nan, *lows]), MILLI * np.fmax.reduce([np.nan, *highs])
    nearly = r.was + NEARLY * (r.value - r.was)
    return bool(high >= nearly if r.value > r.was else low <= nearly)


def _told(servo: int, r: Returned, unexplained: float) -> Finding:
    return Finding(
        "places-scatter",
        servo,
        r.first_ns,
        r.last_ns,
        r.n,
        f"{r.n} of {r.of} positions of servo {servo} are far from the one before and from the one behind: "
        "no joint moves so",
        tuple(Place(one.at, len(one.there), one.t_ns, _in_words(one)) for one in r.kept[:3]),
        strength=min(0.5 + r.n / 40, 1.0) * unexplained,
        brief=f"the position of servo {servo} is here and there by turns",
    )


def _in_words(r: Return) -> str:
    return f"{r.there.hex()} between {r.before.hex()} and {r.behind.hex()}"


def _share(kept: Sequence[Return], is_so: Callable[[int, int], bool]) -> float:
    """Return the part of what was kept that a misreading explains, the one way or the other."""
    return sum(_explains(r, is_so) for r in kept) / max(len(kept), 1)


def _explains(r: Return, is_so: Callable[[int, int], bool]) -> bool:
    """Tell whether the last byte is a misreading of what it would have been, or its neighbours are.

    The last one: of answers of two bytes the first one may be a load, which changes as it likes.
    """
    before, there, behind = (frame[-1] for frame in (r.before, r.there, r.behind))
    low, high = sorted((before, behind))
    between = range(low - NEAR, high + NEAR + 1) if high - low <= APART else ()
    if any(is_so(x, there) for x in between):
        return True
    about = range(there - 2 * NEAR, there + 2 * NEAR + 1)
    return any(is_so(x, before) or is_so(x, behind) for x in about)


def _readings(kept: Sequence[Return]) -> Sequence[Callable[[int, int], bool]]:
    """Return the ways in which one place may be the other one misread."""
    ends = [frame[0] & 0x80 for r in kept for frame in (r.before, r.there, r.behind)]
    early: tuple[Callable[[int, int], bool], ...] = (_is_early,)
    if sum(map(bool, ends)) > SOME * len(ends):
        early = (*early, _is_begun_late)
    return (_is_one_bit, _is_late, lambda sent, got: any(is_so(sent, got) for is_so in early))


def _is_one_bit(sent: int, got: int) -> bool:
    return (sent ^ got).bit_count() == 1


def _is_late(sent: int, got: int) -> bool:
    """Tell whether the last bits are each the one before it: a clock that is slower."""
    return any(got == _mixed(sent, sent << 1, first) for first in LAST)


def _is_early(sent: int, got: int) -> bool:
    """Tell whether the last bits are each the one behind it, then the stop bit: a faster clock."""
    return any(got == _mixed(sent, sent >> 1 | 0x80, first) for first in LAST)


def _is_begun_late(sent: int, got: int) -> bool:
    """Tell whether all bits are those behind them, and then those of an idle line.

    So it is where a clock is that fast that the start bit is taken for the stop bit before it: a
    later low bit stands for it. The stop bit is taken for the last bit then, too, sooner or later.
    """
    return any(got == (sent >> missed | 0xFF << 8 - missed & 0xFF) for missed in MISSED)


def _mixed(sent: int, moved: int, first: int) -> int:
    kept = (1 << first) - 1
    return (sent & kept) | (moved & 0xFF & ~kept)


RULES: Final[tuple[Rule, ...]] = (scatter,)
"""The rules of this file."""
