"""What the example protocols make of bytes, told shortly."""

from __future__ import annotations

from typing import Any

from sniffer.decoding.decoder import Decoder
from sniffer.ground.codes import OUTCOMES
from sniffer.ground.model import Batch, Chunk
from tests.streams.members import example


def protocol(name: str) -> Any:
    """Return the protocol of an example."""
    return example(name).PROTOCOL


def heard(name: str, *said: bytes, models: dict[int | None, str] | None = None) -> Batch:
    """Return what one pass makes of bytes."""
    decoder = Decoder(protocol(name), models=models)
    first, last = decoder.feed(Chunk(b"".join(said))), decoder.close()
    return last if len(last.frames) else first


def values(name: str, batch: Batch) -> list[tuple[int, str, float]]:
    """Return (servo id, register, value) of all samples, rounded as tables are."""
    registers, v = protocol(name).registers, batch.values
    return [
        (int(who), registers[r].name, round(float(x), 3))
        for who, r, x in zip(v.servo_id, v.register, v.value, strict=True)
    ]


def outcomes(batch: Batch) -> list[str]:
    """Return what became of each exchange."""
    return [OUTCOMES[k] for k in batch.transactions.outcome]
