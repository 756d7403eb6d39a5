"""What the tap itself does to a capture: losses, wires, echo, one direction only."""

from __future__ import annotations

from typing import TYPE_CHECKING, Final

import numpy as np

from sniffer.diagnosis.catalogue import FindingCode
from sniffer.diagnosis.evidence.placed import finding_of
from sniffer.diagnosis.ledger.damage import IN_REQUEST
from sniffer.diagnosis.model import Finding, Place
from sniffer.diagnosis.physics.comparing import is_altered
from sniffer.ground.codes import NO_RESPONSE
from sniffer.ground.model import MS, MarkKind
from sniffer.ground.wording import counted

if TYPE_CHECKING:
    from collections.abc import Iterator

    from sniffer.diagnosis.case import Case
    from sniffer.diagnosis.rules import Rule

FINDINGS: Final = (
    FindingCode(
        "wires-swapped",
        "Requests come in on the servos' wire and answers on the controller's.",
        "Nearly all frames came in on the wire of the other direction.",
    ),
    FindingCode(
        "said-twice",
        "Every request stands there twice, right behind each other, and none has an answer.",
        "Requests byte for byte as the one before, without a pause between, about as many as others; hardly an answer. Where the host takes two at once, these differ from what was said before them.",
    ),
    FindingCode(
        "echo-differs",
        "On a bus with an echo, what comes back is not what was sent: noise, or somebody spoke into it.",
        "Behind a request stands damage of its length, most of whose bytes are the request's.",
    ),
    FindingCode(
        "nobody-answers",
        "Not one answer was heard in the whole capture.",
        "At least eight requests that must be answered, and no answer.",
        settle="Look whether the robot moves: then servos do answer, and the tap hears one wire of two. Else measure the supply at a servo and see whose cable is in this port; then ping one at each rate.",
    ),
    FindingCode(
        "nobody-asks",
        "Answers were heard, and not one request in the whole capture.",
        "At least eight answers, and no request, torn ones neither.",
    ),
    FindingCode(
        "goes-on-unanswered",
        "Answers are missing here, and the controller goes on as fast as behind those that it gets.",
        "The time to the next request is that of sound exchanges of the same kind, or, where there "
        "are none, shorter than any timeout and long enough for an answer.",
    ),
    FindingCode(
        "waits-in-vain",
        "No servo answers, and the controller waits for each answer as long as it can be due.",
        "The time to the next request is never shorter than the manual's window for an answer. It counts "
        "little more than half where no request is repeated: who asks once a cycle waits as long behind an answer.",
        settle="Measure the supply at a servo, and see whose cable is in this port; then ping one at each rate.",
    ),
    FindingCode(
        "clock-stepped",
        "The stamps of the input step back: times across the step mean nothing.",
        "The decoder's `clock-step` notes.",
    ),
    FindingCode(
        "tap-was-late",
        "The recorder itself came late to read: bytes are older than their stamps.",
        "What the recorder marked (`late-read`).",
    ),
)

SWAPPED: Final = 0.8
"""Share of frames on the wrong wire that no echo and no lost order explains."""

ENOUGH: Final = 8
"""As many as the decoder wants to hear before it says that one side is missing."""

AS_USUAL: Final = 1.25
"""A controller that got its answer goes on within the slowest tenth of its usual times and a bit."""

PIPED: Final = 0.02
"""Part of the answers behind another request, of a controller that goes on without them."""

PROMPT_NS: Final = 8 * MS
"""Timeouts of clients are 10 ms (LSS library) to seconds: who goes on sooner has heard something."""

SHARE: Final = 0.6
"""Share of the exchanges without an answer behind which a controller goes on, where the tap lost
the answers; where nobody answers it waits behind each."""


AGAIN: Final = 3
"""Repeated requests that show that answers are missed."""

ONCE: Final = 0.6
"""How much waits count where nothing is repeated: they may be the pace of the loop. Of two causes that
are as likely then, the one that keeps a robot from moving is named first."""


