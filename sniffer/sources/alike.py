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

    from sniffer.ground.model import I64, U8, Mask

FEW: Final = 16
"""So few lines are read one by one: columns cost as much."""

PATTERNS_MOST: Final = 32
"""Lines of a block that others are compared with: where all are unlike, that is given up."""

NONE: Final = 0xFF
"""The value of what is no digit."""

DECIMAL: Final = np.full(256, NONE, np.uint8)
"""Value of each sign as a decimal digit."""

UPPER: Final = np.full(256, NONE, np.uint8)
"""Value of each sign as a hexadecimal digit in capitals."""

for _nth, _digit in enumerate(b"0123456789ABCDEF"):
    UPPER[_digit] = _nth
DECIMAL[UPPER < 10] = UPPER[UPPER < 10]

Span = tuple[int, int]
"""Where a number stands in a line."""


class TextLines:
    """The lines of a text, by their length."""

    def __init__(self, text: bytes) -> None:
        self.text = text
        self._data = np.frombuffer(text, np.uint8)
        breaks = np.flatnonzero(self._data == ord("\n"))
        self._begin = np.concatenate([[0], breaks + 1])
        self._size = np.append(breaks, len(text)) - self._begin

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
        """Return lines of one length, a column a sign."""
        size = int(self._size[rows[0]])
        if int(self._begin[rows[-1]] - self._begin[rows[0]]) == (len(rows) - 1) * (size + 1):
            begin = int(self._begin[rows[0]])  # they follow on each other
            padded = self._data[begin : begin + len(rows) * (size + 1)]
            if len(padded) == len(rows) * (size + 1):
                return padded.reshape(len(rows), size + 1)[:, :size]
        return self._data[self._begin[rows, None] + np.arange(size)]


def alike(signs: U8, like: U8, decimal: Sequence[Span], upper: Sequence[Span]) -> Mask:
    """Tell which lines differ from one in these numbers alone, and have digits where it has."""
    out = np.ones(len(signs), bool)
    at = 0
    for (begin, end), digits in sorted(
        [*((span, DECIMAL) for span in decimal), *((span, UPPER) for span in upper)],
        key=lambda told: told[0],
    ):
        if at < begin:
            out &= (signs[:, at:begin] == like[at:begin]).all(axis=1)
        out &= (digits[signs[:, begin:end]] != NONE).all(axis=1)
        at = end
    if at < signs.shape[1]:
        out &= (signs[:, at:] == like[at:]).all(axis=1)
    return out


def number(signs: U8, span: Span) -> I64:
    """Return the decimal numbers that stand there, of 18 digits at most."""
    out = np.zeros(len(signs), np.int64)
    for place in range(*span):
        out *= 10
        out += DECIMAL[signs[:, place]]
    return out


def octets(signs: U8, span: Span) -> U8:
    """Return the bytes that stand there in hexadecimal capitals, a column each."""
    digits = UPPER[signs[:, slice(*span)]]
    return np.asarray(digits[:, ::2] << np.uint8(4) | digits[:, 1::2])


class UnlikeError(ValueError):
    """A line is not as lines of its kind nearly always are: it needs a closer look."""


class AlikeLines(NamedTuple):
    """Lines that are alike: one of them taken apart, the rows of all, their signs in columns."""

    one: re.Match[bytes]
    rows: I64
    signs: U8

    def number(self, group: int) -> I64:
        """Return the decimal numbers that a group of the expression matches."""
        return number(self.signs, self.one.span(group))

    def octets(self, group: int) -> U8:
        """Return the bytes that a group matches, a column each."""
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
                yield AlikeLines(one, rows[:1], signs[:1])
                rows, signs = rows[1:], signs[1:]
                continue
            looked += 1
            spans = ([one.span(n) for n in decimal], [one.span(n) for n in upper])
            like = alike(signs, signs[0], *spans)
            yield AlikeLines(one, rows[like], signs[like])
            rows, signs = rows[~like], signs[~like]
