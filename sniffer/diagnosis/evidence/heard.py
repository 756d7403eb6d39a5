"""Torn requests that were answered: who answers heard them whole, so only the tap heard them torn.

Where answers have headers pairing tells: they are answers without a request. A bare one behind a
torn request is nothing but bytes of no frame::

    FF A1 35 21   14 93      the request FF A1 00 21, one byte of it torn, and its answer
    18 A1 00 21 12 7B        without a header both are noise in one go

Neither is a second answer to the request before, nor was it torn by one.
"""

from __future__ import annotations

import itertools
from typing import TYPE_CHECKING, Final, NamedTuple

from sniffer.diagnosis.ledger.damage import IN_IDLE, IN_REQUEST
from sniffer.diagnosis.physics.comparing import is_altered
from sniffer.diagnosis.physics.misread import BITS_FEW, misread

if TYPE_CHECKING:
    from collections.abc import Iterable, Set

    from sniffer.diagnosis.case import Case

SURELY: Final = 0.75
"""Part of the bytes that are as they should be where what is torn is surely a known request."""

MOSTLY: Final = 0.5
"""Part of the torn requests that are answered where it is the tap that tears them."""


class HeardWhole(NamedTuple):
    """Where torn requests stand that were answered, and the bare answers to them."""

    requests: Set[int]
    answers: Set[int]


def heard(case: Case) -> HeardWhole:
    """Return the torn requests that were answered, where answers are bare; else none."""
    return case.once(_heard)


def is_mostly_heard(case: Case) -> bool:
    """Tell whether most of the torn requests were answered."""
    torn = sum(d.turn == IN_REQUEST for d in case.damages)
    return len(heard(case).requests) > MOSTLY * torn


def _heard(case: Case) -> HeardWhole:
    size = case.ledger.answer_length
    if not case.has_bare_answers or not size:
        return HeardWhole(frozenset(), frozenset())
    known = {*case.ledger.exchanges.kinds.requests, *case.ledger.damages.likes.known}
    joined = [
        d._replace(got=d.got[:-size], length=d.length - size)
        for d in case.damages
        if d.turn == IN_REQUEST and not d.alike and d.length == len(d.got) > size
    ]
    # one bit turned, and it holds: what it states may be anything
    turned = (m for m in misread(case.protocol, joined, {}, len(joined)) if m.shape == BITS_FEW)
    in_one_go = {m.damage.at for m in turned}
    in_one_go |= {d.at for d in joined if _is_nearly(d.got, known)}
    pairs = [
        (d.at, behind.at)
        for d, behind in itertools.pairwise(case.damages)
        if d.turn == IN_REQUEST and behind.turn == IN_IDLE
        if d.at + d.length == behind.at and behind.length == size
        if _is_nearly(d.got, d.alike)
    ]
    return HeardWhole(in_one_go | {d for d, _ in pairs}, {behind for _, behind in pairs})


def _is_nearly(got: bytes, known: Iterable[bytes]) -> bool:
    """Tell whether torn bytes are surely one of some requests, but for a few bytes."""
    return any(is_altered(got, one, SURELY) for one in known)
