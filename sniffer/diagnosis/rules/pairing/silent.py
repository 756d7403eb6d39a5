"""Who answers whom: servos never heard, gone silent, away for a while."""

from __future__ import annotations

from itertools import pairwise
from typing import TYPE_CHECKING, Final

import numpy as np

from sniffer.diagnosis.catalogue import FindingCode
from sniffer.diagnosis.evidence.chances import so_alike, sureness
from sniffer.diagnosis.evidence.questions import is_one_question
from sniffer.diagnosis.evidence.told import told_to_start
from sniffer.diagnosis.ledger.silences import ENOUGH, of_one_length
from sniffer.diagnosis.model import Finding, Place
from sniffer.diagnosis.physics.comparing import bits_wrong
from sniffer.ground.model import NS
from sniffer.ground.wording import counted

if TYPE_CHECKING:
    from collections.abc import Iterator, Sequence

    from sniffer.diagnosis.case import Case
    from sniffer.diagnosis.ledger.silences import Silence
    from sniffer.diagnosis.rules import Rule
    from sniffer.ground.model import I64

FINDINGS: Final = (
    FindingCode(
        "never-answered",
        "A servo was asked time and again, and never answered, while others did.",
        "At least five requests with an expected answer, no answer, another servo answered.",
    ),
    FindingCode(
        "silent-since",
        "A servo answered until one moment, and not once since.",
        "Answers before, and at least five requests in a row without one until the end.",
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
        "Of six outages and more the times from its return to the next one vary by less than half of their mean; it counts as much as "
        "what comes at any time is seldom so even.",
    ),
    FindingCode(
        "outages-anytime",
        "A servo is away now and then, without a rhythm.",
        "Of six outages and more the times between vary by 85 % of their mean and more.",
    ),
)


LOOKS: Final = 3
"""Quarters of a second in which an id is asked for that is not just looked for."""

TOGETHER: Final = 4
"""So many times fewer stretches of losses than single ones make are no chance, however much is lost."""

AGAIN: Final = 3
"""Silences that are a habit."""

CHANCE: Final = 3.0
"""So many times as often as chance would have it, requests in a row are lost for a reason."""

SWEEP: Final = 5
"""Ids without a servo, asked about alike: somebody looks who is there."""

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

MOSTLY: Final = 0.8
"""Part of the requests to a servo that is not there which have no answer: behind some stands what
noise or a hole leaves of others."""

MEANT: Final = 20
"""How many times as often a request was said of which one bit was misread where another one is heard."""

AHEAD: Final = 5.0
"""How many times the others' share of losses a servo must have to be the one that misses."""


def never_answered(case: Case) -> Iterator[Finding]:
    """Servos that are asked and were never heard; looking for servos is none of that."""
    a = case.answers
    if not case.answering:
        return
    absent: dict[int, I64] = {}
    for servo in case.servos:
        rows = np.flatnonzero(a["servo_id"] == servo)
        asked, missing = int(a["asked"][rows].sum()), int(a["missing"][rows].sum())
        if missing and missing >= MOSTLY * asked and servo not in case.ledger.silences.heard:
            absent[servo] = rows
    counts = [int(a["missing"][rows].sum()) for rows in absent.values()]
    is_sweep = len(absent) >= SWEEP and max(counts) <= 2 * min(counts) + 1
    for servo, rows in absent.items():
        missing = int(a["missing"][rows].sum())
        first, last = int(a["t_first"][rows].min()), int(a["t_last"][rows].max())
        asked_along = len(rows) >= LOOKS or last - first > NS
        if not case.has_clock:  # counted from the bytes, a quarter second is anything
            asked_along |= 2 * (last - first) > case.last_ns - case.first_ns
        if missing < ENOUGH or is_sweep or not asked_along or _is_misread(case, servo):
            continue
        yield Finding(
            "never-answered",
            servo,
            first,
            last,
            missing,
            f"servo {servo} was asked {missing} times and never answered",
            (Place(int(a["at"][rows[0]]), 1, int(a["t_first"][rows[0]]), "the first request"),),
            brief=f"servo {servo} never answers ({missing} requests)",
        )


def _is_misread(case: Case, servo: int) -> bool:
    """Tell whether all that a servo is asked may be what others are asked, with one bit misread.

    What has no checksum holds all the same; and where that happens, other bits tear frames.
    """
    kinds = case.ledger.exchanges.kinds
    mine = [k for k in range(len(kinds)) if kinds.servo_id[k] == servo]
    if not mine or int(case.damage["n"].sum()) < int(kinds.n[mine].sum()):
        return False  # none of its own: who is named in lists alone is meant there
    others = [k for k in range(len(kinds)) if kinds.servo_id[k] in case.answering]
    return all(
        case.protocol.checksum_of(kinds.example[k]) is None
        and any(
            kinds.n[q] >= MEANT * kinds.n[k]
            and len(kinds.example[q]) == len(kinds.example[k])
            and bits_wrong(kinds.example[q], kinds.example[k]) == 1
            for q in others
        )
        for k in mine
    )


