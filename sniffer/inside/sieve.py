"""Which lines cannot hold a word, told in columns: only the others are put in words.

The text of a line is what several columns say, joined by blanks. A word without blanks is in one
of these pieces or in none, and pages have few pieces that differ. Where words follow each other,
each of them must be somewhere in the line; whether they follow each other, its text tells.
"""

from __future__ import annotations

from collections import OrderedDict
from typing import TYPE_CHECKING, Final

import numpy as np

from sniffer.ground.codes import OUTCOMES
from sniffer.ground.model import Severity
from sniffer.inside.columns import GAP, NO_OUTCOME
from sniffer.inside.texts import called
from sniffer.inside.words import gap_verdict, stated, verdict, worst_codes
from sniffer.sinks.kept import packed
from sniffer.sinks.words import FrameWords, errors_in_words

if TYPE_CHECKING:
    from collections.abc import Iterable, Iterator

    from sniffer.ground.model import I64, Batch, Mask, Samples
    from sniffer.inside.columns import Table
    from sniffer.inside.index import CaptureIndex
    from sniffer.inside.pages import Page

OPEN: Final = 8
"""Pages of which is kept what they hold: as many as of texts."""

_TIME: Final = frozenset("<0123456789.ms")
"""What a response time is written with."""


class WordSieve:
    """Tells of lines whether they may hold a text: it is never wrong where it says no.

    Args:
        index: the capture.
        text: what is looked for, whatever its case.
        exchanges: with what became of each request.
    """

    def __init__(self, index: CaptureIndex, text: str, *, exchanges: bool) -> None:
        # a comma behind a word may be the one between two values
        told = (word.rstrip(",") for word in text.lower().split() if word != "→")
        self._words = list(dict.fromkeys(word for word in told if word))
        self._index = index
        self._exchanges = exchanges
        self._pages: OrderedDict[int, tuple[Mask, Mask]] = OrderedDict()
        self._frame_words: dict[int, FrameWords] = {}

    def may(self, numbers: I64) -> Mask:
        """Tell which of some lines may hold the text."""
        lines = self._index.lines[numbers]
        held = self._held(lines, numbers)
        if self._exchanges:
            partner = lines["partner"]
            some = np.flatnonzero(partner >= 0)
            others = partner[some]
            held[:, some] |= self._held(self._index.lines[others], others)
        every: Mask = np.logical_and.reduce(held, axis=0)
        return every

    def _held(self, lines: Table, numbers: I64) -> Mask:
        """Tell of each word which lines hold it."""
        ops = self._in(self._index.ops)
        out: Mask = ops[:, lines["op"]] | self._verdicts(lines, numbers)
        if self._index.names:
            names, which = called(self._index, lines)
            out |= self._in(names)[:, which]
        for page in np.unique(lines["page"]).tolist():
            frames, gaps = self._of(page)
            mine = lines["page"] == page
            is_gap = lines["kind"] == GAP
            for rows, held in ((mine & ~is_gap, frames), (mine & is_gap, gaps)):
                out[:, rows] |= held[:, lines["row"][rows]]
        return out

    def _in(self, texts: Iterable[str]) -> Mask:
        """Tell of each word in which texts it is."""
        lower = [text.lower() for text in texts]
        return np.array([[word in text for text in lower] for word in self._words], bool).reshape(
            len(self._words), len(lower)
        )

    def _verdicts(self, lines: Table, numbers: I64) -> Mask:
        """Tell which lines have a verdict with each word; those of gaps are told with them."""
        told = [
            *(verdict(0, outcome, -1, -1) for outcome in range(len(OUTCOMES))),
            *("" for _ in range(len(OUTCOMES), NO_OUTCOME + 1)),
        ]
        out: Mask = self._in(told)[:, lines["outcome"]]
        codes = worst_codes(self._index, numbers)
        if codes:
            bad = np.flatnonzero(lines["severity"] > Severity.WARN)
            texts = [
                verdict(Severity.ERROR, NO_OUTCOME, -1, -1, codes.get(number, ""))
                for number in numbers[bad].tolist()
            ]
            out[:, bad] |= self._in(texts)
        if any(_TIME.issuperset(word) for word in self._words):
            took = np.flatnonzero(lines["took"] >= 0)
            pairs = zip(lines["took"][took].tolist(), lines["spread"][took].tolist(), strict=True)
            out[:, took] |= self._in(verdict(0, NO_OUTCOME, *pair) for pair in pairs)
        return out

    def _of(self, number: int) -> tuple[Mask, Mask]:
        """Return which frames and gaps of a page hold each word."""
        found = self._pages.get(number)
        if found is None:
            page = self._index.pages.get(number)
            gaps = range(len(page.batch.gaps))
            texts = [f"{stated(page, GAP, row)} {gap_verdict(page, row)}" for row in gaps]
            found = self._pages[number] = self._frames(page), self._in(texts)
            if len(self._pages) > OPEN:
                self._pages.popitem(last=False)
        return found

    def _frames(self, page: Page) -> Mask:
        """Tell which frames of a page state something with each word."""
        batch, protocol = page.batch, page.protocol
        f, v = batch.frames, batch.values
        out = np.zeros((len(self._words), len(f)), bool)
        if batch.is_shared:
            out |= self._in([f"{protocol.name}:"])
        words = self._frame_words.setdefault(id(protocol), FrameWords(protocol))
        first, which = _values_alike(v)
        held = self._in(words.each_value(v.take(first)))[:, which]
        others = np.flatnonzero((v.servo_id != f.servo_id[v.row]) & (v.servo_id >= 0))
        if len(others):
            who, which = np.unique(v.servo_id[others], return_inverse=True)
            held[:, others] |= self._in(f"{servo}:" for servo in who.tolist())[:, which]
            named, which = np.unique(v.register[others], return_inverse=True)
            names = (protocol.registers[register].name for register in named.tolist())
            held[:, others] |= self._in(names)[:, which]
        for word, mine in zip(out, held, strict=True):
            word[v.row[mine]] = True
        states, which = np.unique(f.status, return_inverse=True)
        told = (
            errors_in_words(protocol, status) if status > 0 else "" for status in states.tolist()
        )
        out |= self._in(told)[:, which]
        bare = f.status <= 0
        bare[v.row] = False
        for rows, first, which in _frames_alike(batch, np.flatnonzero(bare)):
            out[:, rows] |= self._in(words.told(batch, rows[first].tolist()))[:, which]
        return out


