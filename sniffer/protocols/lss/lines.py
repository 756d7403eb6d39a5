"""LSS lines read one by one, in plain Python: for lines of rare shape, for people, and for damage.

The grammar says what a line is; this says where a line stops being one.
"""

from __future__ import annotations

import re
from dataclasses import dataclass
from typing import Any, Final, NamedTuple

from sniffer.ground.model import Gap
from sniffer.ground.patterns import later
from sniffer.protocols.lss.grammar import (
    COMMAND_MARK,
    END,
    ID_DIGITS,
    IDS,
    LONGEST,
    NUMBER_DIGITS,
    REPLY_MARK,
    SERVO_IDS,
    TEXT_WORDS,
    WORD_LETTERS,
    WORDS,
    query_form,
)

_DIGITS: Final = later(rb"[0-9]*")
_LETTERS: Final = later(rb"[A-Za-z]*")
_NUMBER: Final = later(rb"-?[0-9]*")
_TEXT: Final = later(rb"[ !\"$-)+-~]+")
_TEXT_WORD: Final = later("|".join(TEXT_WORDS).encode(), re.IGNORECASE)
BLANK: Final = b" \t\n"
_BLANK: Final = later(b"[" + BLANK + b"]+")
_NOISE: Final = later(rb"[^#* \t\n]+")
_EDGE: Final = later(rb"[#*\r]")
# Runs of lines that say nothing are one piece each: a line of hostile bytes makes no object a byte.
_EMPTY: Final = later(rb"(?:[#*]+\r)+")
_CUT: Final = later(rb"(?:[#*][^#*\r]{0,%d})+(?=[#*])" % (LONGEST - 1))
_MARKS: Final = later(rb"[#*]+(?=[#*]|\Z)")
_ID_EXPECTED: Final = f"an id of 1 to {ID_DIGITS} digits"


@dataclass(frozen=True, slots=True)
class Line:
    """A line that holds: ``word`` as it was sent, ``at`` where its value or text begins."""

    is_reply: bool
    servo_id: int
    word: str
    at: int
    value: int | None = None
    signed: bool = False
    modifiers: tuple[tuple[str, int], ...] = ()
    text: str | None = None


class Misfit(NamedTuple):
    """Where a line stops making sense: ``column`` counts from 1, the mark's."""

    column: int
    expected: str
    servo_id: int = -1
    word: str = ""


def read(raw: bytes) -> Line | Misfit:
    """Read one line, from its mark to its carriage return."""
    if len(raw) > LONGEST:
        return Misfit(LONGEST, "a carriage return by then")
    # What is tried, in this order, for it decides what a line means:
    #
    #     *QID5         the one reply without an id: it tells the id, 5
    #     *5QN12        a query's word with a number: 12
    #     *5QNX12       not of that form, and QN may have a text: "X12"
    #     *5XYZ-1       of that form, with a word that no manual has: -1
    #     #5D12X        neither: a number should stand in column 7, behind X
    #
    # A text may hold letters and digits, so "12" in the second could be a text too; numbers go
    # first. Only where a line has no such form, or no known word, is a text looked for.
    is_reply = raw[:1] == REPLY_MARK
    digits = _DIGITS.match(raw, 1)
    assert digits is not None
    at = digits.end()
    if at == 1 and is_reply and raw[at : at + 3].upper() == b"QID":
        return _id_reply(raw)
    if not 1 <= at - 1 <= ID_DIGITS:
        return Misfit(2, _ID_EXPECTED)
    servo_id = int(digits[0])
    if servo_id not in IDS:
        return Misfit(2, "an id of 0..250, 254 or 255")
    plain = _numbers(raw, at, servo_id, is_reply=is_reply)
    if not is_reply:
        return plain
    if isinstance(plain, Line):
        word = WORDS.get(query_form(plain.word.upper()))
        if word is not None and word.is_query:
            return plain
    prefix = _TEXT_WORD.match(raw, at)
    if prefix is not None:
        text = _TEXT.fullmatch(raw, prefix.end(), len(raw) - 1)
        if text is not None:
            sent = prefix[0].decode("ascii")
            return Line(True, servo_id, sent, prefix.end(), text=text[0].decode("ascii"))
    return plain


def _id_reply(raw: bytes) -> Line | Misfit:
    digits = _DIGITS.match(raw, 4)
    assert digits is not None
    known = 1 <= len(digits[0]) <= ID_DIGITS and int(digits[0]) in SERVO_IDS
    if not known or raw[digits.end() :] != END:
        return Misfit(5, "an id of 0..250 and the end of the line")
    servo_id = int(digits[0])
    return Line(True, servo_id, raw[1:4].decode("ascii"), 4, servo_id)


