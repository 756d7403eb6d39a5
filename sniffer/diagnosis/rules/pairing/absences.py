"""What goes with the silences of a servo: torn answers, others that are away, torque that stays."""

from __future__ import annotations

import math
from typing import TYPE_CHECKING, Final

import numpy as np

from sniffer.diagnosis.catalogue import FindingCode
from sniffer.diagnosis.evidence.chances import at_least
from sniffer.diagnosis.evidence.gone import gone_at_once
from sniffer.diagnosis.evidence.placed import silent
from sniffer.diagnosis.evidence.tracks import track
from sniffer.ground.distinct import within
from sniffer.ground.model import NS
from sniffer.ground.wording import counted

if TYPE_CHECKING:
    from collections.abc import Iterator, Sequence

    from sniffer.diagnosis.case import Case
    from sniffer.diagnosis.ledger.silences import Silence
    from sniffer.diagnosis.model import Finding
    from sniffer.diagnosis.rules import Rule
    from sniffer.ground.model import I64, Mask

FINDINGS: Final = (
    FindingCode(
        "away-for-long",
        "A servo is silent for longer than any restart takes, while it is asked, and answers again.",
        "At least ten seconds and five requests in a row without an answer: the longest restart known of these servos takes three (RS30x, by how long its clients wait), and a supply that sags is back in moments. It hung until it was switched off, or was unplugged.",
    ),
    FindingCode(
        "away-without-a-tear",
        "A servo goes away time and again, and never within an answer.",
        "More than three silences or single losses, and no torn answer of it, or one for forty of those; it counts as likely as a contact that opens so often would have torn an answer.",
    ),
    FindingCode(
        "torn-when-away",
        "A servo goes away time and again, now and then within an answer.",
        "More than three silences or single losses, or three of several requests each, and torn answers of it, two at least and one for ten of those, and more than it would have if it were hit as the others are.",
    ),
    FindingCode(
        "others-away-too",
        "Another servo goes away, too: in the same moments, or about as often.",
        "At least two of its silences, and half of them, overlap with silences of one other servo; or that one has a third as many, two at least each; or it is away once, and two others twice or more each. Others miss nothing.",
    ),
    FindingCode(
        "all-away-at-once",
        "All servos go away in the same moments, and come back.",
        "Two servos or more answer, and each is away when all others are, in nine of ten of its silences of two requests and more.",
    ),
    FindingCode(
        "several-away-at-once",
        "Several servos fall silent at one moment, and each of them at no other.",
        "Three servos and more, each away once for two requests and more; between the last request that it answered and the first one that it did not lies one moment, the same for all.",
    ),
    FindingCode(
        "torque-survives",
        "A servo follows its goals when it is back, and nobody switched its torque on: it was never without power.",
        "Its torque is off after power-on by the manual's default and was switched on less than half as often meanwhile as it was away: who does so after most of its silences keeps it on himself; its joint follows between the silences and behind them, and its torque is not stated as off.",
    ),
)

LONG_NS: Final = 10 * NS
ASKED: Final = 5
"""How long a servo is silent, and how often it is asked meanwhile, that does not only restart."""

OFTEN: Final = 3
"""Silences that are a habit."""

TWICE: Final = 2
"""Servos that can go away at once."""

BY_CHANCE: Final = 0.05
"""So likely a servo has so many torn answers if all are hit alike: what hits all is not its contact."""

PLENTY: Final = 6
"""So many silences and torn answers are no chance."""

ALSO: Final = 0.3
"""Another servo that loses so much of what one does, while others lose nothing, is behind it."""

LESS: Final = 0.7
"""How much it counts if they are not away at once."""

FEW: Final = 0.05
"""Part of the time for which a servo speaks, where no clock tells it."""

HARDLY: Final = 40
"""Of so many silences a torn answer may be another matter."""

WITHIN: Final = 0.04
"""How often a contact that opens for one request alone is open for so short a time, and in its answer."""

NEARLY_ALL: Final = 0.9
"""Part of the silences of each servo that must be those of all: one may miss a moment of its own."""

SWITCHED: Final = 0.5
"""Part of its silences behind which a servo's torque may have been switched on where it kept it."""

BEHIND_NS: Final = 2 * NS
"""How long behind its silences a joint is looked at."""

NEAR_NS: Final = NS // 10
"""Servos are asked one after the other: silences so close to each other are of one moment."""