def wires_swapped(case: Case) -> Iterator[Finding]:
    """Tell of swapped wires once, not with every frame."""
    rows = case.alarm_rows("direction-mismatch")
    wrong = int(case.alarms["n"][rows].sum())
    if wrong < ENOUGH or wrong < SWAPPED * case.ledger.frames:
        return
    yield Finding(
        "wires-swapped",
        None,
        int(case.alarms["t_first"][rows].min()),
        int(case.alarms["t_last"][rows].max()),
        wrong,
        f"{wrong} of {case.ledger.frames} frames came in on the wire of the other direction",
        case.places(case.anomalies("direction-mismatch"), "on the other wire", 2),
        brief="requests on the servos' wire, answers on the controller's",
    )


def said_twice(case: Case) -> Iterator[Finding]:
    """Requests that all stand there twice where no answer proves that it is an echo."""
    exchanges = case.ledger.exchanges
    if not case.has_clock or case.count("adapter-echo"):
        return
    n, doubled = exchanges.silent, exchanges.doubled
    if doubled < 3 * ENOUGH or not 0.48 * n <= doubled <= 0.52 * n:
        return
    if case.total("ok") >= ENOUGH:
        return  # an echo spares no question, and is proved by those that are answered
    if not case.has_prompt_stamps and exchanges.pairs < ENOUGH:
        return  # what is said all the time comes in pairs where the host takes two at once
    yield Finding(
        "said-twice",
        None,
        case.first_ns,
        case.last_ns,
        doubled,
        f"{doubled} of {n} requests are said once more right behind, byte for byte",
        (Place(exchanges.kinds.at[0], 1, case.first_ns, "the first request"),),
        brief="every request stands there twice",
    )


def echo_differs(case: Case) -> Iterator[Finding]:
    """Echoes that are not what was sent."""
    if not case.count("adapter-echo"):
        return
    torn = [d for d in case.damages if d.asked and is_altered(d.got[: len(d.asked)], d.asked)]
    if len(torn) < 2:
        return
    yield finding_of(
        torn,
        "echo-differs",
        None,
        f"{len(torn)} echoes are not what was sent",
        "an echo that differs",
        strength=min(0.5 + len(torn) / 10, 1.0),
        brief="what comes back is not what was sent",
    )


def nobody_answers(case: Case) -> Iterator[Finding]:
    """Requests without any answer: is nobody there, or is the other wire not heard?"""
    missing = case.total("missing")
    if missing < ENOUGH or case.total("ok") or case.total("unsolicited"):
        return
    if case.total("damaged") or case.total("mismatched"):
        return
    servos = [s for s in case.servos if case.total("missing", s)]
    a = case.answers
    first, last = int(a["t_first"].min()), int(a["t_last"].max())
    place = Place(int(a["at"].min()), 1, first, "the first request")
    many = "one servo" if len(servos) == 1 else f"{len(servos)} servos"
    yield Finding(
        "nobody-answers",
        None,
        first,
        last,
        missing,
        f"{missing} requests to {many} that must be answered, and not one answer",
        (place,),
        strength=1.0 if len(servos) > 1 else 0.7,
        brief=f"no answer to {missing} requests to {many}",
    )
    exchanges = case.ledger.exchanges
    waits = exchanges.waited()
    n = int(waits["n"].sum())
    if not case.has_clock or not n or case.latency_ns >= PROMPT_NS:
        return
    hasty = int(waits["hasty"].sum())
    mean_ns = int(waits["wait_sum"].sum()) / n
    at = f"{hasty} of {n} waits for an answer are over before it must have begun"
    if hasty >= SHARE * n and mean_ns < PROMPT_NS:
        yield Finding(
            "goes-on-unanswered",
            None,
            first,
            last,
            hasty,
            f"{at}, after {mean_ns / MS:.2f} ms on average: the controller does hear answers",
            (place,),
            brief=f"the controller goes on after {mean_ns / MS:.1f} ms all the same",
        )
    elif not hasty and int(waits["wait_min"].min()) >= PROMPT_NS:
        yield Finding(
            "waits-in-vain",
            None,
            first,
            last,
            n,
            f"the controller waits {int(waits['wait_min'].min()) / MS:.0f} ms and more behind each of "
            f"{n} requests: it hears no answer either",
            (place,),
            strength=1.0 if exchanges.retried()["n"].sum() >= AGAIN else ONCE,
            brief="the controller waits for each answer in vain",
        )


