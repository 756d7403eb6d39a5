"""Holes that join two frames: one begins as it should, another one goes on, nothing is altered.

Noise alters bytes and leaves their number; two who speak at once alter those they have in common.
What a hole leaves has a length that no frame has, and every byte of it stands where it stands in
its frame, counted from the beginning or from the end::

    FD DF 04 00 2A 12 01 | 48 02 .. D4      an answer of servo 4, and the end of one of servo 5
    FF FF FF 02 04 | 0E 72                  a request to servo 2, and the end of one to servo 3
"""

from __future__ import annotations

from collections import Counter
from typing import TYPE_CHECKING, Final

from sniffer.diagnosis.catalogue import FindingCode
from sniffer.diagnosis.evidence.hit import torn_answers
from sniffer.diagnosis.evidence.order import Order
from sniffer.diagnosis.evidence.placed import finding_of
from sniffer.diagnosis.ledger.damage import HELD, IN_REPLY, IN_REQUEST, REST
from sniffer.ground.codes import RESPONSE

if TYPE_CHECKING:
    from collections.abc import Iterator, Sequence

    from sniffer.diagnosis.case import Case
    from sniffer.diagnosis.ledger.damage import Damage
    from sniffer.diagnosis.model import Finding
    from sniffer.diagnosis.rules import Rule

FINDINGS: Final = (
    FindingCode(
        "frames-spliced",
        "Torn places are ends of frames, alone or behind the beginning of another, and no byte is altered.",
        "Ends of answers that lack two bytes and more, or of a length that no frame has, nor two (but where longer requests are missing from the order), by two bytes at least; each byte as it always is at its place, from the beginning up to the hole and from the end. Three places and more, a quarter of all torn ones; a request is cut, or missing before the end of an answer. Answers of a servo that is hit far more than others are left out. Of protocols with a checksum and a header in each frame.",
    ),
)

LEAST: Final = 3
PART: Final = 0.25
"""Splices that make a pattern, and which part of all torn places they must be."""

SHORT: Final = 2
"""By so many bytes a length differs from that of any frame: a pulse takes or adds one at most."""

STEADY: Final = 3
"""Bytes that are always the same which both parts must have: a header, an end of zeros."""

MOST: Final = 0.4
"""Part of the places of such lengths that must be splices: a pulse that takes bytes alters others,
but of what goals state only one example is known."""

ALIKE: Final = 0.7
"""Part of the ends that may lack equally many bytes: a hole takes now these, now those."""

LOOKED: Final = 200
"""Torn places that are looked at."""

_Template = tuple[int, ...]
"""The bytes of a frame that are always the same; -1: any."""


def splices(case: Case) -> Iterator[Finding]:
    """Find places at which a hole has joined two frames."""
    if not case.has_checksum or case.protocol.ordered:
        return
    hit = torn_answers(case)  # what tears the answers of one servo is another matter
    torn = [d for d in case.damages if d.turn != HELD and len(d.got) == d.length]
    torn = [d for d in torn if d.turn not in (IN_REPLY, REST) or d.servo_id not in hit][:LOOKED]
    if len(torn) < LEAST:
        return
    # what varies slowly varies over the whole capture: what stood near each torn place is seen, too
    asked_near = [one for d in torn if d.turn == IN_REQUEST for one in d.alike]
    said_near = [one for d in torn if d.turn == IN_REPLY for one in d.alike]
    said = [one for some in case.ledger.damages.likes.known.values() for one in some]
    kinds = case.ledger.exchanges.kinds.requests
    requests = list(_templates(case, [*kinds, *asked_near]))
    answers = list(_templates(case, [*said, *said_near]))
    known = (*requests, *answers)
    one = {len(template) + k for template in known for k in range(1 - SHORT, SHORT)}
    two = {a + len(template) for template in known for a in one}
    odd = [d for d in torn if d.length not in one]
    lacks = {d.at: n for d in torn if (n := _lacks(d, answers))}
    # what lacks the same each time has its beginning under what stands before it
    usual = max(Counter(lacks.values()).values(), default=0)
    ends = [d for d in torn if d.at in lacks] if usual <= ALIKE * len(lacks) else []
    order = case.once(Order)
    told = [d for d in odd if d.length >= 2 * STEADY]
    # as long as two frames in a row it may be both, unless longer requests are missing there
    told = [d for d in told if d.length not in two or d.length <= order.missing_bytes(d)]
    joined = [d for d in told if not _is_piece(d.got, known)]
    # what ends as a request in the place of an answer may have been said into it
    joined = [d for d in joined if d.turn != IN_REPLY or not _is_spliced(d.got, answers, requests)]
    spliced = [
        d for d in joined if _is_spliced(d.got, known, answers if d.turn == IN_REPLY else known)
    ]
    shown = sorted((*ends, *spliced), key=lambda d: d.at)
    # an open contact cuts answers, and nothing of a request
    asked = len(ends) + sum(d.turn == IN_REQUEST for d in spliced)
    if len(shown) < max(LEAST, PART * len(torn)) or not asked:
        return
    if len(shown) < MOST * (len(ends) + len(joined)):
        return
    yield finding_of(
        shown,
        "frames-spliced",
        None,
        f"{len(shown)} of {len(torn)} torn places are the end of a frame, {len(spliced)} behind the "
        f"beginning of another, no byte is altered, and {asked} times a request is missing or cut",
        "frames without what is between",
        strength=min(0.4 + 0.1 * len(shown), 1.0),
        brief=f"{len(shown)} times the end of a frame stands without what belongs before it",
    )


def _templates(case: Case, frames: Sequence[bytes]) -> Iterator[_Template]:
    """Yield frames by their length, with all bytes left open that are not always the same."""
    by_length: dict[int, list[bytes]] = {}
    for frame in frames:
        if len(frame) > STEADY and case.protocol.checksum_of(frame) is not None:
            by_length.setdefault(len(frame), []).append(frame)
    for alike in by_length.values():
        columns = (set(column) for column in zip(*alike, strict=True))
        yield tuple(c.pop() if len(c) == 1 else -1 for c in columns)


def _lacks(d: Damage, answers: Sequence[_Template]) -> int:
    """Return how many bytes are missing where it is the end of an answer without its request; 0: none."""
    back = d.got[::-1]
    if d.behind != RESPONSE or d.turn == IN_REPLY:
        return 0
    longer = (len(t) - len(back) for t in answers if _fits(back, t[::-1]) == len(back))
    return max((n for n in longer if n >= SHORT), default=0)


def _is_piece(got: bytes, frames: Sequence[_Template]) -> bool:
    """Tell whether bytes are a frame that breaks off, or the end of one: it may be anybody's doing."""
    both = (got, 0), (got[::-1], -1)
    return any(_fits(row, t[::-1] if way else t) == len(row) for row, way in both for t in frames)


def _is_spliced(got: bytes, begins: Sequence[_Template], ends: Sequence[_Template]) -> bool:
    """Tell whether bytes are the beginning of one frame and the end of another, and nothing else."""
    begun = max((_fits(got, template) for template in begins), default=0)
    back = got[::-1]
    ended = max((_fits(back, template[::-1]) for template in ends), default=0)
    return min(begun, ended) > 0 and begun + ended >= len(got)


def _fits(got: bytes, template: _Template) -> int:
    """Return how many first bytes are as a frame has them; 0: fewer than tell anything."""
    n = steady = 0
    for byte, meant in zip(got, template, strict=False):
        if meant not in (-1, byte):
            break
        n += 1
        steady += meant == byte
    return n if steady >= STEADY else 0


RULES: Final[tuple[Rule, ...]] = (splices,)
"""The rules of this area."""
