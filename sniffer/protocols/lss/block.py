"""LSS in columns: the common line is parsed eight characters at a time, the rare one alone.

A line's id, word and number are each read as one 64-bit word (little-endian, so the first character
is the lowest byte); words and numbers that do not fit it, texts and damage go to ``lines.read``.
"""

from __future__ import annotations

import re
from dataclasses import dataclass
from typing import Final

import numpy as np
import numpy.typing as npt

from sniffer.framing import Block
from sniffer.model import (
    ANY_ID,
    I64,
    IF_ALL,
    MALFORMED,
    MANY,
    MUST,
    NEVER,
    NO_ALT,
    REQUEST,
    RESPONSE,
    U8,
    UNKNOWN,
    UNUSUAL,
    Columns,
    Frames,
    Mask,
    Spans,
)
from sniffer.protocols.base import State, Values
from sniffer.protocols.lss.grammar import (
    BROADCAST,
    BUTTON_MODE,
    COMMAND_MARK,
    END,
    IDS,
    LONGEST,
    NUMBER_DIGITS,
    REPLY_MARK,
    SELECTOR_MOST,
    WORDS,
    packed,
    query_form,
)
from sniffer.protocols.lss.lines import Line, read
from sniffer.protocols.lss.tables import (
    CANONICAL,
    EMPTY_OK,
    ENTRIES,
    FITS,
    IS_QUERY,
    IS_UNCLEAR,
    LISTED,
    MODIFIER_ENTRIES,
    MODIFIER_REGISTER,
    NUMBER_OK,
    REGISTER,
    SELECTORS,
    STATED,
)

U64 = npt.NDArray[np.uint64]
_WIDE: Final = 8  # characters that one 64-bit word holds


def _each(byte: int) -> np.uint64:
    """Return eight copies of a byte."""
    return np.uint64(byte * 0x0101010101010101)


_HIGH, _BIT5, _LETTER_BITS = _each(0x80), _each(0x20), _each(0x60)
_ZEROS, _NO_DIGIT, _NO_LETTER, _SOME = _each(0x30), _each(0x76), _each(0x65), _each(0x7F)
_PAIRS, _FOURS, _EIGHTS = np.uint64(0x00FF00FF00FF00FF), np.uint64(0x0000FFFF0000FFFF), np.uint64(0xFFFFFFFF)
_U = [np.uint64(k) for k in range(65)]
_TEN, _HUNDRED, _MYRIAD = np.uint64(10), np.uint64(100), np.uint64(10_000)
_27, _27_2, _27_4 = np.uint64(27), np.uint64(27**2), np.uint64(27**4)
_Q27: Final = np.array([17 * 27**n for n in range(_WIDE + 1)])

_HASH, _STAR, _CR, _MINUS, _ZERO, _NINE = (b[0] for b in (COMMAND_MARK, REPLY_MARK, END, b"-", b"0", b"9"))
_IS_EDGE: Final = np.isin(np.arange(256), [_HASH, _STAR, _CR])
_IS_ID: Final = np.isin(np.arange(1000), list(IDS))
_NUMBER: Final = re.compile(rb"-?[0-9]{1,%d}" % NUMBER_DIGITS)
_MODIFIER: Final = re.compile(rb"([A-Za-z]+)([0-9]+)")
_CACHE_MOST: Final = 65536
_cache: dict[bytes, Line | None] = {}


