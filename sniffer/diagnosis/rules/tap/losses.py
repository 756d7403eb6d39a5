"""Bytes that the tap lost: frames that lack bytes here, and were whole on the line."""

from __future__ import annotations

from typing import TYPE_CHECKING, Final

import numpy as np

from sniffer.diagnosis.catalogue import FindingCode
from sniffer.diagnosis.evidence.chances import at_least
from sniffer.diagnosis.evidence.order import Order
from sniffer.diagnosis.evidence.placed import finding_of
from sniffer.diagnosis.evidence.signs import BARE
from sniffer.diagnosis.ledger.damage import IN_REPLY, IN_REQUEST
from sniffer.diagnosis.model import Finding, Place
from sniffer.diagnosis.physics.comparing import alike, are_beginnings, is_altered
from sniffer.ground.codes import REQUEST, RESPONSE
from sniffer.ground.distinct import within
from sniffer.ground.gaps import CHECKSUM

if TYPE_CHECKING:
    from collections.abc import Iterator, Sequence

    from sniffer.diagnosis.case import Case
    from sniffer.diagnosis.ledger.damage import Damage
    from sniffer.diagnosis.rules import Rule
    from sniffer.ground.model import I64

TAP_IT_BETTER: Final = (
    "The servos understand the controller, so look at the tap: tap nearer to the controller, join the "
    "grounds, compare the tap's level (3.3 V, 5 V) and its rate with the controller's."
)

FINDINGS: Final = (
    FindingCode(
        "requests-missing",
        "Requests are missing from the order in which this controller makes them, and nothing torn "
        "stands in their place.",
        "Which kind of request follows which: where the order is fixed, the places at which some of "
        "the cycle are left out, behind exchanges that did not fail, in a pause that has time for them.",
    ),
    FindingCode(
        "requests-torn-short",
        "Requests lack bytes: a controller sends them in one go, and noise alters bytes but hardly "
        "ever takes any away.",
        "Torn requests that begin as one which this controller made and end as one, without a middle; "
        "most torn requests are so, and not all are mere beginnings that nobody answers: who breaks off leaves such.",
    ),
    FindingCode(
        "headless-frames",
        "Ends of frames stand without their beginnings, and not right behind a request.",
        "Three bytes or more of no frame, behind an answer or a pause, that no request begins with, "
        "with a length that no request and no answer here has: noise alters frames and leaves their "
        "length.",
    ),
    FindingCode(
        "order-lacks-bytes",
        "Torn places stand for requests that are longer than they are.",
        "Behind sound answers, requests are missing from the controller's fixed order around torn "
        "bytes, and those alone have two bytes more and beyond: three such places, a quarter of all "
        "torn ones. Where answers are bare, torn requests with them are as they were sent but for bytes in a row "
        "that are missing, more than pulses leave. Noise alters bytes and leaves their number.",
    ),
    FindingCode(
        "answered-though-torn",
        "Servos answer requests that lack bytes here: on the line they were whole.",
        "An answer right behind a torn request that is shorter than the one it begins or ends as: two, and one for fifty torn requests.",
    ),
    FindingCode(
        "answered-though-altered",
        "Servos answer requests whose checksum is wrong here: they read what the tap does not.",
        "A sound answer right behind most of the requests that have their length and a wrong checksum, eight and more.",
        remedy=TAP_IT_BETTER,
        settle=TAP_IT_BETTER,
    ),
)

LEAST: Final = 3
"""Torn requests that make a pattern."""

MOST: Final = 0.6
"""Share of torn requests that are short where bytes are lost; noise leaves nearly all their length.
Of those that are altered, the share that is answered where it is the tap that reads them wrong."""

ENOUGH: Final = 8
"""Requests that are altered and answered which are no chance: one sum in 256 is right by chance."""

ENDED: Final = 0.15
"""Part of the short pieces that may be more than a beginning where a controller breaks off: a piece
of an answer that came meanwhile stands behind it."""

SOME: Final = 0.12
"""Share of all torn requests, of which most are joined to what came behind the hole: two who speak at
once leave one in ten that looks so."""

