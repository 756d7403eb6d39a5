r"""Logs that people and programs of their own write: bytes behind a time, a direction, or both.

    22:55:06.001 -> FF FF FF 01 02 F1 0B           the monitor of the Arduino IDE
    [2026-11-20 22:55:06,001] TX: ff-ff-ff-01-02-f1-0b
    1795215306.001216 RX FFFFFF010200FC
    Sent: 0xFF 0xA0 0x00 0x20   Received: 0x00 0xA4
    >> #5QD
    << *5QD1443
    [DEBUG] [1732694400.123456]: TX: FF A0 00 20   behind the head of a logging framework

No tool defines them, so nobody knows of which byte a time is: it is taken for the moment at which
all of them had been read, or at which they were handed over to be sent. LSS text stands as it is.
"""

from __future__ import annotations

import re
from typing import TYPE_CHECKING, Final, NamedTuple

from sniffer.ground.coarse import coarse
from sniffer.ground.limits import is_time
from sniffer.ground.model import NS, Chunk, Clock, Direction
from sniffer.ground.patterns import later
from sniffer.sources.logheads import log_head
from sniffer.sources.plain import BadLineError, hex_line, share_of_hex
from sniffer.sources.sides import handed_over, oriented
from sniffer.sources.spelling import Spelling
from sniffer.sources.text import (
    DamagedLine,
    LineBlock,
    Opened,
    TextLog,
    left_out,
    quoted,
    read_log,
    remarks,
)
from sniffer.sources.walltime import DATELESS, ZONELESS, DayClock, WallClock, zone_ns

if TYPE_CHECKING:
    from collections.abc import Iterator, Sequence

SENT: Final = ("tx", "send", "sent", "sending", "write", "written", "out", "output", "w")
HEARD: Final = ("rx", "recv", "received", "receive", "receiving", "read", "in", "input", "r")
"""What logs call the two directions, of whoever writes them; arrows point away from him."""

_WORDS: Final = "|".join(sorted((*SENT, *HEARD), key=len, reverse=True)).encode()
_STAMP: Final = (
    rb"[ \t]{0,8}[\[(]?[ \t]{0,8}(?:(?:(?P<day>\d{4}[-/]\d\d[-/]\d\d)[ T])?"
    rb"(?P<time>\d\d:\d\d:\d\d)(?:[.,](?P<part>\d{1,9}))?(?P<zone>Z|[+-]\d\d:?\d\d)?"
    rb"|(?P<seconds>\d{1,10})\.(?P<fraction>\d{3,9})s?)(?P<closed>[\])])?"
    rb"(?P<arrow>[ \t]{0,8}->)?[ \t]{0,8}(?:[:|-]|,(?=[ \t]))?[ \t]{0,8}(?![\d:,])"
)
_STAMPED: Final = later(_STAMP)
_BODY: Final = rb"(?=[ \t]{0,8}(?:[0-9A-Fa-f]{2}|0x|\\x|[#*\[{(]|(?:bytearray\()?b['\"]|$))"
_OF: Final = (
    rb"(?:[ \t]{1,8}(?:\d{1,4}[ \t]{1,8})?(?:bytes?|data|packet|frame|message)(?=[ \t]{0,8}[:=])"
    rb"|[ \t]{0,8}(?:\[\d{1,4}\]|\(\d{1,4}(?: bytes?)?\))(?=[ \t]{0,8}[:=]))?"
)
"""What else a direction is told with: ``Sent 7 bytes:``, ``TX packet:``, ``RX [7]:``."""

_PEER: Final = rb"(?:[ \t]{0,8}\[[A-Za-z][\w -]{0,30}\](?=:))?"  # ->[Dynamixel]:FF FF 00
_WAY: Final = later(
    rb"(?:^|(?<=[ \t\])|]))[\[(<]?(?:(?P<word>"
    + _WORDS
    + rb")(?:\b|(?==))[\])>]?"
    + _OF
    + rb"[ \t]{0,8}[:=]?[ \t]{0,8}"
    rb"(?:-{1,3}>|<-{1,3})?|(?P<arrow>-{1,3}>|<-{1,3}|>{1,3}|<{1,3})"
    + _PEER
    + rb":?)"
    + _BODY
    + rb"[ \t]{0,8}:?",
    re.IGNORECASE,
)
_PLACE: Final = later(rb"^(?:0x[0-9A-Fa-f]{8}[ \t]{2,}|(?:0x)?0[0-9A-Fa-f]{3}:[ \t]+)")
"""An offset or an address in front of bytes, as dumps have it."""

