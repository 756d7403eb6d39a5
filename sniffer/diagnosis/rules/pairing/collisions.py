"""Two that speak at once: twins that share an id."""

from __future__ import annotations

from collections import Counter
from typing import TYPE_CHECKING, Final

import numpy as np

from sniffer.diagnosis.catalogue import FindingCode
from sniffer.diagnosis.evidence.hit import torn_answers
from sniffer.diagnosis.evidence.intruders import torn_requests
from sniffer.diagnosis.evidence.overdue import is_overdue
from sniffer.diagnosis.evidence.overlying import lies_over
from sniffer.diagnosis.evidence.placed import finding_of
from sniffer.diagnosis.evidence.stamps import EXACT_NS
from sniffer.diagnosis.evidence.swallowing import swallowing
from sniffer.diagnosis.evidence.twins import LEAST, PART, torn_by_twins, twins
from sniffer.diagnosis.ledger.damage import IN_REPLY, IN_REQUEST
from sniffer.diagnosis.model import Finding, Place
from sniffer.diagnosis.physics.misread import BITS_FEW, FRONT
from sniffer.diagnosis.rules.pairing.bare import said_by_another
from sniffer.ground.model import MarkKind

if TYPE_CHECKING:
    from collections.abc import Iterator

    from sniffer.diagnosis.case import Case
    from sniffer.diagnosis.ledger.damage import Damage
    from sniffer.diagnosis.rules import Rule

FINDINGS: Final = (
    FindingCode(
        "answers-twice",
        "A servo answers twice: one answer torn and one whole behind the same request, or two whole ones, "
        "or torn bytes at others' turn that come a steady time behind its requests, or all that is torn "
        "stands behind its exchanges in the order of the bus.",
        "Three such requests or more, and one in fifty of its answers. Torn bytes are whose requests they "
        "follow most steadily (stamps of a millisecond or better); where nothing else shows a second answer, "
        "ten of them or more, and far more steadily than behind any other's. By order, which needs no times: "
        "nine in ten torn places, ten requests among them, stand behind its answer or the one after it, a "
        "tenth of them behind no other's, or three second answers say that they are its own, whole or by three "
        "bytes of their beginning within what is torn; it has not much more than half of the exchanges, and its "
        "answers have a checksum.",
    ),
    FindingCode(
        "second-answers-whole",
        "A servo answers twice time and again, and both answers are whole.",
        "Twenty second answers of one servo that are whole and name it, three times as many as there are torn places in all, and behind a third of its exchanges: who speaks into answers tears them, who speaks now and then says less.",
    ),
    FindingCode(
        "several-answer-twice",
        "Several servos answer twice now and then, and none of them mostly.",
        "Two servos and more with three whole second answers each, behind at most a tenth of their exchanges, and as many torn requests: a second servo would answer each request, and tears less.",
    ),
    FindingCode(
        "answers-mixed",
        "Torn answers of a servo are two of its answers at once, some bits apart, or lie over those of the servo asked next.",
        "The bytes with which its answers always begin, laid over themselves some bits later (AND, OR), are what a UART made of at least three torn answers, and of a quarter of them. Those of the servo asked before are told where its beginning laid over theirs makes more of them: of places that only one of the two makes, half would be either's.",
    ),
    FindingCode(
        "stop-bits-held-low",
        "Answers of a servo lack the byte behind one that has no stop bit, and whose last bit is low: the "
        "line was held low, and no clock does that.",
        "Six such answers of one servo at least, by the tap's own line errors, nine in ten of those that are "
        "short, a quarter of its torn ones, and ten times as many as answers of others are torn. A clock that is slow has its stop "
        "bits late, and the next byte begins as it should; one that is fast has them read as last bits.",
    ),
    FindingCode(
        "answers-always-torn",
        "Hardly an answer of a servo is whole, and none is missing, while others are sound.",
        "At least eight answers, of which nine in ten are torn (seven where there is no checksum) and one in ten at most is missing; no clock, no single bit and no lost first byte explains it.",
    ),
)

CROSSED: Final = 0.3
"""How much it counts that requests behind a servo's exchanges are torn, and nothing else is told: what
a clock that is off, or a driver that comes on late, makes of its one answer lies over them as well."""

NOW_AND_THEN: Final = 0.1
"""Part of a servo's exchanges in which it may answer twice without a twin: who answers each request
is heard oftener, but for what collides."""

WHOLE: Final = 20
WHOLE_TIMES: Final = 3
"""Second answers that are whole, and how many times as many they are as torn places: what tears
answers, and another one behind it, leaves no more of them than it tears."""

MANY: Final = 1 / 3
"""Part of a servo's exchanges behind which they stand: who speaks now and then has fewer."""

ALWAYS: Final = 8
NEARLY: Final = 0.9
MOSTLY: Final = 0.7
"""How many torn answers, and which part of all, are always; the latter where no checksum tells: two
lines of digits that lie over each other are a line of digits now and then."""

