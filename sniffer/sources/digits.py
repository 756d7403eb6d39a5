"""Decimal numbers anywhere in a text, all of them at once: eight digits are one word of 64 bits."""

from __future__ import annotations

from typing import TYPE_CHECKING, Final

import numpy as np

if TYPE_CHECKING:
    import numpy.typing as npt

    from sniffer.ground.model import I64, U8, Mask

DIGITS: Final = 18
"""Digits of a number: more are beyond 64 bits."""

PAD: Final = 24
"""What must stand in front of the first number: digits are read by eights, back from its end."""

_EIGHT: Final = 8
_ONES: Final = 0x0101_0101_0101_0101
_PAIRED: Final = ((2, 0x00FF_00FF_00FF_00FF), (4, 0x0000_FFFF_0000_FFFF), (8, 0xFFFF_FFFF))
"""Digits of two neighbours taken together, and what is kept of the word then."""


def numbers(data: U8, end: I64, size: I64) -> tuple[I64, Mask]:
    """Return the numbers that end before ``end``, and which of them have another sign in them.

    ``size``: how many digits each has, ``DIGITS`` at most.
    """
    at = np.ndarray(len(data) - _EIGHT + 1, "<u8", data, 0, (1,))  # what begins at each place
    most, least = (int(size.max()), int(size.min())) if len(size) else (0, 0)
    out = np.zeros(len(end), np.uint64)
    wrong = np.zeros(len(end), bool)
    for behind in range(0, most, _EIGHT):
        # the first digit is the lowest byte
        eight = at[end - (behind + _EIGHT)]
        eight ^= np.uint64(ord("0") * _ONES)
        if most == least and most < behind + _EIGHT:
            front = np.uint64((behind + _EIGHT - most) * _EIGHT)
            eight >>= front
            eight <<= front
        elif least < behind + _EIGHT:
            # what stands in front of the number is no digit of it
            there = np.clip(size - behind, 0, _EIGHT).astype(np.uint64)
            fronts = (_EIGHT - np.maximum(there, 1)) * _EIGHT
            eight = np.where(there > 0, eight >> fronts << fronts, 0)
        value, strange = _first_digits(eight) if behind else _values(eight)
        if behind:
            value *= np.uint64(10**behind)
        out += value
        wrong |= strange
    return out.view(np.int64), wrong


def _first_digits(eight: npt.NDArray[np.uint64]) -> tuple[npt.NDArray[np.uint64], Mask]:
    """Return the same as ``_values``, sooner where most are as the one before: those of times."""
    new = np.flatnonzero(eight[1:] != eight[:-1]) + 1
    if len(new) >= len(eight) // _EIGHT:
        return _values(eight)
    runs = np.diff(new, prepend=0, append=len(eight))
    value, strange = _values(eight[np.concatenate([[0], new])])
    return np.repeat(value, runs), np.repeat(strange, runs)


def _values(eight: npt.NDArray[np.uint64]) -> tuple[npt.NDArray[np.uint64], Mask]:
    """Return the numbers that eight values of digits each are, and which have no digits in them."""
    strange = eight + (0x80 - 10) * _ONES
    strange |= eight
    strange &= np.uint64(0x80 * _ONES)
    for places, mask in _PAIRED:
        higher = eight >> np.uint64(4 * places)
        eight *= np.uint64(10 ** (places // 2))
        eight += higher
        eight &= np.uint64(mask)
    return eight, strange != 0
