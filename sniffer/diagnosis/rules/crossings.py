"""Two controllers on one line: requests that run into each other, streams that know nothing of it."""

from __future__ import annotations

from typing import TYPE_CHECKING, Final

import numpy as np

from sniffer.diagnosis.catalogue import FindingCode
from sniffer.diagnosis.chances import at_least, sureness
from sniffer.diagnosis.comparing import alike, header_of
from sniffer.diagnosis.damage import HELD, IN_REPLY, IN_REQUEST
from sniffer.diagnosis.model import Finding, Place
from sniffer.diagnosis.placed import finding_of
from sniffer.diagnosis.rules.ends import may_be_cut
from sniffer.diagnosis.signs import beginnings, signed
from sniffer.diagnosis.twins import of_twins
from sniffer.ground.codes import RESPONSE
from sniffer.ground.model import MS, NS

if TYPE_CHECKING:
    from collections.abc import Iterable, Iterator, Sequence

    from sniffer.diagnosis.case import Case
    from sniffer.diagnosis.damage import Damage
    from sniffer.diagnosis.rules import Rule
    from sniffer.ground.model import F64, I64

FINDINGS: Final = (
    FindingCode(
        "requests-run-together",
        "line",
        "Two requests run into each other: bytes begin as one and end as another.",
        "Unclaimed bytes that begin as a request of this bus (three bytes and more), end as another one (three bytes), and are as long as neither of the two nor both in a row.",
    ),
    FindingCode(
        "requests-spoken-into",
        "line",
        "Requests begin as they should and differ for long from there on: somebody speaks into them.",
        "Torn requests that begin as one of this bus, and are as long as none that begins so, nor one of them but for two bytes: far more of them than pulses leave, which alter a byte or lose one. Half of them at least are of a kind that is heard whole, too.",
    ),
    FindingCode(
        "kind-never-whole",
        "controller",
        "Requests of one kind are torn each time, and nothing else is: they are sent so.",
        "Twenty requests and more that begin as those of this bus and differ for long, of which none of a like beginning is whole, but by chance; of other requests and of answers hardly one is torn.",
    ),
    FindingCode(
        "torn-when-none-due",
        "line",
        "Requests are torn right behind answers, when no answer is due.",
        "Three of them and more, one in ten of all torn requests and answers, that begin as one and of which more than the last byte is torn, and no second answer of one id does it.",
    ),
    FindingCode(
        "streams-apart",
        "line",
        "Requests come in two rhythms that know nothing of each other.",
        "A kind of request that comes at regular times, and another one that stands at any place between them: by no multiple of the rhythm up to the sixth do they go together. It counts little where less is torn than by two who do not listen.",
    ),
)

BY_PULSES: Final = 0.25
"""Share of torn requests of which pulses garble more: those whose stop bit they hit."""

WHOM: Final = 2
"""Bytes behind the header that tell to whom a request is, and of what kind or how long."""

OFTEN, BESIDE = 20, 0.02
"""Torn requests of kinds that never are whole, and how many other torn frames there may be for each:
what tears at random spares none."""

BY_CHANCE: Final = 0.01
"""Part of all requests that are of a kind that is whole by chance."""

GARBLED: Final = 2
"""Bytes that a pulse alters at most where it leaves the length as it was."""

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

LEAST: Final = 24
"""Requests of a kind that show a rhythm."""

STEADY: Final = 0.15
REGULAR: Final = 0.5
"""A kind is regular if so many of its periods are that near to the middle one: some are torn."""

HARMONICS: Final = 6
"""A loop may ask something several times a cycle, at steady places of it."""

APART: Final = 0.36
"""What goes together less than that is apart: of 24 at any place the greatest of six is below."""

OFTENER: Final = 2.5
"""What comes so many times as often as the rhythm has wandered too far when that comes again."""

PART: Final = 400
PARTS: Final = 4
"""Requests that are looked at together at least, and parts of a stretch: one may join later."""

EXACT_NS: Final = 2_000_000
"""Stamps that are worse tell no place in a cycle."""

MEET: Final = 0.1
"""Part of the meetings that chance would have of two who do not listen: fewer, and one of them does
or there is only one."""

MET: Final = 3
"""Torn places that are no accident."""

TIMERS: Final = 0.3
"""How much two rhythms count that never meet: one program may have two timers, and does not run into
itself."""


def requests_run_together(case: Case) -> Iterator[Finding]:
    """Find places at which two requests were said at once."""
    torn = [
        d
        for d in case.damages
        if d.turn in (IN_REQUEST, IN_REPLY) and d.turn != HELD and d.length <= len(d.got)
        if not of_twins(case, d)
    ]
    known = case.ledger.exchanges.kinds.requests
    shared = header_of(known)
    into = [
        d
        for d in torn
        if d.turn == IN_REQUEST and d.at not in signed(case)
        if _is_two(d, _begun(case, d, known), known, shared)
    ]
    answers = [
        d for d in torn if d.turn == IN_REPLY and d.alike and _is_two(d, d.alike, known, shared)
    ]
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


