"""Who is damaged on the line, and when: everybody or some, always or while motors work."""

from __future__ import annotations

from collections import Counter
from typing import TYPE_CHECKING, Final, NamedTuple

import numpy as np

from sniffer.diagnosis.case import sums
from sniffer.diagnosis.catalogue import FindingCode
from sniffer.diagnosis.evidence.chances import at_least, sureness
from sniffer.diagnosis.evidence.jumping import altered_bare
from sniffer.diagnosis.evidence.placed import finding_of, is_talk
from sniffer.diagnosis.evidence.twins import of_twins
from sniffer.diagnosis.ledger.damage import AT_TURN, IN_IDLE, IN_REPLY, IN_REQUEST, STRAYS
from sniffer.diagnosis.model import Finding, Place
from sniffer.diagnosis.physics.uart import FALLS
from sniffer.ground.codes import REQUEST, RESPONSE
from sniffer.ground.model import NS
from sniffer.ground.wording import counted

if TYPE_CHECKING:
    from collections.abc import Iterator, Sequence

    from sniffer.diagnosis.case import Case
    from sniffer.diagnosis.ledger.damage import Damage
    from sniffer.diagnosis.rules import Rule
    from sniffer.ground.model import I64, Mask

FINDINGS: Final = (
    FindingCode(
        "damage-everywhere",
        "Frames of several senders are damaged, in about the share of what each says.",
        "At least three torn frames, of two senders or more, and no sender has far more than its share.",
    ),
    FindingCode(
        "damage-one-servo",
        "The answers of this servo are damaged, and those of others hardly ever.",
        "Three torn answers or more, and a share of its answers that is five times that of all other frames and no chance.",
        is_its_own=True,
    ),
    FindingCode(
        "damage-in-answers",
        "Answers are damaged, of several servos alike, and requests hardly ever.",
        "Three torn answers or more, of two servos, and fewer torn requests than chance would have it: of them a third of that share at most.",
    ),
    FindingCode(
        "damage-in-requests",
        "Requests are damaged, and answers hardly ever.",
        "Three torn requests or more, and fewer torn answers than chance would have it.",
    ),
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

LEAST: Final = 3
"""Places that make a pattern."""

AHEAD: Final = 5.0
"""How many times the others' share a sender must have to be one of few."""

CHANCE: Final = 1e-3
"""What is as likely as that by chance is no pattern."""

CLEARLY: Final = 0.05
"""What each of several servos must show; all of them together are beyond doubt then."""

MANY: Final = 20
"""Strays of which some would have hit a frame if they came at any time."""

LEAST_BUSY: Final = 0.05
"""Part of the time for which a line that somebody polls is busy at least: without a clock."""

HITS: Final = 0.3
"""Part of the disturbances within a frame that are long enough, and at the place, to alter a bit."""

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

SPARES: Final = 1 / 3
"""Part of the share of answers that are torn which may be torn of requests that are spared."""

PLENTY: Final = 12
"""So many places are beyond doubt."""

HIDDEN: Final = 0.45
"""How much it counts where of the answers values alone tell: a weak signal alters them, too."""

ONE_WAY: Final = 0.6
"""How much it counts that chance may have hit answers only, or requests only, so few they are."""


def who_is_damaged(case: Case) -> Iterator[Finding]:
    """Tell whose frames are damaged: some servos' answers, all answers, all requests, or all."""
    d = case.damage
    in_reply, in_request = d["turn"] == IN_REPLY, d["turn"] == IN_REQUEST
    torn, answered, asked_torn, requests = case.once(_shares)
    total = sum(torn.values()) + asked_torn
    if total < LEAST or not is_talk(case):
        return
    few = singled_out(case)
    for servo in few:
        rest = total - sum(torn[s] for s in few)
        frames = requests + sum(n for s, n in answered.items() if s not in few)
        chance = at_least(torn[servo], answered[servo], (rest + 1) / (frames + 1))
        yield _damage(
            case,
            in_reply & (d["servo_id"] == servo),
            "damage-one-servo",
            servo,
            f"{torn[servo]} of {answered[servo]} answers of servo {servo} are damaged, and "
            f"{rest} of {frames} other frames",
            f"{torn[servo]} answers of servo {servo} damaged",
            max(sureness(chance), 0.5),
        )
    torn = {s: n for s, n in torn.items() if s not in few}
    answered = {s: n for s, n in answered.items() if s not in few}
    left = sum(torn.values())
    if left + asked_torn < LEAST:
        return
    answers = sum(answered.values())
    rows = in_request | (in_reply & ~np.isin(d["servo_id"], few))
    sizes = case.ledger.exchanges.sizes()
    share = answers * sizes[1] / max(answers * sizes[1] + requests * sizes[0], 1)
    what = (
        f"{left} of {answers} answers of {counted(len(answered), 'servo')} and "
        f"{asked_torn} of {requests} requests are damaged"
    )
    altered = altered_bare(case)
    if altered:
        what += f"; values of {counted(altered, 'servo')} are in doubt"
    requests_alone = asked_torn >= LEAST
    requests_alone &= at_least(asked_torn, left + asked_torn, 1 - share) < CHANCE
    # what tears a third of the requests does not spare them, however many answers it tears
    is_spared = asked_torn * answers <= SPARES * left * requests
    if left >= LEAST and is_spared and at_least(left, left + asked_torn, share) < CHANCE:
        yield _damage(case, rows, "damage-in-answers", None, what, "answers damaged")
    elif requests_alone and not altered:
        yield _damage(case, rows, "damage-in-requests", None, what, "requests damaged")
    else:
        sure = min(0.5 + (left + asked_torn) / (2 * PLENTY), 1.0)
        sure *= HIDDEN if requests_alone else 1.0 if left and asked_torn else ONE_WAY
        yield _damage(case, rows, "damage-everywhere", None, what, "frames damaged", sure)


def singled_out(case: Case) -> Sequence[int]:
    """Return the servos whose answers are torn far oftener than all else."""
    torn, answered, asked_torn, requests = case.once(_shares)
    if sum(torn.values()) + asked_torn < LEAST:
        return ()
    return _few(torn, answered, asked_torn, requests)


class _Shares(NamedTuple):
    """How many answers of each servo are torn, and how many there are; the same of requests."""

    torn: dict[int, int]
    answered: dict[int, int]
    asked_torn: int
    requests: int


def _shares(case: Case) -> _Shares:
    d = case.damage
    in_reply, in_request = d["turn"] == IN_REPLY, d["turn"] == IN_REQUEST
    others = Counter(  # what twins tear is a matter of its own
        (x.turn, x.servo_id) for x in case.damages if of_twins(case, x)
    )
    torn = {
        s: n - others[IN_REPLY, s]
        for s, n in sums(_rows(d, in_reply), "servo_id", "n").items()
        if s >= 0 and n > others[IN_REPLY, s]
    }
    heard = ("ok", "damaged", "unsolicited")  # the last of them behind requests that are torn
    answered = {s: sum(case.total(what, s) for what in heard) for s in {*torn, *case.servos}}
    answered = {s: max(n, torn.get(s, 0)) for s, n in answered.items() if n or torn.get(s)}
    asked_torn = int(d["n"][in_request].sum())
    asked_torn -= sum(n for (turn, _), n in others.items() if turn == IN_REQUEST)
    requests = int(case.traffic["requests"].sum()) + asked_torn
    return _Shares(torn, answered, asked_torn, requests)


def _few(
    torn: dict[int, int], answered: dict[int, int], asked_torn: int, requests: int
) -> list[int]:
    """Return the servos that have far more than their share of the damage."""
    ahead = sorted(torn, key=lambda s: -torn[s] / answered[s])
    for count in range(len(answered) - 1, 0, -1):
        mine, rest = ahead[:count], [s for s in answered if s not in ahead[:count]]
        if len(mine) < count:
            continue
        n = sum(torn.get(s, 0) for s in rest) + asked_torn
        frames = sum(answered[s] for s in rest) + requests
        share = (n + 1) / (frames + 1)
        least = min(torn[s] / answered[s] for s in mine)
        # each of the others must be better than any of them, and not by chance
        better = all(
            torn.get(s, 0) * AHEAD <= least * answered[s]
            and at_least(answered[s] - torn.get(s, 0), answered[s], 1 - least) < CLEARLY
            for s in rest
        )
        if better and all(
            torn[s] >= LEAST
            and torn[s] / answered[s] >= AHEAD * share
            and at_least(torn[s], answered[s], share) < CHANCE
            for s in mine
        ):
            return sorted(mine)
    return []


def strays(case: Case) -> Iterator[Finding]:
    """Tell where single bytes of nobody stand."""
    d = case.damage
    at_turn, idle = d["turn"] == AT_TURN, d["turn"] == IN_IDLE
    if sum(of_twins(case, x) for x in case.damages if x.turn in STRAYS) >= LEAST:
        return  # they are what is left of second answers
    if not case.traffic["requests"].sum() or not is_talk(case):
        return  # no turn is heard, and an answer of a byte (an ACK of RS30x) is none by itself
    turns, between = int(d["n"][at_turn].sum()), int(d["n"][idle].sum())
    torn = int(d["n"][np.isin(d["turn"], (IN_REPLY, IN_REQUEST))].sum())
    seen = sorted({x.got.hex(" ").upper() for x in case.damages if x.turn in STRAYS})
    shown = ", ".join(seen[:4])
    both = at_turn | idle
    if turns >= max(LEAST, FEW * torn, 3 * between):  # of many torn frames a few leave some, too
        yield _damage(
            case,
            at_turn,
            "strays-at-turn",
            None,
            f"{turns} times stray bytes stand at the turn of {max(case.total('ok'), 1)} exchanges, "
            f"{between} times elsewhere: {shown}",
            f"{turns} stray bytes where the direction changes",
        )
    elif behind := _behind_requests(case):
        yield _damage(
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
        yield _damage(
            case,
            both,
            "strays-at-turn",
            None,
            f"{turns + between} times stray bytes stand between frames, and {torn} frames of "
            f"{case.ledger.frames} are torn: what came at any time would hit frames, too; {shown}",
            f"{turns + between} stray bytes between frames",
            0.9 * spared,
        )
    elif turns + between >= LEAST and between:
        yield _damage(
            case,
            both,
            "strays-anywhere",
            None,
            f"{turns + between} times stray bytes came while nobody spoke: {shown}",
            f"{turns + between} stray bytes",
        )


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


def _rows(table: dict[str, I64], rows: Mask) -> dict[str, I64]:
    return {name: column[rows] for name, column in table.items()}


def _damage(
    case: Case,
    rows: Mask,
    code: str,
    servo: int | None,
    what: str,
    brief: str,
    strength: float | None = None,
) -> Finding:
    d = _rows(case.damage, rows)
    n = int(d["n"].sum())
    return Finding(
        code,
        servo,
        int(d["t_first"].min()),
        int(d["t_last"].max()),
        n,
        what,
        tuple(
            Place(at, length, t, "damaged")
            for at, length, t in zip(
                d["at"][:3].tolist(),
                d["length"][:3].tolist(),
                d["t_first"][:3].tolist(),
                strict=True,
            )
        ),
        strength=min(0.5 + n / (2 * PLENTY), 1.0) if strength is None else strength,
        brief=brief,
        values=(("torn", n),),
    )


RULES: Final[tuple[Rule, ...]] = (who_is_damaged, strays, strays_alone)
"""The rules of this area."""
