"""Raw bytes as they were on the wire: no offsets, no times, nothing to get wrong."""

from __future__ import annotations

from typing import TYPE_CHECKING

from sniffer.ground.model import Chunk
from sniffer.sources.text import BLOCK, PAUSE, Opened, pauses

if TYPE_CHECKING:
    from collections.abc import Iterator


def read_binary(opened: Opened) -> Iterator[Chunk]:
    """Yield the bytes of ``opened`` unchanged."""
    while True:
        if pauses(opened.stream):
            yield PAUSE
        data = opened.stream.read(BLOCK)
        if not data:
            return
        yield Chunk(data, bus=opened.bus)
