"""Servos whose answers get lost now and then, alone or together, while others are sound."""

from __future__ import annotations

from collections import Counter
from typing import TYPE_CHECKING, Final

import numpy as np

from sniffer.diagnosis.case import BUCKET_NS, episodes
from sniffer.diagnosis.catalogue import FindingCode
from sniffer.diagnosis.evidence.chances import at_least, so_alike, sureness
from sniffer.diagnosis.evidence.lost import NEAR_NS, LostAnswers
from sniffer.diagnosis.evidence.parts import more_and_more
from sniffer.diagnosis.evidence.twins import of_twins
from sniffer.diagnosis.ledger.damage import IN_REPLY, IN_REQUEST
from sniffer.diagnosis.ledger.silences import of_one_length
from sniffer.diagnosis.model import Finding, Place
from sniffer.ground.distinct import within
from sniffer.ground.medians import median
from sniffer.ground.model import MS
from sniffer.ground.wording import between, counted, servos

if TYPE_CHECKING:
    from collections.abc import Iterator, Sequence

    from sniffer.diagnosis.case import Case
    from sniffer.diagnosis.rules import Rule
    from sniffer.ground.model import I64

FINDINGS: Final = (
    FindingCode(
        "comes-and-goes",
        "Answers of this servo are missing or torn now and then, in moments in which others are sound.",
        "At least three lost answers in two moments or more with sound ones between, in a share that others do not come near; or for a while so many, some of them missing, without one of another servo between, that chance does not choose it; or, of three servos and more, in the same three moments and in hardly any other, where another one is sound and nothing is torn.",
    ),
    FindingCode(
        "lost-more-and-more",
        "A servo that loses answers now and then loses more and more of them.",
        "As `comes-and-goes`; how many are lost in each of twenty parts of the time goes with the time (a correlation of ranks of 0.8), and the last quarter has the most.",
        is_manner=True,
    ),
    FindingCode(
        "lost-together",
        "Several servos lose answers in the same moments, and others do not.",
        "Moments in which two servos or more lost answers, or answers of one that always fall into those of another.",
    ),
    FindingCode(
        "away-unevenly",
        "The silences of a servo are of all lengths, from a moment on.",
        "At least four silences, of which two and a fifth are shorter than a quarter of the longest.",
    ),
    FindingCode(
        "away-alike",
        "A servo is away for about as long each time.",
        "At least four silences, all of which may have been of one length, half of it or twice as much; it counts as much as what ends at any time is seldom so even.",
    ),
    FindingCode(
        "back-too-soon",
        "A servo that misses requests answers again sooner than any servo starts.",
        "At least four silences, of which more are of one request than a start of 60 ms would leave; the next answer tells how far requests to it are apart. Needs times.",
    ),
)

LEAST: Final = 3
"""Lost answers: one or two are lost on many a line."""

MOMENTS: Final = 2

CHANCE: Final = 1e-3

AHEAD: Final = 5.0
"""How many times the share of the soundest servo a servo must lose."""

TOGETHER: Final = 3
"""Servos that lose answers in the same three moments, and hardly any else: chance does not have it."""

SAME: Final = 0.75
"""Part of a servo's bad moments that must be another's, too, for the two to fail together."""

RUNS: Final = 4
SHORTER: Final = 4
MANY_SHORT: Final = 0.2
"""How many times shorter than the longest a short silence is, and which part of them is short where
they are of all lengths: who starts anew takes about as long each time."""

AS_LIKELY: Final = 0.5
SELDOM_ALIKE: Final = 1e-3
"""How likely silences that end at any time may be so alike by chance where that tells nothing, and
where it counts in full."""

START_NS: Final = 60 * MS
"""No servo here starts sooner: wCK names 65 ms, and has the shortest start."""

DOUBTED: Final = 0.05
"""How likely silences of one request may be of who starts anew, for that to be doubted; it counts the
more the less likely it is."""

TORN_ONLY: Final = 0.25
"""How much it counts where every lost answer is torn and none is missing: what is away for longer
than an answer takes misses requests, too."""


ALONE: Final = 1e-6
"""How likely it may be that of losses of all a row is of one servo, for that row to be its own."""