ANSWERED: Final = 0.25
"""Share of them that are answered: a hole often takes the answer, too."""

PIECE: Final = 3
"""Bytes alike from the beginning or up to the end: three alike by chance are one in 16 million."""

SHORT: Final = 2
"""Bytes that a request is short of at least where it is not what was torn: a pulse takes one at most."""

BY_NOISE: Final = 0.35
CHANCE: Final = 1e-3
"""Part of the torn requests that pulses leave as if bytes were missing, and how likely so many may be
by them."""

HARDLY: Final = 0.02
"""Part of the torn requests that may be answered, and seem to lack bytes, by chance."""

SOME_SHORT: Final = 0.25
"""Part of the torn places that must be too short for what is missing there."""

PART: Final = 0.3
"""Share of all damage that pieces without a beginning are where bytes are lost."""

TURN: Final = 1e-2
"""How likely it is by chance that all stand behind requests, where they are hit there."""


def torn_requests(case: Case) -> Iterator[Finding]:
    """Requests that lack bytes, and what servos say to them."""
    known = case.ledger.exchanges.kinds.requests
    bare = BARE if case.protocol.ordered else 0  # an answer without a header belongs to the piece
    ends = {d.at + d.length for d in case.damages}
    short, altered = [], 0
    for d in case.damages:
        # what stands right behind a torn answer was said into it
        if (d.turn == IN_REPLY and not _is_end(d.got, known)) or d.at in ends:
            continue
        if _is_short(d.got, known) or (bare and _is_short(d.got[:-bare], known)):
            short.append(d)
        else:
            altered += any(is_altered(d.got, whole) for whole in known)
    torn = sum(d.turn == IN_REQUEST for d in case.damages)
    if only_at_the_turn(case, [d for d in short if d.turn != IN_REPLY]):
        return
    answered = _answered(case, short)
    were_whole = len(answered) >= max(LEAST - 1, ANSWERED * len(short), HARDLY * torn)
    is_cut_by_tap = were_whole or _end_anywhere(short, known)
    if is_cut_by_tap and len(short) >= max(LEAST, SOME * torn, MOST * (len(short) + altered)):
        yield _told(
            "requests-torn-short",
            short,
            f"{len(short)} requests lack bytes, and {altered} are altered",
            "a request that lacks bytes",
        )
    if were_whole:
        yield _told(
            "answered-though-torn",
            answered,
            f"{len(answered)} of {len(short)} requests that lack bytes here were answered: the servos "
            "had them whole",
            "it was answered all the same",
        )


def altered_requests(case: Case) -> Iterator[Finding]:
    """Requests that are altered here, and are answered all the same."""
    altered = [d for d in case.damages if d.turn == IN_REQUEST and d.kind == CHECKSUM]
    complaints = _complaints(case)
    answered = [d for d in altered if d.then is None and d.at + d.length not in complaints]
    if len(answered) >= max(ENOUGH, MOST * len(altered)):
        yield _told(
            "answered-though-altered",
            answered,
            f"{len(answered)} of {len(altered)} requests whose checksum is wrong here were answered: "
            "the servos read them right",
            "it was answered all the same",
        )


def only_at_the_turn(case: Case, torn: Sequence[Damage]) -> bool:
    """Tell whether torn requests stand behind requests only, though most sound ones do not.

    A hole may be anywhere. What begins behind a request and lasts too long, a driver that does not
    let go, cuts whatever comes next: answers, and the request behind one that nobody answers.
    """
    behind = sum(d.behind == REQUEST for d in torn)
    usual = 1 - case.total("ok") / max(int(case.traffic["requests"].sum()), 1)
    return 0 < behind == len(torn) and at_least(behind, behind, max(usual, 0.0)) < TURN


