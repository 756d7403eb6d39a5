"""Plain lists of bytes, without offsets: hex in all its spellings, decimal where one says so.

Whole blocks go through ``bytes.fromhex``; only where that fails, or where there are comments, the
lines are looked at one by one, and tokens only to say where the mistake is.
"""

from __future__ import annotations

import ast
import re
from typing import TYPE_CHECKING, Final

from sniffer.ground.patterns import later
from sniffer.sources.text import DamagedLine, LineBlock, Opened, arriving, quoted, untimed

if TYPE_CHECKING:
    from collections.abc import Callable, Iterator

    from sniffer.ground.model import Chunk

_PLACES: Final = 3  # of a byte in decimal
_DIGITS: Final = b"0123456789abcdefABCDEF"
# what may stand between bytes, besides blanks: lists, C arrays, string quotes around \x escapes
_MARKS: Final = bytes.maketrans(b",;{}[]()\"'\r", b" " * 11)
_TOKEN: Final = later(rb"[^\s,;{}\[\]()\"']+")
_BYTES: Final = later(rb"(?:(?:0[xX]|\\x)?[0-9A-Fa-f]{2})+|0[xX][0-9A-Fa-f]?|\\x")
_ODD: Final = later(rb"(?:0[xX]|\\x|[0-9A-Fa-f])+")
_STRANGE: Final = later(rb"[^0-9A-Fa-fxX\\]|$")
_SINGLE: Final = later(rb"\b0[xX]([0-9A-Fa-f])\b")
# a line of nothing but FF:FF:01, FF-FF-01 or <FF><FF><01>; elsewhere, and where it
# could be 12:30:00 or 26-11-20, they are of times and dates
_PAIRED: Final = later(
    rb"^[ \t]*(?:(?!\d\d[:-]\d\d(?:[:-]\d\d)?[ \t\r]*$)"
    rb"[0-9A-Fa-f]{2}([:-])(?:[0-9A-Fa-f]{2}\1)*(?:[0-9A-Fa-f]{2})?"
    rb"|(?:<[0-9A-Fa-f]{2}>[ \t]*)+)[ \t\r]*$",
    re.MULTILINE,
)
_TWO: Final = "has an odd number of hex digits: write each byte with two"
_ONES: Final = later(rb"(?<![^\s,;])[0-9A-Fa-f](?![^\s,;])")
_ALONE: Final = r" (`sed -E 's/\b[0-9A-Fa-f]\b/0&/g'` does, where a program left zeros out)"
_NO_HEX: Final = "is not hex: put # before what is no byte"
_BETWEEN: Final = bytes.maketrans(b":-<>", b"    ")
_LITERAL: Final = later(rb"""\b((?:bytearray\()?)(b(["'])((?:\\.|(?!\3)[^\\])*)\3)""")
_UNENDED: Final = later(rb"""\bb(["'])(?=[^"']*\\[^"']*$)""")
# comments, "static const uint8_t data[] = {", the length that xxd -i writes behind the array, the b
# of b""
_ASIDE: Final = later(
    rb"(?:^|(?<=\s))(?:#|//).*$"
    rb"|/\*.{,200}?\*/"
    rb"|^\s*(?:[A-Za-z_]\w*\s+)+\w+\s*\[\s*\w*\s*\]\s*=\s*(?=\{|$)"
    rb"|^\s*(?:[A-Za-z_]\w*\s+)+\w+\s*=\s*\d+\s*;\s*$"
    rb"|\bb(?=[\"'])"
)


class BadLineError(ValueError):
    """What is wrong with a line, and the column (from 0) where it is.

    Up to the column ``good`` the line is right.
    """

    def __init__(self, column: int, why: str, good: int | None = None) -> None:
        super().__init__(f"column {column + 1}: {why}")
        self.column = column
        self.why = why
        self.good = column if good is None else good


def part_line(held: bytes) -> int:
    """Return where an endless line may be parted without parting a byte, 0 for nowhere yet."""
    end = max(held.rfind(mark) for mark in (b" ", b"\t", b",", b";", b"\r", b"\\"))
    paired = max(held.rfind(mark) for mark in (b":", b"-", b">")) + 1
    if max(end, paired) > 0:
        return max(end, paired)
    # packed hex has no marks at all: an even number of digits is whole bytes
    return len(held) - (len(held) - len(held.rstrip(_DIGITS))) % 2


def bare(line: bytes) -> bytes:
    """Return a line with comments and C declarations blanked out; columns stay."""
    return _ASIDE.sub(lambda match: b" " * len(match[0]), line)


