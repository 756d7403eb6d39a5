"""What losses of the tap leave: pieces whose bytes are as they were sent, but for those missing.

Noise alters bytes, and a piece in which one is altered becomes no frame by what is put before it.
"""

from __future__ import annotations

from collections import Counter
from dataclasses import replace
from typing import TYPE_CHECKING, Final

from sniffer.decoding.holding import held
from sniffer.diagnosis.catalogue import FindingCode
from sniffer.diagnosis.evidence.chances import at_least, sureness
from sniffer.diagnosis.evidence.hit import torn_answers
from sniffer.diagnosis.evidence.placed import finding_of
from sniffer.diagnosis.evidence.signs import BARE
from sniffer.diagnosis.evidence.twins import of_twins
from sniffer.diagnosis.ledger.damage import HELD, IN_REPLY, IN_REQUEST, REST
from sniffer.diagnosis.physics.comparing import alike, is_altered
from sniffer.diagnosis.rules.tap.losses import only_at_the_turn

if TYPE_CHECKING:
    from collections.abc import Collection, Iterator, Mapping, Sequence, Set

    from sniffer.diagnosis.case import Case
    from sniffer.diagnosis.ledger.damage import Damage
    from sniffer.diagnosis.model import Finding
    from sniffer.diagnosis.rules import Rule

FINDINGS: Final = (
    FindingCode(
        "pieces-complete",
        "Pieces of frames become sound ones when the beginning that is missing is put before them: "
        "nothing in them is altered.",
        "Bytes of no frame that hold behind the beginning of a frame known here, lacking now these, now those bytes; requests among them; more than the checksum lets by by chance. Of lines of text without one: torn lines of both sides in which every sign is one that sound lines have. Answers of a servo that is hit far more than others are left out.",
    ),
)

KEPT: Final = 80
"""Pieces that are looked at."""

SHORTEST: Final = 2
"""Fewer bytes hold behind nearly anything."""

ALIKE: Final = 0.7
"""Part of the pieces that may lack equally many bytes: at a turn it is always the first one or two."""

EITHER: Final = 0.6
"""How much pieces count that lack no more than such an answer has, where no time tells of a hole."""

HEADER: Final = 2
"""Bytes that begin all frames alike: what has them lacks no beginning."""

HEADS: Final = 24
"""Beginnings that are tried, of the frames that are said most."""

BY_CHANCE: Final = 1 / 150
"""A checksum of seven or eight bits lets one of 128 or 256 tries pass; some frames are alike."""

LEAST: Final = 3

REQUESTS: Final = 0.1
"""Part of the pieces that must be requests': an open contact at a servo takes none of those."""

CHANCE: Final = 1e-6
SOME: Final = 1e-2
"""How likely it is by chance alone where it counts in full, and where it counts at all."""

ENDS: Final = 4
"""Bytes of the end of a line of text: with more, only its first one may be missing."""

DIGITS: Final = frozenset(b"0123456789")

BY_TWO: Final = 0.2
TWO: Final = 0.4
"""Part of the pieces of which two who speak at once leave the end of the second one, and how much it
counts where there are hardly more."""

NOT_BY_TWO: Final = 5e-2
"""How likely such a part is by two who speak at once where it counts no less."""

BY_NOISE: Final = 0.3
"""Part of short pieces that noise makes of signs that stand in lines, with the end of one."""


def pieces_complete(case: Case) -> Iterator[Finding]:
    """Pieces that lack nothing but their beginning."""
    kinds = case.ledger.exchanges.kinds
    order = sorted(range(len(kinds)), key=lambda k: -int(kinds.n[k]))
    requests = [kinds.example[k] for k in order[:HEADS]]
    likes = case.ledger.damages.likes
    # one of each length and servo: most are acknowledgements of goals, each another request
    some = {(likes.asked[q], len(known[0])): known[0] for q, known in likes.known.items()}
    said = [answer for answer in some.values() if len(answer) >= SHORTEST][:HEADS]
    acks = {answer for answer in some.values() if len(answer) < SHORTEST}
    answers = said if case.has_checksum else []  # bare answers hold by no checksum
    # what tears the answers of one servo far more than those of others is another matter; of bare
    # ones it is not known whose they are
    hit = {} if case.protocol.ordered else torn_answers(case)
    torn = [d for d in case.damages if d.turn != HELD and len(d.got) == d.length >= SHORTEST]
    torn = [d for d in torn if d.turn not in (IN_REPLY, REST) or d.servo_id not in hit]
    torn = [d for d in torn if not (hit and of_twins(case, d))][:KEPT]
    if len(torn) < LEAST or not requests:
        return
    if case.protocol.checksum_of(requests[0]) is None:
        yield from _line_ends(case, torn, requests, said)
        return
    # what ends as a request in the place of an answer was said into it
    alone = [d for d in torn if d.turn != IN_REPLY]
    of_requests, tried = _completed(case, alone, requests, acks)
    of_answers, more = _completed(case, torn, answers, ())
    found = {**of_answers, **of_requests}
    chance = at_least(len(found), len(torn), min((tried + more) * BY_CHANCE / len(torn), 0.5))
    if len(found) < LEAST or len(of_requests) < max(1, REQUESTS * len(found)):
        return
    altered = sum(any(is_altered(d.got, whole) for whole in (*requests, *answers)) for d in torn)
    lacks = Counter(n for _, n in found.values()).most_common(1)[0][1]
    if altered >= len(found):
        return
    if chance > SOME or lacks > ALIKE * len(found):
        return
    if only_at_the_turn(case, [d for d, _ in of_requests.values()]):
        return
    shown = [found[at][0] for at in sorted(found)]
    what = (
        f"{len(shown)} of {len(torn)} pieces ({len(of_requests)} of requests) lack nothing but bytes "
        "before them: no bit of them is altered"
    )
    told = _told(shown, what, chance)
    if not case.has_clock and not case.has_checksum and max(n for _, n in found.values()) <= BARE:
        # a bare answer over the beginning of the next request leaves the same, and is an answer
        told = replace(told, strength=told.strength * EITHER)
    by_two = at_least(len(found), len(torn), BY_TWO) > NOT_BY_TWO
    yield replace(told, strength=TWO * told.strength) if by_two else told


