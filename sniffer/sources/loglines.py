r"""A line that people or programs of their own write, taken apart: one grammar of all of them.

    [mark] [head | time] {direction [time] [aside] bytes [note]}

    - TX: FF A0 00 20                        a mark of a list, a number, a quote: > 1. * #1
    [DEBUG] [1732694400.123456]: TX: FF ..   the head of a logging framework, see ``logheads``
    22:55:06.001 TX [4 bytes]: FF ..         a time, a direction, and what else is told of the bytes
    TX 22:55:06.001 FF ..                    the direction first
    host -> servo: FF ..                     whose they are
    TX: FF A0 00 20   RX: 00 A4              several on a line

Words in other languages and signs beside ASCII are put into these first.
"""

from __future__ import annotations

import functools
import re
from typing import TYPE_CHECKING, Final, NamedTuple

from sniffer.ground.model import Direction
from sniffer.ground.patterns import later
from sniffer.sources.logbytes import PLACE
from sniffer.sources.logfronts import in_numbers, unquoted
from sniffer.sources.logheads import log_head
from sniffer.sources.logstamps import STAMP, is_no_byte, is_sure

if TYPE_CHECKING:
    from collections.abc import Sequence, Set

SENT: Final = ("tx", "send", "sent", "sending", "write", "written", "out", "output", "w")
HEARD: Final = ("rx", "recv", "received", "receive", "receiving", "read", "in", "input", "r")
"""What logs call the two directions, of whoever writes them; arrows point away from him."""

ASKING: Final = (
    *("request", "req", "query", "command", "cmd", "master", "host", "controller", "client"),
    *("pc", "mcu"),
)
ANSWERING: Final = (
    *("response", "resp", "reply", "answer", "ans", "slave", "servo", "device", "motor", "got"),
)
"""Names of what is said, and of who says it; only with a colon, for they stand in prose, too."""


def _any(words: Sequence[str]) -> bytes:
    return b"(?:" + "|".join(sorted(words, key=len, reverse=True)).encode() + b")"


_WORDS: Final = _any((*SENT, *HEARD))
_NAMES: Final = _any((*ASKING, *ANSWERING))
_PAIR: Final = rb"[0-9A-Fa-f]{2}(?:h\b|(?![G-Zg-z]))"
_STARTS: Final = b"|".join(
    (
        _PAIR,
        rb"0x|\\x",
        rb"[$%][0-9A-Fa-f]{2}|<[0-9A-Fa-f]{2}>|\{[0-9A-Fa-f]{2}\}",
        rb"(?:bytearray\()?b['\"]|<Buffer\b",
        rb"[\"'`][ \t]{0,8}(?:" + _PAIR + rb"|\\x|[#*])",
    )
)
"""What bytes begin with, whatever stands in front of them."""

_BODY: Final = rb"(?=[ \t]{0,8}(?:" + _STARTS + rb"|[#*\[{(]|$))"
_COUNT: Final = rb"\d{1,4}(?:[ \t]?bytes?)?"
_THEN: Final = rb"(?=[ \t]{0,8}[:=]|[ \t]{1,8}(?:" + _STARTS + rb"|\[0x))"
_TOLD: Final = b"|".join(
    (
        rb"\[" + _COUNT + rb"\]" + _THEN + rb"|\(" + _COUNT + rb"\)" + _THEN,  # [7], (7 bytes)
        rb"[\[(](?=[^\])]{0,40}[g-wyz])[A-Za-z][\w .:=-]{0,40}[\])](?=[ \t]{0,8}[:=])",  # (id 1):
        rb"[A-Za-z]\w{0,15}=(?:0x[0-9A-Fa-f]{1,8}|\d{1,10})\b[,;]?(?=[ \t:])",  # len=7
        rb"(?<=[ \t])\d{1,4}[ \t]{1,8}bytes?\b(?=[ \t:=])",  # 7 bytes
        rb"(?<=[ \t])(?:packet|frame|message)[ \t]{1,8}\d{3,6}\b(?=[ \t:=])",  # frame 009
        rb"(?<=[ \t])(?:bytes?|data|packet|frame|message|hex)\b(?=[ \t:=])",
        rb"(?<=[ \t])\d{1,4}(?=:[ \t]+(?!.*:[ \t]))",  # 7:
    )
)
"""What else a direction is told with: numbers that stand so are of none of its bytes."""

