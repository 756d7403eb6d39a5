"""Looking for bytes or words in the lines shown, in steps."""

from __future__ import annotations

import re
import time
from typing import TYPE_CHECKING, Final

import numpy as np

from sniffer.inside.sieve import WordSieve
from sniffer.inside.texts import SearchedTexts
from sniffer.inside.view import SLICE_S

if TYPE_CHECKING:
    from collections.abc import Iterator

    from sniffer.ground.model import I64, Batch, Mask
    from sniffer.inside.view import LineView

STRETCH: Final = 1 << 13
"""Lines whose bytes are looked through at once."""

WORDS: Final = 1 << 9
"""Lines that are put in words at once: some 2 ms."""

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
        is_hex = _HEX.fullmatch(self.text) is not None
        self._bytes = bytes.fromhex(re.sub("[ ,]", "", self.text)) if is_hex else b""
        self._word = self.text.lower()
        self._found = self._looking(position)

    def steps(self, slice_s: float = SLICE_S) -> int | None:
        """Look for a while; return the position found, -1 for none, None: there is more to do."""
        until = time.monotonic() + slice_s
        for found in self._found:
            if found is not None:
                return found
            if time.monotonic() >= until:
                return None
        return -1

    def _looking(self, position: int) -> Iterator[int | None]:
        """Yield None whenever some lines were looked at, and what was found in the end."""
        view, looked = self._view, 0
        texts = sieve = None
        if len(self._bytes) < 2:  # one byte may be a word: ad
            texts = SearchedTexts(view.index, exchanges=view.exchanges)
            sieve = WordSieve(view.index, self.text, exchanges=view.exchanges)
        for stretch in view.after(position, STRETCH):
            numbers = view.numbers(stretch)
            held = self._held(numbers) if self._bytes else np.zeros(len(numbers), bool)
            likely = np.flatnonzero(held if sieve is None else held | sieve.may(numbers))
            for at in range(0, len(likely), WORDS):
                some = likely[at : at + WORDS]
                found = held[some]
                if texts is not None:
                    found |= [self._word in text.lower() for text in texts.of(numbers[some])]
                if found.any():
                    yield stretch.start + int(some[np.argmax(found)])
                    return
                yield None
            looked += len(stretch)
            self.done = min(looked / max(view.count, 1), 1.0)
            yield None

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


def places_of(wanted: bytes, batch: Batch) -> I64:
    """Return the offsets in its bus at which bytes stand in a batch, in order."""
    if len(wanted) == 1:  # which stands everywhere
        alike = np.frombuffer(batch.data, np.uint8) == wanted[0]
        return np.flatnonzero(alike) + batch.base
    out, at = [], batch.data.find(wanted)
    while at >= 0:
        out.append(at)
        at = batch.data.find(wanted, at + 1)
    return np.array(out, np.int64) + batch.base
