"""Requests that were said into torn answers, by how long the controller then waited: twice.

Who goes on after one time, whatever comes, lets it pass twice where the next request is said into
the answer: once before that request, and once behind it. Where two answers of one servo lie over
each other no request is missing, and it waits as long as ever::

    request to 3    5.5 ms    torn: answer of 3, request to 4    5.4 ms    request to 1
    request to 3    torn: two answers                            5.4 ms    request to 4

The order of requests says the same where the one that is missing is whole now and then; one that
is never heard is in no order.
"""

from __future__ import annotations

from typing import TYPE_CHECKING, Final

from sniffer.diagnosis.evidence.overdue import overdue
from sniffer.diagnosis.evidence.overlying import lies_over
from sniffer.diagnosis.evidence.twins import twins
from sniffer.diagnosis.ledger.damage import IN_REPLY
from sniffer.diagnosis.model import Finding, Place
from sniffer.diagnosis.rules.controller.patience import KNOWN, ONE_TIME, WAITED_NS
from sniffer.ground.codes import DAMAGED, NO_RESPONSE
from sniffer.ground.medians import median, quantile
from sniffer.ground.model import MS

if TYPE_CHECKING:
    from collections.abc import Iterable, Iterator, Sequence

    from sniffer.diagnosis.case import Case
    from sniffer.diagnosis.catalogue import FindingCode
    from sniffer.diagnosis.ledger.exchanges import Failed
    from sniffer.diagnosis.rules import Rule

FINDINGS: Final[tuple[FindingCode, ...]] = ()

LEAST: Final = 8
"""Torn answers that show it: a pulse may tear a request as well, now and then."""

SHARE: Final = 0.6
"""Part of the torn answers behind which a request must be missing."""

LATER: Final = 3.0
LATER_NS: Final = 1_000_000
"""So many times as late as what others take, and by so much, no peer of theirs begins to answer."""

SHORT: Final = 2
"""Bytes that two at once may lack, or have more than their time holds."""

BY_BEGIN: Final = 0.8
"""How much it counts where the one time is told by when the torn bytes come, not by other waits."""

UNSURE: Final = 0.5
"""How much late answers count where a servo that is not there and a fault of the next one look so."""


def waits_twice(case: Case) -> Iterator[Finding]:
    """Torn answers behind which the controller waits as long as for two requests."""
    if not case.has_prompt_stamps:
        return
    torn, waited = _torn(case), _one_waits(case)
    for servo in sorted({t.failed.servo_id for t in torn}):
        mine = [t for t in torn if t.failed.servo_id == servo]
        told = [([t for t in mine if t.holds(ns, ns)], 1.0) for ns in waited]
        told.append((_late(mine, _usual_ns(case, servo)), BY_BEGIN))
        shown, sure = max(told, key=lambda one: len(one[0]) * one[1])
        if len(shown) >= max(LEAST, SHARE * len(mine)):
            yield _finding(mine, shown, sure)


def lain_over(case: Case) -> Iterator[Finding]:
    """Whatever is torn stands behind requests to one servo, whose answers are overdue."""
    late = overdue(case)
    if late is None or any(t.mixed and t.over < 0 for t in twins(case).values()):
        return  # or bytes prove that two of one id lie over each other
    servo, a = late.servo_id, case.answers
    is_sure = late.is_sure or lies_over(case) == servo
    yield Finding(
        "torn-behind-unanswered",
        None,
        int(a["t_first"][a["servo_id"] == servo].min()),
        late.places[-1].t_ns,
        len(late.places),
        f"{len(late.places)} torn places stand behind requests to servo {servo} that were waited with "
        "in vain, and hardly any elsewhere: its answers come later",
        tuple(Place(d.at, d.length, d.t_ns, "an answer before comes now") for d in late.places[:3]),
        strength=min(0.6 + len(late.places) / 50, 1.0) * (1.0 if is_sure else UNSURE),
        brief=f"late answers of servo {servo} lie over what follows",
        befell=(servo,) if is_sure else (),
    )


