"""Plain lists of bytes, without offsets: hex in all its spellings, decimal where one says so.

Whole blocks go through ``bytes.fromhex``; only where that fails, or where there are comments, the
lines are looked at one by one, and tokens only to say where the mistake is.
"""

from __future__ import annotations

import re
from collections.abc import Callable, Iterator
from typing import Final

from sniffer.model import Chunk
from sniffer.sources.text import Block, Damage, Opened, blocks, quoted, untimed

# what may stand between bytes, besides blanks: lists, C arrays, string quotes around \x escapes
_MARKS: Final = bytes.maketrans(b",;{}[]()\"'\r", b" " * 11)
_TOKEN: Final = re.compile(rb"[^\s,;{}\[\]()\"']+")
_BYTE: Final = re.compile(rb"(?:0[xX]|\\x)?[0-9A-Fa-f]{2}")
_HEX: Final = re.compile(rb"(?:0[xX]|\\x)?[0-9A-Fa-f]*")
# "static const uint8_t data[] = {", and the length that xxd -i writes behind the array
_DECLARED: Final = re.compile(rb"\s*(?:[A-Za-z_]\w*\s+)+\w+\s*\[\s*\w*\s*\]\s*=\s*(?=\{|$)")
_LENGTH: Final = re.compile(rb"\s*(?:[A-Za-z_]\w*\s+)+\w+\s*=\s*\d+\s*;\s*$")
_COMMENT: Final = re.compile(rb"(?:^|(?<=\s))(?:#|//).*$")
_BYTES_LITERAL: Final = re.compile(rb"\bb(?=[\"'])")
_SINGLE: Final = re.compile(rb"\b0[xX]([0-9A-Fa-f])\b")
_STAR: Final = b"*"


def part_line(held: bytes) -> int:
    """Return where an endless line may be parted without parting a byte, 0 for nowhere yet."""
    end = max(held.rfind(mark) for mark in (b" ", b"\t", b",", b";", b"\r", b"\\"))
    # packed hex has no marks at all: an even number of digits is whole bytes
    return end if end > 0 else len(held) & ~1


def bare(line: bytes) -> bytes:
    """Return a line without comment and C declaration."""
    if _LENGTH.match(line):
        return b""
    line = _COMMENT.sub(b"", line)
    match = _DECLARED.match(line)
    return line[match.end() :] if match else line


def _spaced(text: bytes) -> bytes:
    """Return hex text with every mark and prefix turned into blanks."""
    text = text.translate(_MARKS)
    if b"x" in text or b"X" in text:
        text = _SINGLE.sub(rb" 0\1", text)
        for prefix in (b"0x", b"0X", b"\\x"):
            text = text.replace(prefix, b" ")
    return text


def hex_line(line: bytes) -> bytes:
    """Return the bytes that one line of hex states.

    Raises ValueError with the column (from 0) and what is wrong there.
    """
    line_bare = bare(line)
    text = _BYTES_LITERAL.sub(b" ", line_bare)
    try:
        return bytes.fromhex(_spaced(text).decode("ascii"))
    except ValueError:
        shift = len(line) - len(line_bare) if _DECLARED.match(line) else 0
        column, why = _mistake(text)
        raise ValueError(column + shift, why) from None


def _mistake(text: bytes) -> tuple[int, str]:
    for token in _TOKEN.finditer(text):
        word = token[0]
        start = 0
        while match := _BYTE.match(word, start):
            start = match.end()
        if start == len(word):
            continue
        if _HEX.fullmatch(word, start):
            digits = len(re.sub(rb"0[xX]|\\x", b"", word))
            return token.start(), f"{quoted(word)} has an odd number of hex digits ({digits})"
        bad = re.search(rb"[^0-9A-Fa-f]", word[start:])
        column = token.start() + start + (bad.start() if bad else 0)
        if word == _STAR:
            return column, "a * (repeated lines) cannot be counted without offsets: use od -v"
        return column, f"{quoted(word)} is not hex"
    return 0, f"{quoted(text)} is not hex"


def decimal_line(line: bytes) -> bytes:
    """Return the bytes that one line of decimal numbers states; errors as :func:`hex_line`."""
    line_bare = bare(line)
    words = line_bare.translate(_MARKS).split()
    try:
        # int() would also take signs and underscores
        if b"".join(words).isdigit() or not words:
            return bytes(map(int, words))
    except ValueError:
        pass
    shift = len(line) - len(line_bare) if _DECLARED.match(line) else 0
    for token in _TOKEN.finditer(line_bare):
        if not token[0].isdigit() or len(token[0]) > 9 or int(token[0]) > 255:
            why = f"{quoted(token[0])} is not a decimal number from 0 to 255"
            raise ValueError(token.start() + shift, why)
    raise ValueError(0, f"{quoted(line)} is not a list of decimal numbers")


def _hex_block(text: bytes) -> bytes:
    if b"#" in text or b"/" in text:
        raise ValueError
    return bytes.fromhex(_spaced(text).decode("ascii"))


def _decimal_block(text: bytes) -> bytes:
    words = text.translate(_MARKS).split()
    if words and not b"".join(words).isdigit():
        raise ValueError
    return bytes(map(int, words))


def _bytes(
    opened: Opened, whole: Callable[[bytes], bytes], single: Callable[[bytes], bytes]
) -> Iterator[bytes]:
    for block in blocks(opened.stream, part_line):
        try:
            data = whole(block.text)
        except ValueError:
            yield from _lines(block, single)
        else:
            yield data


def _lines(block: Block, single: Callable[[bytes], bytes]) -> Iterator[bytes]:
    for index, line in enumerate(block.lines()):
        try:
            yield single(line)
        except ValueError as error:
            column, why = error.args
            column += 1 + (0 if index else block.column)
            raise Damage(block.number + index, f"column {column}: {why}") from None


def read_hex(opened: Opened) -> Iterator[Chunk]:
    """Yield the bytes of plain hex text: spaced, packed, 0x, escapes, C arrays, comments."""
    return untimed(_bytes(opened, _hex_block, hex_line), opened.bus)


def read_decimal(opened: Opened) -> Iterator[Chunk]:
    """Yield the bytes of a list of decimal numbers from 0 to 255."""
    return untimed(_bytes(opened, _decimal_block, decimal_line), opened.bus)
