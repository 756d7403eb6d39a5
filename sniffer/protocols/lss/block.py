"""LSS in columns: what the lines of a block are, expect and state."""

from __future__ import annotations

import functools
from typing import TYPE_CHECKING, Final

import numpy as np

from sniffer.ground.clues import told_by_word
from sniffer.ground.codes import IF_ALL, MANY, MUST, NEVER, REQUEST, RESPONSE
from sniffer.ground.distinct import numbers
from sniffer.ground.model import (
    ANY_ID,
    I64,
    MALFORMED,
    NO_ALT,
    U8,
    UNKNOWN,
    UNUSUAL,
    Frames,
    Mask,
    Spans,
)
from sniffer.ground.patterns import later
from sniffer.protocols.base import Sightings, State, Values
from sniffer.protocols.lss.grammar import (
    BROADCAST,
    BUTTON_MODE,
    LONGEST,
    MODELS,
    NUMBER_DIGITS,
    SELECTOR_MOST,
    WORD_LETTERS,
    WORDS,
    packed,
    unpacked,
)
from sniffer.protocols.lss.parsing import CR, HASH, MINUS, STAR, WIDE, Lines, Text, parse
from sniffer.protocols.lss.tables import (
    CANONICAL,
    EMPTY_OK,
    ENTRIES,
    FITS,
    IDENTIFIES,
    IS_QUERY,
    LISTED,
    MODIFIER_ENTRIES,
    MODIFIER_REGISTER,
    NUMBER_OK,
    PLAIN,
    REGISTER,
    SELECTORS,
    STATED,
    TELLS,
)

if TYPE_CHECKING:
    from sniffer.ground.clues import Clue
    from sniffer.ground.framing import Block

_NUMBER: Final = later(rb"-?[0-9]{1,%d}" % NUMBER_DIGITS)
_MODIFIER: Final = later(rb"([A-Za-z]+)([0-9]+)")
_LONG: Final = 27 ** (WORD_LETTERS - 1)  # the least packed word that has all letters
_Q: Final = packed("Q")
_TEXT, _LINES = "text", "lines"  # what a block's notes hold


def _text(block: Block) -> Text:
    text: Text | None = block.notes.get(_TEXT)
    if text is None:
        text = block.notes[_TEXT] = Text(block.data)
    return text


def frame(block: Block) -> tuple[Spans, int]:
    """Frame from a mark to the next carriage return; a mark between them begins anew."""
    data = block.data
    # Marks and carriage returns alone, in order, tell all lines. In #5QD. *5QD132. #5D-300. #5D18
    # #6QV. xx*6QV7 (a dot is a carriage return, the end is open):
    #
    #     edges    0  4  5  12 13 20 21 26 30 33
    #     byte     #  .  *  .  #  .  #  #  .  *
    #     line     0     2     4        7            marks whose next edge is a carriage return
    #     start    0     5     13       26
    #     end         5     13    21       31
    #
    # "#5D18" (21) is cut by the next mark, "xx" is no line's. No mark stands inside a line, so
    # lines never overlap and need no greedy walk. From the last edge on, 33, a line may still be
    # whole, and nothing before it may: that is ``decided``. A regular expression finds the same
    # lines, one Python object each.
    edges = np.flatnonzero((data == HASH) | (data == STAR) | (data == CR))
    kind = data[edges]
    line = np.flatnonzero((kind[:-1] != CR) & (kind[1:] == CR))
    start, end = edges[line], edges[line + 1] + 1
    fits = (end - start <= LONGEST) & (end <= block.limit(start))
    if not fits.all():
        start, end = start[fits], end[fits]
    decided = block.n
    if len(edges) and kind[-1] != CR:
        begun = edges[-1:]
        waits = bool(np.all(block.open(block.limit(begun)))) and block.n - int(begun[0]) < LONGEST
        decided = int(begun[0]) if waits else block.n
    lines = parse(_text(block), start, end)
    if not lines.good.all():
        good = np.flatnonzero(lines.good)
        start, end, lines = start[good], end[good], lines.take(good)
    block.notes[_LINES] = start, lines
    return Spans(
        start, end, np.where(data[start] == STAR, RESPONSE, REQUEST).astype(np.uint8)
    ), decided


