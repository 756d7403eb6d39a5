"""Servos that are not heard for a while, time and again, or from one moment on."""

from __future__ import annotations

from itertools import pairwise
from typing import TYPE_CHECKING, Final

import numpy as np

from sniffer.diagnosis.catalogue import FindingCode
from sniffer.diagnosis.evidence.chances import so_alike, sureness
from sniffer.diagnosis.evidence.goal_steps import set_out
from sniffer.diagnosis.evidence.gone import taken_along
from sniffer.diagnosis.evidence.outages import (
    AGAIN,
    CHANCE,
    away_with,
    ending,
    gone_with,
    is_for_good,
    outages,
    seldom_away,
)
from sniffer.diagnosis.evidence.told import told_to_start
from sniffer.diagnosis.ledger.silences import of_one_length
from sniffer.diagnosis.model import Finding, Place
from sniffer.ground.medians import median
from sniffer.ground.model import NS
from sniffer.ground.wording import between, counted, servos

if TYPE_CHECKING:
    from collections.abc import Iterator, Mapping, Sequence

    from sniffer.diagnosis.case import Case
    from sniffer.diagnosis.ledger.silences import Silence
    from sniffer.diagnosis.rules import Rule

FINDINGS: Final = (
    FindingCode(
        "silent-since",
        "A servo answered until one moment, and not once since.",
        "Answers before, and at least five requests in a row without one until the end, or three in three seconds; fewer where it was hardly ever away before, and others were not. It counts the less the shorter that is.",
    ),
    FindingCode(
        "away-for-a-while",
        "A servo answered nothing for some requests in a row, and then again.",
        "At least three requests in a row without an answer (two, where single ones are not lost), answers before and behind, more often than chance has it at this rate of losses.",
        is_of_supply=True,
    ),
    FindingCode(
        "away-again-and-again",
        "A servo goes away for a moment and comes back, time and again, for about as long each time.",
        "At least three such silences, nine tenths of which may have been of one length, half of it or twice as much, single losses among them where others hardly have any, and these at most twice as often.",
    ),
    FindingCode(
        "misses-now-and-then",
        "One servo leaves requests without an answer now and then; others hardly ever do.",
        "At least three single losses, a share of its requests that is five times that of all others.",
    ),
    FindingCode(
        "outages-evenly",
        "A servo is away at even times.",
        "Of six outages and more, that steps of goals do not bring, the times from its return to the next one vary by less than half of their mean; it counts as much as "
        "what comes at any time is seldom so even.",
    ),
    FindingCode(
        "outages-anytime",
        "A servo is away now and then, without a rhythm.",
        "Of six outages and more the times between vary by 85 % of their mean and more.",
    ),
)


MOST: Final = 0.9
"""Restarts of one servo take about as long each time; contacts open for as long as they like."""

LONG_MS: Final = 10_000
"""What lasts longer is told in seconds."""

BOOT_MS: Final = 1000.0
"""Small servos are up again within tenths of a second: wCK names 65 ms."""

LONG: Final = 0.5
"""How much it counts if they stay away for longer."""

UNKNOWN: Final = 0.3
"""How much it counts if it is asked too seldom to tell how long it stays away."""

SELDOM_ALIKE: Final = 0.05
"""How likely silences that end at any time may be so alike where that counts in full."""

OUTAGES: Final = 6
"""Outages whose rhythm can be told."""

EVEN: Final = 0.6
UNEVEN: Final = 0.85
"""Parts of their mean by which the times between outages vary, up to which they are even, and from
which on not."""

SELDOM: Final = 1e-4
"""How likely they may be so even by chance where that counts in full."""

GONE_NS: Final = NS
SOON: Final = 0.35
"""How long a silence that goes on counts in full, and how much one does that has just begun: most
starts are over by then."""

AHEAD: Final = 5.0
"""How many times the others' share of losses a servo must have to be the one that misses."""


def silences(case: Case) -> Iterator[Finding]:
    """Servos that answered and stopped: for ever, for a while, or now and then."""
    for servo in case.answering:
        yield from _to_the_end(case, servo)
        away = outages(case, servo)
        if away:
            yield _away(case, servo, away)
            if len(away) >= AGAIN and not _mostly_short(case, servo, away):
                yield from _again(case, servo, away)
        if len(away) < AGAIN:
            yield from _now_and_then(case, servo)
        yield from _rhythm(case, servo)


