"""Batches as plain tuples: the kit's, under the name that tests know; and the law of the oracle."""

from __future__ import annotations

from typing import TYPE_CHECKING

from sniffer.decoding.decoder import Decoder
from sniffer.decoding.reference import Reference
from sniffer.testing.records import asked_at, batches, gaps, records

if TYPE_CHECKING:
    from collections.abc import Sequence

    from sniffer.ground.model import Batch, Chunk
    from sniffer.protocols.base import BusProtocol

__all__ = ["asked_at", "batches", "gaps", "held_to_the_oracle", "records"]


def held_to_the_oracle(protocol: BusProtocol, chunks: Sequence[Chunk]) -> list[Batch]:
    """Hold columns to what the oracle says, in one go and chunk by chunk; return their batches."""
    parts = batches(Decoder(protocol), [chunks])
    got, want = records(parts), Reference(protocol).decode(chunks)
    assert got.frames == want.frames
    assert got.transactions == want.transactions
    assert got.samples == want.samples
    one = batches(Decoder(protocol), [[c] for c in chunks])
    assert records(one) == got
    assert gaps(one) == gaps(parts)
    return parts
