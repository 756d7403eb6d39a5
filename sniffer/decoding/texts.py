"""Bytes that are text: in which encoding, and whether commands and answers in text stand in it."""

from __future__ import annotations

import re
from typing import Final

CR, LF = b"\r", b"\n"

WRITTEN_OUT: Final = re.compile(rb"[\\/]r(?:[\\/]n)?")
"""The end of a line as source code has it, sent as the characters that stand there."""

READABLE: Final = 0x80
"""Bytes below are text in ASCII."""

_SPOKEN: Final = re.compile(rb"[#*][0-9]*[A-Za-z]+[-0-9A-Za-z.]*")
"""A command or an answer in text, as LSS has them."""

_PRINTED: Final = bytes(range(0x20, 0x7F)) + b"\t\r\n"


def text_of(data: bytes) -> str | None:
    """Return bytes as UTF-8 text, None where they are none; the last character may be cut."""
    for cut in range(4):
        try:
            return data[: len(data) - cut].decode("utf-8")
        except UnicodeDecodeError:
            continue
    return None


def is_printed(data: bytes) -> bool:
    """Tell whether bytes are letters, digits and signs, in lines or not: no control characters."""
    return not data.translate(None, _PRINTED)


def is_latin(data: bytes) -> bool:
    """Tell whether bytes are text of none but the first 256 characters, and not all ASCII."""
    text = text_of(data)
    return text is not None and READABLE <= max(map(ord, text), default=0) < 256


def is_around_lines(data: bytes) -> bool:
    """Tell whether this is text, and most of its lines have a command or an answer in them."""
    if CR in data or LF not in data or max(data) >= READABLE:
        return False
    lines = [line for line in data.split(LF) if line.strip()]
    return 2 * sum(_SPOKEN.search(line) is not None for line in lines) >= len(lines)


def lines_in(data: bytes) -> bytes:
    """Return the commands and answers that stand in a text, each with its end as on the wire."""
    return b"".join(line + CR for line in _SPOKEN.findall(data))