def _to_the_end(case: Case, servo: int) -> Iterator[Finding]:
    """Yield that a servo answers nothing until the end.

    It counts the less the shorter that is: it may just start anew.
    """
    s = ending(case, servo)
    if s is None or not (is_for_good(case, s) or seldom_away(case, servo)):
        return
    took_ns = case.last_ns - s.first_ns
    took = f"{took_ns / NS:.3g} s" if case.has_clock else counted(s.missed, "request")
    ordered = told_to_start(case, servo, [s])
    yield Finding(
        "silent-since",
        servo,
        s.first_ns,
        case.last_ns,
        s.missed,
        f"servo {servo} answered until {case.since(s.before_ns)} and not once since, "
        f"{counted(s.missed, 'request')}"
        + (f" in {took}" if case.has_clock else "")
        + ("; it was told to start anew just before" if ordered else ""),
        (Place(s.at, s.length, s.first_ns, "the first request without an answer"),),
        strength=min(max(took_ns / GONE_NS, SOON), 1.0) if case.has_clock else 1.0,
        brief=_gone(case, gone_with(case, servo, s)),
        # who asks it again and again does so since it is gone, and who waits for it is not heard
        befell=(servo, *taken_along(case, servo, s)),
    )


def _gone(case: Case, group: Mapping[int, Silence]) -> str:
    """Return the few words of servos that fell silent for good at one moment."""
    lasted = [case.last_ns - one.first_ns for one in group.values()]
    if case.has_clock:
        took = between(
            f"{min(lasted) / NS:.2g}", f"{max(lasted) / NS:.2g}", f"{max(lasted) / NS:.2g} s"
        )
    else:
        missed = [one.missed for one in group.values()]
        took = between(min(missed), max(missed), counted(max(missed), "request"))
    return f"{servos(group)} silent to the end, for {took}"


def _times_away(case: Case, servo: int, away: Sequence[Silence]) -> Sequence[Silence]:
    """Return how often a servo was away, for one request as well where others hardly miss one."""
    kept = case.ledger.silences
    single = kept.lengths(servo)[0]
    return kept.runs(servo) if single > CHANCE * _usual(case, servo) else away


def _mostly_short(case: Case, servo: int, away: Sequence[Silence]) -> bool:
    """Tell whether a servo is away for a moment far oftener than for as long as these silences.

    Who starts anew takes as long each time: only what is away for moments of all lengths mostly
    misses one request.
    """
    single = case.ledger.silences.lengths(servo)[0]
    least = min(s.missed for s in away)
    return least > 2 and single > 2 * len(away) + _usual(case, servo)


def _usual(case: Case, servo: int) -> float:
    """Return how many requests a servo would miss if it missed as many as the others."""
    missing, asked = case.total("missing", servo), case.total("asked", servo)
    return (case.total("missing") - missing) / max(case.total("asked") - asked, 1) * asked


def _away(case: Case, servo: int, away: Sequence[Silence]) -> Finding:
    told, missed = _lasted(case, away, is_one=len(away) == 1)
    group = away_with(case, servo)
    every = [s for one in group for s in outages(case, one)]
    of_all = _lasted(case, every, is_one=len(away) == 1)[0]
    often = "once" if len(away) == 1 else f"{len(away)} times"
    ordered = len(told_to_start(case, servo, away))
    times = "" if ordered == len(away) else f"{ordered} times "
    return Finding(
        "away-for-a-while",
        servo,
        away[0].first_ns,
        away[-1].back_ns or 0,
        len(away),
        f"servo {servo} was away {often}, for {told}{missed}"
        + (f", {times}since it was told to start anew" if ordered else ""),
        tuple(
            Place(s.at, s.length, s.first_ns, "the first request without an answer")
            for s in away[:3]
        ),
        strength=min(0.8 + 0.1 * len(away), 1.0),
        brief=f"{servos(group)} silent {'at once ' if len(group) > 1 else ''}for {of_all}"
        + ("" if len(away) == 1 else f", {len(away)} times"),
        episodes=tuple((s.first_ns, s.back_ns or 0) for s in away),
    )


def _lasted(case: Case, away: Sequence[Silence], *, is_one: bool) -> tuple[str, str]:
    """Return how long silences were, and what to add to that; in requests where nobody knows.

    Of one, of whoever it is, the bounds are told, of several the shortest and the longest.
    """
    missed = [s.missed for s in away]
    most = counted(max(missed), "request")
    asked = f"{between(min(missed), max(missed), most)} in a row"
    if not case.has_clock:
        return asked, ""
    spans = [t for s in away for t in (s.bounds_ns if is_one else (s.lasted_ns,))]
    low_ms, high_ms = min(spans) / 1e6, max(spans) / 1e6
    if high_ms < LONG_MS:
        took = between(f"{low_ms:.0f}", f"{high_ms:.0f}", f"{high_ms:.0f} ms")
    else:
        took = between(f"{low_ms / 1000:.0f}", f"{high_ms / 1000:.0f}", f"{high_ms / 1000:.0f} s")
    return took, f" ({asked})"


