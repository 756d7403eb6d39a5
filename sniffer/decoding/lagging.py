"""A pipeline for captures that are there as a whole: what comes last is decoded with the end."""

from __future__ import annotations

from typing import TYPE_CHECKING

from sniffer.decoding.pipeline import Pipeline
from sniffer.ground.limits import chunks_of
from sniffer.ground.runs import ChunkRun

if TYPE_CHECKING:
    from collections.abc import Iterable, Sequence

    from sniffer.ground.model import Chunk


class LaggingPipeline(Pipeline):
    """A pipeline that decodes a group when the next one comes, the last one with the end.

    The records are the same. That is a pass less: of a capture that is one group, half the work.
    """

    _held: Iterable[Chunk] = ()
    _is_ending = False

    def feed(self, group: Iterable[Chunk]) -> None:
        """Take a group, and decode the one before."""
        group, self._held = self._held, group
        super().feed(group)

    def close(self) -> None:
        """Decode the last group and what waits, and finish the decoders."""
        self._is_ending = True
        last, self._held = self._held, ()
        super().feed(last)
        super().close()

    def _decode(self, bus: str, chunks: Sequence[Chunk]) -> None:
        if not self._is_ending:
            super()._decode(bus, chunks)
            return
        self.first.keep(bus, chunks)
        told = [chunks] if isinstance(chunks, ChunkRun) else chunks
        self._decoders[bus].take(chunks_of(told))
