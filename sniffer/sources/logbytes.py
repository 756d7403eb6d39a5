r"""The bytes that stand behind a time or a direction, in the spellings that programs have for them.

    FF A0 00 20   ff-a0-00-20   0xFF,0xA0   FFA00020   hex, and "FF A0" or `FF A0` in quotes
    b'\xff\xa0\x00 '   <Buffer ff a0 00 20>            as Python and node.js show them
    $FF $A0   FFh A0h   %FF%A0   {FF}{A0}   <FF><A0>   each byte with a mark
    FF A0 0 20   [255, 160, 0, 32]                     where the lines prove it, see ``spelling``
    #5QD                                               LSS text, which ends in 0D on the wire

What stands behind them is a note where no byte could look so: counted, and left out.
"""

from __future__ import annotations

import re
from typing import TYPE_CHECKING, Final

from sniffer.ground.patterns import later
from sniffer.sources.misreads import hex_before_text
from sniffer.sources.plain import BadLineError, hex_line, share_of_hex

if TYPE_CHECKING:
    from sniffer.sources.spelling import Spelling

LSS_LINE: Final = later(rb"#\d{1,3}[A-Za-z]+[-\w.*]*|\*\d{0,3}[A-Za-z]+[-\w.]*")
"""A line of an LSS: ``#5QD`` asks, ``*5QD1443`` answers; only ``*QID5`` names no servo."""

SOME_BYTES: Final = later(rb"[0-9A-Fa-f]{2}[ ,:-]{1,2}(?:0x)?[0-9A-Fa-f]{2}\b")
MOSTLY: Final = 0.6
"""Share of the words of a text from which on it is meant to be hex."""

PLACE: Final = later(rb"^(?:0x[0-9A-Fa-f]{8}[ \t]{2,}|(?:0x)?0[0-9A-Fa-f]{3}:[ \t]+)")
"""An offset or an address in front of bytes, as dumps have it."""

_PAIRS: Final = later(rb"[0-9A-Fa-f]{2}(?: [0-9A-Fa-f]{2})+")
_IN_QUOTES: Final = rb"(?:'(?:\\.|[^'\\])*'|\"(?:\\.|[^\"\\])*\")"
_LITERAL: Final = later(rb"(?:bytearray\()?(b" + _IN_QUOTES + rb")\)?")
_QUOTED: Final = later(_IN_QUOTES + rb"|`[^`]*`")
_ENCLOSED: Final = later(_LITERAL.pattern + rb"|" + _QUOTED.pattern)
_BUFFER: Final = later(rb"<Buffer((?: [0-9A-Fa-f]{2})*) ?>")
_ONE: Final = (
    rb"(?:[$%][0-9A-Fa-f]{2}|[0-9A-Fa-f]{2}[hH]\b|\{[0-9A-Fa-f]{2}\}|<[0-9A-Fa-f]{2}>)[ \t,]{0,2}"
)
_MARKED: Final = later(rb"(?:" + _ONE + rb")+")
_MARKS: Final = b"$%hH{}<>,"
_ENDED: Final = later(rb"(?:[ \t]*-{1,3}>|\\r|<CR>|\[CR\]|\xe2\x90\x8d)$", re.IGNORECASE)
_WORDY: Final = rb"(?:(?=[A-Za-z]*[G-WYZg-wyz])[A-Za-z]{3,32}|[Oo][Kk])\b"
_NOTE: Final = later(
    rb"[ \t](?:(?P<text>\|)|[(;\"'`]|//|#(?!\d)|<-).*$|(?:[ \t]{2}|\t)" + _WORDY + rb".*$"
)
"""What is no byte behind bytes. A word stands apart from them: else it may be one that is torn."""

_APART: Final = later(
    rb"(?:[0-9A-Fa-f]{2} )+(?:[ \t]+)(?![0-9A-Fa-f]{2}(?:[ \t]|$))[0-9A-Fa-f]+(?=[ \t]|$)"
)
_TORN: Final = later(rb"(?:" + _ONE + rb"){2}|[0-9A-Fa-f]{7,}(?=[ \t]|$)")
_DIGITS: Final = later(rb"(?:[0-9A-Fa-f]{1,2}[ ,]+)+[0-9A-Fa-f]{1,2}")
_NUMBERS: Final = later(rb"[\[{(][\d ,;\t]*\d[\d ,;\t]*[\]})]?")
_TEXT_LEAST: Final = 4


def stated(text: bytes, spelling: Spelling, *, is_directed: bool) -> bytes:
    """Return the bytes that a text states, none where it is of words.

    Args:
        text: what stands behind a time or a direction.
        spelling: what the lines before have told; what is left out is counted there.
        is_directed: a direction stands in front; else small numbers may be of anything.

    Raises:
        BadLineError: it is hex, but for something.
    """
    plain = text.strip(b" \t\r;,")
    if _PAIRS.fullmatch(plain) or LSS_LINE.fullmatch(plain):  # as in nearly all lines
        return _spelled(plain, spelling, is_directed)
    plain = _ENDED.sub(b"", plain).rstrip(b" \t")
    enclosed = _ENCLOSED.match(plain)
    note = _NOTE.search(plain, enclosed.end() if enclosed else 0)
    body = plain[: note.start()].rstrip(b" \t;,") if note else plain
    if literal := _LITERAL.fullmatch(body):  # as Python shows them
        data = hex_line(literal[1])
    else:
        body = _without_text(PLACE.sub(b"", _unquoted(body)))
        data = _spelled(body, spelling, is_directed)
    spelling.notes += bool(data and note and not note["text"])
    return data


def _unquoted(text: bytes) -> bytes:
    """Return what stands in quotes, in the form that Python has for it where it needs one."""
    if not _QUOTED.fullmatch(text):
        return text
    return hex_line(b"b" + text).hex().encode() if b"\\" in text else text[1:-1].strip(b" \t")


def _without_text(text: bytes) -> bytes:
    """Return a text without the bytes once more as text, which may look like hex."""
    if b"  " not in text:
        return text
    size, column = hex_before_text(text) or (0, 0)
    return text[:column] if size >= _TEXT_LEAST else text


def _spelled(text: bytes, spelling: Spelling, is_directed: bool) -> bytes:
    """Return the bytes that a text states with nothing behind them.

    Raises:
        BadLineError: it is hex, but for something.
    """
    if LSS_LINE.fullmatch(text):
        return text + b"\r"
    if is_directed and _MARKED.fullmatch(text):
        text = text.translate(None, _MARKS)
    elif buffer := _BUFFER.fullmatch(text):
        text = buffer[1]
    listed = spelling.read(text, is_directed=is_directed)
    if listed is not None:
        return listed
    if _NUMBERS.fullmatch(text):
        raise BadLineError(0, "numbers in a list may be decimal: write 0x before those in hex")
    if apart := _APART.match(text):
        why = "what stands apart from the bytes may be a note: put # before it"
        raise BadLineError(apart.end(), why)
    try:
        return hex_line(text.replace(b"-", b" ").replace(b":", b" "))
    except BadLineError:
        torn = (
            SOME_BYTES.search(text)
            or _DIGITS.fullmatch(text)
            or (is_directed and _TORN.match(text))
        )
        if torn or share_of_hex(text) > MOSTLY:
            raise
        return b""