def tears(case: Case) -> Iterator[Finding]:
    """Tell whether servos that are away often leave within answers."""
    for servo in case.answering:
        runs = case.ledger.silences.runs(servo)
        torn = case.total("damaged", servo)
        # three are a habit where each is of several requests, and answers are torn besides
        is_habit = torn > 0 and len(runs) == OFTEN and all(run.missed > 1 for run in runs)
        is_whole = torn * HARDLY <= len(runs)
        if not (is_habit or len(runs) > OFTEN) or not (
            is_whole or (torn >= max(2, len(runs) / 10) and _is_torn_more(case, servo))
        ):
            continue
        yield silent(
            "away-without-a-tear" if is_whole else "torn-when-away",
            servo,
            runs,
            f"servo {servo} was away {len(runs)} times, and {torn or 'not one'} of its answers "
            f"{'are' if torn > 1 else 'is'} torn",
            _would_tear(case, servo, runs) if is_whole else min((len(runs) + torn) / PLENTY, 1.0),
        )


def _is_torn_more(case: Case, servo: int) -> bool:
    """Tell whether more of a servo's answers are torn than if it were hit as the others are."""
    others = [other for other in case.answering if other != servo]
    mine = case.total("damaged", servo)
    torn = sum(case.total("damaged", other) for other in others)
    whole = sum(case.total("ok", other) for other in others)
    return at_least(mine, mine + case.total("ok", servo), torn / max(torn + whole, 1)) < BY_CHANCE


def for_long(case: Case) -> Iterator[Finding]:
    """Tell which servos were silent for longer than a restart takes, and came back."""
    for servo in case.answering if case.has_clock else ():
        long = [
            s
            for s in case.ledger.silences.runs(servo)
            if s.missed >= ASKED and s.lasted_ns >= LONG_NS
        ]
        if long:
            took = max(s.lasted_ns for s in long) / NS
            what = f"servo {servo} answered nothing for {took:.0f} s, and then again"
            yield silent("away-for-long", servo, long, what, 1.0)


def _would_tear(case: Case, servo: int, runs: Sequence[Silence]) -> float:
    """Return how likely a contact that opens so often would have torn an answer of a servo.

    An answer takes so much of the time, and a contact opens at any moment of it. Where one request
    alone is missed it may have been open for less than an exchange, and within the answer as well.
    """
    rows = case.traffic["servo_id"] == servo
    frames = max(int(case.traffic["frames"][rows].sum()), 1)
    mean_bytes = case.ledger.bytes / max(case.ledger.frames, 1)
    said_ns = frames / 2 * mean_bytes * case.ledger.byte_ns
    share = said_ns / max(case.seconds * NS, 1.0) if case.has_clock else FEW
    single = sum(run.missed == 1 for run in runs)
    return min(1.0 - math.exp(-len(runs) * share - single * WITHIN), 1.0)


def several_at_once(case: Case) -> Iterator[Finding]:
    """Tell which servos fell silent at one moment."""
    gone = sorted(gone_at_once(case))
    for servo in gone:
        mine = case.ledger.silences.runs(servo)
        others = (
            f"all {len(gone)} servos"
            if len(gone) == len(case.answering)
            else f"{len(gone)} of {len(case.answering)} servos"
        )
        what = f"{others} fall silent at one moment, {case.since(mine[0].first_ns)}, and servo {servo} at no other"
        yield silent("several-away-at-once", servo, mine, what, 1.0)


def together(case: Case) -> Iterator[Finding]:
    """Tell which servos are away when another one is."""
    runs = {s: case.ledger.silences.runs(s) for s in case.answering}
    if sum(not r for r in runs.values()) < 1:
        yield from _all_at_once(case)  # no matter of one place
        return
    for servo, mine in runs.items():
        others = {other: theirs for other, theirs in runs.items() if other != servo and theirs}
        if not mine or not others:
            continue
        both = {o: int(_overlapping(mine, theirs).sum()) for o, theirs in others.items()}
        other = max(both, key=lambda o: both[o])
        if both[other] >= 2 and 2 * both[other] >= len(mine):
            what = (
                f"{both[other]} of {len(mine)} times that servo {servo} was away, servo {other} "
                f"was, too"
            )
            yield silent("others-away-too", servo, mine, what, min(both[other] / len(mine), 1.0))
            continue
        other = max(others, key=lambda o: len(others[o]))
        lost = len(others[other]) + case.total("damaged", other)
        # one silence while the other one answers is no habit that the two could share; with two
        # that have it, one more servo behind the same place is likelier than a fault of its own
        habit = [o for o, theirs in others.items() if len(theirs) > 1]
        if len(mine) == 1 and len(habit) > 1:
            what = (
                f"servo {servo} was away once, and {len(habit)} others "
                f"{sum(len(others[o]) for o in habit)} times"
            )
            yield silent("others-away-too", servo, mine, what, LESS)
        elif min(lost, len(mine)) > 1 and lost >= ALSO * len(mine):
            what = f"servo {servo} was away {len(mine)} times, and servo {other} {lost} times"
            yield silent("others-away-too", servo, mine, what, LESS)


