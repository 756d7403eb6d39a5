"""By which bytes the beginning of an answer tells whose it is."""

from __future__ import annotations

from typing import TYPE_CHECKING, Final

from sniffer.diagnosis.comparing import alike
from sniffer.diagnosis.mixing import beginning

if TYPE_CHECKING:
    from collections.abc import Mapping, Sequence

    from sniffer.diagnosis.case import Case

SIGN: Final = 2
"""Bytes at least by which the beginning of an answer tells whose it is."""


def beginnings(case: Case) -> Mapping[int, bytes]:
    """Return with what the answers of each servo begin."""
    likes = case.ledger.damages.likes
    answers: dict[int, list[bytes]] = {}
    for request, known in likes.known.items():
        answers.setdefault(likes.asked[request], []).extend(known)
    return {servo: beginning(some) for servo, some in answers.items()}


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
