"""What a live tap remarked about its bytes, until the bytes are decided."""

from __future__ import annotations

from typing import TYPE_CHECKING, Final

from sniffer.ground.gaps import ERRORS_HERE
from sniffer.ground.memory import Remembering
from sniffer.ground.model import Chunk, Gap, MarkKind, Remark

if TYPE_CHECKING:
    from collections.abc import Iterable, Sequence

LINE_ERRORS: Final = frozenset({MarkKind.FRAMING, MarkKind.PARITY, MarkKind.BREAK})
"""Kinds that say: the byte may not be what was on the line."""

TEARS: Final = frozenset(
    {MarkKind.LOST, MarkKind.BACK, MarkKind.SKIPPED, MarkKind.SILENT, MarkKind.TUNED}
)
"""Kinds that say: bytes are missing here, or none came, for long; nothing crosses this place."""


OF_STAMPS: Final = frozenset({MarkKind.SENT, MarkKind.COARSE})
"""Kinds that concern a stamp: they are in the uncertainty, and nobody needs to be told."""


class Remarks(Remembering):
    """The marks of chunks that are still in the buffer, at their places in the stream."""

    PASSING = ("_waiting", "_losses")

    def __init__(self) -> None:
        self._waiting: list[Remark] = []
        self._losses: list[tuple[int, int]] = []

    def add(self, chunks: Sequence[Chunk], at: int, now_ns: int) -> list[int]:
        """Take the marks of chunks whose first byte stands at offset ``at``.

        ``now_ns`` is the time of a chunk without a stamp. Returns the offsets of tears.
        """
        torn = []
        for chunk in chunks:
            now_ns = now_ns if chunk.t_ns is None else chunk.t_ns
            for m in chunk.marks:
                if m.kind in OF_STAMPS:
                    continue
                self._waiting.append(Remark(m.kind, at + m.start, m.length, m.count, now_ns))
                if m.kind in TEARS:
                    torn.append(at + m.start)
                # one that is counted when all its bytes are past comes too late to explain them
                if m.kind == MarkKind.OVERRUN and m.start + m.length > 0:
                    self._losses.append((at + m.start, at + m.start + m.length))
            at += len(chunk.data)
        return torn

    def until(self, offset: int) -> tuple[Remark, ...]:
        """Return what ends at or before ``offset``, once."""
        if not self._waiting:
            return ()
        due = tuple(r for r in self._waiting if r.end <= offset)
        self._waiting = [r for r in self._waiting if r.end > offset]
        return due

    def take_losses(self) -> list[tuple[int, int]]:
        """Return, once, from where to where the tap is known to have lost bytes."""
        losses, self._losses = self._losses, []
        return losses

    @property
    def doubts(self) -> list[Remark]:
        """What waits and says that bytes may not be what was on the line."""
        return [r for r in self._waiting if r.kind in LINE_ERRORS]

    def explain(self, gaps: list[Gap], base: int) -> list[Gap]:
        """Add to the gaps how many line errors the UART told in their bytes."""
        doubts = self.doubts
        if not doubts:
            return gaps
        return [_doubted(g, base, doubts) for g in gaps]


def _doubted(gap: Gap, base: int, doubts: Iterable[Remark]) -> Gap:
    start = base + gap.start
    errors = sum(r.count for r in doubts if r.start < start + gap.length and r.end > start)
    return gap._replace(detail={**gap.detail, ERRORS_HERE: errors}) if errors else gap