_ASIDES: Final = rb"(?:[ \t]{0,8}(?:" + _TOLD + rb")){0,3}"
_SEP: Final = rb"[ \t]{0,8}(?:[:=|,;]|-{1,2}(?=[ \t]))?[ \t]{0,8}(?:-{1,3}>|<-{1,3})?"
_PEER: Final = rb"(?:[ \t]{0,8}\[[A-Za-z][\w -]{0,30}\](?=:))?"  # ->[Dynamixel]:FF FF 00
_TO: Final = rb"(?:[ \t]{0,4}(?:-{1,3}>|to\b)[ \t]{0,4}" + _NAMES + rb"\b)?"  # host -> servo
_WAY: Final = b"|".join(
    (
        rb"[\[(<]?(?P<word>" + _WORDS + rb")(?:\b|(?==))[\])>]?" + _ASIDES + _SEP,
        rb"(?P<name>" + _NAMES + rb")\b" + _TO + _ASIDES + rb"[ \t]{0,8}[:=]",
        rb"(?P<arrow>-{1,3}>|<-{1,3}|>{1,3}|<{1,3}(?![0-9A-Fa-f]{2}>))" + _PEER + rb":?",
    )
)
_COLON: Final = rb"[ \t]{0,8}:?"
_STRICT: Final = later(rb"(?:^|(?<=[ \t\])|]))(?:" + _WAY + rb")" + _BODY + _COLON, re.IGNORECASE)
"""A direction with bytes behind it."""

_LOOSE: Final = later(
    rb"(?:" + _WAY + rb")(?:(?<=[ \t:=|,;\])>])|(?=[ \t]|$))" + _COLON, re.IGNORECASE
)
"""A direction at the begin of a line with anything behind it, so that what is no byte is told."""

_LETTERS: Final = {word[0] for word in (*SENT, *HEARD, *ASKING, *ANSWERING)}
_BEGINNINGS: Final = frozenset(
    sign.encode() for letter in _LETTERS for sign in (letter, letter.upper(), *"[(<>-")
)
"""What a direction begins with: a letter of its word, a bracket around that, or an arrow."""

_OF_BYTES: Final = b"0123456789abcdefABCDEFxX ,:-\r"
_BACK: Final = later(STAMP.pattern + rb"<-.*")
_MARK: Final = later(
    rb"[ \t]{0,8}(?:(?:[-*+|]|\xe2\x80\xa2|>|&gt;|\d{1,6}[.)]|#\d{1,6}:?)[ \t]{1,8}){1,3}"
)
_BEGUN: Final = later(rb"(?:" + _STARTS + rb")", re.IGNORECASE)
_BEGIN: Final = later(  # bytes that begin a message
    rb"(?:" + PLACE.pattern + rb")?(?:(?:(?:0x)?[0-9A-Fa-f]{1,2}[ ,:-]{1,2}){2}"
    rb"|(?:[0-9A-Fa-f]{2}){4,}[ \t\r]*$|(?:bytearray\()?b['\"])|[#*]\d"
)

BLOCKS: Final = (8, 16, 32)
"""Bytes in a line of a dump that has more: ESP_LOG_BUFFER_HEX has 16."""

_REST: Final = later(rb"[0-9A-Fa-f]{2}(?: [0-9A-Fa-f]{2})*(?:[ \t\r]*|[ \t]{2,}\|.*)")
"""What a block of a dump ends with; behind it may stand the same as text."""

_SIGNS: Final = str.maketrans(
    {
        **dict.fromkeys("\u00a0\u2007\u202f\u3000", " "),
        **dict.fromkeys("\ufe0e\ufe0f\u200b", ""),
        **dict.fromkeys("→⟶⇒➔➜➞➡▶►", "->"),
        **dict.fromkeys("←⟵⇐⬅◀◄", "<-"),
        "\uff1a": ":",
    }
)
_SSCOM: Final = tuple(
    (sign.encode(encoding), told)
    for sign, told in (("发→◇", b" TX "), ("收←◆", b" RX "))
    for encoding in ("utf-8", "gbk")
)
"""What SSCOM writes before bytes, as it is saved by hand and as a Chinese Windows encodes it."""


class SaidLine(NamedTuple):
    """What a line says: ``parts`` are directions, each with the text of its bytes.

    ``dump`` is the name in its head behind which bytes stand without a direction, as in dumps.
    """

    stamp: re.Match[bytes] | None
    parts: Sequence[tuple[Direction, bytes]]
    dump: bytes = b""


class Dumps:
    """Names in heads behind which a whole block of bytes stood last: its rest may follow."""

    def __init__(self) -> None:
        self.names: set[bytes] = set()

    def take(self, name: bytes, size: int) -> None:
        """Take how many bytes stood behind a name, none where it has none."""
        if name and size in BLOCKS:
            self.names.add(name)
        else:
            self.names.discard(name)