def nobody_asks(case: Case) -> Iterator[Finding]:
    """Answers without any request."""
    frames = case.ledger.frames
    if frames < ENOUGH or len(case.ledger.exchanges.kinds):
        return
    torn = case.damage["n"][case.damage["turn"] == IN_REQUEST].sum()
    if torn >= SHARE * frames:
        return  # the requests are heard, and none of them holds
    yield Finding(
        "nobody-asks",
        None,
        case.first_ns,
        case.last_ns,
        frames,
        f"{frames} answers of {counted(len(case.servos), 'servo')}, and not one request",
        (Place(int(case.traffic["at"].min()), 1, case.first_ns, "the first answer"),),
        brief=f"{frames} answers without a request",
    )


def goes_on(case: Case) -> Iterator[Finding]:
    """Missing answers behind which the controller goes on as if it had them."""
    exchanges = case.ledger.exchanges
    if not case.has_clock or not case.total("ok"):
        return
    if exchanges.in_flight > PIPED * case.total("ok"):
        return  # it does not wait for answers, whether they come or not
    missing = [f for f in exchanges.failed if f.outcome == NO_RESPONSE]
    judged = usual = 0
    shown = []
    for f in missing:
        least, most = exchanges.turns.at(f.kind, 0.05), exchanges.turns.at(f.kind, 0.9)
        if least is None or most is None or exchanges.turns.count(f.kind) < ENOUGH:
            continue
        # Behind the last request of a cycle the next one comes when it is time, answered or not.
        if f.unsure_ns > least.low / 2 or most.high > PROMPT_NS:
            continue
        judged += 1
        if 0.9 * least.low - f.unsure_ns <= f.wait_ns <= AS_USUAL * most.high + f.unsure_ns:
            usual += not f.is_again
            shown.append(f)
    if usual < 3 or usual < SHARE * judged:
        return
    yield Finding(
        "goes-on-unanswered",
        None,
        shown[0].t_ns,
        shown[-1].t_ns,
        usual,
        f"behind {usual} of {judged} requests whose answers are missing here the next one comes as "
        "soon as behind answers: the controller got them",
        tuple(Place(f.at, f.length, f.t_ns, "no answer here, and no wait") for f in shown[:3]),
        strength=min(0.5 + usual / 10, 1.0),
        brief=f"{usual} answers missing that the controller got",
    )


def clock_stepped(case: Case) -> Iterator[Finding]:
    """Stamps that step back."""
    steps = case.anomalies("clock-step")
    if len(steps):
        yield Finding(
            "clock-stepped",
            None,
            int(steps.t_ns[0]),
            int(steps.t_ns[-1]),
            case.count("clock-step"),
            f"the clock of the input steps back {case.count('clock-step')} times",
            case.places(steps, "the clock steps back", 2),
        )


def tap_was_late(case: Case) -> Iterator[Finding]:
    """Reads that came late."""
    held = case.remarks(MarkKind.HELD)
    if len(held):
        worst = int(held.after.max())
        yield Finding(
            "tap-was-late",
            None,
            int(held.t_ns.min()),
            int(np.max(held.t_ns)),
            len(held),
            f"{len(held)} reads came late, at most by {worst / MS:.0f} ms",
            case.places(held, "read late", 2),
        )


RULES: Final[tuple[Rule, ...]] = (
    wires_swapped,
    said_twice,
    echo_differs,
    nobody_answers,
    nobody_asks,
    goes_on,
    clock_stepped,
    tap_was_late,
)
"""The rules of this area."""