def headless(case: Case) -> Iterator[Finding]:
    """Ends of frames without their beginnings."""
    exchanges = case.ledger.exchanges
    whole = {len(e) for e in exchanges.kinds.example}
    whole |= set(np.flatnonzero(exchanges.answer_lengths).tolist())
    ends = {d.at + d.length for d in case.damages}
    idle = [
        d
        for d in case.damages
        if d.turn not in (IN_REPLY, IN_REQUEST) and d.at not in ends and d.length >= PIECE
    ]
    known = exchanges.kinds.requests
    pieces = [
        d
        for d in idle
        if d.length not in whole and len(set(d.got)) > 1 and not _is_begun(d.got, known)
    ]
    if len(pieces) < LEAST or len(pieces) < max(MOST * len(idle), PART * len(case.damages)):
        return
    yield _told(
        "headless-frames",
        pieces,
        f"{len(pieces)} pieces of 3 bytes and more stand where no frame begins, of no frame's length",
        "the end of a frame whose beginning is missing",
    )


def order_lacks_bytes(case: Case) -> Iterator[Finding]:
    """Torn places that are shorter than the requests which are missing there."""
    order = case.once(Order)
    if case.has_bare_answers:
        yield from _bare_lack_bytes(case, order)
        return
    torn = [d for d in case.damages if d.turn in (IN_REPLY, IN_REQUEST)]
    found = [d for d in torn if _is_too_short(d, order)]
    known = case.ledger.exchanges.kinds.requests
    if len(found) >= max(LEAST, SOME_SHORT * len(torn)) and _end_anywhere(found, known):
        yield _told(
            "order-lacks-bytes",
            found,
            f"{len(found)} of {len(torn)} torn places are shorter than the requests that are missing there",
            "requests of more bytes are missing here",
        )


def _bare_lack_bytes(case: Case, order: Order) -> Iterator[Finding]:
    """The same where answers are bare: behind what is left of the request they belong to the place."""
    known = case.ledger.exchanges.kinds.requests
    torn = [
        d
        for d in case.damages
        if d.turn == IN_REQUEST and order.is_broken_at(d)
        if not any(_is_by_its_end(d.got, whole) for whole in known)
    ]
    holes = {d.at for d in torn if any(_has_hole(d.got, whole) for whole in known)}
    found = [d for d in torn if d.at in holes or _is_too_short(d, order)]
    chance = at_least(len(found), len(torn), BY_NOISE)
    if len(holes) >= LEAST and chance < CHANCE:
        yield _told(
            "order-lacks-bytes",
            found,
            f"{len(found)} of {len(torn)} torn requests and their answers are as they were sent, but for "
            "bytes that are missing",
            "bytes of a request and its answer are missing",
        )


def _is_by_its_end(got: bytes, whole: bytes) -> bool:
    """Tell whether bytes begin as a request of their length: the rest may be altered, or an answer."""
    return len(got) == len(whole) and alike(got, whole) >= BARE


def _is_too_short(d: Damage, order: Order) -> bool:
    """Tell whether a torn place has fewer bytes than the requests that are missing there.

    Who was not answered may leave out what it has no time for: only behind sound answers. Several
    torn requests in a row are several places, and missing together.
    """
    due = d.turn == IN_REQUEST and d.behind == RESPONSE and d.length >= PIECE
    return due and max(d.length, d.between) <= order.missing_bytes(d) - SHORT


def _has_hole(got: bytes, whole: bytes) -> bool:
    """Tell whether bytes are a request and a bare answer without one or more bytes in a row.

    Of one that states goals, which are any, its head is as it should be, and it is too short.
    """
    size = len(whole) + BARE
    if not PIECE < len(got) < size:
        return False
    head = alike(got, whole)
    if len(got) < len(whole) and head >= PIECE:
        return True
    behind = whole[len(whole) - max(len(got) - head - BARE, 0) :]
    return got[head : head + len(behind)] == behind


