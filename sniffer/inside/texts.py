"""What many lines say, for who looks through all of them: page by page, not line by line."""

from __future__ import annotations

import itertools
from collections import OrderedDict
from typing import TYPE_CHECKING, Final

import numpy as np

from sniffer.inside.columns import GAP
from sniffer.inside.words import both, gap_verdict, stated, verdict, worst_codes
from sniffer.sinks.words import FrameWords

if TYPE_CHECKING:
    from collections.abc import Iterator

    from sniffer.ground.model import I64
    from sniffer.inside.columns import Table
    from sniffer.inside.index import CaptureIndex
    from sniffer.inside.pages import Page
    from sniffer.protocols.base import BusProtocol

OPEN: Final = 8
"""Pages whose texts are kept: lines of as many buses take turns, and exchanges go over an edge."""


class SearchedTexts:
    """The cells of lines as ``line_words`` has them, in one text a line.

    Args:
        index: the capture.
        exchanges: with what became of each request.
    """

    def __init__(self, index: CaptureIndex, *, exchanges: bool) -> None:
        self._index = index
        self._exchanges = exchanges
        self._pages: OrderedDict[int, _PageTexts] = OrderedDict()
        self._words: dict[int, FrameWords] = {}

    def of(self, numbers: I64) -> list[str]:
        """Return name, command, values and verdict of each line; ``numbers`` go up."""
        lines = self._index.lines[numbers]
        ops = [self._index.ops[op] for op in lines["op"].tolist()]
        values, verdicts = self._values(lines), self._verdicts(lines, numbers)
        if self._exchanges:
            self._answered(lines, values, verdicts)
        told = list(map(" ".join, zip(ops, values, verdicts, strict=True)))
        if self._index.names:
            names, which = called(self._index, lines)
            told = [f"{names[k]} {text}" for k, text in zip(which.tolist(), told, strict=True)]
        return told

    def _answered(self, lines: Table, values: list[str], verdicts: list[str]) -> None:
        """Put in what became of requests."""
        mine = np.flatnonzero(lines["partner"] >= 0)
        partners = lines["partner"][mine]
        others = self._index.lines[partners]
        told = zip(
            mine.tolist(),
            lines["page"][mine].tolist(),
            lines["row"][mine].tolist(),
            self._values(others),
            self._verdicts(others, partners),
            strict=True,
        )
        for k, page, row, answer, became in told:
            values[k] = both(values[k], answer, writes=self._page(page).writes(row))
            verdicts[k] = became or verdicts[k]

    def _values(self, lines: Table) -> list[str]:
        columns = (lines[name].tolist() for name in ("page", "kind", "row"))
        return [self._page(page).text(kind, row) for page, kind, row in zip(*columns, strict=True)]

    def _verdicts(self, lines: Table, numbers: I64) -> list[str]:
        codes = worst_codes(self._index, numbers)
        names = ("page", "kind", "row", "severity", "outcome", "took", "spread")
        columns = (lines[name].tolist() for name in names)
        return [
            gap_verdict(self._page(page).page, row)
            if kind == GAP
            else verdict(severity, outcome, took, spread, codes.get(number, ""))
            for number, page, kind, row, severity, outcome, took, spread in zip(
                numbers.tolist(), *columns, strict=True
            )
        ]

    def _page(self, number: int) -> _PageTexts:
        found = self._pages.get(number)
        if found is None:
            page = self._index.pages.get(number)
            found = self._pages[number] = _PageTexts(page, self._words_of(page.protocol))
            if len(self._pages) > OPEN:
                self._pages.popitem(last=False)
        return found

    def _words_of(self, protocol: BusProtocol) -> FrameWords:
        known = self._words.get(id(protocol))
        if known is None:
            known = self._words[id(protocol)] = FrameWords(protocol)
        return known


def called(index: CaptureIndex, lines: Table) -> tuple[list[str], I64]:
    """Return what the servos of some lines are called, and which of it each line has."""
    key = lines["bus"].astype(np.int64) << 16 | lines["servo"].astype(np.int64) & 0xFFFF
    keys, which = np.unique(key, return_inverse=True)
    pairs = ((index.buses[k >> 16], k & 0xFFFF) for k in keys.tolist())
    return [index.names.of(bus, servo) or "" for bus, servo in pairs], which


class _PageTexts:
    """What the frames of a page state, told as far as somebody asked."""

    def __init__(self, page: Page, words: FrameWords) -> None:
        self.page = page
        self._told: list[str] = []
        self._coming: Iterator[str] = words.told(page.batch, range(len(page.batch.frames)))
        self._whose = f"{page.protocol.name}: " if page.batch.is_shared else ""
        self._writing = frozenset(page.batch.values.row.tolist())

    def text(self, kind: int, row: int) -> str:
        """Return what a frame states, or the bytes that are none."""
        if kind == GAP:
            return stated(self.page, kind, row)
        missing = row + 1 - len(self._told)
        if missing > 0:
            self._told.extend(itertools.islice(self._coming, missing))
        return self._whose + self._told[row]

    def writes(self, row: int) -> bool:
        """Tell whether a frame states values of registers."""
        return row in self._writing
