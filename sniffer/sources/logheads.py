r"""Heads that logging frameworks put in front of a message: a time, a level, whose it is.

    [INFO] [1732694400.123456]: TX: FF A0 00 20                          rospy
    [arm-1] [DEBUG] [1732694400.123456789] [servo_bus]: >> FF A0 00 20   ROS 2, launched
    DEBUG:servo.bus:-> ff-a0-00-20                                       Python
    2026-11-27 07:18:00,123 - servo.bus - DEBUG - write: b'\xff\xa0\x00 '
    I (1234) servo_bus: ff a0 00 20                                      ESP-IDF
    [21:57:15][D][uart_debug:114]: >>> FF:A0:00:20                       ESPHome
    [2026-11-20T22:55:06.000Z DEBUG servo::bus] tx ffa00020              Rust's env_logger
    2026/11/20 22:55:06.000000 servo.go:31: -> ff a0 00 20               Go, with the place

Every framework lets its user lay the head out, so it is taken apart word by word. It has a level or
a place in a source, else it may be anything; what follows its last word is bytes, or a direction
and bytes.
"""

from __future__ import annotations

import re
from typing import TYPE_CHECKING, Final, NamedTuple

from sniffer.ground.patterns import later
from sniffer.sources.logfronts import prefix_of

if TYPE_CHECKING:
    from collections.abc import Callable

_LEVELS: Final = rb"(?:TRACE|VERBOSE|DEBUG|INFO|NOTICE|WARN(?:ING)?|ERROR|CRITICAL|FATAL)(?![\w.])"
_SOURCE: Final = rb"[A-Za-z_][\w./-]{0,60}\.[A-Za-z]{1,4}:\d{1,6}(?=:)"
_SOME_LEVEL: Final = later(
    _LEVELS + rb"|[EWIDV] \([\d:.]+\)|\](?:\[VV\]|\[[EWICDV]\])\[|" + _SOURCE, re.IGNORECASE
)
_WORD: Final = later(
    rb"[\[(<]?[ \t]{0,4}(?P<level>" + _LEVELS + rb")[ \t]{0,4}[\])>]?"
    rb"|(?P<short>[EWIDV] \((?:(?P<ms>\d{1,10})|(?P<clock>\d\d:\d\d:\d\d\.\d{3}))\)"
    rb"|(?:\[VV\]|\[[EWICDV]\])(?=\[))"
    rb"|[\[(]?(?:WallTime: )?(?P<time>(?:\d{4}[-/]\d\d[-/]\d\d[ T])?\d\d:\d\d:\d\d"
    rb"(?:[.,]\d{1,9})?(?:Z|[+-]\d\d:?\d\d)?|\d{1,10}\.\d{3,9})(?:, ?\d+\.\d+)?[\])]?"
    rb"|(?P<source>" + _SOURCE + rb")"
    rb"|(?P<name>[\w.]{1,60}:[\w.<>]{1,60}:\d{1,6}(?= - )"
    rb"|[A-Za-z_][\w./]{0,60}(?=[ \t]{0,16}[-:|])|\[[^\[\]]{1,60}\]|\([^()]{1,60}\))"
    rb"(?::\d{1,6}(?=\W))?|(?P<bare>[A-Za-z_][\w./]{0,60})"
    rb"|(?P<closes>\])|[-:|]{1,2}|[ \t]{1,16}",
    re.IGNORECASE,
)
_MOST_WORDS: Final = 24
_REACH: Final = 160
"""Bytes of a line within which its level stands."""


class LogHead(NamedTuple):
    """The head of a line: its time as text, whose message it is, and where the message begins."""

    time: bytes
    name: bytes
    size: int


def log_head(line: bytes, begins: Callable[[bytes, bytes, bool], object]) -> LogHead | None:
    """Return the head of ``line``, None where it has none or no message that is one follows it.

    ``begins`` tells whether a text begins with what is looked for, and is told behind which name it
    stands, and whether that may be bytes without a direction: behind a bare word they may be of
    anything.
    """
    if (known := prefix_of(line)) and begins(line[known[2] :], known[1], True):
        return LogHead(*known)
    if not _SOME_LEVEL.search(line[:_REACH]):
        return None
    at, time, name, has_level, bare_words, is_bare = 0, b"", b"", False, 0, False
    has_source = False
    for _ in range(_MOST_WORDS):
        alone = not is_bare and bool(has_level or time)
        if (has_level or has_source) and begins(line[at:], name, alone):
            return LogHead(time, name, at)
        word = _WORD.match(line, at)
        if word is None or (word["time"] and time):
            return None
        if word["closes"] and line.count(b"[", 0, at) <= line.count(b"]", 0, at):
            return None
        has_source |= word["source"] is not None
        if word["level"] or word["short"]:
            has_level, bare_words = True, 0
        if not word[0].isspace():
            is_bare = word["bare"] is not None
            bare_words += is_bare
        if bare_words > 1:  # that is prose
            return None
        time = time or _time(word)
        name = word["bare"] or word["name"] or name
        at = word.end()
    return None


def _time(word: re.Match[bytes]) -> bytes:
    if word["ms"]:  # since it was switched on
        return b"%d.%03d" % divmod(int(word["ms"]), 1000)
    return word["time"] or word["clock"] or b""
