"""Which protocol is this? For each of them: the share of bytes that frames that hold explain."""

from __future__ import annotations

from dataclasses import dataclass
from typing import TYPE_CHECKING, Final

from sniffer.decoding.decoder import Decoder
from sniffer.ground.model import Chunk, InputError
from sniffer.protocols import PROTOCOLS

if TYPE_CHECKING:
    from collections.abc import Mapping, Sequence

ENOUGH: Final = 32 * 1024
"""Bytes that are looked at: some thousand frames, a second of a busy bus."""

CLEAR: Final = 0.5
"""A share from which a protocol is taken if no other comes near."""

SURE: Final = "sure"
"""What is said of more than nine tenths of the bytes explained."""

GUESSED: Final = "not sure"
"""What is said of a much damaged capture."""

FEW: Final = 0.05
"""Below CLEAR, a much damaged capture is still taken from this share and three frames on."""


@dataclass(frozen=True, slots=True)
class Detection:
    """The protocol found, how sure, and the share of bytes each candidate explains."""

    protocol: str
    certainty: str
    scores: Mapping[str, float]

    def __str__(self) -> str:
        others = _shares({k: v for k, v in self.scores.items() if k != self.protocol})
        return (
            f"{self.protocol} ({self.certainty}: explains {self.scores[self.protocol]:.1%} "
            f"of the bytes; {others})"
        )


def _shares(scores: Mapping[str, float]) -> str:
    return ", ".join(f"{k} {v:.1%}" for k, v in sorted(scores.items(), key=lambda e: -e[1]))


@dataclass(frozen=True, slots=True)
class Mistake:
    """A bus that was said to speak ``named``, which explains only ``share`` of its bytes."""

    bus: str
    named: str
    share: float
    found: Detection

    def __str__(self) -> str:
        shown = f"only {self.share:.1%} of the bytes are frames" if self.share else "no frame"
        return f"{self.bus}: {shown} of {self.named}"


class UndecidedError(InputError):
    """No protocol explains the bytes well enough, or two do."""


def detect(chunks: Sequence[Chunk]) -> Detection:
    """Return the protocol of the chunks.

    Raises:
        UndecidedError: it cannot be told; the message shows all scores.
    """
    taken: list[Chunk] = []
    size = 0
    for chunk in chunks:
        if size >= ENOUGH:
            break
        part = chunk.data[: ENOUGH - size]
        taken.append(Chunk(part, chunk.t_ns, chunk.clock))
        size += len(part)
    if not size:
        raise UndecidedError("the input has no bytes: nothing to decode")
    scores: dict[str, float] = {}
    frames: dict[str, int] = {}
    for protocol in PROTOCOLS.candidates():
        name, decoder = protocol.name, Decoder(protocol)
        parts = (decoder.feed(*taken), decoder.close())
        frames[name] = sum(len(b.frames) for b in parts)
        scores[name] = sum(int(b.frames.length.sum()) for b in parts) / size
    ranked = sorted(scores, key=lambda k: -scores[k])
    best, second = scores[ranked[0]], scores[ranked[1]] if len(ranked) > 1 else 0.0
    if best >= CLEAR and best >= 1.5 * second:
        return Detection(ranked[0], SURE if best > 0.9 else "likely", scores)
    if best >= FEW and frames[ranked[0]] >= 3 and best >= 4 * second:
        return Detection(ranked[0], GUESSED, scores)
    raise UndecidedError(
        f"cannot tell the protocol of these {size} bytes ({_shares(scores)}): "
        "name it with --protocol, or check that this is a bus capture"
    )


def latest(chunks: Sequence[Chunk], size: int) -> list[Chunk]:
    """Return the last chunks, of about so many bytes."""
    taken, held = 0, 0
    while taken < len(chunks) and held < size:
        taken += 1
        held += len(chunks[-taken].data)
    return list(chunks[len(chunks) - taken :])