def _all_at_once(case: Case) -> Iterator[Finding]:
    """Tell whether all servos are away in the same moments."""
    runs = {
        servo: [s for s in case.ledger.silences.runs(servo) if s.missed > 1]
        for servo in case.answering
    }
    if len(runs) < TWICE or not all(runs.values()):
        return
    both = {
        servo: int(np.all([_overlapping(mine, theirs) for theirs in runs.values()], axis=0).sum())
        for servo, mine in runs.items()
    }
    if any(both[servo] < NEARLY_ALL * len(mine) for servo, mine in runs.items()):
        return
    for servo, mine in runs.items():
        what = f"in {both[servo]} of {len(mine)} outages of servo {servo} all {len(runs)} are away"
        yield silent("all-away-at-once", servo, mine, what, 1.0)


def _overlapping(some: Sequence[Silence], others: Sequence[Silence]) -> Mask:
    """Tell which silences have one of others in their moment."""
    begin, until = _moments(some)
    theirs, back = _moments(others)
    near = (theirs <= until[:, None] + NEAR_NS) & (back >= begin[:, None] - NEAR_NS)
    found: Mask = np.logical_or.reduce(near, axis=1)
    return found


def _moments(some: Sequence[Silence]) -> tuple[I64, I64]:
    """Return when silences begin, and when they are over."""
    begin, until = np.array([(s.first_ns, s.back_ns or 0) for s in some], np.int64).T
    return begin, until


def torque_kept(case: Case) -> Iterator[Finding]:
    """Tell which servos had their torque still when they were back."""
    registers = case.protocol.registers
    w = case.writes
    torque = [i for i, r in enumerate(registers) if r.quantity == "torque_enable"]
    if not any(registers[i].default == 0 for i in torque):
        return
    for servo in case.answering:
        runs = [s for s in case.ledger.silences.runs(servo) if s.missed > 1]
        joint = track(case, servo)
        if not runs or joint is None:
            continue
        mine = case.registers_of(servo, "torque_enable")
        if not mine or mine[0].default != 0:
            continue
        # what was before the first silence and long behind the last one is another matter
        first, back = runs[0].first_ns, runs[0].back_ns or 0
        until = (runs[-1].back_ns or 0) + BEHIND_NS
        to_it = within(w["servo_id"], [servo, *case.everyone]) & within(w["register"], torque)
        writes = min(int(w["n"][to_it].sum()), _stated(case, servo, first, until))
        after = (joint.position.t_first > back) & (joint.position.t <= until)
        moved = joint.position.high[after].max(initial=-np.inf) - joint.position.low[after].min(
            initial=np.inf
        )
        if writes > SWITCHED * len(runs) or moved < 2 * joint.far:
            continue
        known = case.settings("torque_enable", servo_id=servo)
        if ((known.after == 0) & (known.t_ns >= first) & (known.t_ns <= until)).any():
            continue  # it is read, or switched, off meanwhile
        if any(a.last_ns > back and a.first_ns < until for a in joint.away):
            continue
        yield silent(
            "torque-survives",
            servo,
            runs,
            f"servo {servo} follows its goals after {counted(len(runs), 'outage')}, and its torque was "
            + (f"written {counted(writes, 'time')}" if writes else "not written meanwhile"),
            # who switches it on when it is back may do so behind some of the silences only
            1.0 if w["t_last"][to_it].max(initial=0) <= back else 1.0 - writes / len(runs),
        )


def _stated(case: Case, servo: int, first_ns: int, until_ns: int) -> int:
    """Return how often the torque of a servo was stated in a stretch, by a write or an answer."""
    stated = [case.series(who, "torque_enable") for who in (servo, *case.everyone)]
    return sum(
        int(one.n[(one.t >= first_ns) & (one.t_first <= until_ns)].sum()) for one in stated if one
    )


RULES: Final[tuple[Rule, ...]] = (tears, several_at_once, together, torque_kept, for_long)
"""The rules of this file."""
