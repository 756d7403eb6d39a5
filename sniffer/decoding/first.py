"""The first bytes of buses whose protocol was named, kept to tell if they speak another one."""

from __future__ import annotations

import contextlib
from typing import TYPE_CHECKING

from sniffer.decoding.detect import CLEAR, ENOUGH, GUESSED, Mistake, UndecidedError, detect

if TYPE_CHECKING:
    from collections.abc import Callable, Iterable, Mapping, Sequence

    from sniffer.decoding.summary import Summary
    from sniffer.ground.model import Chunk


class FirstBytes:
    """Keeps of each of some buses what is heard first, just ``ENOUGH`` bytes or more of it."""

    def __init__(self, buses: Iterable[str] = ()) -> None:
        self._kept: dict[str, list[Chunk]] = {bus: [] for bus in buses}
        self._sizes = dict.fromkeys(self._kept, 0)

    @property
    def kept(self) -> Mapping[str, Sequence[Chunk]]:
        """What was kept of each bus."""
        return self._kept

    @property
    def wanted(self) -> frozenset[str]:
        """The buses of which more is to be kept."""
        return frozenset(bus for bus, size in self._sizes.items() if size < ENOUGH)

    def want(self, bus: str) -> None:
        """Keep what comes of a bus from now on."""
        self._kept[bus], self._sizes[bus] = [], 0

    def keep(self, bus: str, chunks: Sequence[Chunk]) -> None:
        """Take what comes of any bus."""
        if self._sizes.get(bus, ENOUGH) < ENOUGH:
            self._kept[bus] += chunks
            self._sizes[bus] += sum(len(c.data) for c in chunks)

    def mistaken(self, summary: Summary, stated: Callable[[str], int | None]) -> list[Mistake]:
        """Return the buses whose named protocol explains little, though another one does.

        ``summary`` is of all that was decoded, ``stated`` returns the rate that a bus is said to
        have.
        """
        out = []
        for bus, chunks in self._kept.items():
            totals = summary.buses.get(bus)
            if totals is None or not totals.bytes or totals.bytes_in_frames > CLEAR * totals.bytes:
                continue
            with contextlib.suppress(UndecidedError):
                found = detect(chunks, stated(bus))
                share = totals.bytes_in_frames / totals.bytes
                if found.protocol != totals.protocol and (not share or found.certainty != GUESSED):
                    out.append(Mistake(bus, totals.protocol, share, found))
        return out
