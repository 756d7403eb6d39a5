"""How a log spells its bytes where it spells them loosely, as ``Serial.print(b, HEX)`` does.

    TX: FF FF FF 1 2 F1 B              hex without the zeros in front
    TX [255, 255, 255, 1, 2, 241, 11]  decimal

One program printed all lines, so they tell it together, and what none of them proves is refused: a
letter is hex, three digits are decimal; where bytes below sixteen have a zero in front, a byte of
one digit has lost another one.
"""

from __future__ import annotations

from typing import TYPE_CHECKING, Final

from sniffer.ground.patterns import later
from sniffer.sources.plain import BadLineError
from sniffer.sources.text import quoted

if TYPE_CHECKING:
    from collections.abc import Sequence

_LIST: Final = later(
    rb"(?P<open>[\[{(]?)[ \t]*(?:[0-9A-Fa-f]{1,3}[ \t,:-]+)+(?:[0-9A-Fa-f]{1,3})?[ \t]*[\]})]?"
)
_NUMBER: Final = later(rb"[0-9A-Fa-f]+")
_LETTERED: Final = later(rb"[A-Fa-f][0-9A-Fa-f]|[0-9][A-Fa-f]")
_DECIMAL, _HEX = 10, 16


class Spelling:
    """What the lines of a log have told so far of how it spells its bytes.

    ``notes`` counts the lines in which something else stood behind them.
    """

    def __init__(self) -> None:
        self.notes = 0
        self._radix = 0
        self._padded = b""
        self._short = b""

    def read(self, text: bytes, *, is_directed: bool) -> bytes | None:
        """Return the bytes that a list of numbers states, None where their spelling proves none.

        ``is_directed``: a direction stands in front; else small numbers may be of anything.

        Raises:
            BadLineError: it is spelled otherwise than the lines before it.
        """
        found = _LIST.fullmatch(text)
        if found is None:
            return None
        numbers = _NUMBER.findall(text)
        proved = _proved(numbers)
        if proved is None or not (is_directed or any(map(_LETTERED.fullmatch, numbers))):
            return None
        if proved and self._radix not in (0, proved):
            was = "decimal" if proved == _HEX else "hex"
            raise BadLineError(0, f"the lines before it are {was}, this one cannot be")
        self._radix = self._radix or proved
        if self._radix == _DECIMAL:
            return bytes(map(int, numbers))
        if not self._radix and (found["open"] or any(len(number) == 1 for number in numbers)):
            return None
        self._radix = _HEX  # from here on: pairs of digits are hex where nothing was decimal before
        return self._hex(numbers)

    def _hex(self, numbers: Sequence[bytes]) -> bytes | None:
        shortest = min(numbers, key=len)
        self._short = self._short or (shortest if len(shortest) == 1 else b"")
        self._padded = self._padded or next((n for n in numbers if n[0] == 48 and len(n) == 2), b"")
        if self._short and self._padded:
            why = f"{quoted(self._short)} has one digit, {quoted(self._padded)} a zero in front"
            raise BadLineError(0, f"{why}: write each byte with two")
        return bytes.fromhex(b"".join(number.zfill(2) for number in numbers).decode("ascii"))


def _proved(numbers: Sequence[bytes]) -> int | None:
    """Return the radix that numbers prove, 0 for none, None where they are no bytes in any."""
    if max(map(len, numbers)) < 3:
        return 0 if b"".join(numbers).isdigit() else _HEX
    is_decimal = all(number.isdigit() and str(int(number)).encode() == number for number in numbers)
    return _DECIMAL if is_decimal and max(map(int, numbers)) < 256 else None
