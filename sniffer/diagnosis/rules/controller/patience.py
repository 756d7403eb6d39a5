"""How a controller waits: not long enough, again and again, or for nobody."""

from __future__ import annotations

from collections import Counter
from typing import TYPE_CHECKING, Final

import numpy as np

from sniffer.diagnosis.catalogue import FindingCode
from sniffer.diagnosis.evidence.placed import finding_of
from sniffer.diagnosis.evidence.twins import late_answers
from sniffer.diagnosis.ledger.damage import IN_REPLY
from sniffer.diagnosis.model import Finding, Place
from sniffer.ground.codes import DAMAGED, NO_RESPONSE
from sniffer.ground.distinct import numbers
from sniffer.ground.medians import median, quantile
from sniffer.ground.model import MS, NEVER_NS, NS

if TYPE_CHECKING:
    from collections.abc import Iterator

    from sniffer.diagnosis.case import Case
    from sniffer.diagnosis.rules import Rule

FINDINGS: Final = (
    FindingCode(
        "hasty-request",
        "The next request comes before the answer to the last one can be over.",
        "The time from a request without a good answer to the next one, against the shortest time in which sound answers to such requests are over, less what the stamps leave open.",
    ),
    FindingCode(
        "answers-after-next",
        "Answers come when the controller has asked something else already.",
        "`late-response` for requests behind which the next one came within the manual's window; or answers that come behind the next request time and again, each of which was waited with; or torn ones that begin as that of the servo asked right before, whose own place is empty.",
    ),
    FindingCode(
        "gives-up-early",
        "The controller goes on after one time without an answer, and answers come behind that.",
        "Whole answers behind the next request, one in fifty and more, and twenty requests without one: the median wait of both is the same, 1.5 ms at least, and varies by no more than a quarter and what the stamps leave open. Not where lines hold with altered ids: half as many answers, and more, of servos that were not asked.",
    ),
    FindingCode(
        "torn-behind-unanswered",
        "Answers are torn right behind requests that had none: the one that comes late lies over the next.",
        "Ten torn answers and more, and three fifths of all, follow a request that was given up after one time, of two servos and more which mostly answer; and hardly two requests in a row have none. Or nine in ten of all torn places stand behind requests in vain to one servo that hardly ever answers in time.",
    ),
    FindingCode(
        "absent-costs",
        "Asking a servo that never answers takes a share of all time.",
        "The waits behind all requests to a servo that never answered.",
    ),
)

KNOWN: Final = 5
"""Sound exchanges of a kind that say how long one takes."""

ENOUGH: Final = 2
"""One may be a stamp that is off."""

PIPED: Final = 0.02
"""Share of answers behind another request from which on a controller does so by plan, or always."""

WAITED_NS: Final = 1_500_000
"""A program that asks several at once sends its requests one behind the other; who lets so much time
pass has waited."""

HABIT: Final = 20
"""Requests of a kind that show whether it is asked together with others by plan."""

ONE_TIME: Final = 0.25
"""Part of a time by which it may vary and be one: a timeout, and what a program does beside."""

PART_TORN: Final = 0.2
"""Share of failed exchanges that show a cause; what fewer show may look so by chance."""

COLLIDED, SO_TORN, IN_ROW = 10, 0.6, 0.1
"""Torn answers behind requests that had none, their part of all torn ones, and the part of such requests
that may follow each other, as they do in moments in which a line or a supply fails."""

ALTERED: Final = 0.5
"""As many answers of who was not asked, for each that comes late, show that ids are altered."""

OVERLAPS: Final = 3
"""Times that are no rounding."""


PART: Final = 0.05
"""Part of the time that a storm takes, or of all requests that are repetitions."""


def hasty(case: Case) -> Iterator[Finding]:
    """Requests that come before the answer can be over."""
    if not case.has_clock or not case.total("ok"):
        return
    exchanges = case.ledger.exchanges
    known = _shortest(case)
    if exchanges.in_flight > PIPED * case.total("ok"):
        return  # it asks several at once, and they answer in turn
    failed = [f for f in exchanges.failed if f.outcome in (NO_RESPONSE, DAMAGED)]
    echo = case.anomalies("adapter-echo").t_ns[:1]  # until it is known, it is taken for a request
    judged = [f for f in failed if f.kind in known and not (f.t_ns <= echo).any()]
    shown = [f for f in judged if f.wait_ns + f.unsure_ns < known[f.kind]]
    if len(shown) < max(ENOUGH, PART_TORN * len(judged)):
        return
    most = max(f.wait_ns for f in shown)
    least_ns = min(known[f.kind] for f in shown)
    yield Finding(
        "hasty-request",
        None,
        shown[0].t_ns,
        shown[-1].t_ns,
        len(shown),
        f"{len(shown)} of {len(judged)} requests whose answers failed are followed by the next one within "
        f"{most / MS:.2f} ms, and an answer takes at least {least_ns / MS:.2f} ms",
        tuple(Place(f.at, f.length, f.t_ns, "the next request comes too soon") for f in shown[:3]),
        strength=min(0.5 + len(shown) / 10, 1.0),
        brief=f"requests within {most / MS:.1f} ms of the last one",
    )