GONE: Final = 0.25
"""Part of such a row that must be missing: what bits or places of words tear is there, and torn."""


SELDOM: Final = 0.4
"""Part of the time near moments from which on losses coincide by chance."""


def losses(case: Case) -> Iterator[Finding]:
    """Find servos that lose answers now and then, and those that do it together."""
    torn = Counter(d.servo_id for d in case.damages if d.turn == IN_REPLY)
    twins = Counter(d.servo_id for d in case.damages if d.turn == IN_REPLY and of_twins(case, d))
    lost = [
        one
        for s in case.answering
        if 2 * twins[s] <= torn[s] and (one := LostAnswers(case, s)).ok + one.bad > LEAST
    ]
    # a row of torn answers without a sound one between neither comes nor goes
    lost = [one for one in lost if one.missing or not one.bad or one.moments >= MOMENTS]
    bad = sorted((one for one in lost if one.bad), key=lambda one: -one.share)
    if not bad or bad[0].bad < LEAST or bad[0].moments < MOMENTS:
        return
    group, sound = _group(case, bad, lost)
    if not group:
        yield from _for_a_while(case, bad)
        return
    rest_bad, rest = sum(o.bad for o in sound), sum(o.bad + o.ok for o in sound)
    shared = _shared(group)
    together = _told_together(case, [one for one in group if one.servo in shared])
    first = min(int(o.times[0]) for o in group)
    for one in group:
        chance = at_least(one.bad, one.bad + one.ok, (rest_bad + 1) / (rest + 2)) if sound else 0.1
        # of who is asked seldom nobody knows how much he loses
        chance = max(chance, at_least(rest - rest_bad, rest, 1 - one.share)) if sound else chance
        places = tuple(
            Place(at, 1, t, "a request without a sound answer")
            for at, t in zip(one.at[:3].tolist(), one.times[:3].tolist(), strict=True)
        )
        more = more_and_more(one.times, case.first_ns, case.last_ns) if case.has_clock else ()
        others = (
            f"{rest_bad} of {rest} of {counted(len(sound), 'other')}"
            if sound
            else "nobody else is there"
        )
        yield Finding(
            "comes-and-goes",
            one.servo,
            first,
            int(one.times[-1]),
            one.outages,
            f"servo {one.servo} lost {one.bad} of {one.bad + one.ok} answers "
            f"({one.torn} of them torn) in {one.told}; {others}"
            + (f"; {one.to_the_end} more until the end" if one.to_the_end else ""),
            places,
            strength=max(sureness(chance), 0.4) * min(TORN_ONLY + 1.5 * one.missing / one.bad, 1.0),
            brief=together
            if one.servo in shared
            else f"servo {one.servo} loses "
            + ("more and more answers" if more else f"answers in {one.told}"),
            episodes=episodes(one.times, one.times, BUCKET_NS),
        )
        if more:
            yield Finding(
                "lost-more-and-more",
                one.servo,
                first,
                int(one.times[-1]),
                one.bad,
                f"servo {one.servo} loses more and more: {', '.join(map(str, more))} answers by "
                "quarters of the time",
                places,
            )
        if one.servo in shared:
            yield Finding(
                "lost-together",
                one.servo,
                first,
                int(one.times[-1]),
                one.outages,
                f"{together}; {others}",
                places,
            )


def _told_together(case: Case, group: Sequence[LostAnswers]) -> str:
    """Return that several servos lose answers in the same moments, and where on the line they part.

    Which wires go where no byte tells: servos that are wired by their ids part at one place.
    """
    if not group:
        return ""
    mine = [one.servo for one in group]
    counts = [one.outages for one in group]
    told = f"{servos(mine)} lose answers in the same {between(min(counts), max(counts), f'{max(counts)} moments')}"
    sound = [servo for servo in case.answering if servo not in mine]
    nearer, farther = (sound, mine) if sound and sound[0] < min(mine) else (mine, sound)
    if sound and max(nearer) < min(farther):
        place = f"between {max(nearer)} and {min(farther)}"
        told += f", {servos(sound)} do not ({place} if they are wired in this order)"
    return told


