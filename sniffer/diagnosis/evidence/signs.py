"""By which bytes an answer tells whose it is: where it begins, or within what else is torn.

A second answer that lies over what others say is read from wherever the receiver finds a start bit
once they are silent. So its first bytes, which name its servo, stand within what is torn, as they
are or some bits apart::

    answer of 6      2A 36 51 44 2D 32 34
    second one of 4              2A 34 51 44 2D 32 31 38 0D
    heard            2A 36 51 44 2D 32 34 B7 34 51 44 2D 32 31 38 0D
"""

from __future__ import annotations

import functools
from collections import Counter
from typing import TYPE_CHECKING, Final

from sniffer.diagnosis.ledger.damage import IN_REPLY
from sniffer.diagnosis.physics.comparing import alike
from sniffer.diagnosis.physics.mixing import beginning
from sniffer.diagnosis.physics.uart import BITS, LOW, received, sent
from sniffer.protocols.base import answer_begins

if TYPE_CHECKING:
    from collections.abc import Iterable, Iterator, Mapping, Sequence, Set

    from sniffer.diagnosis.case import Case
    from sniffer.diagnosis.ledger.damage import Damage
    from sniffer.diagnosis.ledger.kinds import RequestKinds

BARE: Final = 2
"""Bytes of an answer without a header (wCK), which cannot be told from what stands before it."""

SIGN: Final = 2
"""Bytes at least by which the beginning of an answer tells whose it is."""

OFTEN: Final = 3
"""Times that a request was said by somebody who meant it."""

WITHIN: Final = 3
"""Bytes at least by which what stands within torn bytes tells whose it is: chance has these once in
a hundred thousand places."""

SAID: Final = 3
"""Torn places that say whose they are, and are not taken for somebody else's."""

PLAIN: Final = b"\x00\xff"
"""Bytes of which what answers tell is full."""

HEAD: Final = 6
"""First bytes of an answer that may name its servo."""

ALONE: Final = 0.75
"""Part of the torn places that name somebody within, which must name one servo: what a tap lost, or
noise, joins pieces of everybody's answers."""


def beginnings(case: Case) -> Mapping[int, bytes]:
    """Return with what the answers of each servo begin, by what was heard, else by its requests."""
    return case.once(_beginnings)


def _beginnings(case: Case) -> Mapping[int, bytes]:
    likes, kinds = case.ledger.damages.likes, case.ledger.exchanges.kinds
    answers: dict[int, list[bytes]] = {}
    for request, known in likes.known.items():
        answers.setdefault(likes.asked[request], []).extend(known)
    # a bare byte (an ACK) names nobody
    answers = {s: [a for a in some if len(a) > SIGN] or some for s, some in answers.items()}
    due: dict[int, list[bytes]] = {}
    for request, servo in _often(kinds):
        if servo not in answers and (head := answer_begins(case.protocol, request)):
            due.setdefault(servo, []).append(head)
    return {servo: beginning(some) for servo, some in (*answers.items(), *due.items())}


def _often(kinds: RequestKinds) -> Iterator[tuple[bytes, int]]:
    """Yield requests with whom they ask: what was said but once may be torn, and hold by chance."""
    for request, servo, n in zip(kinds.example, kinds.servo_id, kinds.n.tolist(), strict=True):
        if n >= OFTEN:
            yield request, servo


def begins_like(got: bytes, theirs: bytes, others: Sequence[bytes]) -> bool:
    """Tell whether bytes begin as one servo's answers up to where others' differ, and behind.

    Where a request to it begins so, too, they must go on otherwise than that one.
    """
    size = _telling(theirs, others)
    is_one = SIGN <= size < len(got) and got[:size] == theirs[:size]
    return is_one and all(alike(got, other) <= size for other in others)


def sign_of(theirs: bytes, others: Sequence[bytes]) -> bytes:
    """Return the first bytes of one servo's answers that tell them from all others; empty: none do.

    Answers of two lengths have in common only what a request to their servo begins with, too.
    """
    sign = theirs[: _telling(theirs, others)]
    return b"" if any(other.startswith(sign) for other in others) else sign


def _telling(theirs: bytes, others: Sequence[bytes]) -> int:
    """Return up to which byte one servo's answers differ from all others that ever do."""
    same = ((alike(theirs, other), min(len(theirs), len(other))) for other in others)
    return max((n + 1 for n, size in same if n < size), default=0)


def named_by_header(case: Case) -> Mapping[int, int]:
    """Return whose frames torn places say they are, by their first bytes, by place."""
    told = case.anomalies("bad-checksum", "truncated-frame", "damaged-frame")
    return dict(zip(told.at.tolist(), told.servo_id.tolist(), strict=True))


def signed(case: Case) -> Mapping[int, int]:
    """Return the torn places that hold what one servo's answers alone begin with, by place.

    Of those where its answer is awaited only where that is another's.
    """
    return case.once(_signed)


def _signed(case: Case) -> Mapping[int, int]:
    if case.protocol.ordered or not case.damages:
        return {}
    signs = case.once(_signs)
    telling = _telling_one(case.once(_unsaid))
    sizes = sorted(set(map(len, telling)))
    out = {}
    for d in case.damages:
        awaited, own = d.turn == IN_REPLY, signs.get(d.asked_id, ())
        if awaited and not any(d.got.startswith(one) for one in own):
            continue  # two of one id make any other of it
        if awaited and loses_most(case, d.asked_id):
            continue  # of a thousand torn answers some hold any three bytes, as data
        got = _behind_head(d.got, own) if awaited else d.got
        parts = (got[k : k + n] for n in sizes for k in range(len(got) - n + 1))
        found = {telling[part] for part in parts if part in telling}
        if awaited:
            found.discard(d.asked_id)
        found = {servo for servo in found if not loses_most(case, servo)}
        if len(found) == 1:
            out[d.at] = found.pop()
    return out


