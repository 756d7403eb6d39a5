"""Answers of which the first byte is missing or wrong, and how one knows."""

from __future__ import annotations

from typing import TYPE_CHECKING, Final

from sniffer.diagnosis.evidence.delays import delays
from sniffer.diagnosis.evidence.signs import beginnings
from sniffer.diagnosis.evidence.twins import torn_by_twins, twins
from sniffer.diagnosis.ledger.damage import IN_REPLY
from sniffer.diagnosis.physics.comparing import alike, header_of
from sniffer.diagnosis.physics.misread import BITS_FEW, FRONT
from sniffer.ground.model import NEVER_NS

if TYPE_CHECKING:
    from collections.abc import Sequence

    from sniffer.diagnosis.case import Case
    from sniffer.diagnosis.physics.misread import Misread

PROMPT: Final = 0.1
"""Part of a byte time, a bit, by which an answer must be later than any sound one to lack its
beginning."""

IN_FRONT: Final = 2
"""Bytes of an answer's beginning: what stands where the direction changes may hit the second."""

EITHER: Final = 0.5
"""How often a contact that opens and closes at any time takes the beginning, and leaves the end."""


def torn_in_front(case: Case) -> list[Misread]:
    """Return torn answers whose first byte is missing or wrong, and the second at most."""
    answers = [m for m in case.misreads if m.damage.turn == IN_REPLY]
    late = _late(case, answers)
    other = _begin_of_requests(case)
    return [
        m
        for m in answers
        # what tears these tears any byte
        if m.damage.at not in torn_by_twins(case)
        and m.servo_id not in twins(case)
        and m.damage.got[:1] != other  # a request that somebody speaks into
        if m.shape == FRONT or _hit_in_front(m) or m.damage.at in late
    ]


def _begin_of_requests(case: Case) -> bytes | None:
    """Return the byte with which all requests begin, where answers have headers of another one."""
    requests = case.ledger.exchanges.kinds.requests
    answers = [a for some in case.ledger.damages.likes.known.values() for a in some]
    if case.protocol.ordered or not header_of(requests) or not header_of(answers):
        return None
    begin = requests[0][:1]
    return begin if begin != answers[0][:1] else None


def _late(case: Case, answers: Sequence[Misread]) -> set[int]:
    """Return the places of torn answers that begin later than any sound one: they lack a byte.

    Both are stamped alike, so that what all stamps are off by does not matter; what they vary by is
    in the latest sound one.
    """
    latest = {servo: delay.latest_ns for servo, delay in delays(case).items()}
    least, begins = PROMPT * case.ledger.byte_ns, beginnings(case)
    return {
        m.damage.at
        for m in answers
        if m.shape != BITS_FEW
        and m.damage.since_ns > latest.get(m.servo_id, NEVER_NS) + least
        # when it began is reckoned by its bytes, of which a second sender may have taken some
        and not _has_front(m.damage.got, begins.get(m.servo_id, b""))
    }


def _has_front(got: bytes, begin: bytes) -> bool:
    """Tell whether bytes begin as answers do, rather than as answers without their first byte."""
    return alike(got, begin) > alike(got, begin[1:])


def _hit_in_front(m: Misread) -> bool:
    """Tell whether the first byte is wrong, and the second at most beside it.

    What is there when the direction changes hits the one before the other.
    """
    return is_hit(m) and min(m.bytes_hit) == 0 and max(m.bytes_hit) < IN_FRONT


def is_hit(m: Misread) -> bool:
    """Tell whether it is known which bytes of a frame are wrong."""
    return m.shape == BITS_FEW and bool(m.bytes_hit)
