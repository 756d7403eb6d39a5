"""Looking for bytes or words in the lines shown, in steps."""

from __future__ import annotations

import re
import time
from typing import TYPE_CHECKING, Final

import numpy as np

from sniffer.inside.detail import raw_of
from sniffer.inside.view import SLICE_S
from sniffer.inside.words import line_words

if TYPE_CHECKING:
    from collections.abc import Iterator

    from sniffer.ground.model import I64, Batch, Mask
    from sniffer.inside.view import LineView

STRETCH: Final = 1 << 13
"""Lines that are looked through at once."""

_HEX: Final = re.compile(r"(?:[0-9A-Fa-f]{2}[ ,]*)*[0-9A-Fa-f]{2}")


class Search:
    """Looks from a position on, to the end and round.

    ``done`` is how much of it is done. What reads as bytes is looked for in the bytes, and else in
    the words of a line, whatever its case.
    """

    def __init__(self, view: LineView, position: int, text: str) -> None:
        self.text = text.strip()
        self.done = 0.0
        self._view = view
        self._count = max(view.count, 1)
        self._looked = 0
        self._stretches = view.after(position, STRETCH)
        self._positions: Iterator[int] = iter(())
        is_hex = _HEX.fullmatch(self.text) is not None
        self._bytes = bytes.fromhex(re.sub("[ ,]", "", self.text)) if is_hex else b""
        self._word = self.text.lower()

    def steps(self, slice_s: float = SLICE_S) -> int | None:
        """Look for a while; return the position found, -1 for none, None: there is more to do."""
        until = time.monotonic() + slice_s
        while True:
            for position in self._positions:
                if self._says(position):
                    return position
                self._looked += 1
                if time.monotonic() >= until:
                    self.done = min(self._looked / self._count, 1.0)
                    return None
            stretch = next(self._stretches, None)
            if stretch is None:
                return -1
            if len(self._bytes) > 1:
                held = np.flatnonzero(self._held(self._view.numbers(stretch)))
                if len(held):
                    return stretch.start + int(held[0])
                self._looked += len(stretch)
            else:
                self._positions = iter(stretch)
            if time.monotonic() >= until:
                self.done = min(self._looked / self._count, 1.0)
                return None

    def _held(self, numbers: I64) -> Mask:
        """Tell which lines hold the bytes; of an exchange, in one of its halves."""
        out = self._in(numbers)
        if self._view.exchanges:
            partner = self._view.index.lines["partner"][numbers]
            some = np.flatnonzero(partner >= 0)
            out[some] |= self._in(partner[some])
        return out

    def _in(self, numbers: I64) -> Mask:
        index = self._view.index
        lines = index.lines[numbers]
        out = np.zeros(len(lines), bool)
        for number in np.unique(lines["page"]).tolist():
            mine = np.flatnonzero(lines["page"] == number)
            begin = lines["at"][mine]
            found = places_of(self._bytes, index.pages.get(number).batch)
            if len(found):
                first = found[np.minimum(np.searchsorted(found, begin), len(found) - 1)]
                end = begin + lines["length"][mine]
                out[mine] = (first >= begin) & (first + len(self._bytes) <= end)
        return out

    def _says(self, position: int) -> bool:
        index, number = self._view.index, self._view.line(position)
        if self._bytes and self._bytes in raw_of(index, number):
            return True
        words = line_words(index, number, exchange=self._view.exchanges)
        return self._word in f"{words.op} {words.values} {words.verdict}".lower()


def places_of(wanted: bytes, batch: Batch) -> I64:
    """Return the offsets in its bus at which bytes stand in a batch, in order."""
    out, at = [], batch.data.find(wanted)
    while at >= 0:
        out.append(at)
        at = batch.data.find(wanted, at + 1)
    return np.array(out, np.int64) + batch.base