def loses_most(case: Case, servo: int) -> bool:
    """Tell whether most answers of a servo are torn or missing: it was asked for what it says."""
    return case.total("damaged", servo) + case.total("missing", servo) > case.total("ok", servo)


def is_anothers(case: Case, places: Iterable[int], servo: int) -> bool:
    """Tell whether torn places say, by offset, that they are another servo's than this one's."""
    found = signed(case)
    said = Counter(found[at] for at in places if at in found)
    return any(n >= SAID and n > said[servo] for other, n in said.items() if other != servo)


def named_within(case: Case) -> Mapping[int, int]:
    """Return the torn places that hold what an answer of a servo asked before begins with.

    That servo has answered already, and another one is asked; only of the servo that is named in
    nearly all such places.
    """
    return case.once(_named_within)


def _named_within(case: Case) -> Mapping[int, int]:
    if case.protocol.ordered or not case.damages:
        return {}
    signs, alone = case.once(_signs), case.once(_unsaid)
    named = {
        d.at: servo
        for d in case.damages
        # while an answer is awaited no request is said
        if (servo := _within(d, signs if d.turn == IN_REPLY else alone)) >= 0
    }
    if not named:
        return {}
    ((one, count),) = Counter(named.values()).most_common(1)
    # two of one id lie over each other, and what they make of it may be another's now and then
    telling = _telling_one(signs)
    own = {servo: [s for s in some if s in telling] for servo, some in signs.items()}
    twice = sum(_has(d.got, own.get(d.asked_id, ())) for d in case.damages if d.turn == IN_REPLY)
    if count < ALONE * (len(named) + twice):
        return {}
    return {at: servo for at, servo in named.items() if servo == one}


def _has(got: bytes, own: Sequence[bytes]) -> bool:
    """Tell whether the signs of the servo that was asked stand in its answer once more."""
    behind = _behind_head(got, own)
    return any(s in behind for s in own)


def _behind_head(got: bytes, own: Sequence[bytes]) -> bytes:
    """Return what stands behind one's own head: an id that is misread there names nobody else."""
    return got[max(max(map(len, own), default=WITHIN) - WITHIN + 1, 1) :]


def _within(d: Damage, signs: Mapping[int, Sequence[bytes]]) -> int:
    """Return the one servo whose sign stands within a torn place, and that was asked before; -1."""
    asked, own = _last_asked(d), signs.get(d.asked_id, ())
    behind = _behind_head(d.got, own)
    found = [
        servo
        for servo, is_answered in asked.items()
        if is_answered and servo != d.asked_id
        if any(s in behind and s not in own for s in signs.get(servo, ()))
    ]
    return found[0] if len(found) == 1 else -1


def _last_asked(d: Damage) -> Mapping[int, bool]:
    """Return who was asked before a place, and whether the last request to each was answered."""
    asked: dict[int, bool] = {}
    for a in d.asked_before:
        asked.setdefault(a.servo_id, a.is_answered)
    return asked


def _signs(case: Case) -> Mapping[int, Sequence[bytes]]:
    """Return of each servo the bytes that its answers begin with, however they are read.

    Those that stand somewhere in what answers tell are left out.
    """
    likes, kinds = case.ledger.damages.likes, case.ledger.exchanges.kinds
    asked = [*likes.asked.items(), *_often(kinds)]
    heads: dict[int, set[bytes]] = {}
    for request, servo in asked:
        head = answer_begins(case.protocol, request) or beginning(likes.known.get(request, ()))
        heads.setdefault(servo, set()).add(head[:HEAD])
    told = {
        answer[k : k + WITHIN]
        for known in likes.known.values()
        for answer in known[:1]
        for k in range(HEAD - 1, len(answer) - WITHIN + 1)
    }
    return {
        servo: [one for head in some for one in _read_as(head) if not _is_told(one, told)]
        for servo, some in heads.items()
    }


def _is_told(sign: bytes, told: Set[bytes]) -> bool:
    """Tell whether a sign may be data: it is some, or a byte among those of which data are full."""
    if sum(byte not in PLAIN for byte in sign) < SIGN:
        return True
    parts = (sign[k : k + WITHIN] for k in range(len(sign) - WITHIN + 1))
    return all(part in told for part in parts)


def _unsaid(case: Case) -> Mapping[int, Sequence[bytes]]:
    """Return of each servo those that no request is read as."""
    said = {one for q in case.ledger.exchanges.kinds.requests for one in _read_as(q[:HEAD])}
    return {s: [one for one in some if one not in said] for s, some in case.once(_signs).items()}


def _telling_one(signs: Mapping[int, Sequence[bytes]]) -> Mapping[bytes, int]:
    """Return the signs that are one servo's alone, with whose they are."""
    whose: dict[bytes, set[int]] = {}
    for servo, some in signs.items():
        for one in some:
            whose.setdefault(one, set()).add(servo)
    return {one: min(servos) for one, servos in whose.items() if len(servos) == 1}


@functools.lru_cache(maxsize=1 << 12)
def _read_as(head: bytes) -> frozenset[bytes]:
    """Return what is read of first bytes by a receiver that begins with any of their bits."""
    edges = sent(head)
    starts = [k for k, (_, level) in enumerate(edges) if level == LOW]
    read = ((b for b in received(edges[k:]) if b.t + BITS <= BITS * len(head)) for k in starts)
    values = [bytes(b.value for b in some) for some in read]
    return frozenset(some[:n] for some in values for n in range(WITHIN, len(some) + 1))