FEW: Final = 0.1
"""Part of the answers of others that may be torn, and of a servo's own that may be missing."""

HELD_LOW: Final = 6
CLEARLY: Final = 0.9
"""How many answers that lack a byte behind a missing stop bit, and which part of the short ones."""

HIGH_LAST: Final = 0x80
"""The last bit of a byte."""

PLAIN: Final = 0.5
"""Part of the torn answers that single bits, or lost first bytes, may explain."""


def answers_twice(case: Case) -> Iterator[Finding]:
    """Find servos of which two answers come."""
    for servo, twin in twins(case).items():
        if twin.twice < LEAST or servo == said_by_another(case):
            continue
        told = [
            f"{n} times {what}"
            for n, what in (
                (twin.whole, "two whole answers to one request"),
                (len(twin.torn), "a torn answer before a whole one"),
                (len(twin.stray), "stray bytes behind its exchanges and nobody else's"),
                (len(twin.crossed), "a torn request behind its exchanges"),
                (len(twin.foreign), "the beginning of its answer where another's is due"),
                (len(twin.behind), "torn bytes a steady time behind its requests, at others' turn"),
            )
            if n
        ]
        torn = [*twin.torn, *twin.stray, *twin.foreign, *twin.crossed]
        traces = [(d.at, d.length, d.t_ns) for d in torn]
        traces += [(t.at, t.length, t.t_ns) for t in twin.behind]
        times = [t_ns for _, _, t_ns in traces] + twin.times
        events = case.anomalies("duplicate-response", servo_id=servo)
        # where a second answer stands tells whose it is by its bytes, or by a time that is known
        told_by = twin.torn or twin.foreign or twin.behind or twin.mixed
        may_be = () if told_by else _asked_before(case, servo)
        sure = min(0.5 + twin.twice / 20, 1.0) * (CROSSED if len(twin.crossed) == twin.twice else 1)
        yield Finding(
            "answers-twice",
            servo,
            min(times),
            max(times),
            twin.twice,
            f"servo {servo} answers twice in {case.total('ok', servo)} exchanges: "
            + ", ".join(told)
            + "".join(
                f"; they may as well be late ones of servo {other}, which is asked before it: no time tells"
                for other in may_be
            ),
            tuple(Place(*trace, "a trace of a second answer") for trace in traces[:2])
            + case.places(events, "a second answer", 2),
            strength=sure,
            brief=f"servo {servo} answers {twin.twice} requests twice",
            may_be=may_be,
        )
        least = max(WHOLE, WHOLE_TIMES * case.damage["n"].sum(), MANY * case.total("ok", servo))
        if not case.has_bare_answers and twin.whole >= least:
            yield Finding(
                "second-answers-whole",
                servo,
                min(times),
                max(times),
                twin.whole,
                f"{twin.whole} second answers of servo {servo} are whole, and "
                f"{int(case.damage['n'].sum())} places are torn in all",
                case.places(events, "a second answer", 2),
                brief=f"both answers of servo {servo} are whole",
            )


def several_answer_twice(case: Case) -> Iterator[Finding]:
    """Find servos that answer twice as seldom as each other: somebody else asks them, too."""
    some = [t for t in twins(case).values() if t.whole >= LEAST]
    seldom = [t for t in some if t.twice <= NOW_AND_THEN * case.total("ok", t.servo_id)]
    many = sum(t.whole for t in some)
    # two that ask run into each other: more of their requests are torn than answers come twice
    torn = int(case.damage["n"][case.damage["turn"] == IN_REQUEST].sum())
    if len(some) < LEAST - 1 or len(seldom) < len(some) or torn < many:
        return
    who = ", ".join(str(t.servo_id) for t in seldom)
    yield Finding(
        "several-answer-twice",
        None,
        min(min(t.times) for t in seldom),
        max(max(t.times) for t in seldom),
        many,
        f"servos {who} answer twice now and then, {many} times in all",
        case.places(case.anomalies("duplicate-response"), "a second answer", 2),
        brief=f"{len(seldom)} servos answer twice now and then",
    )


def _asked_before(case: Case, servo: int) -> tuple[int, ...]:
    """Return whose second answers they may be: bare ones name nobody, and no sure time tells."""
    if not case.has_bare_answers or (case.has_clock and case.latency_ns <= EXACT_NS):
        return ()
    whom, f = case.ledger.exchanges.kinds.servo_id, case.ledger.exchanges.followers()
    before: Counter[int] = Counter()
    for kind, after, n in zip(*(f[c].tolist() for c in ("kind", "next", "n")), strict=True):
        if min(kind, after) >= 0 and whom[after] == servo != whom[kind] in case.answering:
            before[whom[kind]] += n
    return tuple(other for other, _ in before.most_common(1))


