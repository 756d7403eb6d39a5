"""What the decoder says about some bytes, as rows by kind, for tests that read as sentences."""

from __future__ import annotations

from dataclasses import dataclass, field

from sniffer.decoding.decoder import Decoder
from sniffer.decoding.rows import FrameRow, GapRow, SampleRow, TransactionRow, rows
from sniffer.ground.model import Chunk
from sniffer.protocols import PROTOCOLS
from tests.records import batches


@dataclass(slots=True)
class Heard:
    """What the decoder says about some bytes."""

    frames: list[FrameRow] = field(default_factory=list)
    gaps: list[GapRow] = field(default_factory=list)
    samples: list[SampleRow] = field(default_factory=list)
    pairs: list[TransactionRow] = field(default_factory=list)

    @property
    def ops(self) -> list[str]:
        return [f.op for f in self.frames]

    @property
    def outcomes(self) -> list[str]:
        return [p.outcome for p in self.pairs]

    @property
    def flags(self) -> list[tuple[str, ...]]:
        return [f.flags for f in self.frames]

    @property
    def values(self) -> dict[tuple[int | None, str], float | None]:
        return {(s.servo_id, s.register): s.value for s in self.samples}


def hear(protocol: str, *parts: bytes, cuts: bool = False) -> Heard:
    """Decode the parts, each fed for itself if ``cuts``."""
    out = Heard()
    chunks = [Chunk(p) for p in parts]
    for batch in batches(Decoder(protocol), [[c] for c in chunks] if cuts else [chunks]):
        for row in rows(batch, PROTOCOLS[protocol]):
            match row:
                case FrameRow():
                    out.frames.append(row)
                case GapRow():
                    out.gaps.append(row)
                case SampleRow():
                    out.samples.append(row)
                case TransactionRow():
                    out.pairs.append(row)
    return out
