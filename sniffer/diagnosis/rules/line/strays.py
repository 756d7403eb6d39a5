"""Bytes that are nobody's: where the direction changes, or while nobody speaks."""

from __future__ import annotations

import itertools
from collections import Counter
from typing import TYPE_CHECKING, Final

from sniffer.diagnosis.catalogue import FindingCode
from sniffer.diagnosis.evidence.chances import at_least, sureness
from sniffer.diagnosis.evidence.placed import finding_of, is_talk
from sniffer.diagnosis.evidence.twins import of_twins
from sniffer.diagnosis.ledger.damage import AT_TURN, IN_IDLE, IN_REPLY, IN_REQUEST, STRAYS
from sniffer.diagnosis.physics.uart import FALLS
from sniffer.diagnosis.rules.line.damaged import CHANCE, LEAST, PLENTY, damage_of
from sniffer.ground.codes import REQUEST, RESPONSE
from sniffer.ground.distinct import within
from sniffer.ground.model import NS

if TYPE_CHECKING:
    from collections.abc import Iterator

    from sniffer.diagnosis.case import Case
    from sniffer.diagnosis.ledger.damage import Damage
    from sniffer.diagnosis.model import Finding
    from sniffer.diagnosis.rules import Rule

FINDINGS: Final = (
    FindingCode(
        "strays-at-turn",
        "Single bytes of nobody stand where the direction changes: between a request and its answer, or right behind a frame.",
        "Three of them or more, one for fifty torn frames, and three times as many as elsewhere between frames; or nearly all of them behind requests, where chance leaves some behind answers; or bytes that were pushed out of answers without a header.",
    ),
    FindingCode(
        "strays-anywhere",
        "Single bytes of nobody come while nobody speaks.",
        "Three of them or more, not at the turn of the direction.",
    ),
    FindingCode(
        "strays-alone",
        "Single bytes stand alone in pauses of the line: nobody says so little.",
        "Four or more, by stamps of which the line rests for three byte times before and behind; without such stamps those that stand between sound frames and are low for two bits at most (FF, FE), one for fifty torn places at least.",
    ),
)

MANY: Final = 20
"""Strays of which some would have hit a frame if they came at any time."""

LEAST_BUSY: Final = 0.05
"""Part of the time for which a line that somebody polls is busy at least: without a clock."""

HITS: Final = 0.3
"""Part of the disturbances within a frame that are long enough, and at the place, to alter a bit."""

REST_NS: Final = NS
"""What no loop rests for: its program stands, or it is off."""

ALONE_BYTES: Final = 3
"""Byte times of rest before and behind a byte that stands alone."""

PULSE: Final = 1
"""Bytes that a pulse makes where nobody speaks; two who speak at once leave more."""

SHORT: Final = b"\xff\xfe"
"""What a pulse makes that is no longer than a start bit, or a bit longer."""

FEW: Final = 0.02
"""Part of the torn places: two who speak at once leave such a byte between two sound frames, too, but
hardly ever, for one of the two frames is torn."""

NEARLY: Final = 0.95

PUSHED: Final = 0.6
"""Parts of the strays that stand behind requests, or were pushed out of answers, where it is the turn."""

ALONE: Final = 0.8
"""One servo with a greater part of them has a fault of its own."""

SPARED: Final = 0.02
"""From so rare a chance on it counts that no frame is hit."""


