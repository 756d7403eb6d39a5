"""Two controllers on one line: requests that run into each other, streams that know nothing of it."""

from __future__ import annotations

from typing import TYPE_CHECKING, Final

from sniffer.diagnosis.catalogue import FindingCode
from sniffer.diagnosis.evidence.chances import at_least, sureness
from sniffer.diagnosis.evidence.heard import heard, is_mostly_heard
from sniffer.diagnosis.evidence.placed import finding_of
from sniffer.diagnosis.evidence.signs import beginnings, signed
from sniffer.diagnosis.evidence.twins import of_twins
from sniffer.diagnosis.ledger.damage import IN_REPLY, IN_REQUEST
from sniffer.diagnosis.model import Finding, Place
from sniffer.diagnosis.physics.comparing import alike, header_of
from sniffer.diagnosis.physics.misread import BITS_FEW, misread
from sniffer.diagnosis.physics.overlaid import of_two
from sniffer.diagnosis.rules.line.ends import may_be_cut
from sniffer.ground.codes import RESPONSE

if TYPE_CHECKING:
    from collections.abc import Iterable, Iterator, Sequence

    from sniffer.diagnosis.case import Case
    from sniffer.diagnosis.ledger.damage import Damage
    from sniffer.diagnosis.rules import Rule

FINDINGS: Final = (
    FindingCode(
        "requests-run-together",
        "Two requests run into each other: bytes begin as one and end as another.",
        "Unclaimed bytes that begin as a request of this bus (three bytes and more), end as another one (three bytes), and are as long as neither of the two nor both in a row.",
    ),
    FindingCode(
        "requests-overlaid",
        "Torn bytes are, bit by bit, what a line gives on which two requests of this bus are said at once.",
        "Two places and more that no one request explains but for two bytes, and no loss of bytes: a request begun within another, where who pulls low wins, makes just these. More of them than one in two hundred, as chance has it.",
    ),
    FindingCode(
        "requests-spoken-into",
        "Requests begin as they should and differ for long from there on: somebody speaks into them.",
        "Torn requests that begin as one of this bus, and are as long as none that begins so, nor one of them but for two bytes: far more of them than pulses leave, which alter a byte or lose one. Half of them at least are of a kind that is heard whole, too.",
    ),
    FindingCode(
        "kind-never-whole",
        "Requests of one kind are torn each time, and nothing else is: they are sent so.",
        "Twenty requests and more that begin as those of this bus and differ for long, of which none of a like beginning is whole, but by chance; of other requests and of answers hardly one is torn.",
    ),
    FindingCode(
        "torn-when-none-due",
        "Requests are torn right behind answers, when no answer is due.",
        "Three of them and more, one in ten of all torn requests and answers, that begin as one and of which more than the last byte is torn, and no second answer of one id does it.",
    ),
)

BY_PULSES: Final = 0.25
"""Share of torn requests of which pulses garble more: those whose stop bit they hit."""

TRIED: Final = 30
"""Torn places of which it is tried whether they are two requests."""

BY_CHANCE: Final = 5e-3
"""Part of the torn places that two requests would make by chance, of all the ways in which they may lie."""

WHOM: Final = 2
"""Bytes behind the header that tell to whom a request is, and of what kind or how long."""

OFTEN: Final = 20
BESIDE: Final = 0.02
"""Torn requests of kinds that never are whole, and how many other torn frames there may be for each:
what tears at random spares none."""

WHOLE_BY_CHANCE: Final = 0.01
"""Part of all requests that are of a kind that is whole by chance."""

GARBLED: Final = 2
"""Bytes that a pulse alters at most where it leaves the length as it was."""


TWICE: Final = 2
SOME: Final = 1e-2
"""Places, and how likely they are by chance, from where on they count."""

ENOUGH: Final = 3
LEAST_SURE: Final = 0.03
CHANCE: Final = 1e-4
"""Places that are no accident, and how likely they are by pulses where they count at all, and in full."""

UNOWED: Final = 0.1
"""Part of the torn frames that must be requests behind an answer."""

HEAD: Final = 3
"""Bytes behind a common beginning, or with it, that tell which frame has begun."""

TAIL: Final = 3
"""Bytes that tell which one has ended: chance has them once in 16 million."""

SHORT: Final = 6
"""Requests up to so many bytes are told by one byte less at their end."""

PLENTY: Final = 8

ONCE: Final = 0.2
"""How much one place counts: two who do not listen run into each other again, a pulse does so once."""

