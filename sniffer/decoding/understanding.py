"""How much of the bytes is understood, and at which other bauds it might be more."""

from __future__ import annotations

from collections import Counter
from dataclasses import dataclass, field
from typing import TYPE_CHECKING, Final

from sniffer.decoding.detect import Scores, UndecidedError
from sniffer.decoding.names import joined, protocols_named
from sniffer.decoding.options import AUTO
from sniffer.protocols import PROTOCOLS

if TYPE_CHECKING:
    from collections.abc import Mapping, Sequence

    from sniffer.ground.model import Chunk

GOOD: Final = 0.9
"""Share of bytes in frames that hold from which on protocol and baud are right."""

POOR: Final = 0.5
"""Below this share the protocol or the baud is not the right one."""

FEW: Final = 64
"""Bytes that are too few to judge by."""


@dataclass(frozen=True, slots=True)
class Understanding:
    """What the bytes are: ``protocol`` is None where none can be told; shares are of all bytes."""

    size: int
    protocol: str | None
    share: float
    scores: Mapping[str, float] = field(default_factory=dict)

    @property
    def good(self) -> bool:
        """Whether protocol and baud are right beyond doubt."""
        return self.protocol is not None and self.share >= GOOD and self.size >= FEW


def understand(
    chunks: Sequence[Chunk], protocol: str = AUTO, baud: int | None = None
) -> Understanding:
    """Return which protocol the bytes are, and how much of them it explains.

    ``baud`` is the rate they were heard at, where the line has one.
    """
    named = () if protocol == AUTO else protocols_named(protocol)
    scores = Scores(chunks, baud, named)
    if not scores.size:
        return Understanding(0, None, 0.0)
    if named:
        share = scores.share_of(joined(named))
        return Understanding(scores.size, joined(named), share, scores.shares)
    try:
        found = scores.best()
    except UndecidedError:
        return Understanding(scores.size, None, max(scores.shares.values()), scores.shares)
    return Understanding(scores.size, found.protocol, found.share, scores.shares)


def usual_bauds(protocol: str, but: int) -> tuple[int, ...]:
    """Return the bauds to try, the likeliest first, without the one that was tried."""
    if protocol != AUTO:
        named = protocols_named(protocol)
        likely = dict.fromkeys(b for p in named for b in (p.baud, *reversed(p.bauds)))
    else:
        candidates = PROTOCOLS.candidates()
        every = Counter(b for p in candidates for b in p.bauds)
        defaults = Counter(p.baud for p in candidates)
        likely = dict.fromkeys(sorted(every, key=lambda b: (-defaults[b], -every[b], -b)))
    return tuple(baud for baud in likely if baud != but)