def _again(case: Case, servo: int, away: Sequence[Silence]) -> Iterator[Finding]:
    every = _times_away(case, servo, away)
    if of_one_length(every, case.latency_ns).mean() < MOST:
        return
    spans = np.array([s.lasted_ns for s in away]) / 1e6
    apart = np.diff([s.first_ns for s in away]) / NS
    pace = f", every {median(apart):.2g} s or so" if case.has_clock else ""
    missed = np.array([s.missed for s in away])
    told, unit = (spans, "ms") if case.has_clock else (missed, "requests")
    yield Finding(
        "away-again-and-again",
        servo,
        away[0].first_ns,
        away[-1].back_ns or 0,
        len(away),
        f"servo {servo} went away {len(away)} times, for {median(told):.0f} {unit} in the middle "
        f"({told.min():.0f} to {told.max():.0f}){pace}",
        strength=min(0.55 + 0.15 * len(away), 1.0)
        * (LONG if median(spans) > BOOT_MS else 1.0)
        * max(sureness(so_alike([s.bounds_ns for s in every]), SELDOM_ALIKE), UNKNOWN),
        episodes=tuple((s.first_ns, s.back_ns or 0) for s in away),
    )


def _rhythm(case: Case, servo: int) -> Iterator[Finding]:
    """Yield whether the outages of a servo come at even times, or at any: not those that steps of goals bring."""
    runs = case.ledger.silences.runs(servo)
    if not case.has_clock or len(runs) < OUTAGES or set_out(case, servo) is not None:
        return
    # from its return on: while it is away it cannot leave again, however it does that
    ends = [_there_ns(case, servo, run, b.first_ns) for run, b in pairwise(runs)]
    apart = np.array([b.first_ns - end for end, b in zip(ends, runs[1:], strict=True)], np.float64)
    spread = float(apart.std() / max(float(apart.mean()), 1e-9))
    # of a Poisson process it is 1; by chance less, the fewer there are
    even, uneven = EVEN - 1 / len(runs), UNEVEN
    if even < spread < uneven:
        return
    if spread <= even:
        # who is asked seldom has it for one turn or two, and that is no pace
        known = [
            (float(b.before_ns - end), float(b.first_ns - a.last_ns))
            for (a, b), end in zip(pairwise(runs), ends, strict=False)
        ]
        how, strength = "evenly, as restarts do", sureness(so_alike(known), SELDOM)
    else:
        how, strength = (
            "without a rhythm, as a contact opens",
            (spread - (even + uneven) / 2) / (uneven - even),
        )
    yield Finding(
        "outages-evenly" if spread <= even else "outages-anytime",
        servo,
        runs[0].first_ns,
        runs[-1].back_ns or 0,
        len(runs),
        f"the {len(runs)} outages of servo {servo} come {how}: how long it is there before "
        f"each varies by "
        f"{spread:.0%}",
        strength=min(strength, 1.0),
    )


def _there_ns(case: Case, servo: int, run: Silence, until_ns: int) -> int:
    """Return since when a servo is there behind a silence, and behind starts that were ordered since."""
    back_ns = run.first_ns if run.back_ns is None else run.back_ns
    started = case.ledger.excused.started.get(servo, ())
    return max((t for t in started if back_ns <= t <= until_ns), default=back_ns)


def _now_and_then(case: Case, servo: int) -> Iterator[Finding]:
    """Yield the single losses of one servo, if it has far more of them than others."""
    runs = case.ledger.silences.runs(servo)
    missing, asked = case.total("missing", servo), case.total("asked", servo)
    others_missing, others = case.total("missing") - missing, case.total("asked") - asked
    if len(runs) < AGAIN or not others:
        return
    # of those that it never came back from none was single
    gone = sum(s.missed for s in case.ledger.silences.of(servo) if s.back_ns is None)
    missing, asked = missing - gone, asked - gone
    # one more than the others lost: few requests tell little
    if missing / max(asked, 1) < AHEAD * (others_missing + 1) / max(others, 1):
        return
    yield Finding(
        "misses-now-and-then",
        servo,
        runs[0].first_ns,
        runs[-1].back_ns or 0,
        len(runs),
        f"servo {servo} left {missing} of {asked} requests without an answer, in {counted(len(runs), 'outage')}; "
        f"all others {others_missing} of {others}",
        tuple(Place(s.at, s.length, s.first_ns, "a request without an answer") for s in runs[:3]),
        strength=min(0.8 + missing / 50, 1.0),
        brief=f"servo {servo} misses requests",
    )


RULES: Final[tuple[Rule, ...]] = (silences,)
"""The rules of this area."""
