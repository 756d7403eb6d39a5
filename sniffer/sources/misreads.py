"""Text that would be read as hex without complaint, and is something else.

Each of these has hex digits throughout, so nothing in it stops a reader: only the shape of many
lines tells that a column is no bytes, or that the digits are of another radix.
"""

from __future__ import annotations

import itertools
import re
from typing import Final

from sniffer.ground.patterns import later
from sniffer.sources.refusals import decimal_dump, decimal_or_hex, refused
from sniffer.sources.text import FIRST_LINES

_WORD: Final = later(rb"[0-9A-Fa-fxX]+")
_BITS: Final = later(rb"0[bB][01]{1,8}")
_SEVERAL: Final = 4
"""So many lines have the same column before it is taken for one."""

_ROWS: Final = 8
"""So many rows of a dump say the same at one place by no chance."""

_WIDTHS: Final = (9, 17, 33)
"""Words of a dump's row with another one before its bytes."""

_MANY: Final = 48
"""So many bytes of a servo bus are never written in hex without a letter, nor a leading zero."""

_LOOKED_AT: Final = 256
"""Lines of which that is told."""

_SECONDS: Final = 10  # digits of a time since 1970

_PAIRS: Final = later(rb" *(?:[0-9A-Fa-f]{2} +)*")
_FRAMES: Final = b" |;<>"
"""What stands around bytes as text."""
_UNFRAMED: Final = later(rb"[^ |;<>]")
_AS_TEXT: Final = bytes(byte if 32 <= byte < 127 else 0x2E for byte in range(256))
"""What stands there for each byte."""
_LEAST: Final = 4
"""So many bytes stand once more as text before that is no chance."""

_ALONE: Final = "keep only the hex bytes, or write lines `(seconds.fraction) bus0 #HEX`"


def refuse_misread(lines: list[bytes]) -> None:
    """Raise InputError where lines that could be hex are seen to be something else."""
    rows = [words for line in lines[:_LOOKED_AT] if (words := _WORD.findall(line))]
    words = list(itertools.chain.from_iterable(rows))
    if words and all(_BITS.fullmatch(word) for word in words):
        raise refused("a list of bits", "write the bytes in hex")
    if _are_small_decimals(words):
        raise decimal_or_hex()
    column = _column(rows[:FIRST_LINES]) or _constant(rows)
    if column:
        raise refused(f"hex behind a column of {column}", _ALONE)


def refuse_gutter(lines: list[bytes]) -> None:
    """Raise InputError where each line has its bytes once more as text, without an offset.

    That text may be hex throughout: nothing else tells it from bytes.
    """
    lines = lines[:FIRST_LINES]
    looked = lines[:-1] or lines  # the last may be cut
    found = [one for one in map(hex_before_text, looked) if one is not None]
    if len(found) == len(looked) and sum(size for size, _ in found) >= _LEAST:
        column = max(column for _, column in found)
        way = f"keep only the hex: `cut -c1-{column} FILE | sniffer decode -`"
        raise refused("hex with its bytes once more as text", way)


def hex_before_text(line: bytes) -> tuple[int, int] | None:
    """Return how many bytes stand before the same bytes as text, and at what column they end."""
    pairs = _PAIRS.match(line)
    hexes = list(re.finditer(rb"[0-9A-Fa-f]{2}(?= )", pairs[0])) if pairs else []
    data = bytes.fromhex(b"".join(match[0] for match in hexes).decode("ascii"))
    text, whole = data.translate(_AS_TEXT), line.rstrip(_FRAMES)
    first = text.lstrip(_FRAMES)[:1]
    for size, match in enumerate(hexes, 1):
        rest = _UNFRAMED.search(whole, match.end())
        # most are told apart without a look at all of them: a line may have a million bytes
        if rest is None or rest[0] != first or len(whole) - rest.start() > size:
            continue
        if whole[rest.start() :] == text[:size].strip(_FRAMES):
            return size, match.end()
    return None


def refuse_decimal_dump(lines: list[bytes]) -> None:
    """Raise InputError for a dump with offsets whose columns are as wide as decimal numbers.

    Hex stands one blank apart, so two digits behind two blanks each are numbers of up to three.
    """
    bodies = [line.lstrip(b" ").partition(b" ")[2].strip() for line in lines[:FIRST_LINES]]
    words = b" ".join(bodies).split()
    gaps = [gap for body in bodies for gap in re.findall(rb" +", body)]
    if len(words) > 1 and b"".join(words).isdigit() and gaps and min(map(len, gaps)) > 1:
        raise decimal_dump()


def _are_small_decimals(words: list[bytes]) -> bool:
    """Tell whether so many numbers are written as decimal ones are, and as hex never is.

    Every protocol has a byte in each frame that is a letter in hex (FF, FA, 0D).
    """
    return len(words) >= _MANY and all(
        len(word) <= 2 and word.isdigit() and (word == b"0" or word[:1] != b"0") for word in words
    )


def _column(rows: list[list[bytes]]) -> str:
    """Return what the first word of each row is, where it is none of the bytes."""
    if len(rows) < _SEVERAL or any(
        len(row) < 2 or any(len(word) != 2 for word in row[1:]) for row in rows
    ):
        return ""
    if all(_is_number_of(row) for row in rows):
        return "lengths"
    if any(not row[0].isdigit() for row in rows):
        return ""
    firsts = [int(row[0]) for row in rows]
    steps = {after - before for before, after in itertools.pairwise(firsts)}
    if steps == {1}:
        return "line numbers"
    is_growing = min(steps) >= 0 and firsts[0] < firsts[-1]
    digits = min(len(row[0]) for row in rows)
    return "times" if digits >= _SECONDS or (digits > 2 and is_growing) else ""


def _is_number_of(row: list[bytes]) -> bool:
    """Tell whether the first word counts those behind it, in decimal or hex."""
    first, count = row[0].lstrip(b"0"), len(row) - 1
    return first in (b"%d" % count, b"%x" % count, b"%X" % count)


def _constant(rows: list[list[bytes]]) -> str:
    """Return what the first word of each row is, where it is the same in all, and no byte is.

    Where a frame stands on each line, more than one place says the same in all of them: header,
    id, length. Where the rows of a dump do, none does but a column that somebody put before.
    """
    full = rows[:-1]  # the last may be shorter
    if len(full) < _ROWS or len({len(row) for row in full}) > 1 or len(full[0]) not in _WIDTHS:
        return ""
    if any(len(word) != 2 for row in full for word in row):
        return ""
    alike = [len(set(column)) == 1 for column in zip(*full, strict=True)]
    told = f"numbers that are all {full[0][0].decode('ascii')}"
    return told if alike[0] and not any(alike[1:]) else ""