def strays(case: Case) -> Iterator[Finding]:
    """Tell where single bytes of nobody stand."""
    d = case.damage
    at_turn, idle = d["turn"] == AT_TURN, d["turn"] == IN_IDLE
    if sum(of_twins(case, x) for x in case.damages if x.turn in STRAYS) >= LEAST:
        return  # they are what is left of second answers
    if not case.traffic["requests"].sum() or not is_talk(case):
        return  # no turn is heard, and an answer of a byte (an ACK of RS30x) is none by itself
    turns, between = int(d["n"][at_turn].sum()), int(d["n"][idle].sum())
    torn = int(d["n"][within(d["turn"], (IN_REPLY, IN_REQUEST))].sum())
    seen = sorted({x.got.hex(" ").upper() for x in case.damages if x.turn in STRAYS})
    shown = ", ".join(seen[:4])
    both = at_turn | idle
    if turns >= max(LEAST, FEW * torn, 3 * between):  # of many torn frames a few leave some, too
        yield damage_of(
            case,
            at_turn,
            "strays-at-turn",
            None,
            f"{turns} times stray bytes stand at the turn of {max(case.total('ok'), 1)} exchanges, "
            f"{between} times elsewhere: {shown}",
            f"{turns} stray bytes where the direction changes",
        )
    elif behind := _behind_requests(case):
        yield damage_of(
            case,
            both,
            "strays-at-turn",
            None,
            f"{behind} times of {turns + between} stray bytes stand where the direction changes from a "
            f"request to its answer: {shown}",
            f"{behind} stray bytes behind requests",
        )
    elif turns + between >= MANY and (
        spared := sureness(_hits_none(case, torn, turns + between), CHANCE)
    ) >= sureness(SPARED, CHANCE):
        yield damage_of(
            case,
            both,
            "strays-at-turn",
            None,
            f"{turns + between} times stray bytes stand between frames, and {torn} frames of "
            f"{case.ledger.frames} are torn: what came at any time would hit frames, too; {shown}",
            f"{turns + between} stray bytes between frames",
            0.9 * spared,
        )
    elif turns + between - _in_one_rest(case) >= LEAST and between:
        yield damage_of(
            case,
            both,
            "strays-anywhere",
            None,
            f"{turns + between} times stray bytes came while nobody spoke: {shown}",
            f"{turns + between} stray bytes",
        )


def _in_one_rest(case: Case) -> int:
    """Return how many strays follow others while the controller rests: a supply that is switched on makes some."""
    rests = [d for d in case.damages if d.turn == IN_IDLE and d.since_ns > REST_NS]
    return sum(b.at == a.at + a.length for a, b in itertools.pairwise(rests))


def _behind_requests(case: Case) -> int:
    """Return how many strays stand behind requests, if nearly all do, and chance leaves some elsewhere.

    An answer without a header takes the stray for its first byte, and leaves its last one behind.
    """
    found = [x for x in case.damages if x.turn in STRAYS]
    asks = int(case.traffic["requests"].sum())
    share = asks / max(asks + case.total("ok"), 1)
    behind = [x for x in found if x.behind == REQUEST]
    if case.protocol.ordered:
        behind += [x for x in found if x.behind == RESPONSE and _is_pushed(x)]
        whose = Counter(x.asked_id for x in behind)
        one = max(whose.values(), default=0) > ALONE * len(behind) and len(case.answering) > 1
        return len(behind) if len(behind) >= max(MANY, PUSHED * len(found)) and not one else 0
    rare = at_least(len(behind), len(found), share) < CHANCE
    return len(behind) if rare and len(behind) >= NEARLY * len(found) else 0


def _is_pushed(x: Damage) -> bool:
    """Tell whether a byte is what a stray pushed out of an answer: no pulse makes such a one."""
    return x.length == 1 and x.got[0] not in FALLS


def strays_alone(case: Case) -> Iterator[Finding]:
    """Tell of bytes that stand alone: a pulse makes them, and no sender."""
    rest_ns = ALONE_BYTES * case.ledger.byte_ns
    single = [d for d in case.damages if d.turn == IN_IDLE and d.length <= PULSE]
    alone = [d for d in single if case.has_clock and min(d.since_ns, d.until_ns) >= rest_ns]
    if len(alone) <= LEAST:  # whatever the stamps are worth
        alone = [d for d in single if d.got in (SHORT[:1], SHORT[1:])]
        if len(alone) < FEW * len(case.damages):
            return
    if len(alone) <= LEAST or any(of_twins(case, d) for d in alone):
        return
    yield finding_of(
        alone,
        "strays-alone",
        None,
        f"{len(alone)} times a single byte stands alone between frames, where a frame would be longer",
        "a byte that stands alone",
        strength=min(0.5 + len(alone) / (2 * PLENTY), 1.0),
    )


def _hits_none(case: Case, torn: int, strays: int) -> float:
    """Return how likely chance spares frames as what makes strays does."""
    busy = LEAST_BUSY
    if case.has_clock and case.seconds:
        busy = min(case.ledger.bytes * case.ledger.byte_ns / (case.seconds * NS), 1.0)
    return at_least(strays, strays + torn, 1 - busy * HITS)


RULES: Final[tuple[Rule, ...]] = (strays, strays_alone)
"""The rules of this area."""