def _numbers(raw: bytes, at: int, servo_id: int, *, is_reply: bool) -> Line | Misfit:
    """Read a word with its number and, in a command, the modifiers with theirs."""
    pairs: list[tuple[str, int]] = []
    first, signed, value = at, False, None
    while True:
        letters = _LETTERS.match(raw, at)
        assert letters is not None
        word = letters[0].decode("ascii")
        known = pairs[0][0] if pairs else word
        if not 1 <= len(word) <= WORD_LETTERS:
            return Misfit(at + 1, f"a word of 1 to {WORD_LETTERS} letters", servo_id, known)
        at = letters.end()
        number = (_DIGITS if pairs else _NUMBER).match(raw, at)
        assert number is not None
        text = number[0]
        if not pairs:
            first, signed = at, text[:1] == b"-"
        digits = len(text) - (signed and not pairs)
        bare = not digits and not pairs and not signed
        if digits > NUMBER_DIGITS or not (digits or bare):
            return Misfit(at + 1, f"a number of 1 to {NUMBER_DIGITS} digits", servo_id, known)
        if not pairs:
            value = int(text) if digits else None
        pairs.append((word, int(text) if digits else 0))
        at = number.end()
        if raw[at : at + 1] == END:
            word = pairs[0][0]
            return Line(is_reply, servo_id, word, first, value, signed, tuple(pairs[1:]))
        if bare or is_reply or not raw[at : at + 1].isalpha():
            wanted = (
                "a number or the end"
                if bare
                else "the end"
                if is_reply
                else "a modifier or the end"
            )
            return Misfit(at + 1, f"{wanted} of the line", servo_id, known)


def explain(run: bytes, start: int) -> list[Gap]:
    """Say why no frame claims these bytes, in pieces that join to the whole of them.

    Blanks (line feeds, spaces, tabs) between lines are noise marked ``blank``. Lines that another
    mark cuts are truncated. One that reaches its carriage return is damaged: ``column`` (from 1)
    tells where, ``expected`` what should have stood there.
    """
    # A run of 26 bytes (a dot is a carriage return) and its pieces:
    #
    #     0   \n \n      noise, blank
    #     3   xx         noise
    #     5   #5D18#6Q*  truncated: three lines, each cut by the next mark
    #     14  *.         damaged: an id should stand in column 2
    #     16  #          noise: a mark with nothing behind it
    #     17  #7D12?3.   damaged: "a modifier or the end of the line" in column 6
    #     25  #          noise
    #
    # At each place the first pattern that matches takes all it can, so pieces never overlap and
    # join to the whole. Lines cut by marks in a row are one piece, and so are empty ones: a piece a
    # line would let 1 KiB of marks make a thousand objects. What is left ends by itself and gets a
    # reason of its own.
    out: list[Gap] = []
    at, n = 0, len(run)
    while at < n:
        if (found := _BLANK.match(run, at)) is not None:
            end = found.end()
            out.append(Gap(start + at, end - at, "noise", {"blank": True}))
        elif (found := _NOISE.match(run, at)) is not None:
            end = found.end()
            out.append(Gap(start + at, end - at, "noise"))
        elif (found := _MARKS.match(run, at)) is not None:
            end = found.end()  # a mark with nothing behind it tells a line no better than noise
            out.append(Gap(start + at, end - at, "noise"))
        elif (found := _EMPTY.match(run, at)) is not None:
            end = found.end()
            detail = {"column": 2, "expected": _ID_EXPECTED}
            out.append(Gap(start + at, end - at, "damaged", detail))
        elif (found := _CUT.match(run, at)) is not None:
            end = found.end()
            second = _EDGE.search(run, at + 1)
            first = run[at : end if second is None else min(end, second.start())]
            detail = {"have": end - at, **_as_read(first)}
            lines = sum(found[0].count(mark) for mark in (COMMAND_MARK, REPLY_MARK))
            if lines > 1:
                detail["lines"] = lines
            out.append(Gap(start + at, end - at, "truncated", detail))
        else:
            edge = _EDGE.search(run, at + 1)
            end = n if edge is None else edge.end() if edge[0] == END else edge.start()
            out.append(_alone(run[at:end], start + at))
        at = end
    return out


def _alone(raw: bytes, start: int) -> Gap:
    """Explain one line that ends by itself, or is too long, or is the last."""
    if raw[-1:] != END and len(raw) <= LONGEST:
        return Gap(start, len(raw), "truncated", {"have": len(raw), **_as_read(raw)})
    found = read(raw)
    detail: dict[str, Any] = {}
    if isinstance(found, Misfit):
        detail = {"column": found.column, "expected": found.expected}
    return Gap(start, len(raw), "damaged", detail | _fields(found))


def _as_read(cut: bytes) -> dict[str, Any]:
    """Return what can be read of a line that was cut."""
    found = read(cut + END)
    wrong = isinstance(found, Misfit) and found.column <= len(cut)
    told = {"column": found.column, "expected": found.expected} if wrong else {}  # type: ignore[union-attr]
    return told | _fields(found)


def _fields(found: Line | Misfit) -> dict[str, Any]:
    fields: dict[str, Any] = {}
    if found.servo_id >= 0:
        fields["servo_id"] = found.servo_id
    if found.word:
        fields["word"] = found.word
    return {"fields": fields} if fields else {}