_FIRST: Final = later(  # bytes that begin a message
    rb"(?:" + _PLACE.pattern + rb")?(?:(?:(?:0x)?[0-9A-Fa-f]{1,2}[ ,:-]{1,2}){2}"
    rb"|(?:[0-9A-Fa-f]{2}){4,}[ \t\r]*$|(?:bytearray\()?b['\"])|[#*]\d"
)
_ASIDE: Final = later(rb"[ \t][|(\"'].*$|(?:\\r|<CR>)$", re.IGNORECASE)
LSS_LINE: Final = later(rb"#\d{1,3}[A-Za-z]+[-\w.*]*|\*\d{0,3}[A-Za-z]+[-\w.]*")
"""A line of an LSS: ``#5QD`` asks, ``*5QD1443`` answers; only ``*QID5`` names no servo."""

_LITERAL: Final = later(rb"""(?:bytearray\()?(b(?:'.*'|".*"))\)?""")
_BYTES: Final = later(rb"[0-9A-Fa-f]{2}[ ,:-]{1,2}(?:0x)?[0-9A-Fa-f]{2}\b")
_DIGITS: Final = later(rb"(?:[0-9A-Fa-f]{1,2}[ ,]+)+[0-9A-Fa-f]{1,2}")
_DECIMAL: Final = later(rb"[ ,\[]\d{3}(?![^ ,\]])|[\[{(] *\d+,")
_MOSTLY: Final = 0.6
_NANO: Final = 9


class _Labelled(NamedTuple):
    """What a line says: ``parts`` are directions, each with the text of its bytes."""

    stamp: re.Match[bytes] | None
    parts: Sequence[tuple[Direction, bytes]]


def is_log(lines: Sequence[bytes]) -> bool:
    """Tell whether these lines are such a log, in which no line has bytes and nothing in front.

    Mistakes in hex are the reader's to report; numbers of three digits are decimal.
    """
    others = [line for line in lines if not states(line)]
    odd = any(_BYTES.search(line) or share_of_hex(line) > _MOSTLY for line in others)
    return len(others) < len(lines) and not odd


def states(line: bytes) -> bool:
    """Tell whether a line states bytes behind a time or a direction, well or badly."""
    said = _said(line)
    try:
        return said is not None and any(_data(*part, Spelling()) for part in said.parts)
    except BadLineError:
        return not _DECIMAL.search(line)


def _said(line: bytes) -> _Labelled | None:
    """Take a line apart; None where it has neither a time nor a direction in front."""
    if head := log_head(line, _begins):
        stamp, text = _STAMPED.match(head.time), line[head.size :]
    else:
        stamp = _STAMPED.match(line)
        text = line[stamp.end() :] if stamp else line
    ways = [*_WAY.finditer(text)]
    if ways and text[: ways[0].start()].strip(b" \t"):
        ways = []
    if not head and stamp and not ways and not _is_sure(stamp):
        stamp = None
    if not ways:
        return _Labelled(stamp, [(Direction.UNKNOWN, text)]) if stamp or head else None
    ends = [*(way.start() for way in ways[1:]), len(text)]
    parts = [(_way(w), text[w.end() : end]) for w, end in zip(ways, ends, strict=True)]
    return _Labelled(stamp, parts)


def _is_sure(stamp: re.Match[bytes]) -> bool:
    """Tell whether this is a time even where no direction follows: else it may be bytes."""
    return any(stamp[group] for group in ("part", "fraction", "arrow", "closed"))


def _begins(text: bytes, alone: bool) -> bool:
    """Tell whether a text begins with bytes: with a direction, or ``alone``."""
    return bool(_WAY.match(text) or (alone and _FIRST.match(text)))


def _way(way: re.Match[bytes]) -> Direction:
    told = (way["word"] or b"").lower().decode("ascii")
    is_sent = told in SENT if told else b">" in way["arrow"]
    return Direction.TX if is_sent else Direction.RX


