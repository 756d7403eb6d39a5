"""Bytes that the tap lost: frames that lack bytes here, and were whole on the line."""

from __future__ import annotations

from typing import TYPE_CHECKING, Final

from sniffer.diagnosis.catalogue import FindingCode
from sniffer.diagnosis.damage import IN_IDLE, IN_REPLY, IN_REQUEST
from sniffer.diagnosis.model import Finding, Place

if TYPE_CHECKING:
    from collections.abc import Iterator, Sequence

    from sniffer.diagnosis.case import Case
    from sniffer.diagnosis.damage import Damage
    from sniffer.diagnosis.rules import Rule

FINDINGS: Final = (
    FindingCode(
        "requests-torn-short",
        "tap",
        "Requests lack bytes: a controller sends them in one go, and noise alters bytes but hardly "
        "ever takes any away.",
        "Torn requests that begin or end as a request which this controller made, and are shorter; "
        "most torn requests are so.",
    ),
    FindingCode(
        "answered-though-torn",
        "tap",
        "Servos answer requests that lack bytes here: on the line they were whole.",
        "An answer right behind a torn request that is shorter than the one it begins or ends as.",
    ),
)

LEAST: Final = 3
"""Torn requests that make a pattern."""

MOST: Final = 0.6
"""Share of torn requests that are short where bytes are lost; noise leaves nearly all their length."""

ANSWERED: Final = 0.25
"""Share of them that are answered: a hole often takes the answer, too."""

HEAD: Final = 4
"""Bytes alike from the beginning: more than a header."""

TAIL: Final = 3
"""Bytes alike up to the end: the checksum and what is before it."""

FEW: Final = 2
"""What is left of a frame may be as little."""


def torn_requests(case: Case) -> Iterator[Finding]:
    """Requests that lack bytes, and what servos say to them."""
    torn = [
        d for d in case.damages if d.turn in (IN_REQUEST, IN_IDLE, IN_REPLY) and len(d.got) >= FEW
    ]
    requests = [d for d in torn if d.turn == IN_REQUEST]
    known = tuple(set(case.ledger.exchanges.kinds.example))
    short = [d for d in requests if _lacks(d.got, known)]
    if len(short) >= LEAST and len(short) >= MOST * len(requests):
        lost = sum(_lost(d.got, known) for d in short)
        yield _told(
            "requests-torn-short",
            short,
            f"{len(short)} of {len(requests)} torn requests lack bytes, about {lost} in all",
            "a request that lacks bytes",
        )
    answered = _answered(case, short)
    if len(answered) >= LEAST - 1 and len(answered) >= ANSWERED * len(short):
        yield _told(
            "answered-though-torn",
            answered,
            f"{len(answered)} of {len(short)} requests that lack bytes here were answered: the servos "
            "had them whole",
            "it was answered all the same",
        )


def _told(code: str, found: Sequence[Damage], what: str, each: str) -> Finding:
    return Finding(
        code,
        None,
        found[0].t_ns,
        found[-1].t_ns,
        len(found),
        what,
        tuple(Place(d.at, d.length, d.t_ns, each) for d in found[:3]),
        strength=min(0.5 + len(found) / 10, 1.0),
        brief=what,
    )


def _answered(case: Case, torn: Sequence[Damage]) -> list[Damage]:
    """Return those with a sound answer right behind that was no complaint."""
    rows = case.anomalies(
        "unsolicited-response", "mismatched-response", "duplicate-response", "late-response"
    )
    complaints = set(case.anomalies("device-checksum").at.tolist())
    behind = set(rows.at.tolist()) - complaints
    return [d for d in torn if d.at + d.length in behind]


def _lacks(got: bytes, known: Sequence[bytes]) -> bool:
    return _lost(got, known) > 0


def _lost(got: bytes, known: Sequence[bytes]) -> int:
    """Return how many bytes are missing from a request that was meant; 0: none, or nobody knows."""
    best = 0
    for whole in known:
        missing = len(whole) - len(got)
        if missing <= 0:
            continue
        head, tail = alike(got, whole), alike(got[::-1], whole[::-1])
        if (head + tail >= len(got) or head >= HEAD or tail >= TAIL) and (
            not best or missing < best
        ):
            best = missing
    return best


def alike(a: bytes, b: bytes) -> int:
    """Return how many first bytes are the same."""
    return next(
        (n for n, (x, y) in enumerate(zip(a, b, strict=False)) if x != y), min(len(a), len(b))
    )


RULES: Final[tuple[Rule, ...]] = (torn_requests,)
"""The rules of this area."""
