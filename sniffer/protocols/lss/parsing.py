"""LSS lines parsed all at once, eight characters at a time; what does not fit that is read alone.

A line's id, word and number are each read as one 64-bit word (little-endian: the first character is
the lowest byte). Longer words and numbers, texts and damage go to ``lines.read``.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import TYPE_CHECKING, Final

import numpy as np
import numpy.typing as npt

from sniffer.ground.columnar import Columns
from sniffer.protocols.lss.grammar import (
    COMMAND_MARK,
    END,
    IDS,
    REPLY_MARK,
    WORDS,
    packed,
    query_form,
)
from sniffer.protocols.lss.lines import Line, read
from sniffer.protocols.lss.tables import ENTRIES, IS_QUERY

if TYPE_CHECKING:
    from sniffer.ground.model import I64, U8, Mask

U64 = npt.NDArray[np.uint64]
WIDE: Final = 8  # characters that one 64-bit word holds


def _each(byte: int) -> np.uint64:
    """Return eight copies of a byte."""
    return np.uint64(byte * 0x0101010101010101)


_HIGH, _BIT5, _LETTER_BITS = _each(0x80), _each(0x20), _each(0x60)
_ZEROS, _NO_DIGIT, _NO_LETTER, _SOME = _each(0x30), _each(0x76), _each(0x65), _each(0x7F)
_PAIRS, _FOURS, _EIGHTS = (
    np.uint64(0x00FF00FF00FF00FF),
    np.uint64(0x0000FFFF0000FFFF),
    np.uint64(0xFFFFFFFF),
)
_U = [np.uint64(k) for k in range(65)]
_TEN, _HUNDRED, _MYRIAD = np.uint64(10), np.uint64(100), np.uint64(10_000)
_27, _27_2, _27_4 = np.uint64(27), np.uint64(27**2), np.uint64(27**4)
_Q27: Final = np.array([17 * 27**n for n in range(WIDE + 1)])

HASH, STAR, CR, MINUS, BIG_Q = (b[0] for b in (COMMAND_MARK, REPLY_MARK, END, b"-", b"Q"))
_IS_ID: Final = np.isin(np.arange(1000), list(IDS))
_CACHE_MOST: Final = 65536
_cache: dict[bytes, Line | None] = {}


class Text:
    """The block as unaligned 64-bit words, readable up to its last byte."""

    def __init__(self, data: U8) -> None:
        self.data = data
        room = np.concatenate([data, np.zeros(WIDE, np.uint8)])
        self.wide = np.ndarray((len(data) + 1,), "<u8", room, 0, (1,))

    def numbers(self, at: I64) -> tuple[I64, I64]:
        """Return the number that begins at each offset, and its digits: 8 may be cut short."""
        # One word a number, first character lowest. "132" and what stands behind it, by byte:
        #
        #     wide[at]       31 33 32 0D 00 00 00 00   in the order of the wire
        #     ^ _ZEROS       01 03 02 3D 30 30 30 30   digits are 0 to 9 now, nothing else is
        #     marks          00 00 00 80 80 80 80 80   + 76 sets the high bit of what is above 9
        #     digits         3                         bytes before the first mark
        #     << 40          00 00 00 00 00 01 03 02   what stood behind is gone
        #     _PAIRS         0     0     1     32      ten times one plus the next
        #     _FOURS         0           132           two of four
        #     _EIGHTS        132                       one of eight
        #
        # A sum may carry into the next byte, but only from one that is marked itself: behind the
        # first mark nothing counts. No digit at all is a shift by 64; numpy gives 0 for it (C would
        # not). A pair is at most 99 and fits its byte, so one mask behind the sum is enough. int()
        # a line would make one Python object a line; this makes a fixed number of array steps.
        t: U64 = self.wide[at] ^ _ZEROS
        digits = _leading(((t + _NO_DIGIT) | t) & _HIGH)
        t <<= _U[64] - (digits << _U[3])
        t = (t * _TEN + (t >> _U[8])) & _PAIRS
        t = (t * _HUNDRED + (t >> _U[16])) & _FOURS
        t = (t * _MYRIAD + (t >> _U[32])) & _EIGHTS
        return t.view(np.int64), digits.view(np.int64)

    def words(self, at: I64) -> tuple[I64, I64, Mask]:
        """Return the word at each offset, packed; its letters (8 may be cut short); any lower?"""
        # The same for letters, base 27. "QD" in front of "132\r":
        #
        #     x              51 44 31 33 32 0D 00 00
        #     t              11 04 51 53 52 4D 40 40   lower case, ^ 60: letters are 1 to 26
        #     marks          00 00 80 80 80 80 80 80   above 26, or 0
        #     << 48          00 00 00 00 00 00 11 04
        #     packed         17 * 27 + 4 = 463
        #
        # What comes first counts most, as in a number; no letter is 0, so words of different length
        # never get the same number. A pair may reach 728: unlike digits they are masked before they
        # are summed.
        x: U64 = self.wide[at]
        t = (x | _BIT5) ^ _LETTER_BITS
        letters = _leading(((t + _NO_LETTER) | t | ~(t + _SOME)) & _HIGH)
        shift = _U[64] - (letters << _U[3])
        t <<= shift
        t = (t & _PAIRS) * _27 + ((t >> _U[8]) & _PAIRS)
        t = (t & _FOURS) * _27_2 + ((t >> _U[16]) & _FOURS)
        t = (t & _EIGHTS) * _27_4 + (t >> _U[32])
        return t.view(np.int64), letters.view(np.int64), ((x << shift) & _BIT5) != 0

    def line(self, start: int, end: int) -> bytes:
        """Return the bytes of one line."""
        return self.data[start:end].tobytes()


def _leading(marks: U64) -> U64:
    """Return how many bytes stand before the first whose high bit is set."""
    # The lowest mark alone (m & -m), less one, has all bits below it: of 8080808080000000 it is
    # 7FFFFFFF, 31 bits, so 3 whole bytes. No mark gives 64 bits: all 8 bytes. That may be cut
    # short, which is why lines with an 8 are read alone.
    below: U64 = (marks & (~marks + _U[1])) - _U[1]
    return np.bitwise_count(below).astype(np.uint64) >> _U[3]


@dataclass(frozen=True, slots=True)
class Lines(Columns):
    """What a line says: ``word`` is packed as it was sent, ``at`` where its value or text begins.

    ``digits`` is 0 where there is no number; ``modifiers`` counts them, ``modifier`` is the first,
    packed. ``text``: 0 none, 1 one that the word may have, 2 another.
    """

    servo_id: I64
    word: I64
    lower: Mask
    at: I64
    value: I64
    digits: I64
    negative: Mask
    modifiers: I64
    modifier: I64
    text: I64
    asked: I64
    good: Mask


def cached(raw: bytes) -> Line | None:
    """Read a line of rare shape; lines repeat."""
    try:
        return _cache[raw]
    except KeyError:
        pass
    found = read(raw)
    line = found if isinstance(found, Line) else None
    if len(_cache) >= _CACHE_MOST:
        _cache.clear()
    _cache[raw] = line
    return line


def parse(text: Text, start: I64, end: I64) -> Lines:
    """Parse lines that begin with a mark and have their first carriage return at ``end - 1``."""
    # A query, its reply, an action, one with two modifiers, a text, and a line with a stray X:
    #
    #     line         #5QD  *5QD132  #5D-300  #5P1500S750T20  *5QMSLSS-HT1  #5D12X
    #     start        0     5        13       21              36            49
    #     last         4     12       20       35              48            55     carriage return
    #     letters      2     2        1        1               6             1
    #     word         QD    QD       D        P               QMSLSS        D       packed
    #     value        0     132      300      1500            0             12
    #     done         4     12       20       28              45            54     end of number
    #     asked        QD    QD       QD       QP              QMSLSS        QD      with Q in front
    #     rare         0     0        0        0               1             0      ``lines.read``
    #     good         1     1        1        0               0             0      done == last
    #     modifiers                            2                             0      walked below
    #     then good    1     1        1        1               1             0
    #
    # Every line is read as if it were of the common shape, id, word, number; columns tell which
    # were not. A reply's text has no length or mark: "LSS-HT1" runs into the word "QMS". ``rare``
    # is what eight bytes cannot hold or only the list of words can tell: those lines are read one
    # by one, and nothing of them stays as it was (``_fill``). Letting ``read`` do all lines would
    # say the same, one line after the other.
    data, last = text.data, end - 1
    servo_id, id_digits = text.numbers(start + 1)
    first = start + 1 + id_digits
    word, letters, lower = text.words(first)
    at = first + letters
    negative = data[at] == MINUS
    value, digits = text.numbers(at + negative)
    done = at + negative + digits
    is_reply = data[start] == STAR
    # what was asked: in a reply the Q may be missing
    has_q = data[first] & 0xDF == BIG_Q
    asked = word + np.where(has_q, 0, _Q27[letters])
    well = (id_digits >= 1) & (id_digits <= 3) & _IS_ID[np.where(id_digits <= 3, servo_id, 0)]
    bare_sign = negative & (digits == 0)
    well &= (letters > 0) & (is_reply | ~bare_sign)
    rare = well & ((letters == WIDE) | (digits == WIDE))
    text_like = bare_sign | (done != last) | ~IS_QUERY[ENTRIES.find(asked)]
    rare |= well & is_reply & text_like
    rare |= is_reply & (id_digits == 0) & (data[first] & 0xDF == BIG_Q)
    good = well & (done == last) & ~rare
    n = len(start)
    modifiers, modifier = np.zeros(n, np.int64), np.zeros(n, np.int64)
    # One round reads the next modifier of every line that has one, so there are as many rounds as
    # the line with the most has modifiers, however many lines there are:
    #
    #     row    here     name   places   then
    #     3 5    28 54    S X    3 0      X has no number: line 5 stays no line
    #     3      32       T      2        ends at 35, which is ``last``: good
    row = np.flatnonzero(well & ~rare & ~is_reply & (digits > 0) & (done != last))
    here = done[row]
    while len(row):
        name, size, _ = text.words(here)
        _, places = text.numbers(here + size)
        hard = (size == WIDE) | (places == WIDE)
        rare[row[hard]] = True
        ok = (size > 0) & (places > 0) & ~hard
        fresh = ok & (modifiers[row] == 0)
        modifier[row[fresh]] = name[fresh]
        modifiers[row[ok]] += 1
        here = here + size + places
        complete = ok & (here == last[row])
        good[row[complete]] = True
        going = ok & ~complete
        row, here = row[going], here[going]
    lines = Lines(
        servo_id, word, lower, at, value, digits, negative, modifiers, modifier,
        np.zeros(n, np.int64), asked, good,
    )  # fmt: skip
    for i in np.flatnonzero(rare).tolist():
        _fill(lines, i, int(start[i]), cached(text.line(int(start[i]), int(end[i]))))
    return lines


def _fill(lines: Lines, i: int, start: int, line: Line | None) -> None:
    """Take over a line that was read alone."""
    lines.good[i] = line is not None
    if line is None:
        return
    name = line.word.upper()
    lines.servo_id[i] = line.servo_id
    lines.word[i] = packed(name)
    lines.asked[i] = packed(query_form(name))
    lines.lower[i] = name != line.word
    lines.at[i] = start + line.at
    lines.value[i] = line.value or 0
    lines.digits[i] = line.value is not None
    lines.negative[i] = line.signed
    lines.modifiers[i] = len(line.modifiers)
    lines.modifier[i] = packed(line.modifiers[0][0]) if line.modifiers else 0
    if line.text is not None:
        texts = WORDS[name].texts
        lines.text[i] = 1 if "*" in texts or line.text in texts else 2
