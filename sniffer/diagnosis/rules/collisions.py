"""Two that speak at once: twins that share an id."""

from __future__ import annotations

from collections import Counter
from typing import TYPE_CHECKING, Final

from sniffer.diagnosis.catalogue import FindingCode
from sniffer.diagnosis.damage import IN_REPLY
from sniffer.diagnosis.misread import BITS_FEW, FRONT, alike_of
from sniffer.diagnosis.mixing import LEAST as SURE_BYTES
from sniffer.diagnosis.mixing import beginning, mix_of
from sniffer.diagnosis.model import Finding, Place

if TYPE_CHECKING:
    from collections.abc import Iterator, Sequence

    from sniffer.diagnosis.case import Case
    from sniffer.diagnosis.damage import Damage
    from sniffer.diagnosis.rules import Rule

FINDINGS: Final = (
    FindingCode(
        "answers-twice",
        "pairing",
        "A servo answers twice: one answer torn and one whole behind the same request, or two whole ones.",
        "Three such requests or more, and one in fifty of its answers.",
    ),
    FindingCode(
        "answers-mixed",
        "pairing",
        "Torn answers of a servo are two of its answers at once, some bits apart.",
        "The bytes with which its answers always begin, laid over themselves some bits later (AND, OR), are what a UART made of at least three torn answers, and of a quarter of them.",
    ),
    FindingCode(
        "answers-always-torn",
        "pairing",
        "Hardly an answer of a servo is whole, and none is missing, while others are sound.",
        "At least eight answers, of which nineteen in twenty are torn and one in ten at most is missing; no clock, no single bit and no lost first byte explains it.",
    ),
)

LEAST: Final = 3

SHARE: Final = 0.02
"""Part of a servo's answers that must come twice."""

PART: Final = 0.25
"""Part of the torn answers that must be two at once."""

ALWAYS: Final = 8
NEARLY: Final = 0.9
"""How many torn answers, and which part of all, are always."""

FEW: Final = 0.1
"""Part of the answers of others that may be torn, and of a servo's own that may be missing."""

PLAIN: Final = 0.5
"""Part of the torn answers that single bits, or lost first bytes, may explain."""


def answers_twice(case: Case) -> Iterator[Finding]:
    """Find servos of which two answers come."""
    for servo in case.servos:
        torn = [
            d for d in case.damages if d.is_answered and d.turn == IN_REPLY and d.servo_id == servo
        ]
        rows = case.alarm_rows("duplicate-response", servo_id=servo)
        whole = int(case.alarms["n"][rows].sum())
        n, answers = whole + len(torn), case.total("ok", servo)
        if n < LEAST or n < SHARE * answers:
            continue
        events = case.anomalies("duplicate-response", servo_id=servo)
        times = [d.t_ns for d in torn] + events.t_ns.tolist()
        places = [
            Place(d.at, d.length, d.t_ns, "a torn answer before a whole one") for d in torn[:2]
        ]
        places += case.places(events, "a second answer", 2)
        yield Finding(
            "answers-twice",
            servo,
            min(times),
            max(times),
            n,
            f"servo {servo} answers twice: {whole} times two whole answers to one request, "
            f"{len(torn)} times a torn one and a whole one, in {answers} exchanges",
            tuple(places),
            strength=min(0.5 + n / 20, 1.0),
            brief=f"servo {servo} answers {n} requests twice",
        )


def answers_mixed(case: Case) -> Iterator[Finding]:
    """Find servos whose torn answers are two of theirs at once."""
    known = case.ledger.damages.likes.known
    for servo, torn in _torn(case).items():
        tried = [(d, b) for d in torn if len(b := beginning(alike_of(d, known))) >= SURE_BYTES]
        found = [(d, mix) for d, b in tried if (mix := mix_of(d.got, b)) is not None]
        if len(found) < max(LEAST, PART * len(tried)):
            continue
        shifts = sorted(mix.shift for _, mix in found)
        how = Counter(mix.how for _, mix in found).most_common(1)[0][0]
        yield Finding(
            "answers-mixed",
            servo,
            torn[0].t_ns,
            torn[-1].t_ns,
            len(torn),
            f"{len(found)} of {len(tried)} torn answers of servo {servo} are two of its answers at "
            f"once ({how}), {shifts[0]:.1f} to {shifts[-1]:.1f} bits apart",
            tuple(
                Place(d.at, d.length, d.t_ns, f"two answers {mix.shift:.1f} bits apart ({mix.how})")
                for d, mix in found[:3]
            ),
            strength=min(0.5 + len(found) / 12, 1.0),
            brief=f"answers of servo {servo} lie over each other",
        )


def always_torn(case: Case) -> Iterator[Finding]:
    """Find servos of which hardly an answer is whole, and none is missing."""
    by_servo = _torn(case)
    for servo, torn in by_servo.items():
        ok, bad = case.total("ok", servo), case.total("damaged", servo)
        missing = case.total("missing", servo)
        # from the first torn one on: a twin may come later
        since = torn[0].t_ns
        a = case.answers
        rows = (a["servo_id"] == servo) & (a["t_first"] >= since)
        ok, missing = int(a["ok"][rows].sum()), int(a["missing"][rows].sum())
        bad = int(a["damaged"][rows].sum())
        if bad < ALWAYS or bad < NEARLY * (ok + bad) or missing > FEW * bad:
            continue
        others = [s for s in case.servos if s != servo and case.total("ok", s)]
        rest = sum(case.total("damaged", s) for s in others)
        if not others or rest > FEW * sum(case.total("ok", s) for s in others):
            continue
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


def _torn(case: Case) -> dict[int, Sequence[Damage]]:
    """Return the torn answers of each servo that is worth a look."""
    out: dict[int, list[Damage]] = {}
    for d in case.damages:
        if d.turn == IN_REPLY and d.servo_id >= 0:
            out.setdefault(d.servo_id, []).append(d)
    rest = max(case.ledger.frames, 1)
    total = sum(len(torn) for torn in out.values())
    return {
        s: torn[:LOOKED]
        for s, torn in sorted(out.items())
        if len(torn) >= LEAST
        and len(torn) / max(case.total("ok", s) + len(torn), 1)
        >= AHEAD * (total - len(torn)) / rest
    }


AHEAD: Final = 3.0
"""How many times the others' share of torn answers a servo must have to be looked at."""

LOOKED: Final = 100
"""Torn answers of a servo that are looked at."""

RULES: Final[tuple[Rule, ...]] = (answers_twice, answers_mixed, always_torn)
"""The rules of this area."""