SELDOM: Final = 0.02
MANY: Final = 0.08
"""Parts of the torn frames: what tears many frames makes one of them look like two now and then,
and what two controllers tear is two requests in one of ten cases at least, the rest answers."""

KINDS: Final = 12
"""Kinds of requests that are compared, the most frequent ones."""


def requests_run_together(case: Case) -> Iterator[Finding]:
    """Find places at which two requests were said at once."""
    torn = [
        d
        for d in case.damages
        if d.turn in (IN_REQUEST, IN_REPLY) and d.length <= len(d.got)
        if not of_twins(case, d)
    ]
    known = case.ledger.exchanges.kinds.requests
    shared = header_of(known)
    into = [
        d
        for d in torn
        if d.turn == IN_REQUEST and d.at not in signed(case)
        if is_two(d, _begun(case, d, known), known, shared)
    ]
    answers = [
        d for d in torn if d.turn == IN_REPLY and d.alike and is_two(d, d.alike, known, shared)
    ]
    if not answers and _are_altered(case, into):
        return
    every = sorted((*into, *answers), key=lambda d: d.at)
    requests = sum(d.turn == IN_REQUEST for d in torn)
    if not into or len(every) < SELDOM * len(torn):
        return
    yield Finding(
        "requests-run-together",
        None,
        every[0].t_ns,
        every[-1].t_ns,
        len(every),
        f"{len(into)} of {requests} torn requests begin as one request and end as another, "
        f"{len(answers)} torn answers end as a request",
        tuple(Place(d.at, d.length, d.t_ns, "two requests at once") for d in into[:3]),
        strength=min(
            0.35 + len(into) / PLENTY if len(every) > 1 else ONCE,
            len(every) / (MANY * len(torn)),
            1.0,
        ),
        brief=f"{len(into)} requests run into each other",
    )


def _are_altered(case: Case, torn: Sequence[Damage]) -> bool:
    """Tell whether one misread bit explains most of some torn frames: nobody spoke into these.

    Of a line of text it is the one sign that stands in no line.
    """
    read = misread(case.protocol, torn, case.ledger.damages.likes.known)
    return 2 * sum(m.shape == BITS_FEW and len(m.flips) == 1 for m in read) > len(read)


def overlaid(case: Case) -> Iterator[Finding]:
    """Find places at which two requests give just what was heard."""
    kinds = case.ledger.exchanges.kinds
    often = sorted(range(len(kinds)), key=lambda k: -int(kinds.n[k]))[:KINDS]
    known = tuple(dict.fromkeys(kinds.example[k] for k in often))
    torn = [
        d
        for d in case.damages
        if d.turn in (IN_REQUEST, IN_REPLY) and HEAD <= d.length == len(d.got)
        if not any(_is_nearly(d.got, q) for q in known)
    ][:TRIED]
    shown = [d for d in torn if of_two(d.got, known)]
    chance = at_least(len(shown), len(torn), BY_CHANCE)
    if len(shown) < TWICE or chance > SOME:
        return
    yield finding_of(
        shown,
        "requests-overlaid",
        None,
        f"{len(shown)} of {len(torn)} torn frames are, bit by bit, two requests at once",
        "two requests at once",
        strength=sureness(chance, CHANCE),
        brief=f"{len(shown)} requests lie over each other",
    )


def _begun(case: Case, d: Damage, known: Sequence[bytes]) -> Sequence[bytes]:
    """Return the requests as which bytes go on further than as anybody's answers begin."""
    most = max((alike(d.got, head) for head in beginnings(case).values()), default=0)
    return [q for q in known if alike(d.got, q) > most]


def is_two(d: Damage, firsts: Iterable[bytes], seconds: Sequence[bytes], shared: int) -> bool:
    """Tell whether bytes begin as one frame and end as another, and are neither nor both."""
    begun = [a for a in firsts if alike(d.got, a) >= max(HEAD, shared + 1)]
    if not begun:
        return False
    back = d.got[::-1]
    ended = [b for b in seconds if alike(back, b[::-1]) >= TAIL - (len(b) <= SHORT)]
    # what one leaves and another one joins is longer than either; a line of text has any digits
    if not ended or d.length <= max(len(max(begun, key=len)), len(max(ended, key=len))):
        return False
    least = min(map(len, begun))  # a line that lost its end goes on with the next one
    return any(
        b != a
        and d.length not in (len(a), len(b))
        and d.length < least + len(b)  # longer than both in a row there is something between
        and alike(back, a[::-1]) < alike(back, b[::-1])
        for a in begun
        for b in ended
    )