def _begun(case: Case, d: Damage, known: Sequence[bytes]) -> Sequence[bytes]:
    """Return the requests as which bytes go on further than as anybody's answers begin."""
    most = max((alike(d.got, head) for head in beginnings(case).values()), default=0)
    return [q for q in known if alike(d.got, q) > most]


def _is_two(d: Damage, firsts: Iterable[bytes], seconds: Sequence[bytes], shared: int) -> bool:
    """Tell whether bytes begin as one frame and end as another, and are neither nor both."""
    begun = [a for a in firsts if alike(d.got, a) >= max(HEAD, shared + 1)]
    if not begun:
        return False
    back = d.got[::-1]
    ended = [b for b in seconds if alike(back, b[::-1]) >= TAIL - (len(b) <= SHORT)]
    return any(
        b != a
        and d.length not in (len(a), len(b))
        and d.length < len(a) + len(b)  # longer than both in a row there is something between
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
    for d in case.damages:
        whole = d.length == len(d.got) > HEAD and d.turn == IN_REQUEST
        begun = [q for q in known if alike(d.got, q) >= shared] if whole else []
        if not begun or of_twins(case, d):
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
    least = BY_CHANCE * case.total("asked")
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
    if any(abs(len(q) - len(got)) <= 1 for q in begun):
        return True
    same = [q for q in known if len(q) == len(got)]
    return any(sum(a != b for a, b in zip(got, q, strict=True)) <= GARBLED for q in same)


def streams_apart(case: Case) -> Iterator[Finding]:
    """Find two kinds of requests whose rhythms do not go together."""
    best = least_together(case) if case.has_clock and case.latency_ns <= EXACT_NS else None
    if best is None:
        return
    together, one, other, period, first, last = best
    times = int(case.ledger.exchanges.kinds.n[other])
    kinds, protocol = case.ledger.exchanges.kinds, case.protocol
    names = [f"{protocol.op_name(kinds.op[k])} of servo {kinds.servo_id[k]}" for k in (one, other)]
    yield Finding(
        "streams-apart",
        None,
        first,
        last,
        1,
        f"{names[0]} comes every {period / MS:.1f} ms, {names[1]} at any time between (they go "
        f"together by {together:.2f}, 1 is always, 0 never)",
        strength=(1.0 if together < APART / 2 else 0.8) if do_meet(case, times) else TIMERS,
        brief="requests come in two rhythms",
    )


def do_meet(case: Case, times: float, least: int = MET) -> bool:
    """Tell whether so much is torn as two must tear who do not listen; ``times`` one of them speaks."""
    busy = case.ledger.bytes * case.ledger.byte_ns / max(case.seconds * NS, 1.0)
    return int(case.damage["n"].sum()) >= max(least, MEET * busy * times)


def least_together(case: Case) -> tuple[float, int, int, float, int, int] | None:
    """Return the two kinds of requests that go together least, with the rhythm of one; None: all do."""
    found = []
    for t, kind in case.ledger.exchanges.moments.stretches():
        parts = max(min(len(t) // PART, PARTS), 1)
        for part in range(parts):
            rows = slice(len(t) * part // parts, len(t) * (part + 1) // parts)
            found.append(_apart(t[rows], kind[rows]))
    return min((one for one in found if one is not None), default=None)


def _apart(t: I64, kind: I64) -> tuple[float, int, int, float, int, int] | None:
    """Return the two kinds that go together least, if they do not, with the rhythm of one."""
    count = np.bincount(kind[kind >= 0])  # what came when there were too many kinds has none
    often = [k for k in np.argsort(-count, kind="stable")[:KINDS].tolist() if count[k] >= LEAST]
    times = {k: t[kind == k] for k in often}
    best: tuple[float, int, int, float, int, int] | None = None
    for one in often:
        between = np.diff(times[one])
        period = float(np.median(between))
        if period <= 0 or (np.abs(between / period - 1) < STEADY).mean() < REGULAR:
            continue
        for other in often:
            # of what comes oftener than the rhythm nobody knows how far it has wandered meanwhile
            if other == one or count[other] > OFTENER * count[one]:
                continue
            row = np.searchsorted(times[one], times[other], "right") - 1
            since = (times[other] - times[one][np.maximum(row, 0)])[row >= 0] / period
            since = since[since < 1 + STEADY]
            if len(since) < LEAST:
                continue
            together = _together(since)
            if together < APART and (best is None or together < best[0]):
                ends = int(times[other][0]), int(times[other][-1])
                best = together, one, other, period, *ends
    return best


def _together(since: F64) -> float:
    """Return how much places in a period are alike, or in a part of it: 1 all, 0 not at all."""
    turn = np.exp(2j * np.pi * since)
    power, most = turn, 0.0
    for _ in range(HARMONICS):  # a product takes a twentieth of what an exponential does
        most = max(most, float(abs(power.mean())))
        power = power * turn
    return most


RULES: Final[tuple[Rule, ...]] = (requests_run_together, spoken_into, when_none_due, streams_apart)
"""The rules of this area."""
