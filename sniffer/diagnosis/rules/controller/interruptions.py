"""Controllers that speak into answers, by what is left of both."""

from __future__ import annotations

from typing import TYPE_CHECKING, Final

import numpy as np

from sniffer.diagnosis.catalogue import FindingCode
from sniffer.diagnosis.evidence.chances import at_least, sureness
from sniffer.diagnosis.evidence.hasty import ends_of_requests
from sniffer.diagnosis.evidence.intruders import OVERLAPS, torn_requests
from sniffer.diagnosis.evidence.order import Order
from sniffer.diagnosis.evidence.placed import finding_of
from sniffer.diagnosis.evidence.swallowing import swallowing
from sniffer.diagnosis.evidence.twins import of_twins, torn_by_twins
from sniffer.diagnosis.ledger.damage import IN_REPLY, IN_REQUEST
from sniffer.diagnosis.model import Finding, Place
from sniffer.diagnosis.physics.comparing import alike, header_of, is_altered
from sniffer.diagnosis.physics.misread import alike_of
from sniffer.ground.codes import DAMAGED, RESPONSE
from sniffer.ground.model import Clock
from sniffer.ground.timing import byte_time_ns

if TYPE_CHECKING:
    from collections.abc import Iterator, Sequence

    from sniffer.diagnosis.case import Case
    from sniffer.diagnosis.ledger.damage import Damage
    from sniffer.diagnosis.rules import Rule
    from sniffer.ground.model import I64

FINDINGS: Final = (
    FindingCode(
        "request-over-answer",
        "A request begins while the answer to the one before is still on the line.",
        "Exact stamps: the request's first byte begins before the answer's last one ends, by more than "
        "the stamps and rates leave open, on one wire.",
    ),
    FindingCode(
        "request-in-answer",
        "A request runs into an answer: both are torn.",
        "Damage in the place of an answer that begins or ends as one of the controller's own "
        "requests, byte for byte (or as one to another servo, but for its id and checksum), and not as "
        "the answer that is due, nor with a whole answer's bytes "
        "beside it: two lines may only have lost the end that parts them.",
    ),
    FindingCode(
        "request-swallowed",
        "Behind a torn answer the request that always follows is missing: it was said into the answer.",
        "The kinds of requests in the order in which this controller makes them: where an answer is "
        "torn that lacks no bytes, or bytes stand behind one that end as the missing one does, one is "
        "left out, or said again only later. Where stamps do not tell what is torn in one go: five times at least, behind four in "
        "five torn answers that say whose they are. Or by time: the controller waits behind it as long as for two requests.",
    ),
    FindingCode(
        "answers-spoken-into",
        "Answers are whole at their beginning and torn over many bytes from there on: somebody speaks into them.",
        "Most torn answers begin as they should and differ in three bytes and more of those that never change; a pulse alters one or two.",
    ),
)

ENOUGH: Final = 2
"""One may be a stamp that is off."""


PART_TORN: Final = 0.2
"""Share of failed exchanges that show a cause; what fewer show may look so by chance."""

KNOWN: Final = 3
"""Answers that tell which of their bytes never change."""

WHOLE: Final = 3
"""First bytes that must be as they should: what tears the first ones is another matter."""

LONG: Final = 3
"""Bytes of those that never change which somebody else's frame alters; a pulse has one or two."""

LOST: Final = 2
"""Bytes that a mixture has less, or more, than the answer: start bits fall where bits of the other
one are."""

BY_PULSES: Final = 0.4
"""Share of the answers torn by pulses that look so: those in which a byte got lost by one."""

CHANCE: Final = 1e-3

ANYWAY: Final = 0.5
"""Requests torn right behind answers, for each sound answer, from which on some are missing anywhere."""

TAIL: Final = 3
"""Bytes that end, or begin, as a request does: three alike by chance are one in 16 million."""

MORE: Final = 2
"""Bytes beyond what an answer has in common with a request: both begin with one header."""

SHORT: Final = 2
"""Bytes that a torn answer may lack; where more are missing they are lost, not torn."""

SHARE: Final = 0.4
"""Share of torn answers: noise takes a request behind one in a hundred."""


EITHER: Final = 0.6
"""How much they count where no time tells that the request came within the answer."""

NEARLY: Final = 0.8
UNTIMED: Final = 5
"""The same where the stamps do not tell whether answer and request are torn in one go: of two
controllers, and of slow edges, a third of the torn answers and fewer lack the next request."""


def overlapping(case: Case) -> Iterator[Finding]:
    """Requests that begin while an answer is on the line."""
    exchanges = case.ledger.exchanges
    if case.ledger.clock != Clock.SAMPLE or exchanges.overlaps < OVERLAPS:
        return
    if case.ledger.has_wires or case.count("adapter-echo"):
        return  # two wires, each with its own stamps; or a note of what is about to be sent
    shown = exchanges.overlapping
    yield Finding(
        "request-over-answer",
        None,
        shown[0][2],
        shown[-1][2],
        exchanges.overlaps,
        f"{exchanges.overlaps} requests begin while the answer to the one before is on the line",
        tuple(Place(at, length, t, "its answer is talked over") for at, length, t in shown[:3]),
        strength=min(0.5 + exchanges.overlaps / 10, 1.0),
        brief="requests begin while answers are on the line",
    )


