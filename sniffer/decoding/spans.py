"""Parts of a stream of chunks by their offsets on each bus: one, or several side by side."""

from __future__ import annotations

from dataclasses import replace
from typing import TYPE_CHECKING, NamedTuple

from sniffer.ground.cutting import cut
from sniffer.ground.model import Mark, MarkKind

if TYPE_CHECKING:
    from collections.abc import Iterable, Iterator, Mapping, Sequence

    from sniffer.ground.model import Chunk


class Span(NamedTuple):
    """A part of a bus: offsets of its first byte and behind its last one.

    ``next_ns`` is when the next byte was on the wire, None where there is none.
    """

    begin: int
    end: int
    next_ns: int | None


def sliced(
    groups: Iterable[Sequence[Chunk]], spans: Mapping[str, Span], byte_ns: Mapping[str, int]
) -> Iterator[list[Chunk]]:
    """Yield the chunks of some spans, as ``PieceRow`` does of the only piece."""
    return PieceRow(groups, [spans], byte_ns).piece(0)


class PieceRow:
    """Pieces of a stream that lie side by side on each bus, read in one go, one behind the other.

    What comes of later pieces while one is read waits for them: of buses that are read together
    that is little.

    Args:
        groups: the chunks of all.
        pieces: the spans of each piece, by bus.
        byte_ns: how long a byte takes, by bus: it dates the end of a chunk that is cut.
    """

    def __init__(
        self,
        groups: Iterable[Sequence[Chunk]],
        pieces: Sequence[Mapping[str, Span]],
        byte_ns: Mapping[str, int],
    ) -> None:
        self._groups = iter(groups)
        self._pieces = pieces
        self._byte_ns = byte_ns
        self._of_bus: dict[str, list[tuple[int, Span]]] = {}
        for number, spans in enumerate(pieces):
            for bus, span in spans.items():
                self._of_bus.setdefault(bus, []).append((number, span))
        self._at = dict.fromkeys(self._of_bus, 0)
        self._number = 0
        self._kept: list[list[Chunk]] = [[] for _ in pieces]
        self._last: list[dict[str, Chunk]] = [{} for _ in pieces]

    def piece(self, number: int) -> Iterator[list[Chunk]]:
        """Yield the chunks of a piece, those at its edges cut; behind them, that they end.

        It is asked for behind the piece before it.
        """
        spans, self._number = self._pieces[number], number
        while True:
            out, self._kept[number] = self._kept[number], []
            if out:
                yield out
            if all(self._is_over(number, bus, span) for bus, span in spans.items()):
                break
            if (group := next(self._groups, None)) is None:
                break
            self._take(group)
        ended = (Mark(MarkKind.ENDED, 0, count=0),)
        # nothing else was said until then: who had time enough to answer is silent, not cut
        over = [
            replace(chunk, data=b"", t_ns=max(told, chunk.t_ns), marks=ended)
            for bus, chunk in self._last[number].items()
            if (told := spans[bus].next_ns) is not None and chunk.t_ns is not None
        ]
        if over:
            yield over

    def _is_over(self, number: int, bus: str, span: Span) -> bool:
        """Tell whether no byte more of a bus belongs to a piece.

        Only behind the last one marks without bytes are waited for: a bus may be silent for long,
        and all that others say meanwhile would be kept.
        """
        at, is_last = self._at[bus], number == len(self._pieces) - 1
        return at > span.end or (at == span.end and not is_last)

    def _take(self, group: Sequence[Chunk]) -> None:
        for chunk in group:
            left = self._of_bus.get(chunk.bus)
            if not left:
                continue
            start = self._at[chunk.bus]
            end = self._at[chunk.bus] = start + len(chunk.data)
            while left and (left[0][0] < self._number or left[0][1].end < start):
                del left[0]
            # marks that come when their piece is over stand in front of the next one
            for number, span in left if chunk.data else left[:1]:
                if span.begin > end:
                    break
                piece = _within(chunk, start, span, self._byte_ns[chunk.bus], is_first=number == 0)
                if piece is not None:
                    self._kept[number].append(piece)
                    self._last[number][chunk.bus] = piece


def _within(chunk: Chunk, start: int, span: Span, byte_ns: int, *, is_first: bool) -> Chunk | None:
    """Return what of a chunk lies in a span, None where nothing does."""
    end = start + len(chunk.data)
    if not chunk.data:
        is_behind = span.begin < start if is_first else span.begin <= start
        return chunk if is_behind and start <= span.end else None
    low, high = max(start, span.begin), min(end, span.end)
    if low >= high:
        return None
    if high < end:
        t_ns = None if chunk.t_ns is None else chunk.t_ns - (end - high) * byte_ns
        chunk = cut(chunk, high - start, t_ns)[0]
    return cut(chunk, low - start, None)[1] if low > start else chunk