def describe(block: Block, spans: Spans) -> Frames:
    """Say what each line is, and what a command expects."""
    start, end = spans.start, spans.end
    framed, p = block.notes.get(_LINES, (None, None))
    if p is None or framed is not start:
        p = parse(_text(block), start, end)
    # The word's row in the tables (0: none has it) says all, so a line costs a look-up and no
    # branch:
    #
    #     line      #5QD  *5QD132  #5QSD1  *5QSD-300  #5P1500S750T20  #5QZ     #5X7     #254QV
    #     entry     76    76       79      79         8               0        0        92
    #     selector  -1    -1       1       -1         -1              -1       -1       -1
    #     reply     MUST  NEVER    MUST    NEVER      NEVER           IF_ALL   NEVER    MANY
    #     op        QD    QD       QSD     QSD        P               QZ       X        QV
    #     token     QD    QD       QSD     QSD        QP              QZ       QX       QV
    #     flags     0     0        0       0          UNUSUAL         UNKNOWN  UNKNOWN  0
    #
    # A reply may leave the Q out, so request and reply are compared by ``asked``, which has it.
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
    odd = np.flatnonzero(~is_reply & ~known)
    if len(odd):
        # of words no manual has, those that ask begin with Q, too: they may be answered
        name = p.word[odd]
        begins_with_q = (p.asked[odd] == name) & ((name < _LONG) | (name // _LONG == _Q))
        reply[odd[begins_with_q]] = IF_ALL
    anyone = ~is_reply & (reply != NEVER) & (broadcast | (p.servo_id == BUTTON_MODE))
    op = np.where(known, CANONICAL[entry], np.where(is_reply, p.asked, p.word))
    flags = np.where(known, 0, UNKNOWN)
    flags[asks & has_number & ~well] |= MALFORMED
    listed = LISTED[entry, np.clip(selector, 0, SELECTORS)]
    flags[asks & well & ~listed] |= UNUSUAL
    flags[
        is_reply & known & ((p.text == 2) | (~has_number & (p.text == 0) & ~EMPTY_OK[entry]))
    ] |= MALFORMED
    flags[is_reply & p.lower] |= UNUSUAL
    flags[~is_reply & known & ~query & _unusual(p, entry)] |= UNUSUAL
    return Frames.stating(
        start=start,
        length=end - start,
        kind=spans.kind,
        servo_id=p.servo_id,
        op=op,
        address=selector,
        data_start=p.at,
        data_length=np.where(asks, 0, end - 1 - p.at),
        reply=reply,
        token=p.asked,
        alt_id=np.where(anyone, ANY_ID, NO_ALT),
        flags=flags,
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


def states_itself(frames: Frames) -> Mask:
    """Tell which replies have a word that means the same whatever selector the query had."""
    replies: Mask = frames.kind == RESPONSE
    replies &= PLAIN[ENTRIES.find(frames.op)]
    return replies


def values(block: Block, frames: Frames, rows: I64, state: State) -> Values:
    """Read the numbers: a reply's register is told by model, and the query's word and selector."""
    # Three of the lines above state something; the reply's selector is its query's, by pairing:
    #
    #     row        1        3          4
    #     line       *5QD132  *5QSD-300  #5P1500S750T20
    #     at         9        25         33              the number, with its sign
    #     column     0        1          0               of STATED: none, or the selector
    #     register   position max_speed  goal            STATED for replies, REGISTER for the others
    #     raw        132      -300       1500
    #     behind     12       29         37              a reply must end here, an action need not
    #     more                           2               in ``rows``; S750 and T20, a round each
    #
    # Rounds append to the end: row 1 3 4, then 4, then 4. Values are sorted by row, and in a row as
    # they stand in the line, so the sort behind the rounds must be stable.
    model = state.models_of(rows, frames.servo_id[rows])
    text = _text(block)
    at, end = frames.data_start[rows], frames.end[rows] - 1
    asked = frames.kind[rows] == RESPONSE
    entry = ENTRIES.find(frames.op[rows])
    selector = frames.address[rows].astype(np.int64)
    column = np.where(selector < SELECTORS, np.maximum(selector, 0), SELECTORS)
    register = np.where(asked, STATED[model, entry, column], REGISTER[model, entry])
    negative = block.data[at] == MINUS
    raw, digits = text.numbers(at + negative)
    behind = at + negative + digits
    raw = np.where(negative, -raw, raw)
    for i in np.flatnonzero(digits == WIDE).tolist():
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
        for i in np.flatnonzero((size == WIDE) | (digits == WIDE)).tolist():
            pair = _MODIFIER.match(text.line(int(here[i]), int(end[more[i]])))
            assert pair is not None
            name[i], size[i], raw[i], digits[i] = (
                packed(pair[1].decode("ascii")),
                pair.end(1),
                int(pair[2]),
                len(pair[2]),
            )
        register = MODIFIER_REGISTER[model[more], MODIFIER_ENTRIES.find(name)]
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
        sightings=_sightings(text, frames, rows[asked & TELLS[entry]]),
    )


_KNOWN_TEXTS: Final = 1024


@functools.lru_cache(_KNOWN_TEXTS)
def _clues(op: int, said: bytes) -> tuple[Clue, ...]:
    return tuple(told_by_word(MODELS, WORDS[unpacked(op)].asks, said))


def _sightings(text: Text, frames: Frames, rows: I64) -> Sightings | None:
    """Look for clues to the models in answers ``rows``, whose words may tell something."""
    rows = rows[frames.data_length[rows] > 0]
    if not len(rows):
        return None
    op, at, length = frames.op[rows], frames.data_start[rows], frames.data_length[rows]
    found: dict[Clue, int] = {}
    row: list[I64] = []
    clue: list[int] = []

    def take(mine: I64, said: bytes) -> None:
        for told in _clues(int(op[mine[0]]), said):
            row.append(mine)
            clue.append(found.setdefault(told, len(found)))

    # Answers that repeat are worked out once: by their text where it names the model (*5QMSLSS-HT1
    # gives 16 points to the LSS, none to the Pro), by their word where being answered is what
    # tells.
    names_itself = IDENTIFIES[ENTRIES.find(op)]
    for i in np.flatnonzero(names_itself).tolist():
        take(np.array([i]), text.line(int(at[i]), int(at[i] + length[i])))
    by_word = np.flatnonzero(~names_itself)
    for word in numbers(op[by_word]).tolist():
        take(by_word[op[by_word] == word], b"")  # that it is answered tells, not with what
    if not row:
        return None
    met, which = np.concatenate(row), np.repeat(clue, [len(mine) for mine in row])
    order = np.lexsort((which, met))
    met, which = met[order], which[order]
    where = rows[met]
    return Sightings(where, frames.servo_id[where], which, at[met], tuple(found))