def said(
    line: bytes, *, is_pointed: bool = False, dumps: Set[bytes] = frozenset()
) -> SaidLine | None:
    """Take a line apart; None where it has neither a time nor a direction in front.

    Args:
        line: the line.
        is_pointed: an arrow behind a time is a direction, see ``are_pointed``.
        dumps: see ``Dumps``: behind these names two digits are a byte, the rest of a block.
    """
    line = in_ascii(line)
    if head := log_head(line, functools.partial(_begins, dumps)):
        stamp, text = STAMP.match(head.time), line[head.size :]
    else:
        line = unquoted(in_numbers(_unmarked(line)))
        stamp = STAMP.match(line)
        text = line[stamp.end() :] if stamp else line
    text = text.lstrip(b" \t")
    first = _first(text)
    if first is None:
        is_one = head or (stamp and is_sure(stamp))
        way = Direction.TX if is_pointed and stamp and stamp["arrow"] else Direction.UNKNOWN
        dump = head.name if head else b""
        return SaidLine(stamp, [(way, text)], dump) if is_one else None
    begin = first.end()
    if stamp is None and (behind := STAMP.match(text, begin)) and _is_time(behind, text):
        stamp, begin = behind, behind.end()
    # bytes alone, as nearly always, have no further direction
    nexts = [*_STRICT.finditer(text, begin)] if text[begin:].translate(None, _OF_BYTES) else []
    begins = [begin, *(way.end() for way in nexts)]
    ends = [*(way.start() for way in nexts), len(text)]
    spans = zip(map(_way, (first, *nexts)), begins, ends, strict=True)
    return SaidLine(stamp, [(way, text[a:b]) for way, a, b in spans])


def are_pointed(lines: Sequence[bytes]) -> bool:
    """Tell whether arrows behind times are directions: some of them point the other way.

    The monitor of the Arduino IDE has one in each line, which tells of none.
    """
    return any(_BACK.fullmatch(in_ascii(line)) for line in lines)


def in_ascii(line: bytes) -> bytes:
    """Return a line with the signs of ASCII that others stand for: arrows, blanks, words."""
    if line.isascii():
        return line
    for sign, told in _SSCOM:
        line = line.replace(sign, told)
    try:
        return line.decode().translate(_SIGNS).encode()
    except UnicodeDecodeError:
        return line


def way_of(text: bytes) -> Direction:
    """Return the direction that a text is a name of, UNKNOWN where it is none."""
    way = _LOOSE.fullmatch(text.strip(b" \t") + b":")
    return Direction.UNKNOWN if way is None else _way(way)


def _first(text: bytes) -> re.Match[bytes] | None:
    if text[:1] not in _BEGINNINGS:
        return None
    return _STRICT.match(text) or _LOOSE.match(text)


def _unmarked(line: bytes) -> bytes:
    """Return a line without a mark in front of what is a time or a direction beyond doubt."""
    mark = _MARK.match(line)
    if mark is None:
        return line
    rest = line[mark.end() :]
    way = _first(rest)
    is_quoted = b">" in mark[0]  # which may be an arrow in front of a time
    is_marked = (way and not way["arrow"]) or (not is_quoted and STAMP.match(rest))
    return rest if is_marked else line


def _is_time(stamp: re.Match[bytes], text: bytes) -> bool:
    """Tell whether what stands between a direction and its bytes is a time, and no bytes."""
    if is_no_byte(stamp):
        return True
    is_apart = text[stamp.end("time") : stamp.end("time") + 1] in (b" ", b"\t", b"]", b")")
    return is_apart and b":" not in text[stamp.end() :] and bool(_BEGUN.match(text, stamp.end()))


def _begins(dumps: Set[bytes], text: bytes, name: bytes, alone: bool) -> bool:
    """Tell whether a text begins with bytes: with a direction, or ``alone``.

    Names are none behind the head of a framework: there they are of the one who writes.
    """
    if alone and name in dumps and _REST.fullmatch(text):
        return True
    way = _STRICT.match(text)
    return bool((way and not way["name"]) or (alone and _BEGIN.match(text)))


def _way(way: re.Match[bytes]) -> Direction:
    told = (way["word"] or way["name"] or b"").lower().decode("ascii")
    is_sent = told in (*SENT, *ASKING) if told else b">" in way["arrow"]
    return Direction.TX if is_sent else Direction.RX
