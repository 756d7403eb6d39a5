"""Questions that a servo leaves unanswered, and answers all others: it does not know them."""

from __future__ import annotations

from dataclasses import replace
from typing import TYPE_CHECKING, Final

import numpy as np

from sniffer.diagnosis.catalogue import FindingCode
from sniffer.diagnosis.evidence.chances import at_least, may_be_torn, sureness
from sniffer.diagnosis.evidence.left import left_since
from sniffer.diagnosis.evidence.placed import silent
from sniffer.diagnosis.ledger.exchanges import FIRST
from sniffer.diagnosis.model import Finding, Place
from sniffer.ground.distinct import within
from sniffer.ground.model import NEVER_NS
from sniffer.ground.wording import and_

if TYPE_CHECKING:
    from collections.abc import Iterator, Sequence

    from sniffer.diagnosis.case import Case
    from sniffer.diagnosis.ledger.exchanges import Failed
    from sniffer.diagnosis.ledger.silences import Silence
    from sniffer.diagnosis.rules import Rule

FINDINGS: Final = (
    FindingCode(
        "one-question-unanswered",
        "A servo leaves one question unanswered time and again, and answers all others meanwhile.",
        "Two silences or more, of which all but one in ten at most begin with one and the same request, that is a third at most of what it answers (half, where it is said again and no repetition is answered); with sound answers between, so that chance does not choose it. Or questions that it left unanswered each time from a moment on, or ever, six times at least in three silences, and answers all others meanwhile, but for one in fifty of those, so that chance does not choose them. Or a question that nobody ever answered, asked twice and more of one that answers others before it and behind.",
        remedy="Compare the command with the manual of the model (`sniffer explain`); a servo that does what it is told all the same is set to acknowledge less.",
    ),
)

OFTEN: Final = 3
"""Silences that are a habit."""

TWICE: Final = 2
"""Silences from which on chance decides whether they chose a question."""

PLENTY: Final = 6
"""So many times in vain are no chance."""

CHANCE: Final = 1e-3

SAME_QUESTION: Final = 0.9
"""Part of the silences that must begin with one request: of many, another one may get lost, too."""

SELDOM: Final = 1 / 3
"""Who is asked mostly one thing loses mostly that, whatever the reason."""

SELDOM_IN_VAIN: Final = 1 / 2
"""The same where silences do not end with an answer to a repetition: who comes back answers what is asked
just then, and in a storm of retries that is the question that began it."""


def one_question(case: Case) -> Iterator[Finding]:
    """Tell which servos leave one question unanswered: who is away loses whatever is asked then.

    What counts is the request that a silence begins with; who repeats it loses it again.
    """
    exchanges = case.ledger.exchanges
    kind_at = {f.at: f.kind for f in exchanges.failed if f.kind >= 0}
    owner = np.array(exchanges.kinds.servo_id, np.int64)
    for servo in case.answering:
        since = _since_a_moment(case, servo)
        if since is not None:
            yield since
            continue
        runs = [run for run in case.ledger.silences.runs(servo) if run.at in kind_at]
        if len(runs) < TWICE:
            continue
        begins = np.bincount([kind_at[run.at] for run in runs])
        kind, times = int(begins.argmax()), int(begins.max())
        mine = np.flatnonzero(owner == servo)
        answered = {k: exchanges.spans.count(k) for k in {kind, *mine.tolist()}}
        share = (answered.get(kind, 0) + 1) / (sum(answered.values()) + 2)
        if exchanges.count > FIRST:  # the first ones tell what is usual: it may have come later
            said = exchanges.kinds.n
            share = max(share, float(said[kind] / max(said[mine].sum(), 1)))
        chance = at_least(times, len(runs), share)
        most = SELDOM_IN_VAIN if _in_vain(exchanges.failed, servo, runs) else SELDOM
        if times < SAME_QUESTION * len(runs) or share > most or chance > CHANCE:
            continue
        if may_be_torn(case, int(exchanges.kinds.n[kind])):
            continue  # nobody asked that: another request was torn, and the check lets it pass
        if _comes_first(case, servo, kind) and _loses_others(exchanges.failed, servo, kind):
            continue
        which = _question_at(case, next(run for run in runs if kind_at[run.at] == kind))
        told = silent(
            "one-question-unanswered",
            servo,
            runs,
            f"{times} of {len(runs)} outages of servo {servo} begin with one and the same request, "
            f"{which}, which is {share:.0%} of what it answers",
            sureness(chance),
        )
        brief = f"servo {servo} answers all but {which}"
        yield replace(told, places=_unanswered(runs), brief=brief)