class Text:
    """The block as unaligned 64-bit words, readable up to its last byte."""

    def __init__(self, data: U8) -> None:
        self.data = data
        room = np.concatenate([data, np.zeros(_WIDE, np.uint8)])
        self.wide = np.ndarray((len(data) + 1,), "<u8", room, 0, (1,))

    def numbers(self, at: I64) -> tuple[I64, I64]:
        """Return the number that begins at each offset, and its digits: 8 may be cut short."""
        t: U64 = self.wide[at] ^ _ZEROS
        digits = _leading(((t + _NO_DIGIT) | t) & _HIGH)
        t <<= _U[64] - (digits << _U[3])
        t = (t * _TEN + (t >> _U[8])) & _PAIRS
        t = (t * _HUNDRED + (t >> _U[16])) & _FOURS
        t = (t * _MYRIAD + (t >> _U[32])) & _EIGHTS
        return t.view(np.int64), digits.view(np.int64)

    def words(self, at: I64) -> tuple[I64, I64, Mask]:
        """Return the word at each offset, packed, its letters (8 may be cut short), any in lower case."""
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
    data, last = text.data, end - 1
    servo_id, id_digits = text.numbers(start + 1)
    first = start + 1 + id_digits
    word, letters, lower = text.words(first)
    at = first + letters
    negative = data[at] == _MINUS
    value, digits = text.numbers(at + negative)
    done = at + negative + digits
    is_reply = data[start] == _STAR
    # what was asked: in a reply the Q may be missing
    has_q = data[first] & 0x1F == 17
    asked = word + np.where(has_q, 0, _Q27[letters])
    well = (id_digits >= 1) & (id_digits <= 3) & _IS_ID[np.where(id_digits <= 3, servo_id, 0)]
    well &= (letters > 0) & ~(negative & (digits == 0))
    rare = well & ((letters == _WIDE) | (digits == _WIDE))
    rare |= well & is_reply & ((done != last) | ~IS_QUERY[ENTRIES.find(asked)])
    rare |= is_reply & (id_digits == 0) & (data[first] & 0x1F == 17)
    good = well & (done == last) & ~rare
    n = len(start)
    modifiers, modifier = np.zeros(n, np.int64), np.zeros(n, np.int64)
    row = np.flatnonzero(well & ~rare & ~is_reply & (digits > 0) & (done != last))
    here = done[row]
    while len(row):
        name, size, _ = text.words(here)
        _, places = text.numbers(here + size)
        hard = (size == _WIDE) | (places == _WIDE)
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


def frame(block: Block) -> tuple[Spans, int]:
    """Frame from a mark to the next carriage return; a mark between them begins anew."""
    data = block.data
    edges = np.flatnonzero(_IS_EDGE[data])
    kind = data[edges]
    line = (kind[:-1] != _CR) & (kind[1:] == _CR)
    start, end = edges[:-1][line], edges[1:][line] + 1
    fits = (end - start <= LONGEST) & (end <= block.limit(start))
    if not fits.all():
        start, end = start[fits], end[fits]
    decided = block.n
    if len(edges) and kind[-1] != _CR:
        begun = edges[-1:]
        waits = bool(np.all(block.open(block.limit(begun)))) and block.n - int(begun[0]) < LONGEST
        decided = int(begun[0]) if waits else block.n
    good = parse(Text(data), start, end).good
    if not good.all():
        start, end = start[good], end[good]
    return Spans(start, end, np.where(data[start] == _STAR, RESPONSE, REQUEST).astype(np.uint8)), decided


def describe(block: Block, spans: Spans) -> Frames:
    """Say what each line is, and what a command expects."""
    text, start, end = Text(block.data), spans.start, spans.end
    p = parse(text, start, end)
    n = len(start)
    is_reply = spans.kind == RESPONSE
    entry = ENTRIES.find(np.where(is_reply, p.asked, p.word))
    known = entry > 0
    query = IS_QUERY[entry]
    has_number = p.digits > 0
    well = has_number & ~p.negative & (p.modifiers == 0) & (p.value <= SELECTOR_MOST)
    asks = query & ~is_reply
    selector = np.where(asks & well, p.value, -1)
    broadcast = p.servo_id == BROADCAST
    reply = np.where(asks, np.where(broadcast, MANY, MUST), NEVER)
    reply[~is_reply & (~known | IS_UNCLEAR[entry])] = IF_ALL
    anyone = ~is_reply & (reply != NEVER) & (broadcast | (p.servo_id == BUTTON_MODE))
    op = np.where(known, CANONICAL[entry], np.where(is_reply, p.asked, p.word))
    flags = np.where(known, 0, UNKNOWN)
    flags[asks & has_number & ~well] |= MALFORMED
    listed = LISTED[entry, np.clip(selector, 0, SELECTORS)]
    flags[asks & well & ~listed] |= UNUSUAL
    flags[is_reply & known & ((p.text == 2) | (~has_number & (p.text == 0) & ~EMPTY_OK[entry]))] |= MALFORMED
    flags[is_reply & p.lower] |= UNUSUAL
    flags[~is_reply & known & ~query & _unusual(p, entry)] |= UNUSUAL
    data_start = p.at
    zero = np.zeros(n, np.int64)
    return Frames(
        start=start,
        length=end - start,
        kind=spans.kind,
        servo_id=p.servo_id.astype(np.int16),
        op=op,
        address=selector.astype(np.int16),
        data_start=data_start,
        data_length=np.where(asks, 0, end - 1 - data_start),
        status=np.full(n, -1, np.int16),
        reply=reply.astype(np.uint8),
        token=p.asked,
        alt_id=np.where(anyone, ANY_ID, NO_ALT).astype(np.int16),
        flags=flags.astype(np.uint8),
        t_start=zero,
        t_end=zero,
        uncertainty=zero,
        direction=np.zeros(n, np.uint8),
    )


