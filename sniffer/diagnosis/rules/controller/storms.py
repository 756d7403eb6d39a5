"""Requests said again and again, while the others wait."""

from __future__ import annotations

from typing import TYPE_CHECKING, Final

import numpy as np

from sniffer.diagnosis.catalogue import FindingCode
from sniffer.diagnosis.ledger.kinds import KINDS
from sniffer.diagnosis.model import Finding, Place
from sniffer.diagnosis.rules.controller.patience import KNOWN, PART
from sniffer.ground.model import NS

if TYPE_CHECKING:
    from collections.abc import Iterator

    from sniffer.diagnosis.case import Case
    from sniffer.diagnosis.ledger.exchanges import Run
    from sniffer.diagnosis.rules import Rule

FINDINGS: Final = (
    FindingCode(
        "retry-storm",
        "A request that is not answered is said many times in a row, and the others wait.",
        "Runs of the same request, byte for byte, without an answer between, of five and more, on a bus whose controller else asks in turn, and goes on to another request where that one is answered; and the share of the time that they take. Not where no answer at all is heard, nor before anything else is asked, as by a program that waits for power.",
    ),
)

SELDOM_NS: Final = NS // 2
"""Who asks no oftener leaves the line to others, and looks whether a servo is back."""

STORM: Final = 4
"""Repetitions that no usual client makes: libraries try three times at most."""

ENDLESS: Final = 12
"""One row of so many is a storm, however short it is in the whole."""


def retry_storms(case: Case) -> Iterator[Finding]:
    """Requests said again and again."""
    exchanges = case.ledger.exchanges
    # A program that waits for power at its start keeps nobody waiting: it has asked nothing else.
    began = int(min(exchanges.kinds.at, default=0))
    storms = [run for run in exchanges.all_runs if run.again >= STORM and run.at > began]
    storms = [run for run in storms if not case.has_clock or not _is_watch(run)]
    if not storms or case.count("adapter-echo") or not case.answering:
        return  # where nobody is heard, nobody knows what was answered
    repeated = _repeated(case)
    storms = [run for run in storms if run.kind not in repeated]
    if not storms:
        return
    kinds = exchanges.kinds
    busiest = int(kinds.n.max(initial=0))
    # A controller with one thing to ask repeats it anyway.
    others = [k for k in range(len(kinds)) if kinds.n[k] * 20 >= busiest and kinds.n[k] >= STORM]
    if len(others) < 2:
        return
    retried = exchanges.retried()
    total = int(retried["n"].sum())
    took = sum(run.until_ns - run.t_ns for run in storms)
    seconds = max(case.last_ns - case.first_ns, 1)
    share = took / seconds if case.has_clock else total / max(exchanges.count, 1)
    longest = max(storms, key=lambda run: run.again)
    if share < PART and len(storms) < 3 and longest.again < ENDLESS:
        return
    servos = sorted({run.servo_id for run in storms})
    yield Finding(
        "retry-storm",
        servos[0] if len(servos) == 1 else None,
        storms[0].t_ns,
        storms[-1].until_ns,
        len(storms),
        f"{len(storms)} times the same request {STORM + 1} times in a row and more, at most "
        f"{longest.again + 1} times (servo {longest.servo_id}), {share:.0%} of "
        + ("the time" if case.has_clock else "all requests"),
        tuple(
            Place(run.at, run.length, run.t_ns, f"said {run.again + 1} times in a row")
            for run in storms[:3]
        ),
        strength=min(0.7 + len(storms) / 10, 1.0),
        brief=f"one request {longest.again + 1} times in a row",
        values=(("share", share), ("retries", total)),
    )


def _is_watch(run: Run) -> bool:
    """Tell whether a request comes so seldom that nobody waits: somebody looks whether a servo is back."""
    return run.until_ns - run.t_ns >= SELDOM_NS * run.again


def _repeated(case: Case) -> set[int]:
    """Return the kinds of requests that are mostly made again although they are answered.

    Who asks a joint whether it moves still, asks that again until it does not: those are no retries.
    """
    f = case.ledger.exchanges.followers()
    all_n, same = np.zeros((2, KINDS + 1), np.int64)
    np.add.at(all_n, f["kind"], f["n"])
    np.add.at(same, f["kind"], f["n"] * (f["kind"] == f["next"]))
    return set(np.flatnonzero((2 * same >= all_n) & (all_n >= KNOWN)).tolist())


RULES: Final[tuple[Rule, ...]] = (retry_storms,)
"""The rules of this file."""