def requests_missing(case: Case) -> Iterator[Finding]:
    """Requests that are missing from a fixed order, with nothing torn in their place."""
    if not case.answering and not case.ledger.exchanges.silent:
        return
    if not case.has_clock:
        return
    exchanges, order = case.ledger.exchanges, case.once(Order)
    pairs, rows = order.breaks()
    rows = np.array([r for r in rows.tolist() if _took(case, order, pairs, r)], np.int64)
    n = int(pairs["n"][rows].sum())
    # A controller that waits for an answer in vain may leave out what it has no time for.
    if n < LEAST or len(exchanges.failed) > n:
        return
    rows = rows[np.argsort(pairs["t_first"][rows], kind="stable")]
    yield Finding(
        "requests-missing",
        None,
        int(pairs["t_first"][rows].min()),
        int(pairs["t_last"][rows].max()),
        n,
        f"{n} times requests of the controller's cycle are missing, which it else makes in one order",
        tuple(
            Place(
                int(pairs["at"][r]), 1, int(pairs["t_first"][r]), "behind this the next is missing"
            )
            for r in rows[:3]
        ),
        strength=min(0.4 + n / 15, 1.0),
        brief=f"requests missing {n} times",
    )


def _took(case: Case, order: Order, pairs: dict[str, I64], row: int) -> bool:
    """Tell whether a break in the order has time for an exchange that is missing in it.

    What is asked next is not asked sooner than it usually is: a loop that asks its servos in
    another order now and then rests before its goals all the same.
    """
    turns, next_kind = case.ledger.exchanges.turns, int(pairs["next"][row])
    missing = [turns.at(k, 0.05) for k in order.usual.get(int(pairs["kind"][row]), ())]
    least = min((turn.low for turn in missing if turn is not None), default=0)
    usual = [k for k, after in order.usual.items() if next_kind in after]
    before = within(pairs["kind"], usual) & (pairs["next"] == next_kind)
    rests = int(pairs["rest_min"][before].clip(0).min()) if before.any() else 0
    return least > 0 and int(pairs["rest_min"][row]) - rests - case.latency_ns > least


def _told(code: str, found: Sequence[Damage], what: str, each: str) -> Finding:
    strength = min(0.5 + len(found) / 10, 1.0)
    return finding_of(found, code, None, what, each, strength=strength, brief=what)


def _answered(case: Case, torn: Sequence[Damage]) -> list[Damage]:
    """Return those with a sound answer right behind that was no complaint."""
    # a late answer is told of by its request, which may stand there, too
    rows = case.anomalies("unsolicited-response", "mismatched-response", "duplicate-response")
    behind = set(rows.at.tolist()) - _complaints(case)
    # where the end of a request stands for an answer, the answer to that request is the next
    return [d for d in torn if d.at + d.length in behind or (d.turn == IN_REPLY and d.is_answered)]


def _complaints(case: Case) -> set[int]:
    """Return where servos say that what they heard was torn."""
    return set(case.anomalies("device-checksum").at.tolist())


def _end_anywhere(torn: Sequence[Damage], known: Sequence[bytes]) -> bool:
    """Tell whether torn places end wherever a hole does.

    A controller that breaks off, or that throws away what its port has not sent yet, leaves
    beginnings alone.
    """
    return sum(not are_beginnings(d.got, known) for d in torn) > ENDED * len(torn)


def _is_begun(got: bytes, known: Sequence[bytes]) -> bool:
    """Tell whether bytes are the beginning of a request, and nothing else."""
    return any(whole.startswith(got) for whole in known)


def _is_end(got: bytes, known: Sequence[bytes]) -> bool:
    """Tell whether bytes are the end of a request: the answer that was awaited is missing, too."""
    size = len(got)
    return size > PIECE and any(q.endswith(got) and len(q) > size + 1 for q in known)


def _is_short(got: bytes, known: Sequence[bytes]) -> bool:
    """Tell whether bytes are the beginning of a request, the end of one, or both without a middle."""
    if len(got) < PIECE or len(got) in {len(whole) for whole in known}:
        return False
    # one value is the half of a header, or a line that is held; and a late driver takes the first byte
    if len(set(got)) == 1 or any(got == whole[1:] for whole in known):
        return False
    head = max((alike(got, whole) for whole in known), default=0)
    tail = max((alike(got[::-1], whole[::-1]) for whole in known), default=0)
    return head + tail >= len(got)


RULES: Final[tuple[Rule, ...]] = (
    *(torn_requests, altered_requests, headless),
    *(order_lacks_bytes, requests_missing),
)
"""The rules of this area."""