def silences(case: Case) -> Iterator[Finding]:
    """Servos that answered and stopped: for ever, for a while, or now and then."""
    for servo in case.answering:
        spells = case.ledger.silences.of(servo)
        for s in spells:
            if s.back_ns is None and s.missed >= ENOUGH and not is_one_question(case, servo, s):
                took = f" in {(case.last_ns - s.first_ns) / NS:.3g} s" if case.has_clock else ""
                ordered = told_to_start(case, servo, [s])
                yield Finding(
                    "silent-since",
                    servo,
                    s.first_ns,
                    case.last_ns,
                    s.missed,
                    f"servo {servo} answered until {case.since(s.before_ns)} and not once since, "
                    f"{counted(s.missed, 'request')}{took}"
                    + ("; it was told to start anew just before" if ordered else ""),
                    (Place(s.at, s.length, s.first_ns, "the first request without an answer"),),
                    brief=f"servo {servo} silent to the end",
                )
        away = _outages(case, servo)
        if away:
            yield _away(case, servo, away)
            if len(away) >= AGAIN and not _mostly_short(case, servo, away):
                yield from _again(case, servo, away)
        if len(away) < AGAIN:
            yield from _now_and_then(case, servo)
        yield from _rhythm(case, servo)


def _outages(case: Case, servo: int) -> list[Silence]:
    """Return the silences that are no chance among single losses."""
    kept = case.ledger.silences
    lengths = kept.lengths(servo)
    runs, asked = sum(lengths), case.total("asked", servo)
    if not runs:
        return []
    late = kept.late(servo)
    missing = case.total("missing", servo) - (late.missed if late else 0)
    share = min(missing / max(asked, 1), 1.0)
    several = lengths[1] + lengths[2]
    if lengths[1] and several > max(CHANCE * runs * share, 2 * lengths[0]):
        return [s for s in kept.runs(servo) if s.missed > 1]
    by_chance = asked * share * (1 - share)  # stretches, if each request were lost by itself
    if lengths[2] > CHANCE * runs * share**2 or (lengths[2] and TOGETHER * runs < by_chance):
        return [s for s in kept.of(servo) if s.back_ns is not None]
    return []


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
    longest = max(away, key=lambda s: s.lasted_ns if case.has_clock else s.missed)
    told, missed = _lasted(case, longest)
    often = "once" if len(away) == 1 else f"{len(away)} times"
    most = "" if len(away) == 1 else "at most "
    ordered = len(told_to_start(case, servo, away))
    times = "" if ordered == len(away) else f"{ordered} times "
    return Finding(
        "away-for-a-while",
        servo,
        away[0].first_ns,
        away[-1].back_ns or 0,
        len(away),
        f"servo {servo} was away {often}, {most}for {told}{missed}"
        + (f", {times}since it was told to start anew" if ordered else ""),
        tuple(
            Place(s.at, s.length, s.first_ns, "the first request without an answer")
            for s in away[:3]
        ),
        strength=min(0.8 + 0.1 * len(away), 1.0),
        brief=f"servo {servo} silent for {told}"
        + ("" if len(away) == 1 else f", {len(away)} times"),
        episodes=tuple((s.first_ns, s.back_ns or 0) for s in away),
    )


def _lasted(case: Case, s: Silence) -> tuple[str, str]:
    """Return how long a silence was, and what to add to that; in requests where nobody knows."""
    asked = f"{counted(s.missed, 'request')} in a row"
    took_ms = s.lasted_ns / 1e6
    if not case.has_clock:
        return asked, ""
    return f"{took_ms:.0f} ms" if took_ms < LONG_MS else f"{took_ms / 1000:.0f} s", f" ({asked})"


def _again(case: Case, servo: int, away: Sequence[Silence]) -> Iterator[Finding]:
    every = _times_away(case, servo, away)
    if of_one_length(every, case.latency_ns).mean() < MOST:
        return
    spans = np.array([s.lasted_ns for s in away]) / 1e6
    apart = np.diff([s.first_ns for s in away]) / NS
    pace = f", every {np.median(apart):.2g} s or so" if case.has_clock else ""
    missed = np.array([s.missed for s in away])
    told, unit = (spans, "ms") if case.has_clock else (missed, "requests")
    yield Finding(
        "away-again-and-again",
        servo,
        away[0].first_ns,
        away[-1].back_ns or 0,
        len(away),
        f"servo {servo} went away {len(away)} times, for {np.median(told):.0f} {unit} in the middle "
        f"({told.min():.0f} to {told.max():.0f}){pace}",
        strength=min(0.55 + 0.15 * len(away), 1.0)
        * (LONG if np.median(spans) > BOOT_MS else 1.0)
        * max(sureness(so_alike([s.bounds_ns for s in every]), SELDOM_ALIKE), UNKNOWN),
        episodes=tuple((s.first_ns, s.back_ns or 0) for s in away),
    )


def _rhythm(case: Case, servo: int) -> Iterator[Finding]:
    """Yield whether the outages of a servo come at even times, or at any."""
    runs = case.ledger.silences.runs(servo)
    if not case.has_clock or len(runs) < OUTAGES:
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
        missing,
        f"servo {servo} left {missing} of {asked} requests without an answer, one by one; "
        f"all others {others_missing} of {others}",
        tuple(Place(s.at, s.length, s.first_ns, "a request without an answer") for s in runs[:3]),
        strength=min(0.8 + missing / 50, 1.0),
        brief=f"servo {servo} misses requests",
    )


RULES: Final[tuple[Rule, ...]] = (never_answered, silences)
"""The rules of this area."""