def _line_ends(
    case: Case, torn: Sequence[Damage], requests: Sequence[bytes], answers: Sequence[bytes]
) -> Iterator[Finding]:
    """Yield the same of lines of text, which have no checksum: ends of them, and of nothing else."""
    signs = set(b"".join((*requests, *answers)))
    signs |= DIGITS if signs & DIGITS else set()  # a number may be any
    begins = {line[0] for line in (*requests, *answers)}
    end = requests[0][-1]
    short = [d for d in torn if d.length <= ENDS and d.got[0] not in begins]
    pure = [d for d in short if d.got[-1] == end and set(d.got) <= signs]
    chance = at_least(len(pure), len(short), BY_NOISE)
    whole = [bytes((begin,)) + d.got for d in pure for begin in sorted(begins)]
    if sum(held(case.protocol, whole, [len(line) for line in whole])) > ALIKE * len(pure):
        return
    if len(pure) >= LEAST and chance <= SOME:
        what = f"{len(pure)} of {len(short)} short pieces are the ends of lines, in sound signs"
        yield _told(pure, what, chance)
        return
    yield from _lines_unaltered(case, torn, signs)


def _lines_unaltered(case: Case, torn: Sequence[Damage], signs: Set[int]) -> Iterator[Finding]:
    """Yield that torn lines of all senders lack signs, and have none that is not said elsewhere.

    A bit more or less makes another sign of a digit or a letter, or of the end of a line, and most of
    those stand in no line; a turn takes them from answers alone, and a driver from requests.
    """
    pure = [d for d in torn if set(d.got) <= signs]
    asked = [d for d in pure if d.turn == IN_REQUEST]
    chance = at_least(len(pure), len(torn), BY_NOISE)
    if len(pure) < LEAST or chance > SOME or not max(1, REQUESTS * len(pure)) <= len(asked):
        return
    if len(asked) == len(pure) or only_at_the_turn(case, asked):
        return
    what = (
        f"{len(pure)} of {len(torn)} torn lines ({len(asked)} of requests) lack signs, and every "
        "sign that is left is one that lines have"
    )
    yield _told(pure, what, chance)


def _told(shown: Sequence[Damage], what: str, chance: float) -> Finding:
    return finding_of(
        shown,
        "pieces-complete",
        None,
        what,
        "whole but for its beginning",
        strength=sureness(chance, CHANCE),
        brief=f"{len(shown)} frames lack their beginnings, and nothing else is wrong with them",
    )


def _completed(
    case: Case, torn: Sequence[Damage], heads: Sequence[bytes], acks: Collection[bytes]
) -> tuple[Mapping[int, tuple[Damage, int]], int]:
    """Return the pieces that hold behind a beginning, by place, with what they lack; the tries.

    ``acks`` are answers of a byte: behind a piece they are no part of it.
    """
    bare = BARE if case.protocol.ordered else 0
    tries: dict[bytes, list[tuple[Damage, int]]] = {}
    count = 0
    for d in torn:
        own = {
            head[: len(head) - len(piece)] + piece: len(head) - len(piece)
            for got in (d.got, *(d.got[: -len(ack)] for ack in acks if d.got.endswith(ack)))
            for piece in _pieces(got, heads, bare)
            for head in heads
            if len(head) > len(piece)
        }
        count += len(own)
        for whole, lacks in own.items():
            tries.setdefault(whole, []).append((d, lacks))
    frames = list(tries)
    sound = held(case.protocol, frames, [len(frame) for frame in frames])
    whole_ones = (f for f, is_sound in zip(frames, sound, strict=True) if is_sound)
    return {d.at: (d, lacks) for frame in whole_ones for d, lacks in tries[frame]}, count


def _pieces(got: bytes, heads: Sequence[bytes], bare: int) -> Sequence[bytes]:
    """Return what may be the end of a frame: all of it, or what stands behind a beginning."""
    begun = max((alike(got, head) for head in heads), default=0)
    whole = (got,) if begun < HEADER else ()
    tails = (*whole, got[begun:], *((got[:-bare],) if bare and whole else ()))
    return [tail for tail in dict.fromkeys(tails) if len(tail) >= SHORTEST]


RULES: Final[tuple[Rule, ...]] = (pieces_complete,)
"""The rules of this area."""
