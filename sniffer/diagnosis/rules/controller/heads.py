"""Requests that hold but for one byte of their head, each time the same one: they are sent so.

A byte of the head tells how a frame goes on: how long it is, how many blocks it has. Where that
alone is wrong, all bytes are there and the checksum is right, over what was sent or over what was
meant. What disturbs a line hits any byte, and not the requests of one kind alone, each of them::

    FA AF 01 00 1E 02 00 F5 01 E8       a write of no block, and yet its data
    FA AF 01 00 1E 02 01 F5 01 E8       with the one block it has it holds
"""

from __future__ import annotations

import itertools
from collections import Counter
from typing import TYPE_CHECKING, Final, NamedTuple

from sniffer.decoding.holding import held
from sniffer.diagnosis.catalogue import FindingCode
from sniffer.diagnosis.evidence.placed import finding_of, single
from sniffer.diagnosis.ledger.damage import IN_REPLY, IN_REQUEST
from sniffer.diagnosis.physics.comparing import header_of

if TYPE_CHECKING:
    from collections.abc import Iterator, Sequence

    from sniffer.diagnosis.case import Case
    from sniffer.diagnosis.ledger.damage import Damage
    from sniffer.diagnosis.model import Finding
    from sniffer.diagnosis.rules import Rule
    from sniffer.protocols.base import BusProtocol

FINDINGS: Final = (
    FindingCode(
        "head-wrong",
        "Requests hold but for one byte of their head, each time the same one: it tells another length than they have, or nothing that there is.",
        "Ten torn requests and more, and four fifths of all torn frames, that become frames of just their bytes when one byte of the first eight is another one; their checksum is right for it, or for the bytes as they stand. Of their beginning, with the right byte, hardly one was heard whole.",
    ),
)

LEAST: Final = 10
"""Requests that fail alike: of those that one bit tears, one in ten has it in a given byte."""

MOSTLY: Final = 0.8
"""Part of the torn places, and of the torn requests that are tried, which must be so."""

TRIED: Final = 12
"""Torn requests that are tried."""

HEAD: Final = 8
"""First bytes of a request within which a byte tells how it goes on."""

HEADER: Final = 3
"""Bytes at most that are alike in all requests: who asks one servo only has more that are."""

LINE_ENDS: Final = {0x0A, 0x0D}

WHOLE: Final = 0.01
"""Part of so many requests that may be whole of the same beginning: a weak signal lets some by."""


class _HeadByte(NamedTuple):
    """A byte of a request that is wrong: which one, and what should stand there."""

    byte: int
    meant: int


def head_wrong(case: Case) -> Iterator[Finding]:
    """Find requests that one byte of their head makes none, each time."""
    places = [d for d in case.damages if d.turn == IN_REQUEST]
    torn = sum(d.turn in (IN_REQUEST, IN_REPLY) for d in case.damages)
    header = case.ledger.exchanges.kinds.requests[:1]
    if not header or len(places) < MOSTLY * torn:
        return
    shared = min(header_of(case.ledger.exchanges.kinds.requests) or HEADER, HEADER)
    pieces = [p for d in places for p in _pieces(d, header[0][:shared])]
    if len(pieces) < LEAST:
        return
    tried = min(len(pieces), TRIED)
    some = [pieces[k * len(pieces) // tried] for k in range(tried)]
    wrong = _wrong(case.protocol, some, shared)
    ((byte, n),) = Counter(w.byte for found in wrong for w in found).most_common(1) or ((-1, 0),)
    if n < max(MOSTLY * len(some), LEAST):
        return
    of_it = [(p, w) for p, found in zip(some, wrong, strict=True) for w in found if w.byte == byte]
    if _whole(case, of_it) > WHOLE * len(pieces):
        return
    if all({p[byte], w.meant} == LINE_ENDS for p, w in of_it):
        return  # a port that is not raw exchanges them
    first, one = of_it[0]
    whose = {p[: shared + 1] for p in pieces}
    yield finding_of(
        places,
        "head-wrong",
        single(case, places[0].servo_id) if len(whose) == 1 else None,
        f"{n} of {len(some)} torn requests that were tried hold as soon as byte {byte + 1} of them is "
        f"another one, such as {one.meant:02X} for {first[byte]:02X} in {first[:24].hex(' ').upper()}",
        f"no frame by its byte {byte + 1}",
        brief=f"byte {byte + 1} of requests is wrong, and all else is right",
    )


def _pieces(d: Damage, header: bytes) -> list[bytes]:
    """Return what is torn, request by request: what stands behind one header up to the next."""
    starts = [k for k in range(len(d.got)) if d.got.startswith(header, k)]
    cut = d.length > len(d.got)
    pieces = [d.got[a:b] for a, b in itertools.pairwise([0, *starts[1:], len(d.got)])]
    return [p for p in pieces[: len(pieces) - cut] if len(p) > HEAD and p.startswith(header)]


def _whole(case: Case, of_it: Sequence[tuple[bytes, _HeadByte]]) -> int:
    """Return how many requests were heard whole that begin as these do, and have the right byte."""
    begin = {p[: w.byte] + bytes((w.meant,)) for p, w in of_it}
    kinds = case.ledger.exchanges.kinds
    return sum(
        n
        for q, n in zip(kinds.example, kinds.n.tolist(), strict=True)
        if any(q.startswith(b) for b in begin)
    )


def _wrong(protocol: BusProtocol, some: Sequence[bytes], header: int) -> list[set[_HeadByte]]:
    """Return of each torn request the bytes with which, one of them changed, it would hold."""
    tries = [
        (k, w, t)
        for k, got in enumerate(some)
        if not _fits(protocol, got)
        for w, t in _tries(protocol, got, header)
    ]
    hold = held(protocol, [t for *_, t in tries], [len(t) for *_, t in tries])
    found: list[set[_HeadByte]] = [set() for _ in some]
    for (k, w, _), is_one in zip(tries, hold, strict=True):
        if is_one:
            found[k].add(w)
    return found


def _fits(protocol: BusProtocol, got: bytes) -> bool:
    """Tell whether bytes would hold with another checksum: their head is right then."""
    checksum = protocol.checksum_of(got)
    if checksum is None or checksum[2] != got[-1]:
        return True
    how, counted, _ = checksum
    resealed = got[:-1] + bytes((how(counted),))
    return held(protocol, [resealed], [len(got)])[0]


def _tries(protocol: BusProtocol, got: bytes, header: int) -> Iterator[tuple[_HeadByte, bytes]]:
    """Yield a request with another byte behind its header, and a checksum that is right for it.

    That is the one which stands there, or where that is right for all bytes as they stand, another.
    """
    is_of_all = _sum_of(protocol, got) == got[-1]
    for k in range(header, HEAD):
        for value in range(256):
            other = got[:k] + bytes((value,)) + got[k + 1 :]
            total = _sum_of(protocol, other)
            if value != got[k] and total >= 0 and (is_of_all or total == got[-1]):
                yield _HeadByte(k, value), other[:-1] + bytes((total,))


def _sum_of(protocol: BusProtocol, raw: bytes) -> int:
    """Return the checksum that bytes should have as a frame; -1: such a one has none."""
    checksum = protocol.checksum_of(raw)
    return -1 if checksum is None else checksum[0](checksum[1])


RULES: Final[tuple[Rule, ...]] = (head_wrong,)
"""The rules of this file."""