def hurried(case: Case) -> Iterator[Finding]:
    """Requests that come before the answer to the last one, behind some wait for it."""
    exchanges = case.ledger.exchanges
    waited = exchanges.hurried.at(0, 0.5)
    n = exchanges.in_flight - exchanges.overlaps
    if not case.has_clock or waited is None or n < OVERLAPS or case.count("adapter-echo"):
        return
    early, said = exchanges.early, exchanges.kinds.n
    share = early / np.maximum(said[: len(early)], 1)
    # Who asks several at once by plan does not wait first; who does it now and then, with other
    # requests each time, may do it by plan, too.
    is_habit = bool((share[said[: len(early)] >= HABIT] > 0.5).any())
    has_waited = waited.low - case.latency_ns >= WAITED_NS
    if not (is_habit and has_waited and n > PIPED * case.total("ok")):
        return
    worst = int(early.argmax())
    servos = {exchanges.kinds.servo_id[k] for k in np.flatnonzero(early).tolist()}
    whose = f" (all of servo {min(servos)})" if len(servos) == 1 < len(case.answering) else ""
    yield Finding(
        "answers-after-next",
        None,
        case.first_ns,
        case.last_ns,
        n,
        f"{n} of {case.total('ok')} answers{whose} come behind the next request, which comes "
        f"{waited.low / MS:.1f} ms behind the one that they answer",
        (Place(exchanges.kinds.at[worst], 1, exchanges.kinds.t_first[worst], "such a request"),),
        strength=min(0.5 + n / 50, 1.0),
        brief=f"answers{whose} come behind the next request, {waited.low / MS:.1f} ms later",
    )


def after_next(case: Case) -> Iterator[Finding]:
    """Answers that come when the controller has gone on."""
    if not case.has_clock:
        return
    rows = case.alarm_rows("late-response")
    exchanges, known = case.ledger.exchanges, _shortest(case)
    waits = exchanges.waited()
    for servo in numbers(case.alarms["servo_id"][rows]).tolist():
        mine = rows[case.alarms["servo_id"][rows] == servo]
        late = int(case.alarms["n"][mine].sum())
        failed = [f for f in exchanges.failed if f.servo_id == servo]
        hasty = sum(f.wait_ns + f.unsure_ns < known.get(f.kind, 0) for f in failed)
        if not any(f.kind in known for f in failed):  # it never answers in time
            hasty = int(waits["hasty"][waits["servo_id"] == servo].sum())
        if late < ENOUGH or 2 * hasty < late:
            continue
        yield Finding(
            "answers-after-next",
            servo,
            int(case.alarms["t_first"][mine].min()),
            int(case.alarms["t_last"][mine].max()),
            late,
            f"{late} answers of servo {servo} come behind the next request, which did not wait for "
            f"them ({hasty} times)",
            case.places(
                case.anomalies("late-response", servo_id=servo), "an answer behind the next"
            ),
            strength=min(0.5 + late / 20, 1.0),
            brief=f"answers of servo {servo} come behind the next request",
        )


def gives_up(case: Case) -> Iterator[Finding]:
    """A controller that goes on after one time whatever does not come, and answers that exceed it.

    What comes whole behind the next request, and what never does, were waited for equally long:
    another controller's requests would come after any time, and who asks several at once by plan
    lets no answer fail.
    """
    exchanges = case.ledger.exchanges
    failed = [f for f in exchanges.failed if f.outcome == NO_RESPONSE]
    waited = exchanges.hurried.at(0, 0.5)
    n = exchanges.in_flight - exchanges.overlaps
    if not case.has_clock or waited is None or len(failed) < HABIT or n <= PIPED * case.total("ok"):
        return
    of_nobody = case.count("mismatched-response", "unsolicited-response")
    if not case.has_checksum and of_nobody >= ALTERED * n:  # altered ids: some are whose is awaited
        return
    low, middle, high = quantile([f.wait_ns for f in failed], (0.1, 0.5, 0.9)).tolist()
    unsure = float(median([f.unsure_ns for f in failed]))
    vary = ONE_TIME * middle + unsure
    is_one = high - low <= vary and abs(waited.low - middle) <= vary and 2 * unsure <= middle
    if not is_one or middle - case.latency_ns < WAITED_NS:
        return
    yield Finding(
        "gives-up-early",
        None,
        failed[0].t_ns,
        failed[-1].t_ns,
        n,
        f"{n} answers come behind the next request, and as long as those requests waited, "
        f"{middle / MS:.1f} ms, waited {len(failed)} without an answer",
        tuple(Place(f.at, f.length, f.t_ns, "the next request comes then") for f in failed[:3]),
        strength=min(0.5 + n / 50, 1.0),
        brief=f"the controller waits {middle / MS:.1f} ms, and answers come later",
    )