def _data(way: Direction, text: bytes, spelling: Spelling) -> bytes:
    """Return the bytes that a text states, none where it is of words.

    Raises:
        BadLineError: it is hex, but for something.
    """
    plain = text.strip(b" \t\r;,")
    if literal := _LITERAL.fullmatch(plain):  # as Python shows them
        return hex_line(literal[1])
    plain = _PLACE.sub(b"", _ASIDE.sub(b"", plain).rstrip(b" \t"))
    if LSS_LINE.fullmatch(plain):
        return plain + b"\r"
    listed = spelling.read(plain, is_directed=way is not Direction.UNKNOWN)
    if listed is not None:
        return listed
    if plain[:1] in (b"[", b"{", b"(") and b"x" not in plain:
        raise BadLineError(0, "numbers in a list may be decimal: write 0x before those in hex")
    try:
        return hex_line(plain.replace(b"-", b" ").replace(b":", b" "))
    except BadLineError:
        if _BYTES.search(plain) or _DIGITS.fullmatch(plain) or share_of_hex(plain) > _MOSTLY:
            raise
        return b""


class _Lines(TextLog):
    """Where a log has got to."""

    def __init__(self, bus: str) -> None:
        self._bus = bus
        self._wall, self._day = WallClock(), DayClock()
        self.zoneless = self.dateless = self.timed = self.cut_off = False
        self._spelling = Spelling()
        self.talk = 0

    def chunks(self, block: LineBlock) -> Iterator[Chunk]:
        """Yield what the lines of ``block`` hold."""
        lines = block.lines()
        for number, line in enumerate(lines, block.number):
            is_last = block.cut_off and number == block.number + len(lines) - 1
            said = _said(line)
            told = self.cut_off = False
            stamp, parts = said or (None, ())
            for direction, text in parts:
                try:
                    data = _data(direction, text, self._spelling)
                except BadLineError as error:
                    if not is_last:
                        raise DamagedLine(number, f"{quoted(line)}: {error.why}") from None
                    self.cut_off = told = True
                    break
                if data:
                    told = True
                    yield self._chunk(stamp, direction, data, number)
            self.talk += bool(line.strip()) and not told

    def _chunk(
        self, stamp: re.Match[bytes] | None, direction: Direction, data: bytes, number: int
    ) -> Chunk:
        if stamp is None:
            return Chunk(data, bus=self._bus, direction=direction)
        self.timed = True
        places = len(stamp["part"] or stamp["fraction"] or b"")
        marks = coarse(len(data), places)
        return Chunk(data, self._time(stamp, number), Clock.FILE, self._bus, direction, marks)

    def _time(self, stamp: re.Match[bytes], number: int) -> int:
        if stamp["time"] is None:
            t_ns = int(stamp["seconds"]) * NS + int(stamp["fraction"].ljust(_NANO, b"0"))
        elif stamp["day"] is not None:
            zone = (stamp["zone"] or b"").decode("ascii")
            self.zoneless |= not zone
            t_ns = self._wall.ns(stamp["day"], stamp["time"], stamp["part"] or b"", number)
            t_ns -= zone_ns(zone)
        else:
            self.dateless = True
            hour, minute, second = stamp["time"].split(b":")
            t_ns = self._day.ns(hour, minute, second, stamp["part"] or b"", number)
        if not is_time(t_ns):
            raise DamagedLine(number, f"there is no time {quoted(stamp[0].strip())}")
        return t_ns

    def notes(self) -> Iterator[str]:
        """Yield what is worth knowing about the log, at its end."""
        if self.timed:
            whose = "nobody says of which byte its times are: taken for the last one of what was "
            told = whose + "read, and for when what was sent was handed over"
            clock = ZONELESS if self.zoneless else DATELESS if self.dateless else ""
            yield "; ".join(filter(None, (clock, told)))
        else:
            yield "it has no times: its bytes are laid out back to back"
        others = left_out(self.talk, "between", "its own")
        yield from remarks(others, cut_off=self.cut_off)


def read_labelled(opened: Opened) -> Iterator[Chunk]:
    """Yield a chunk for each direction of a line; the frames tell which one is the controller's."""
    lines = handed_over(read_log(opened, _Lines(opened.bus)), Direction.TX)
    return oriented(lines, opened.notes, ("TX", "RX"))