class _Torn:
    """A torn answer: its exchange, and when it began and was over behind the request."""

    def __init__(self, failed: Failed, begins_ns: int, ends_ns: int, byte_ns: int) -> None:
        self.failed = failed
        self.begins_ns = begins_ns
        self.ends_ns = ends_ns
        self.request_ns = failed.length * byte_ns

    def holds(self, least_ns: int, most_ns: int) -> bool:
        """Tell whether a request was said within it, and waited behind for the same time.

        That time is ``least_ns`` to ``most_ns``.
        """
        if most_ns + self.request_ns < self.begins_ns or least_ns > self.ends_ns:
            return False
        vary = ONE_TIME * least_ns + self.failed.unsure_ns
        wait = self.failed.wait_ns - self.request_ns
        return 2 * least_ns - vary <= wait <= 2 * most_ns + vary


def _torn(case: Case) -> list[_Torn]:
    """Return the torn answers in which no byte is missing."""
    byte_ns = case.ledger.byte_ns
    torn = {d.at: d for d in case.damages if d.turn == IN_REPLY and d.begins_ns >= 0}
    out = []
    for f in case.ledger.exchanges.failed:
        d = torn.get(f.at + f.length) if f.outcome == DAMAGED else None
        if d is None or d.length + SHORT < len(d.expected):
            continue
        if d.t_ns - d.begins_ns <= (d.length + SHORT) * byte_ns + case.latency_ns:
            out.append(_Torn(f, d.begins_ns - f.t_ns, d.t_ns - f.t_ns, byte_ns))
    return out


def _one_waits(case: Case) -> Iterable[int]:
    """Yield the times after which this controller may always go on, in ns.

    Behind what is not answered it waits for one; who sleeps behind each request goes on after
    one behind answers, too.
    """
    exchanges = case.ledger.exchanges
    turns = exchanges.turns
    spans = [(turns.at(k, 0.1), turns.at(k, 0.9)) for k in turns.keys if turns.count(k) >= KNOWN]
    for waits in (
        [f.wait_ns for f in exchanges.failed if f.outcome == NO_RESPONSE],
        [bounds.low for span in spans for bounds in span if bounds is not None],
    ):
        low, middle, high = quantile(waits or [0], (0.1, 0.5, 0.9)).tolist()
        if len(waits) >= KNOWN and middle >= WAITED_NS and high - low <= ONE_TIME * middle:
            yield int(middle)


def _late(torn: Sequence[_Torn], usual_ns: float) -> list[_Torn]:
    """Return those that come far later than others answer, and behind which it is as long again."""
    low, high = quantile([t.failed.wait_ns for t in torn], (0.1, 0.9)).tolist()
    if not usual_ns or high - low > ONE_TIME * low:
        return []
    late = [t for t in torn if t.begins_ns >= LATER * usual_ns + LATER_NS]
    return [t for t in late if t.holds(t.begins_ns - t.request_ns, t.ends_ns)]


def _usual_ns(case: Case, servo: int) -> float:
    """Return after how long the slowest of the others usually begins to answer; 0: none does."""
    a = case.answers
    others = [s for s in case.answering if s != servo]
    took = [
        int(a["took_sum"][rows].sum()) / n
        for rows in (a["servo_id"] == s for s in others)
        if (n := int(a["took_n"][rows].sum())) >= KNOWN
    ]
    return max(took, default=0.0)


def _finding(judged: Sequence[_Torn], shown: Sequence[_Torn], sure: float) -> Finding:
    """Return the finding of a servo's torn answers, with how long was waited behind them."""
    waited = float(median([t.failed.wait_ns for t in shown])) / MS
    came = float(median([t.begins_ns for t in shown])) / MS
    return Finding(
        "request-swallowed",
        None,
        shown[0].failed.t_ns,
        shown[-1].failed.t_ns,
        len(shown),
        f"behind {len(shown)} of {len(judged)} torn answers, which come {came:.1f} ms behind their "
        f"request, the controller waits {waited:.1f} ms, as long as for two requests",
        tuple(
            Place(t.failed.at, t.failed.length, t.failed.t_ns, "behind its answer one is missing")
            for t in shown[:3]
        ),
        strength=min(0.5 + len(shown) / 10, 1.0) * sure,
        brief="requests are missing behind torn answers",
    )


RULES: Final[tuple[Rule, ...]] = (waits_twice, lain_over)
"""The rules of this area."""
