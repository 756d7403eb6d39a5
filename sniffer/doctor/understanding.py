"""How much of the bytes is understood, and at which other bauds it might be more."""

from __future__ import annotations

from collections import Counter
from dataclasses import dataclass, field
from typing import TYPE_CHECKING, Final

from sniffer.decoding.decoder import Decoder
from sniffer.decoding.detect import ENOUGH, UndecidedError, detect
from sniffer.decoding.pipeline import AUTO
from sniffer.ground.model import Chunk
from sniffer.protocols import PROTOCOLS, protocol_named

if TYPE_CHECKING:
    from collections.abc import Mapping, Sequence

    from sniffer.protocols.base import BusProtocol

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


def understand(chunks: Sequence[Chunk], protocol: str = AUTO) -> Understanding:
    """Return which protocol the bytes are, and how much of them it explains."""
    taken: list[Chunk] = []
    size = 0
    for chunk in chunks:
        if size >= ENOUGH:
            break
        taken.append(Chunk(chunk.data, chunk.t_ns, chunk.clock))
        size += len(chunk.data)
    if not size:
        return Understanding(0, None, 0.0)
    scores = {p.name: _framed(taken, p) / size for p in PROTOCOLS.candidates()}
    if protocol == AUTO:
        try:
            protocol = detect(taken).protocol
        except UndecidedError:
            return Understanding(size, None, max(scores.values()), scores)
    named = protocol_named(protocol)
    if named.name not in scores:
        scores[named.name] = _framed(taken, named) / size
    return Understanding(size, named.name, scores[named.name], scores)


def _framed(chunks: Sequence[Chunk], protocol: BusProtocol) -> int:
    decoder = Decoder(protocol)
    return sum(int(b.frames.length.sum()) for b in (decoder.feed(*chunks), decoder.close()))


def usual_bauds(protocol: str, but: int) -> tuple[int, ...]:
    """Return the bauds to try, the likeliest first, without the one that was tried."""
    if protocol != AUTO:
        known = protocol_named(protocol)
        likely = dict.fromkeys((known.baud, *reversed(known.bauds)))
    else:
        candidates = PROTOCOLS.candidates()
        every = Counter(b for p in candidates for b in p.bauds)
        defaults = Counter(p.baud for p in candidates)
        likely = dict.fromkeys(sorted(every, key=lambda b: (-defaults[b], -every[b], -b)))
    return tuple(baud for baud in likely if baud != but)