def torn_behind(case: Case) -> Iterator[Finding]:
    """Torn answers behind requests that were given up: two lie over each other.

    What tears answers for itself does not look whether the one before came.
    """
    failed = case.ledger.exchanges.failed
    vain = {f.at + f.length: f for f in failed if f.outcome == NO_RESPONSE}
    torn = [f for f in failed if f.outcome == DAMAGED]
    behind = [f for f in torn if f.at in vain]
    in_row = sum(f.at in vain for f in vain.values())
    if len(behind) < max(COLLIDED, SO_TORN * len(torn)) or in_row > IN_ROW * len(vain):
        return
    before = [vain[f.at] for f in behind]
    late = Counter(f.servo_id for f in before)
    if min(len(late), len({f.servo_id for f in behind})) < ENOUGH:
        return
    if any(case.total("ok", servo) < n for servo, n in late.items()):
        return  # who hardly ever answers is not there
    low, middle, high = quantile([f.wait_ns for f in before], (0.1, 0.5, 0.9)).tolist()
    unsure = float(median([f.unsure_ns for f in before]))
    if case.has_clock and high - low > ONE_TIME * middle + unsure:
        return  # another controller's requests come after any time
    waited = f" for {middle / MS:.1f} ms" if case.has_clock else ""
    yield Finding(
        "torn-behind-unanswered",
        None,
        before[0].t_ns,
        behind[-1].t_ns,
        len(behind),
        f"{len(behind)} of {len(torn)} torn answers follow a request that was waited with in vain{waited}, "
        f"and of {len(vain)} such requests {in_row} follow another one",
        tuple(Place(f.at, f.length, f.t_ns, "the answer before comes now") for f in behind[:3]),
        strength=min(0.6 + len(behind) / 50, 1.0),
        brief="late answers lie over the next ones",
    )


def belated(case: Case) -> Iterator[Finding]:
    """Answers in the place of the next one's, to a controller that did not wait for them."""
    waits = case.ledger.exchanges.waited()
    late = late_answers(case)
    hasty = {
        servo: int(waits["hasty"][waits["servo_id"] == servo].sum())
        for servo in {d.earlier_id for d in late}
    }
    late = [d for d in late if case.has_clock and 2 * hasty[d.earlier_id] >= HABIT]
    if len(late) < max(OVERLAPS, PART_TORN * sum(d.turn == IN_REPLY for d in case.damages)):
        return
    yield finding_of(
        late,
        "answers-after-next",
        None,
        f"{len(late)} torn answers begin as that of the servo asked before, whose request had none, and "
        "the next one came before it was due",
        "the answer to the request before",
        strength=min(0.5 + len(late) / 20, 1.0),
        brief="answers come behind the next request",
    )


def _shortest(case: Case) -> dict[int, int]:
    """Return the shortest time, in ns, within which sound answers are over, by kind of request."""
    spans = case.ledger.exchanges.spans
    least = {k: spans.at(k, 0.02) for k in spans.keys if spans.count(k) >= KNOWN}
    return {k: bounds.low for k, bounds in least.items() if bounds is not None}


def absent_costs(case: Case) -> Iterator[Finding]:
    """What asking servos costs that never answer."""
    if not case.has_clock or not case.answering:
        return
    waits = case.ledger.exchanges.waited()
    for servo in case.servos:
        rows = np.flatnonzero((waits["servo_id"] == servo) & (waits["outcome"] == NO_RESPONSE))
        n = int(waits["n"][rows].sum())
        # Behind the last request of a cycle the controller rests as well: the shortest wait counts.
        took = n * int(waits["wait_min"][rows].min(initial=NEVER_NS)) if n else 0
        share = took / max(case.last_ns - case.first_ns, 1)
        if servo in case.ledger.silences.heard or n < 5 or share < PART:
            continue
        yield Finding(
            "absent-costs",
            servo,
            int(waits["t_first"][rows].min()),
            int(waits["t_last"][rows].max()),
            n,
            f"waiting for servo {servo}, which never answers, takes {took / NS:.2f} s, {share:.0%} of "
            "the time",
            strength=min(2 * share + 0.5, 1.0),
            brief=f"waiting for servo {servo} takes {share:.0%} of the time",
            values=(("share", share),),
        )


RULES: Final[tuple[Rule, ...]] = (
    hasty,
    hurried,
    after_next,
    gives_up,
    torn_behind,
    belated,
    absent_costs,
)
"""The rules of this area."""