def request_in_answer(case: Case) -> Iterator[Finding]:
    """Requests that run into answers, by their bytes."""
    if not case.has_prompt_stamps or case.count("adapter-echo"):
        return  # of an echo it is what comes back; of a host that holds bytes, two pieces
    if case.once(tears_anyway):
        return
    asked = {f.at + f.length: f.t_ns for f in case.ledger.exchanges.failed}
    replies = [d for d in case.damages if d.turn == IN_REPLY and d.asked]
    replies = [d for d in replies if d.at not in torn_by_twins(case)]
    places = [d for d in replies if d.at in asked and _is_in_one_go(case, d, asked[d.at])]
    seldom_whole = torn_requests(case, replies)
    places += [d for d in seldom_whole if d not in places]
    if not places:
        return
    asks = case.ledger.exchanges.kinds.requests
    known = tuple(dict.fromkeys((*asks, *(d.asked for d in places))))
    header = header_of(known)
    answers = case.ledger.damages.likes.known
    torn = [d for d in places if _holds_request(d, known, header, alike_of(d, answers))]
    torn += [d for d in seldom_whole if d not in torn]
    if len(torn) < ENOUGH or len(torn) < PART_TORN * len(places):
        return
    yield finding_of(
        torn,
        "request-in-answer",
        None,
        f"{len(torn)} of {len(places)} torn answers begin or end as requests of this controller",
        "a request runs into this answer",
        strength=min(0.5 + len(torn) / 10, 1.0) * min(2 * len(torn) / len(places), 1.0),
        brief="requests run into answers",
    )


def swallowed(case: Case) -> Iterator[Finding]:
    """Requests that are missing behind torn answers."""
    exchanges = case.ledger.exchanges
    torn = {d.at: d for d in case.damages if d.turn == IN_REPLY}
    is_timed = case.has_prompt_stamps
    if not torn or (case.protocol.ordered and not is_timed) or case.once(tears_anyway):
        return
    order = case.once(Order)
    judged, shown = 0, []
    as_peers = {f for some in swallowing(case).values() for f in some}
    for f in exchanges.failed:
        damage = torn.get(f.at + f.length)
        if damage is None or f.outcome != DAMAGED:
            continue
        if f.kind not in order.usual and f not in as_peers:
            continue
        if damage.length + SHORT < len(damage.expected):
            continue
        if is_timed and not _is_in_one_go(case, damage, f.t_ns):
            continue
        judged += 1
        if order.skips_one(f.kind, f.next_kind) or f in as_peers:
            shown.append(f)
    # the order needs no times; without them an answer may be torn, and a request lost, apart
    share, least = (SHARE, ENOUGH) if is_timed else (NEARLY, UNTIMED)
    if len(shown) < least or len(shown) < share * judged:
        return
    yield Finding(
        "request-swallowed",
        None,
        shown[0].t_ns,
        shown[-1].t_ns,
        len(shown),
        f"behind {len(shown)} of {judged} torn answers the request is missing that comes next in this "
        "controller's order",
        tuple(Place(f.at, f.length, f.t_ns, "behind its answer one is missing") for f in shown[:3]),
        strength=min(0.5 + len(shown) / 10, 1.0),
        brief="requests are missing behind torn answers",
    )


def swallowed_behind(case: Case) -> Iterator[Finding]:
    """Requests that are missing where bytes stand behind an answer, and whose last byte ends them.

    A bare answer that is spoken into holds as it is: what is left of the request is noise.
    """
    if case.has_checksum:
        return
    order, kinds = case.once(Order), case.ledger.exchanges.kinds
    stretches = case.ledger.exchanges.moments.stretches()
    is_timed, said_into = case.has_prompt_stamps, ends_of_requests(case)
    judged, shown = 0, []
    for d in case.damages:
        follows = d.behind == RESPONSE and 0 <= d.since_ns <= case.ledger.byte_ns
        if is_timed and not (follows and d.got):
            continue
        judged += 1  # without times: a tap that loses bytes tears requests in the middle, too
        pair = _around(d.t_ns, stretches)
        if pair is None or min(pair) < 0 or pair[0] not in order.usual:
            judged -= is_timed
            continue
        due = [kinds.example[k] for k in order.usual[pair[0]] if k >= 0]
        left = [one for one in due if d.length < len(one) and d.got[-1:] == one[-1:]]
        # who waits for its answer in vain says it again
        is_missing = d.at in said_into or order.skips_one(*pair)
        if left and d.behind == RESPONSE and is_missing:
            shown.append(d)
    if len(shown) < (ENOUGH if is_timed else UNTIMED) or len(shown) < SHARE * judged:
        return
    yield finding_of(
        shown,
        "request-swallowed",
        None,
        f"{len(shown)} of {judged} times bytes stand behind an answer, they end as the request that "
        "comes next in this controller's order, and that one is not there",
        "what is left of a request",
        # what the tap lost may leave such pieces as well, among others
        strength=min(0.5 + len(shown) / 10, 1.0) * (1.0 if is_timed else EITHER),
        brief="requests are missing behind answers",
    )


