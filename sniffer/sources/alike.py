"""Lines that are alike: they differ from one of them in digits alone, so they are read in columns.

A table or a log mostly repeats one line with other numbers. One line is taken apart as ever, and
says where its numbers stand; all lines of its length that have its other signs at the same places
are then read together. What is like no line that was taken apart, is read one by one.
"""

from __future__ import annotations

from typing import TYPE_CHECKING, Final, NamedTuple

import numpy as np

if TYPE_CHECKING:
    import re
    from collections.abc import Iterator, Sequence

    from sniffer.ground.model import F64, I64, U8, Mask

FEW: Final = 16
"""So few lines are read one by one: columns cost as much."""

PATTERNS_MOST: Final = 32
"""Lines of a block that others are compared with: where all are unlike, that is given up."""

_ZERO: Final = np.uint8(ord("0"))
_UPPER: Final = np.full(256, 0xFF, np.uint8)  # the value of each sign as a capital digit
_UPPER[list(b"0123456789ABCDEF")] = np.arange(16)

EXACT: Final = 15
"""Decimal digits that a float always tells apart."""

Span = tuple[int, int]
"""Where a number stands in a line."""


class TextLines:
    """The lines of a text, by their length."""

    def __init__(self, text: bytes) -> None:
        self.text = text + b"\n"
        self._data = np.frombuffer(self.text, np.uint8)
        breaks = np.flatnonzero(self._data == ord("\n"))
        self._begin = np.concatenate([[0], breaks[:-1] + 1])
        self._size = breaks - self._begin

    def __len__(self) -> int:
        return len(self._begin)

    def line(self, row: int) -> bytes:
        """Return a line."""
        begin = int(self._begin[row])
        return self.text[begin : begin + int(self._size[row])]

    def groups(self) -> Iterator[I64]:
        """Yield the rows of lines of one length."""
        order = np.argsort(self._size, kind="stable")
        borders = np.flatnonzero(np.diff(self._size[order])) + 1
        yield from np.split(order, borders)

    def signs(self, rows: I64) -> U8:
        """Return lines of one length, a row a place: what stands there in each of them."""
        size = int(self._size[rows[0]])
        begin, count = int(self._begin[rows[0]]), len(rows)
        if int(self._begin[rows[-1]]) - begin == (count - 1) * (size + 1):  # nothing between them
            signs = self._data[begin : begin + count * (size + 1)].reshape(count, size + 1)
            return np.ascontiguousarray(signs[:, :size].T)
        return self._data[self._begin[rows] + np.arange(size)[:, None]]


def alike(signs: U8, decimal: Sequence[Span], upper: Sequence[Span]) -> Mask:
    """Tell which lines differ from the first in these numbers alone, and have digits there."""
    free: dict[int, bool] = {place: True for span in decimal for place in range(*span)}
    free |= {place: False for span in upper for place in range(*span)}
    out = np.ones(signs.shape[1], bool)
    for place, said in enumerate(signs):
        is_decimal = free.get(place)
        if is_decimal is None:
            out &= said == said[0]
        elif is_decimal:
            out &= said - _ZERO < 10  # what is less than a 0 wraps
        else:
            out &= _UPPER[said] < 16
    return out


def number(signs: U8, span: Span) -> I64:
    """Return the decimal numbers that stand there, of 18 digits at most."""
    out = np.zeros(signs.shape[1], np.int64)
    for said in signs[slice(*span)]:
        out *= 10
        out += said - _ZERO
    return out


def octets(signs: U8, span: Span) -> U8:
    """Return the bytes that stand there in hexadecimal capitals, a row a place."""
    digits = _UPPER[signs[slice(*span)]]
    return np.asarray(digits[::2] << np.uint8(4) | digits[1::2])


class UnlikeError(ValueError):
    """A line is not as lines of its kind nearly always are: it needs a closer look."""


class AlikeLines(NamedTuple):
    """Lines that are alike: one of them taken apart, the rows of all, their signs by place."""

    one: re.Match[bytes]
    rows: I64
    signs: U8

    def number(self, group: int) -> I64:
        """Return the decimal numbers that a group of the expression matches."""
        return number(self.signs, self.one.span(group))

    def decimals(self, whole: int, part: int) -> F64:
        """Return the fractions of which one group matches the whole and another the digits behind.

        Raises:
            UnlikeError: they have more digits than a float tells apart.
        """
        if len(self.one[whole]) + len(self.one[part]) > EXACT:
            raise UnlikeError
        places = 10 ** len(self.one[part])
        # both are exact, so the quotient is what the text is rounded to
        return np.asarray((self.number(whole) * places + self.number(part)) / places)

    def octets(self, group: int) -> U8:
        """Return the bytes that a group matches, a row a place."""
        return octets(self.signs, self.one.span(group))


def likenesses(
    lines: TextLines, pattern: re.Pattern[bytes], decimal: Sequence[int], upper: Sequence[int]
) -> Iterator[AlikeLines]:
    """Take all lines apart, those that are alike together.

    Args:
        lines: what is taken apart.
        pattern: what all of it is like; every digit in a group is free, other signs are not.
        decimal: groups of decimal digits.
        upper: groups of pairs of hexadecimal capitals.

    Raises:
        UnlikeError: a line does not match; then what was yielded is not to be used.
    """
    looked = 0
    for rows in lines.groups():
        signs = lines.signs(rows)
        while len(rows):
            one = pattern.fullmatch(lines.line(int(rows[0])))
            if one is None:
                raise UnlikeError
            if len(rows) <= FEW or looked >= PATTERNS_MOST:
                yield AlikeLines(one, rows[:1], signs[:, :1])
                rows, signs = rows[1:], signs[:, 1:]
                continue
            looked += 1
            spans = ([one.span(n) for n in decimal], [one.span(n) for n in upper])
            like = alike(signs, *spans)
            if like.all():
                yield AlikeLines(one, rows, signs)
                break
            yield AlikeLines(one, rows[like], signs[:, like])
            rows, signs = rows[~like], signs[:, ~like]