def spoken_into(case: Case) -> Iterator[Finding]:
    """Find requests that begin well and are garbled for long."""
    known = case.ledger.exchanges.kinds.requests
    if not known:
        return
    shared = max(header_of(known), 1)
    judged, shown = 0, []
    # two requests at once look now and then like one and the answer to it, not mostly
    answered = heard(case).requests if is_mostly_heard(case) else frozenset()
    for d in case.damages:
        whole = d.length == len(d.got) > HEAD and d.turn == IN_REQUEST
        begun = [q for q in known if alike(d.got, q) >= shared] if whole else []
        if not begun or d.at in answered or of_twins(case, d):
            continue
        judged += 1
        shown += [] if _is_one(d.got, begun, known) else [d]
    chance = at_least(len(shown), judged, BY_PULSES)
    never = [d for d in shown if not _is_whole_at_times(case, d.got, shared)]
    if len(shown) < ENOUGH or chance > LEAST_SURE:
        return
    if 2 * len(never) > len(shown):
        yield from _never_whole(case, never, judged)
        return
    yield finding_of(
        shown,
        "requests-spoken-into",
        None,
        f"{len(shown)} of {judged} torn requests begin as they should, and then differ for long",
        "somebody speaks into it",
        strength=sureness(chance, CHANCE),
        brief="somebody speaks into requests",
    )


def _never_whole(case: Case, never: Sequence[Damage], judged: int) -> Iterator[Finding]:
    """Say that requests of a kind are torn each time, where nothing else is."""
    others = judged - len(never) + sum(d.turn == IN_REPLY for d in case.damages)
    # answers without a checksum are whole at a wrong rate, too
    if not case.has_checksum or len(never) < OFTEN or others > BESIDE * len(never):
        return
    yield finding_of(
        never,
        "kind-never-whole",
        None,
        f"{len(never)} of {judged} torn requests are of a kind that never is whole, and "
        f"{others} other frames are torn",
        "none of its kind is whole",
        strength=min(0.5 + len(never) / 100, 1.0),
        brief="a kind of request is never whole",
    )


def _is_whole_at_times(case: Case, got: bytes, shared: int) -> bool:
    """Tell whether a request to whom and of what a torn one begins is heard whole, too.

    Who speaks into requests does not choose one kind: what is whole by chance at most was not sent
    whole, or is heard at a wrong rate.
    """
    kinds = case.ledger.exchanges.kinds
    least = WHOLE_BY_CHANCE * case.total("asked")
    return any(
        n >= least and alike(got, q) >= min(shared + WHOM, len(q) // 2)
        for q, n in zip(kinds.example, kinds.n.tolist(), strict=True)
    )


def when_none_due(case: Case) -> Iterator[Finding]:
    """Find requests that are torn when nobody owes an answer.

    Who does not wait tears none of these; a driver that lets go too early, their last bytes only.
    They begin as requests do: the rest of one whose beginning lies under an answer came before it
    was over.
    """
    known = case.ledger.exchanges.kinds.requests
    unowed = [
        m.damage
        for m in case.misreads
        if m.damage.turn == IN_REQUEST and m.damage.behind == RESPONSE
        if not may_be_cut(m) and not of_twins(case, m.damage) and _begun(case, m.damage, known)
    ]
    if len(unowed) >= max(ENOUGH, UNOWED * len(case.misreads)):
        yield finding_of(
            unowed,
            "torn-when-none-due",
            None,
            f"{len(unowed)} of {len(case.misreads)} torn frames are requests right behind an answer: "
            "none was due",
            "a request torn when no answer is due",
            strength=min(0.4 + len(unowed) / (2 * PLENTY), 1.0),
        )


def _is_one(got: bytes, begun: Sequence[bytes], known: Sequence[bytes]) -> bool:
    """Tell whether bytes are a request but for a few, or but for one that is lost or more."""
    if any(abs(len(q) - len(got)) <= 1 or _is_cut(got, q) for q in begun):
        return True
    return any(_is_nearly(got, q) for q in known)


def _is_cut(got: bytes, whole: bytes) -> bool:
    """Tell whether bytes are the beginning of a request, and a few more: nobody spoke on for long."""
    return len(got) < len(whole) and len(got) - alike(got, whole) <= GARBLED


def _is_nearly(got: bytes, whole: bytes) -> bool:
    """Tell whether bytes are a request but for a few that a pulse altered."""
    same = len(got) == len(whole)
    return same and sum(a != b for a, b in zip(got, whole, strict=True)) <= GARBLED


RULES: Final[tuple[Rule, ...]] = (
    requests_run_together,
    overlaid,
    spoken_into,
    when_none_due,
)
"""The rules of this area."""