def _values_alike(v: Samples) -> tuple[I64, I64]:
    """Return rows of values that look different, and of each row which of these looks like it."""
    key = (v.register.astype(np.int64) << 8 | v.part) << 32 | v.raw & 0xFFFF_FFFF
    _, first, which = np.unique(key, return_index=True, return_inverse=True)
    bits = np.ascontiguousarray(v.value).view(np.int64)
    other = first[which]
    apart = np.flatnonzero((bits != bits[other]) | (v.raw != v.raw[other]))
    which[apart] = len(first) + np.arange(len(apart))  # one number, in another unit or too long
    return np.concatenate([first, apart]), which


def _frames_alike(batch: Batch, rows: I64) -> Iterator[tuple[I64, I64, I64]]:
    """Yield frames of one length: those that look different, and which of these each looks like."""
    f = batch.frames
    columns, size = packed(batch, f.length)
    told = np.frombuffer(columns, np.uint8).reshape(-1, size)
    data = np.frombuffer(batch.data, np.uint8)
    for length in np.unique(f.length[rows]).tolist():
        some = rows[f.length[rows] == length]
        spelt = data[f.start[some][:, np.newaxis] + np.arange(length)]
        key = np.ascontiguousarray(np.hstack([told[some], spelt])).view(f"V{size + length}")
        _, first, which = np.unique(key, return_index=True, return_inverse=True)
        yield some, first, which.reshape(-1)