def _spaced(text: bytes) -> bytes:
    """Return hex text with every mark and prefix turned into blanks."""
    if b":" in text or b"-" in text or b"<" in text:
        text = _PAIRED.sub(lambda match: match[0].translate(_BETWEEN), text)
    text = text.translate(_MARKS)
    for prefix in (b"0x", b"0X", b"\\x"):
        text = text.replace(prefix, b" ")
    return text


def hex_block(text: bytes) -> bytes:
    """Return the bytes that lines of hex state; ValueError where they need a closer look."""
    if b"#" in text or b"/" in text or b"b'" in text or b'b"' in text:
        raise ValueError
    return bytes.fromhex(_spaced(text).decode("ascii"))


def hex_line(line: bytes) -> bytes:
    """Return the bytes that one line of hex states; raises :class:`BadLineError`."""
    text = _LITERAL.sub(_said, line)
    if unended := _UNENDED.search(text):
        raise BadLineError(unended.start(), "bytes in quotes that do not end on this line")
    text = bare(text)
    try:
        return bytes.fromhex(_spaced(_SINGLE.sub(rb" 0\1", text)).decode("ascii"))
    except ValueError:
        raise _hex_mistake(text) from None


def _said(literal: re.Match[bytes]) -> bytes:
    """Return bytes as Python shows them in hex: what is printable stands there as it is."""
    if literal[4].strip(_DIGITS) == b"":  # as hexlify gives it
        return b" " * len(literal[1]) + literal[2]
    try:
        data = ast.literal_eval(literal[2].decode("ascii"))
    except (ValueError, SyntaxError):
        return literal[0]
    return b" " + bytes(data).hex().encode() + b" "


def share_of_hex(line: bytes) -> float:
    """Return which share of the tokens of ``line`` is bytes in hex, from 0 to 1."""
    words = _TOKEN.findall(bare(line))
    return sum(_BYTES.fullmatch(word) is not None for word in words) / max(1, len(words))


def _hex_mistake(text: bytes) -> BadLineError:
    for token in _TOKEN.finditer(text):
        word = token[0]
        if _BYTES.fullmatch(word):
            continue
        if word == b"*":
            why = "a * (repeated lines) cannot be counted without offsets: dump again with -v"
            return BadLineError(token.start(), why)
        if _ODD.fullmatch(word):
            where = _ALONE if len(word) == 1 and len(_ONES.findall(text)) > 1 else ""
            return BadLineError(token.start(), f"{quoted(word)} {_TWO}{where}")
        strange = _STRANGE.search(word)
        column = token.start() + (strange.start() if strange else 0)
        return BadLineError(column, f"{quoted(word)} {_NO_HEX}", token.start())
    return BadLineError(0, f"{quoted(text)} is not hex")


def decimal_block(text: bytes) -> bytes:
    """Return the bytes that decimal numbers state; ValueError where they need a closer look."""
    words = text.translate(_MARKS).split()
    if words and not b"".join(words).isdigit():  # int() would also take signs and underscores
        raise ValueError
    if max(map(len, words), default=0) > _PLACES:  # an offset
        raise ValueError
    return bytes(map(int, words))


def decimal_line(line: bytes) -> bytes:
    """Return the bytes that one line of decimal numbers states; raises :class:`BadLineError`."""
    text = bare(line)
    for token in _TOKEN.finditer(text):
        if not token[0].isdigit() or len(token[0]) > _PLACES or int(token[0]) > 255:
            why = f"{quoted(token[0])} is not a decimal number from 0 to 255"
            raise BadLineError(token.start(), why)
    return decimal_block(text)


def _bytes(
    opened: Opened, whole: Callable[[bytes], bytes], single: Callable[[bytes], bytes]
) -> Iterator[bytes | None]:
    for block in arriving(opened.stream, part_line):
        if block is None:
            yield None
            continue
        try:
            data = whole(block.text)
        except ValueError:
            yield from _lines(block, single)
        else:
            yield data


def _lines(block: LineBlock, single: Callable[[bytes], bytes]) -> Iterator[bytes]:
    column = block.column
    for number, line in enumerate(block.lines(), block.number):
        try:
            yield single(line)
        except BadLineError as mistake:
            yield single(line[: mistake.good])
            column += mistake.column + 1
            raise DamagedLine(number, mistake.why, column=column) from None
        column = 0


def read_hex(opened: Opened) -> Iterator[Chunk]:
    """Yield the bytes of plain hex text: spaced, packed, 0x, escapes, C arrays, comments."""
    return untimed(_bytes(opened, hex_block, hex_line), opened.bus)


def read_decimal(opened: Opened) -> Iterator[Chunk]:
    """Yield the bytes of a list of decimal numbers from 0 to 255."""
    return untimed(_bytes(opened, decimal_block, decimal_line), opened.bus)