def _for_a_while(case: Case, bad: list[LostAnswers]) -> Iterator[Finding]:
    """Find the servo that loses answers for a while in which no other one does.

    At other times others do, for another reason.
    """
    exchanges = max(sum(case.total("ok", s) for s in case.servos), 1)
    for one in bad if len(case.answering) > 1 else ():
        others = np.sort(np.concatenate([o.times for o in bad if o is not one] or [one.times[:0]]))
        row = np.searchsorted(others, one.times)
        which, first, n = np.unique(row, return_index=True, return_counts=True)
        best = int(n.argmax())
        mine = slice(int(first[best]), int(first[best] + n[best]))
        usual = max(case.total("ok", one.servo) / exchanges, 1 / len(case.answering))
        chance = len(which) * at_least(int(n[best]), int(n[best]), min(usual, 1.0))
        times, at = one.times[mine], one.at[mine]
        missing = case.anomalies("no-response", servo_id=one.servo).t_ns
        gone = int(within(times, missing).sum())
        moments = 1 + int(one.apart(times).sum())
        if chance > ALONE or gone < GONE * len(times) or moments < LEAST:
            continue
        since, until = case.since(int(times[0])), case.since(int(times[-1]))
        yield Finding(
            "comes-and-goes",
            one.servo,
            int(times[0]),
            int(times[-1]),
            len(times),
            f"from {since} to {until} servo {one.servo} lost {len(times)} answers ({gone} of them "
            f"missing) in {moments} moments, and no other servo lost one between",
            tuple(
                Place(a, 1, t, "a request without a sound answer")
                for a, t in zip(at[:3].tolist(), times[:3].tolist(), strict=True)
            ),
            brief=f"servo {one.servo} alone loses answers in {moments} moments",
            episodes=episodes(times, times, BUCKET_NS),
        )


def lengths(case: Case) -> Iterator[Finding]:
    """Tell whether the silences of a servo are of all lengths, as a contact has them, or alike."""
    for servo in case.answering:
        runs = case.ledger.silences.runs(servo)
        if len(runs) < RUNS:
            continue
        spans = np.array([run.lasted_ns for run in runs])
        # one request in vain is a silence of no known length: it ends when the next one is made
        longest = max((run.lasted_ns for run in runs if run.missed > 1), default=0)
        short = int((spans * SHORTER < longest).sum())
        uneven = short >= max(MOMENTS, MANY_SHORT * len(runs))
        chance = so_alike([run.bounds_ns for run in runs])
        if not uneven and (chance > AS_LIKELY or not of_one_length(runs, case.latency_ns).all()):
            continue
        yield Finding(
            "away-unevenly" if uneven else "away-alike",
            servo,
            runs[0].first_ns,
            runs[-1].back_ns or 0,
            len(runs),
            f"of {len(runs)} outages of servo {servo} {short} are shorter than a quarter of the "
            f"longest ({spans.min() / 1e6:.0f} to {longest / 1e6:.0f} ms)",
            strength=min(0.5 + short / 10, 1.0) if uneven else sureness(chance, SELDOM_ALIKE),
        )


def sooner_than_a_start(case: Case) -> Iterator[Finding]:
    """Find servos that are away for too short a time for a start.

    It begins anywhere behind the request before, and hides one alone only where it is over before
    the next one.
    """
    for servo in case.answering if case.has_clock else ():
        runs = case.ledger.silences.runs(servo)
        alone = [run for run in runs if run.missed == 1]
        if len(runs) < RUNS or not alone:
            continue
        gaps = np.array([run.lasted_ns for run in alone], np.float64)
        before = np.array([max(run.first_ns - run.before_ns, 1) for run in alone], np.float64)
        left = np.clip(before + gaps - START_NS, 0, before) / before
        chance = at_least(len(gaps), len(runs), float(left.mean()))
        if chance > DOUBTED:
            continue
        yield Finding(
            "back-too-soon",
            servo,
            runs[0].first_ns,
            runs[-1].back_ns or 0,
            len(gaps),
            f"{len(gaps)} of {len(runs)} outages of servo {servo} are one request long, and it "
            f"answers {median(gaps) / 1e6:.0f} ms later: a start takes {START_NS // MS} ms or more",
            strength=sureness(chance),
        )