def _around(t_ns: int, stretches: Sequence[tuple[I64, I64]]) -> tuple[int, int] | None:
    """Return the kinds of the requests before and behind a moment; None: they are not kept."""
    for t, kind in stretches:
        row = int(np.searchsorted(t, t_ns))
        if 0 < row < len(t):
            return int(kind[row - 1]), int(kind[row])
    return None


def _is_in_one_go(case: Case, d: Damage, asked_ns: int) -> bool:
    """Tell whether no bytes are missing in damage behind a request.

    It is over as soon as an answer that begins when this servo's do has as many bytes.
    """
    a = case.answers
    rows = a["servo_id"] == d.servo_id
    answered = int(a["took_n"][rows].sum())
    # of one whose answers are never whole nobody knows when they begin
    begins = int(a["took_sum"][rows].sum()) / answered if answered else max(d.since_ns, 0)
    whole = (d.length + SHORT) * byte_time_ns(case.baud)
    return d.t_ns - asked_ns <= begins + whole + case.latency_ns


def tears_anyway(case: Case) -> bool:
    """Tell whether so many requests are torn behind sound answers that some are missing anywhere.

    Then one that is missing behind a torn answer was not said into it.
    """
    torn = sum(
        d.turn == IN_REQUEST and d.behind == RESPONSE and not of_twins(case, d)
        for d in case.damages
    )
    return torn > ANYWAY * case.total("ok")


def _holds_request(d: Damage, known: Sequence[bytes], header: int, due: Sequence[bytes]) -> bool:
    """Tell whether damage begins or ends as a request, and not as the answer that is due.

    Where as many bytes as an answer has stand beside it, two lines lost the end that parts them,
    and none ran into the other. ``header`` is how many first bytes all requests share: answers have them, too. Where a servo has
    had no whole answer, ``due`` are those of its peers with its id, which a request has as well.
    """
    if any(is_altered(d.got, q) or q.startswith(d.got) for q in known):
        return False  # nothing but a request that is torn
    tail = max((_ends_alike(d.got, one) for one in due), default=0)
    head = max((alike(d.got, one) for one in due), default=0)
    shortest = min(map(len, due), default=d.length)
    for request in known:
        if d.length - len(request) >= shortest:
            continue
        ends, begins = _ends_alike(d.got, request), alike(d.got, request)
        if ends >= max(TAIL, tail + MORE) or begins >= max(TAIL, head + MORE, header + 1):
            return True
    return False


def _ends_alike(got: bytes, frame: bytes) -> int:
    """Return how many last bytes are a frame's, or those before its last one.

    That is the checksum where there is one: of the same request to another servo it is another one.
    """
    return max(alike(got[::-1], frame[::-1]), alike(got[-2::-1], frame[-2::-1]))


def spoken_into(case: Case) -> Iterator[Finding]:
    """Answers that are torn from somewhere on, and for long."""
    known = case.ledger.damages.likes.known
    judged, shown = 0, []
    for d in case.damages:
        is_one = d.turn == IN_REPLY and d.at not in torn_by_twins(case)
        some = alike_of(d, known) if is_one else ()
        if not some:
            continue
        judged += 1
        if _is_spoken_into(d, some):
            shown.append(d)
    chance = at_least(len(shown), judged, BY_PULSES)
    if len(shown) < OVERLAPS or chance > CHANCE**0.5:
        return
    yield finding_of(
        shown,
        "answers-spoken-into",
        None,
        f"{len(shown)} of {judged} torn answers begin as they should, and then differ for long",
        "somebody speaks into this answer",
        strength=sureness(chance, CHANCE),
        brief="somebody speaks into answers",
    )


def _is_spoken_into(d: Damage, some: tuple[bytes, ...]) -> bool:
    """Tell whether an answer begins as it should and then differs for long."""
    size = min(map(len, some))
    steady = [k for k in range(size) if len({one[k] for one in some}) == 1]
    if d.got[:WHOLE] != some[0][:WHOLE]:
        return False
    wrong = [k for k in steady if k >= len(d.got) or d.got[k] != some[0][k]]
    # what only breaks off, or lacks bytes, is no mixture
    heard = [k for k in wrong if k < len(d.got)]
    more = len(d.got) - len(some[0])
    if more >= LOST or (more <= -LOST and len(heard) >= LOST):
        return True  # a pulse takes a byte away at most, and an open contact alters none
    is_known = len(some) >= KNOWN and len(steady) > WHOLE + LONG
    return is_known and len(wrong) >= LONG and len(heard) >= 2


RULES: Final[tuple[Rule, ...]] = (
    overlapping,
    request_in_answer,
    swallowed,
    swallowed_behind,
    spoken_into,
)
"""The rules of this area."""
