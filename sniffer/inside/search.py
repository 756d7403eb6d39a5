"""Looking for bytes or words in the lines shown, in steps."""

from __future__ import annotations

import re
import time
from typing import TYPE_CHECKING, Final

from sniffer.inside.detail import raw_of
from sniffer.inside.view import SLICE_S
from sniffer.inside.words import line_words

if TYPE_CHECKING:
    from sniffer.inside.view import LineView

_HEX: Final = re.compile(r"(?:[0-9A-Fa-f]{2}[ ,]*)*[0-9A-Fa-f]{2}")


class Search:
    """Looks from a position on, to the end and round.

    ``done`` is how much of it is done. What reads as bytes is looked for in the bytes, and else in
    the words of a line, whatever its case.
    """

    def __init__(self, view: LineView, position: int, text: str) -> None:
        self.text = text.strip()
        self.done = 0.0
        self._view, self._positions = view, view.after(position)
        self._count = max(view.count, 1)
        self._looked = 0
        is_hex = _HEX.fullmatch(self.text) is not None
        self._bytes = bytes.fromhex(re.sub("[ ,]", "", self.text)) if is_hex else b""
        self._word = self.text.lower()

    def steps(self, slice_s: float = SLICE_S) -> int | None:
        """Look for a while; return the position found, -1 for none, None: there is more to do."""
        until = time.monotonic() + slice_s
        for position in self._positions:
            if self._holds(position):
                return position
            self._looked += 1
            if time.monotonic() >= until:
                self.done = min(self._looked / self._count, 1.0)
                return None
        return -1

    def _holds(self, position: int) -> bool:
        index, number = self._view.index, self._view.line(position)
        if self._bytes and self._bytes in raw_of(index, number):
            return True
        if self._bytes and len(self._bytes) > 1:
            return False
        words = line_words(index, number, exchange=self._view.exchanges)
        return self._word in f"{words.op} {words.values} {words.verdict}".lower()