def _group(
    case: Case, bad: list[LostAnswers], lost: list[LostAnswers]
) -> tuple[list[LostAnswers], list[LostAnswers]]:
    """Return the servos that lose answers in the moments of the worst one, and the sound ones.

    Each of those that have far more than the soundest begins a group; who fails only in its
    moments belongs to it, however few of its answers were asked for just then.
    """
    if len(case.answering) == 1:
        return (bad, []) if _alone_loses(case, bad[0]) else ([], [])
    best = min(lost, key=lambda one: one.share)
    clear = [
        one
        for one in bad
        if one.bad >= LEAST
        and one.moments >= MOMENTS
        and one.share >= AHEAD * best.share
        and at_least(one.bad, one.bad + one.ok, (best.bad + 1) / (best.bad + best.ok + 2)) < CHANCE
    ]
    clear = clear or _few_but_together(case, bad, lost)
    if not clear:
        return [], []
    moments = np.sort(np.concatenate([one.times for one in clear]))
    group = list(clear)
    if not _often(moments):
        group += [o for o in bad if o not in clear and o.within(moments) >= SAME]
    left = [one for one in lost if one not in group]
    if len(left) > 1 and not min(one.bad for one in left):
        # beside it most lose nothing: who does is behind the same place, or else has a cause of his;
        # a contact that opens for longer than an answer leaves some missing, of whoever is behind it
        is_gone = any(one.missing >= GONE * one.bad for one in clear)
        group += [o for o in left if o.bad >= MOMENTS and (o.missing or not is_gone)]
    sound = [one for one in lost if one not in group]
    rest = sum(one.bad for one in sound) / max(sum(one.bad + one.ok for one in sound), 1)
    if sound and rest * AHEAD > min(one.share for one in clear):
        return [], []
    return group, sound


def _few_but_together(
    case: Case, bad: list[LostAnswers], lost: list[LostAnswers]
) -> list[LostAnswers]:
    """Return servos of which none loses much, but all of them in the same few moments.

    Some other one is sound in these, and nothing is torn else: what disturbs the line chooses none.
    """
    some = [one for one in bad if one.bad >= MOMENTS and one.missing >= SAME * one.bad]
    torn = int(case.damage["n"].sum()) - sum(one.torn for one in some)
    if len(some) < TOGETHER or len(some) == len(lost) or len(some) < len(bad) or torn:
        return []
    are_enough = min(one.moments for one in some) >= LEAST
    return some if are_enough and len(_shared(some)) == len(some) else []


def _alone_loses(case: Case, one: LostAnswers) -> bool:
    """Tell whether a servo, beside which there is none, leaves out answers to requests that are whole.

    What disturbs the line tears requests as well, and those are torn here, too.
    """
    torn = int(case.damage["n"][case.damage["turn"] == IN_REQUEST].sum())
    asked = int(case.traffic["requests"].sum()) + torn
    theirs = (torn + 1) / (asked + 2)
    is_more = at_least(one.bad, one.bad + one.ok, theirs) < CHANCE
    return one.missing >= LEAST and is_more and one.share >= AHEAD * torn / max(asked, 1)


def _often(times: I64) -> bool:
    """Tell whether so much of the time is near some moments that others are there by chance."""
    if len(times) < 2:
        return False
    near = int(np.minimum(np.diff(times), 2 * NEAR_NS).sum()) + 2 * NEAR_NS
    return near > SELDOM * int(times[-1] - times[0] + 2 * NEAR_NS)


def _shared(group: list[LostAnswers]) -> list[int]:
    """Return the servos of a group that fail in each other's moments."""
    out = []
    for one in group:
        others = np.sort(np.concatenate([o.times for o in group if o is not one] or [one.times]))
        if len(group) > 1 and not _often(others) and one.within(others) >= SAME:
            out.append(one.servo)
    return sorted(out) if len(out) > 1 else []


RULES: Final[tuple[Rule, ...]] = (losses, lengths, sooner_than_a_start)
"""The rules of this area."""