def _since_a_moment(case: Case, servo: int) -> Finding | None:
    """Return that a servo answers some questions no more, and all others as before."""
    left = left_since(case, servo)
    if left is None or may_be_torn(case, left.missed):
        return None
    kinds = case.ledger.exchanges.kinds
    words = dict.fromkeys(case.protocol.op_name(kinds.op[k]) for k in left.kinds)
    which = and_([*words]) if len(left.kinds) > 1 else _question(case, left.kinds[0])
    since = "" if left.is_from_the_begin else f" since {case.since(left.runs[0].first_ns)}"
    told = silent(
        "one-question-unanswered",
        servo,
        left.runs,
        f"servo {servo} answers no {which}{since}, {left.missed} of {left.missed}, and "
        f"{left.answered} others meanwhile",
        1.0,
    )
    brief = f"servo {servo} answers all but {which}"
    return replace(told, places=_unanswered(left.runs), brief=brief)


def unknown_question(case: Case) -> Iterator[Finding]:
    """Tell which servos are asked what nobody ever answers, and answer all else."""
    for servo in case.answering:
        vain = case.ledger.silences.in_vain(servo)
        asked = sum(one.missed for one in vain)
        if asked < TWICE or may_be_torn(case, asked):
            continue
        which = _question_at(case, vain[0])
        told = silent(
            "one-question-unanswered",
            servo,
            vain,
            f"servo {servo} is asked {which} {asked} times, which nobody ever answered, and answers "
            "what it is asked before and behind",
            min(asked / PLENTY + SELDOM_IN_VAIN, 1.0),
        )
        brief = f"servo {servo} answers all but {which}"
        yield replace(told, places=_unanswered(vain), brief=brief)


def _question_at(case: Case, one: Silence) -> str:
    """Return the request that a silence begins with, as people are told of it."""
    kind = next((f.kind for f in case.ledger.exchanges.failed if f.at == one.at), -1)
    return "a question" if kind < 0 else _question(case, kind)


def _question(case: Case, kind: int) -> str:
    """Return a kind of request as people are told of it."""
    kinds = case.ledger.exchanges.kinds
    told = kinds.example[kind][:16].hex(" ").upper()
    return f"{case.protocol.op_name(kinds.op[kind])} ({told})"


def _unanswered(runs: Sequence[Silence]) -> tuple[Place, ...]:
    return tuple(
        Place(r.at, r.length, r.first_ns, "the question is left unanswered") for r in runs[:3]
    )


def _comes_first(case: Case, servo: int, kind: int) -> bool:
    """Tell whether most of the time between the requests to a servo is over before one of them.

    Where it is asked several things in one go, whatever begins between begins with the first. What
    it is told without an answer, as goals of LSS are, begins no silence.
    """
    exchanges = case.ledger.exchanges
    mine = [
        k
        for k in np.flatnonzero(np.array(exchanges.kinds.servo_id, np.int64) == servo).tolist()
        if k == kind or exchanges.spans.count(k)
    ]
    before = total = 0
    for t, kinds in exchanges.moments.stretches():
        to_it = within(kinds, mine)
        rest = np.diff(t[to_it])
        total += int(rest.sum())
        before += int(rest[kinds[to_it][1:] == kind].sum())
    return before > SELDOM_IN_VAIN * total


def _loses_others(failed: Sequence[Failed], servo: int, kind: int) -> bool:
    """Tell whether other questions are left unanswered as well: then it is not that one."""
    lost = [f.kind for f in failed if f.servo_id == servo]
    return lost.count(kind) < SAME_QUESTION * len(lost)


def _in_vain(failed: Sequence[Failed], servo: int, runs: Sequence[Silence]) -> bool:
    """Tell whether the request is said again in the silences, and the controller then goes on.

    A silence that ends with an answer to a repetition ends behind a failure that was said again.
    """
    mine = [f for f in failed if f.servo_id == servo]
    vain = known = 0
    for run in runs:
        lost = [f for f in mine if run.at <= f.at and f.t_ns < (run.back_ns or NEVER_NS)]
        if len(lost) == run.missed:  # the later ones may not be kept
            known += 1
            vain += len(lost) > 1 and lost[0].is_again and not lost[-1].is_again
    return vain > OFTEN and vain >= SAME_QUESTION * known


RULES: Final[tuple[Rule, ...]] = (one_question, unknown_question)
"""The rules of this file."""
