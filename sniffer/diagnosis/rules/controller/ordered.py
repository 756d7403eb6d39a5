"""Servos that are silent since they were told something."""

from __future__ import annotations

from typing import TYPE_CHECKING, Final, NamedTuple

from sniffer.diagnosis.catalogue import FindingCode
from sniffer.diagnosis.evidence.placed import silent
from sniffer.diagnosis.evidence.told import started_behind, told_to_start
from sniffer.diagnosis.ledger.excused import START_NS
from sniffer.diagnosis.ledger.silences import ENOUGH
from sniffer.diagnosis.model import Finding, Place
from sniffer.ground.model import NS
from sniffer.protocols.base import RESTARTS, ends_goal

if TYPE_CHECKING:
    from collections.abc import Iterator

    from sniffer.diagnosis.case import Case
    from sniffer.diagnosis.ledger.silences import Silence
    from sniffer.diagnosis.rules import Rule

LOOK_IT_UP: Final = (
    "Look up in its manual what the last it was told does (another protocol, a boot loader, its "
    "factory settings with another id or rate), and how it is led back; ping it at other ids and rates."
)

WAIT_LONGER: Final = (
    "Time one start by hand, from the order to the first answer, and wait as long; look why it is told "
    "to start anew at all."
)

FINDINGS: Final = (
    FindingCode(
        "silent-since-an-order",
        "The last that a servo was told before it fell silent for good is something that it is told hardly ever.",
        "Silent to the end, five requests and more; one or two commands to it, said three times at most in the whole capture, in the second before its last answer and the four behind it, the last of which no other question was answered behind, none of them an id or a rate that is given, and none of its questions. A mere restart counts half.",
        remedy=LOOK_IT_UP,
        settle=LOOK_IT_UP,
        concerns="",
    ),
    FindingCode(
        "start-takes-long",
        "A servo is silent from an order to start anew on, for longer than a start takes.",
        "Nine in ten of its silences of three requests and more begin with such an order, and last longer than three seconds, the longest start known of these servos.",
        remedy=WAIT_LONGER,
        settle=WAIT_LONGER,
    ),
    FindingCode(
        "started-when-missing",
        "The controller starts a servo anew whenever an answer of it is missing.",
        "Three silences and more, behind the first request of nine in ten of which the servo is told to start anew before it is asked on.",
    ),
)

SELDOM: Final = 3
"""So often at most it is told what is not of the loop."""

BEFORE_NS: Final = NS
BEHIND_NS: Final = 4 * NS
"""How long before the last answer, and behind it, such a command stands: a start takes up to three."""

SHOWN: Final = 2

RESTART_ALONE: Final = 0.5
"""How much it counts where it was only told to start anew: that ends with its answers, mostly."""


EACH: Final = 0.9
"""Part of its silences that such orders begin, or follow."""

SOME: Final = 3
"""Silences from which on an order behind each is a habit."""


class _LastOrder(NamedTuple):
    """What a servo was told: when, the command, its bytes and its place."""

    t_ns: int
    op: int
    data: bytes
    at: int


def silent_since_an_order(case: Case) -> Iterator[Finding]:
    """Find what servos were told last that never answered since."""
    named = {*case.anomalies("id-changed", "baud-changed").at.tolist()}
    restarts = {op for op, kind in ends_goal(case.protocol).items() if kind == RESTARTS}
    for servo in case.answering:
        silent = next((s for s in case.ledger.silences.of(servo) if s.back_ns is None), None)
        if silent is None or silent.missed < ENOUGH:
            continue
        orders = _orders(case, servo, silent)
        if not orders or any(one.at in named for one in orders):
            continue
        orders = orders[-SHOWN:]
        if orders[-1].t_ns < silent.before_ns:
            continue  # it answered the loop's questions behind it
        told = " and ".join(
            f"{case.protocol.op_name(one.op)} ({one.data[:16].hex(' ').upper()}) at "
            f"{case.since(one.t_ns)}"
            for one in orders
        )
        yield Finding(
            "silent-since-an-order",
            servo,
            orders[0].t_ns,
            case.last_ns,
            silent.missed,
            f"the last that servo {servo} was told before it fell silent for good is {told}",
            tuple(Place(o.at, len(o.data), o.t_ns, "the last it was told") for o in orders),
            strength=RESTART_ALONE if all(o.op in restarts for o in orders) else 1.0,
            brief=f"servo {servo} is told {case.protocol.op_name(orders[-1].op)}",
        )


def _orders(case: Case, servo: int, silent: Silence) -> list[_LastOrder]:
    """Return what a servo was told around its last answer that it is told hardly ever, in order."""
    kinds = case.ledger.exchanges.kinds
    since, until = silent.before_ns - BEFORE_NS, silent.before_ns + BEHIND_NS
    asked = next((f.kind for f in case.ledger.exchanges.failed if f.at == silent.at), -1)
    rows = [
        k
        for k, (who, n, t) in enumerate(
            zip(kinds.servo_id, kinds.n.tolist(), kinds.t_last.tolist(), strict=True)
        )
        if who == servo and n <= SELDOM and since <= t <= min(until, silent.first_ns) and k != asked
    ]
    found = [
        _LastOrder(int(kinds.t_last[k]), kinds.op[k], kinds.example[k], kinds.at[k]) for k in rows
    ]
    return sorted(found)


def start_takes_long(case: Case) -> Iterator[Finding]:
    """Find servos that are away behind orders to start anew, and for longer than that takes."""
    for servo in case.answering if case.has_clock else ():
        away = [s for s in case.ledger.silences.of(servo) if s.back_ns is not None]
        slow = [s for s in told_to_start(case, servo, away) if s.lasted_ns > START_NS]
        if slow and len(slow) >= EACH * len(away):
            longest = max(s.lasted_ns for s in slow) / NS
            what = f"servo {servo} is told to start anew, and answers again {longest:.1f} s behind that"
            if len(slow) > 1:
                what += f" at most, {len(slow)} times"
            yield silent("start-takes-long", servo, slow, what, 1.0)


def started_when_missing(case: Case) -> Iterator[Finding]:
    """Find servos that are told to start anew whenever they leave a request without an answer."""
    for servo in case.answering:
        runs = case.ledger.silences.runs(servo)
        told = started_behind(case, servo, runs)
        if len(told) >= max(SOME, EACH * len(runs)):
            what = (
                f"behind {len(told)} of {len(runs)} requests that servo {servo} leaves without an "
                "answer it is told to start anew"
            )
            yield silent("started-when-missing", servo, told, what, 1.0)


RULES: Final[tuple[Rule, ...]] = (
    silent_since_an_order,
    start_takes_long,
    started_when_missing,
)
"""The rules of this file."""