def _unusual(p: Lines, entry: U8) -> Mask:
    """Tell which actions and configurations do not have the page's form: number, modifiers."""
    has_number = p.digits > 0
    odd = np.where(has_number, ~NUMBER_OK[entry], ~EMPTY_OK[entry])
    more = p.modifiers > 0
    if more.any():
        fits = FITS[MODIFIER_ENTRIES.find(p.modifier), entry]
        odd |= more & ((p.modifiers > 1) | ~fits)
    return odd


def values(block: Block, frames: Frames, rows: I64, state: State) -> Values:
    """Read the numbers: a reply's register is told by the query's word and selector."""
    del state  # nothing that was said before changes what a number means
    text = Text(block.data)
    at, end = frames.data_start[rows], frames.end[rows] - 1
    asked = frames.kind[rows] == RESPONSE
    entry = ENTRIES.find(frames.op[rows])
    selector = frames.address[rows].astype(np.int64)
    column = np.where(selector < SELECTORS, np.maximum(selector, 0), SELECTORS)
    register = np.where(asked, STATED[entry, column], REGISTER[entry])
    negative = block.data[at] == _MINUS
    raw, digits = text.numbers(at + negative)
    behind = at + negative + digits
    raw = np.where(negative, -raw, raw)
    for i in np.flatnonzero(digits == _WIDE).tolist():
        number = _NUMBER.match(text.line(int(at[i]), int(end[i])))
        assert number is not None
        raw[i], behind[i] = int(number[0]), at[i] + number.end()
    stated = (register >= 0) & (digits > 0) & (~asked | (behind == end))
    row, registers, raws = [rows[stated]], [register[stated]], [raw[stated]]
    more = np.flatnonzero(~asked & (entry > 0) & (digits > 0) & (behind < end))
    here = behind[more]
    while len(more):
        name, size, _ = text.words(here)
        raw, digits = text.numbers(here + size)
        for i in np.flatnonzero((size == _WIDE) | (digits == _WIDE)).tolist():
            pair = _MODIFIER.match(text.line(int(here[i]), int(end[more[i]])))
            assert pair is not None
            name[i], size[i], raw[i], digits[i] = packed(pair[1].decode("ascii")), pair.end(1), int(pair[2]), len(pair[2])
        register = MODIFIER_REGISTER[MODIFIER_ENTRIES.find(name)]
        stated = register >= 0
        row.append(rows[more[stated]])
        registers.append(register[stated])
        raws.append(raw[stated])
        here = here + size + digits
        going = here < end[more]
        more, here = more[going], here[going]
    where = np.concatenate(row)
    order = np.argsort(where, kind="stable") if len(row) > 1 else slice(None)
    where = where[order]
    return Values(
        where,
        frames.servo_id[where],
        np.concatenate(registers)[order].astype(np.int16),
        np.concatenate(raws)[order],
        np.zeros(len(where), np.uint8),
    )