def answers_mixed(case: Case) -> Iterator[Finding]:
    """Find servos whose torn answers are two of theirs at once."""
    for servo, twin in twins(case).items():
        if len(twin.mixed) < max(LEAST, PART * twin.tried) or servo == lies_over(case):
            continue
        shifts = sorted(mix.shift for _, mix in twin.mixed)
        how = Counter(mix.how for _, mix in twin.mixed).most_common(1)[0][0]
        whose = servo if twin.over < 0 else twin.over
        two = "two of its answers" if twin.over < 0 else f"one of it and one of servo {servo}"
        yield Finding(
            "answers-mixed",
            servo,
            twin.mixed[0][0].t_ns,
            twin.mixed[-1][0].t_ns,
            len(twin.mixed),
            f"{len(twin.mixed)} of {twin.tried} torn answers of servo {whose} are {two} at once "
            f"({how}), {shifts[0]:.1f} to {shifts[-1]:.1f} bits apart",
            tuple(
                Place(d.at, d.length, d.t_ns, f"two answers {mix.shift:.1f} bits apart ({mix.how})")
                for d, mix in twin.mixed[:3]
            ),
            strength=min(0.5 + len(twin.mixed) / 12, 1.0),
            brief=f"answers of servo {servo} lie over "
            + ("each other" if twin.over < 0 else f"those of servo {whose}"),
            befell=() if twin.over < 0 else (whose,),
        )


def always_torn(case: Case) -> Iterator[Finding]:
    """Find servos of which hardly an answer is whole, and none is missing."""
    if is_overdue(case):
        return  # the answer to a request before lies over them
    for servo, torn in torn_answers(case).items():
        if sum(d.at in torn_by_twins(case) for d in torn) > PLAIN * len(torn):
            continue  # another's second answers lie over them
        # from the first torn one on: a twin may come later
        since = torn[0].t_ns
        a = case.answers
        rows = (a["servo_id"] == servo) & (a["t_last"] >= since)
        rows &= (a["t_first"] >= since) | (a["ok"] == 0)  # what was whole may have been before
        ok, missing = int(a["ok"][rows].sum()), int(a["missing"][rows].sum())
        bad = int(a["damaged"][rows].sum())
        nearly = NEARLY if case.has_checksum else MOSTLY
        if bad < ALWAYS or bad < nearly * (ok + bad) or missing > FEW * bad:
            continue
        others = [s for s in case.servos if s != servo and case.total("ok", s)]
        rest = sum(case.total("damaged", s) for s in others)
        if not others or rest > FEW * sum(case.total("ok", s) for s in others):
            continue
        if servo in swallowing(case) or len(torn_requests(case, torn)) > PLAIN * len(torn):
            continue  # what stands there is no answer
        read = [m for m in case.misreads if m.servo_id == servo]
        plain = sum((m.shape == BITS_FEW and len(m.flips) == 1) or m.shape == FRONT for m in read)
        if plain > PLAIN * len(read):
            continue
        yield Finding(
            "answers-always-torn",
            servo,
            since,
            torn[-1].t_ns,
            bad,
            f"{bad} of {ok + bad} answers of servo {servo} are torn and {missing} are missing, "
            f"{rest} of others are torn",
            tuple(Place(d.at, d.length, d.t_ns, "a torn answer") for d in torn[:3]),
            strength=min(0.5 + bad / 40, 1.0),
            brief=f"hardly an answer of servo {servo} is whole",
        )


def stop_bits_held_low(case: Case) -> Iterator[Finding]:
    """Find servos whose stop bits somebody else holds low, so that the next byte has no beginning."""
    marks = case.remarks(MarkKind.FRAMING, MarkKind.BREAK)
    if not len(marks) or not (case.has_checksum or case.protocol.ordered):
        return  # lines are as long as what they say
    ends = marks.at + marks.length
    torn = [d for d in case.damages if d.turn == IN_REPLY and d.servo_id >= 0]
    by_servo = Counter(d.servo_id for d in torn)
    short: dict[int, list[Damage]] = {}
    for d in torn:
        row = int(np.searchsorted(ends, d.at, "right"))  # the first one that ends behind its begin
        is_marked = row < len(ends) and int(marks.at[row]) < d.at + d.length
        if is_marked and d.length < min(map(len, d.alike), default=0):
            short.setdefault(d.servo_id, []).append(d)
    for servo, mine in short.items():
        low = [d for d in mine if d.got[-1] < HIGH_LAST]
        others = len(torn) - by_servo[servo]
        if len(low) < max(HELD_LOW, CLEARLY * len(mine), PART * by_servo[servo], others / FEW):
            continue
        yield finding_of(
            low,
            "stop-bits-held-low",
            servo,
            f"{len(low)} of {by_servo[servo]} torn answers of servo {servo} lack the byte behind one "
            "without a stop bit whose last bit is low",
            "held low where its stop bit should be",
            strength=min(len(low) / (2 * HELD_LOW), 1.0),
            brief="somebody else holds its stop bits low",
        )


RULES: Final[tuple[Rule, ...]] = (
    answers_twice,
    several_answer_twice,
    answers_mixed,
    stop_bits_held_low,
    always_torn,
)
"""The rules of this area."""
