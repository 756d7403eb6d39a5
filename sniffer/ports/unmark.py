"""Take the kernel's error marks out of what it read from a port (``PARMRK`` of termios(3)).

With ``PARMRK`` and ``INPCK`` the kernel puts ``FF 00`` in front of a byte that came with an error,
a break is ``FF 00 00``, and every real ``FF`` comes twice. Servo headers are made of ``FF``, so the
way without errors is the one that must be fast.
"""

from __future__ import annotations

import re
from collections import Counter
from typing import Final

from sniffer.ground.model import Mark, MarkKind

_FF: Final = b"\xff"
_PAIR: Final = b"\xff\xff"
_ERROR: Final = b"\xff\x00"
_UP_TO_ERROR: Final = re.compile(rb"(?:[^\xff]++|\xff[^\x00])*+\xff\x00", re.DOTALL)
"""Bytes without an error and the beginning of one. What follows an FF belongs to it, so that the
second half of a pair never begins anything."""


class Unmarker:
    """Un-escapes the reads of one port in order; an escape may be cut anywhere between two reads.

    Args:
        widen: whether a mark stands for the whole read it came with. USB adapters tell of an error
            in a packet, and the driver repeats it for each byte of the packet: bytes of one error
            in a row are counted once, the least that there can have been.
    """

    def __init__(self, *, widen: bool) -> None:
        self._widen = widen
        self._held = b""  # the beginning of an escape, until the next read

    def take(self, raw: bytes) -> tuple[bytes, tuple[Mark, ...]]:
        """Return the bytes of the line, and marks that count from the first of them.

        Neighbours with the same error are one mark. An ``FF`` that begins no escape is itself.
        """
        if self._held:
            raw = self._held + raw
            self._held = b""
        singles = raw.count(_FF)
        if not singles:
            return raw, ()
        # all FF stand in pairs: there is no error, and nothing is cut
        if singles == 2 * raw.count(_PAIR):
            return raw.replace(_PAIR, _FF), ()
        return self._with_errors(raw)

    def _with_errors(self, raw: bytes) -> tuple[bytes, tuple[Mark, ...]]:
        out = bytearray()
        errors: list[tuple[MarkKind, int]] = []
        begun = 0
        while (match := _UP_TO_ERROR.match(raw, begun)) is not None:
            out += raw[begun : match.end() - len(_ERROR)].replace(_PAIR, _FF)
            begun = match.end()
            if begun == len(raw):
                self._held = _ERROR
                break
            errors.append((MarkKind.FRAMING if raw[begun] else MarkKind.BREAK, len(out)))
            out.append(raw[begun])
            begun += 1
        rest = raw[begun:]
        if _ends_in_escape(rest):
            self._held = _FF
            rest = rest[:-1]
        out += rest.replace(_PAIR, _FF)
        return bytes(out), self._marks(errors, len(out))

    def _marks(self, errors: list[tuple[MarkKind, int]], length: int) -> tuple[Mark, ...]:
        marks: list[Mark] = []
        for kind, start in errors:
            last = marks[-1] if marks else None
            if last is not None and last.kind == kind and last.start + last.length == start:
                marks[-1] = Mark(kind, last.start, last.length + 1, last.count + 1)
            else:
                marks.append(Mark(kind, start, 1))
        if self._widen:
            runs = Counter(mark.kind for mark in marks)
            return tuple(Mark(kind, 0, length, count) for kind, count in runs.items())
        return tuple(marks)


def _ends_in_escape(rest: bytes) -> bool:
    """Tell whether the last byte is an ``FF`` whose second half has not come."""
    return (len(rest) - len(rest.rstrip(_FF))) % 2 == 1
