"""Who is damaged on the line, and when: everybody or some, always or while motors work."""

from __future__ import annotations

from collections import Counter
from typing import TYPE_CHECKING, Final, NamedTuple

import numpy as np

from sniffer.diagnosis.case import sums
from sniffer.diagnosis.catalogue import FindingCode
from sniffer.diagnosis.evidence.chances import at_least, sureness
from sniffer.diagnosis.evidence.interlude import interlude
from sniffer.diagnosis.evidence.jumping import altered, altered_bare
from sniffer.diagnosis.evidence.parts import more_and_more
from sniffer.diagnosis.evidence.placed import is_talk
from sniffer.diagnosis.evidence.twins import of_twins
from sniffer.diagnosis.ledger.damage import IN_REPLY, IN_REQUEST
from sniffer.diagnosis.model import Finding, Place
from sniffer.ground.distinct import within
from sniffer.ground.wording import counted

if TYPE_CHECKING:
    from collections.abc import Iterator, Sequence

    from sniffer.diagnosis.case import Case
    from sniffer.diagnosis.ledger.steps import Leap
    from sniffer.diagnosis.rules import Rule
    from sniffer.ground.model import I64, Mask

FINDINGS: Final = (
    FindingCode(
        "damage-everywhere",
        "Frames of several senders are damaged, in about the share of what each says.",
        "At least three torn frames, requests and answers among them, and no sender has far more than its share.",
    ),
    FindingCode(
        "damage-undecided",
        "Some frames are damaged, all of them answers or all requests; the others may be spared by chance.",
        "At least three torn frames of one side, no servo with far more than its share, and too few to tell by their shares that the other side is spared.",
    ),
    FindingCode(
        "damage-one-servo",
        "The answers of this servo are damaged, and those of others hardly ever.",
        "Three torn answers or more, and a share of its answers that is five times that of all other frames and no chance. Of answers without a checksum those count whose value jumps as far as one bit is worth, and back.",
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
)

LEAST: Final = 3
"""Places that make a pattern."""

AHEAD: Final = 5.0
"""How many times the others' share a sender must have to be one of few."""

CHANCE: Final = 1e-3
"""What is as likely as that by chance is no pattern."""

CLEARLY: Final = 0.05
"""What each of several servos must show; all of them together are beyond doubt then."""


SPARES: Final = 1 / 3
"""Part of the share of answers that are torn which may be torn of requests that are spared."""

PLENTY: Final = 12
"""So many places are beyond doubt."""

SEEN: Final = 0.25
"""Part of the bits of bare answers that are seen to be altered: the upper ones of what is measured."""

HIDDEN: Final = 0.45
"""How much it counts where of the answers values alone tell: a weak signal alters them, too."""


def who_is_damaged(case: Case) -> Iterator[Finding]:
    """Tell whose frames are damaged: some servos' answers, all answers, all requests, or all."""
    d = case.damage
    in_reply, in_request = d["turn"] == IN_REPLY, d["turn"] == IN_REQUEST
    torn, answered, asked_torn, requests = case.once(_shares)
    total = sum(torn.values()) + asked_torn
    # what is spoken in another protocol is no damage of this one
    if total < LEAST or not is_talk(case) or interlude(case) is not None:
        return
    few = singled_out(case)
    for servo in few:
        rest = total - sum(torn[s] for s in few)
        frames = requests + sum(n for s, n in answered.items() if s not in few)
        chance = at_least(torn[servo], answered[servo], (rest + 1) / (frames + 1))
        jumps = altered(case).get(servo, ())
        by_a_bit = f", {len(jumps)} of them by a bit of what they measure" if jumps else ""
        yield damage_of(
            case,
            in_reply & (d["servo_id"] == servo),
            "damage-one-servo",
            servo,
            f"{torn[servo]} of {answered[servo]} answers of servo {servo} are damaged{by_a_bit}, and "
            f"{rest} of {frames} other frames",
            f"{torn[servo]} answers of servo {servo} damaged",
            max(sureness(chance), 0.5),
            jumps,
        )
    torn = {s: n for s, n in torn.items() if s not in few}
    answered = {s: n for s, n in answered.items() if s not in few}
    left = sum(torn.values())
    if left + asked_torn < LEAST:
        return
    answers = sum(answered.values())
    rows = in_request | (in_reply & ~within(d["servo_id"], few))
    sizes = case.ledger.exchanges.sizes()
    said = answers * sizes[1] * (SEEN if case.has_bare_answers else 1)
    share = said / max(said + requests * sizes[0], 1)
    what = (
        f"{left} of {answers} answers of {counted(len(answered), 'servo')} and "
        f"{asked_torn} of {requests} requests are damaged"
    )
    doubtful = altered_bare(case)
    if doubtful:
        what += f"; values of {counted(doubtful, 'servo')} are in doubt"
    jumps = [jump for s, some in altered(case).items() if s not in few for jump in some]
    requests_alone = asked_torn >= LEAST
    requests_alone &= at_least(asked_torn, left + asked_torn, 1 - share) < CHANCE
    # what tears a third of the requests does not spare them, however many answers it tears
    is_spared = asked_torn * answers <= SPARES * left * requests
    if left >= LEAST and is_spared and at_least(left, left + asked_torn, share) < CHANCE:
        yield damage_of(case, rows, "damage-in-answers", None, what, "answers damaged", jumps=jumps)
    elif requests_alone and not doubtful:
        yield damage_of(case, rows, "damage-in-requests", None, what, "requests damaged")
    else:
        sure = min(0.5 + (left + asked_torn) / (2 * PLENTY), 1.0)
        sure *= HIDDEN if requests_alone else 1.0
        code = "damage-everywhere" if (left or doubtful) and asked_torn else "damage-undecided"
        yield damage_of(case, rows, code, None, what, "frames damaged", sure, jumps)


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
    for servo, jumps in altered(case).items():
        torn[servo] = torn.get(servo, 0) + len(jumps)
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


def _rows(table: dict[str, I64], rows: Mask) -> dict[str, I64]:
    return {name: column[rows] for name, column in table.items()}


def damage_of(
    case: Case,
    rows: Mask,
    code: str,
    servo: int | None,
    what: str,
    brief: str,
    strength: float | None = None,
    jumps: Sequence[Leap] = (),
) -> Finding:
    """Return a finding about torn places, and about values that were altered in answers that hold.

    Args:
        case: the bus.
        rows: of its table of damage.
        code: what is found.
        servo: whose it is; None: it is no servo's.
        what: the sentence.
        brief: the same in a few words.
        strength: how much it counts; by how many there are where it is not said.
        jumps: the values that were altered.
    """
    d = _rows(case.damage, rows)
    n = int(d["n"].sum()) + len(jumps)
    torn = zip(*(d[name].tolist() for name in ("at", "length", "t_first")), strict=True)
    places = [Place(at, length, t, "damaged") for at, length, t in torn]
    places += [Place(s.at, 1, s.t_ns, "a value that one bit altered") for s in jumps]
    places.sort(key=lambda place: place.offset)
    altered_ns = np.array([s.t_ns for s in jumps], np.int64)
    times = np.concatenate([np.repeat(d["t_first"], d["n"]), altered_ns])
    more = more_and_more(times, case.first_ns, case.last_ns) if case.has_clock else ()
    if more:
        what += f"; more and more: {', '.join(map(str, more))} by quarters of the time"
        brief += ", more and more"
    return Finding(
        code,
        servo,
        min([*d["t_first"].tolist(), *(s.t_ns for s in jumps)]),
        max([*d["t_last"].tolist(), *(s.t_ns for s in jumps)]),
        n,
        what,
        tuple(places[:3]),
        strength=min(0.5 + n / (2 * PLENTY), 1.0) if strength is None else strength,
        brief=brief,
        values=(("torn", n),),
    )


RULES: Final[tuple[Rule, ...]] = (who_is_damaged,)
"""The rules of this area."""
