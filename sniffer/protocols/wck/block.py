"""wCK in columns; every layout number comes from ``OPS``.

A reply has no header and no checksum. Whether a command has one is decided by the two bytes behind
it; if so, the command ends two bytes later for the greedy walk. Time decides nothing here: framing
is a function of the bytes and of silences.
"""

from __future__ import annotations

from typing import TYPE_CHECKING, Any, Final

import numpy as np

from sniffer.ground.checksums import XOR7
from sniffer.ground.codes import MUST, NEVER, OPTIONAL, REQUEST, RESPONSE
from sniffer.ground.distinct import numbers, within
from sniffer.ground.framing import Block, in_order, settle
from sniffer.ground.model import (
    ANY_ID,
    DEPTH,
    ECHO_DIFFERS,
    I64,
    NO_ALT,
    U8,
    UNKNOWN,
    UNUSUAL,
    Frames,
    Mask,
    Spans,
)
from sniffer.protocols.wck import controller
from sniffer.protocols.wck.grammar import (
    HEADER,
    INDEX,
    MASKS,
    MOTION_MOST,
    OPS,
    REGISTERS,
    REPLY,
    UNKNOWN_BASE,
    UNKNOWN_OP,
    Op,
    byte_values,
)

if TYPE_CHECKING:
    from collections.abc import Callable

DATA1, DATA2, PARAMS = 1, 2, 3
"""Offsets in a command."""

TO_CONTROLLER: Final = INDEX["rbc_direct_control_end"]
SYNC, BREAK, MOTION = INDEX["sync_position_move"], INDEX["break"], INDEX["motion_data_write"]
MOVE_10BIT, READ_10BIT = INDEX["position_move_10bit"], INDEX["position_read_10bit"]
ID_BITS: Final = 31
"""Bits of Data1 that are the id, and of a synchronized move's Data2 that count its targets."""

NONE: Final = 255
"""In KIND: no command begins so."""


def _table(of: Callable[[Op], Any], dtype: Any) -> Any:
    """Return a property of the commands as an array by row of OPS, zero for no command."""
    out = np.zeros(256, dtype)
    out[: len(OPS)] = [of(op) for op in OPS]
    return out


def _kinds() -> U8:
    out = np.full((256, 256), NONE, np.uint8)
    for i, op in reversed([*enumerate(OPS)]):  # the unknown command gives way to all others
        out[np.ix_(byte_values(op.data2), byte_values(op.data1))] = i
    return out.ravel()


def _byte_at(op: Op, name: str) -> int:
    """Return the offset of a named byte in a command, 0 for none."""
    if name == "data2":
        return DATA2
    return PARAMS + op.params.index(name) if name in op.params and name != "again" else 0


def _again_at(op: Op) -> int:
    return PARAMS + op.params.index("again") if "again" in op.params else 0


def _data(op: Op) -> tuple[int, int]:
    """Return where the parameters begin, behind an id, and how many there are at least."""
    if any(b.name in REGISTERS for b in op.data2):
        return DATA2, 1
    kept = list(op.params)
    while kept and kept[0] in ("id", "again", "arbitrary3", "arbitrary4"):
        del kept[0]
    return PARAMS + len(op.params) - len(kept), len(kept)


KIND: Final = _kinds()
"""Row of OPS by Data2 << 8 | Data1: two bytes in wire order, read as a little-endian number."""

LENGTH: Final = _table(lambda op: op.length, np.int64)
LENGTH[NONE] = min(op.length for op in OPS)
LONGEST: Final = max(OPS[SYNC].length + ID_BITS, controller.LONGEST)
SLOW: Final = _table(lambda op: op.slow, bool)

_ASKS: Final = _table(lambda op: bool(op.reply), bool)
_FF0, _FF1 = _table(lambda op: op.reply_ff[0], bool), _table(lambda op: op.reply_ff[1], bool)
_MOST: Final = _table(lambda op: op.reply_most, np.uint8)
_ECHO0: Final = _table(lambda op: _byte_at(op, op.reply[0]) if op.reply else 0, np.int64)
_ECHO1: Final = _table(lambda op: _byte_at(op, op.reply[1]) if op.reply else 0, np.int64)
_TWICE: Final = _table(lambda op: op.reply[1:] == ("again",), bool)
_MASK: Final = _table(lambda op: MASKS.get(op.reply[0], 0xFF) if op.reply else 0, np.uint8)
_CHECKED: Final = (_ECHO0 > 0) | (_ECHO1 > 0) | _TWICE | (_MOST < HEADER)
_AGAIN: Final = _table(_again_at, np.int64)
_DATA_AT: Final = _table(lambda op: _data(op)[0], np.int64)
_MORE_DATA: Final = _table(lambda op: _data(op)[1], np.int64) - LENGTH
"""What a command has more of data than of bytes: less than none."""
_NEVER_OR_MUST: Final = np.array([NEVER, MUST], np.uint8)


def _commands(data: U8, n: int, start: I64) -> U8:
    """Return the kind of the command that each two bytes behind a header are, of ``n`` pairs."""
    pairs = np.ndarray((n,), "<u2", data, DATA1, (1,))
    return np.asarray(KIND[pairs[start].astype(np.intp)])


def frame(block: Block) -> tuple[Spans, int]:
    """Frame commands by table, and their replies by what follows them."""
    # A read and its reply (07 63), a move of two, two reads with one reply, a bad checksum, and a
    # read with one byte behind it, at an open end of 31 bytes:
    #
    #     start     0     6     12    16    22    26      each FF whose next two bytes are a command
    #     kind      read  sync  read  read  read  read    one look-up of both bytes
    #     end       4     12    16    20    26    30      sync: 4 + 2 targets
    #     good      1     1     1     1     0     1
    #     has       1     0     0     1     -     ?       are the two bytes behind it a reply?
    #     settled   0..6  6..12 12..16 16..22     waits
    #
    # A reply is two bytes of any value, so it is no candidate by itself: it would be one
    # everywhere. It is part of its command, which ends two bytes later for the greedy walk, and
    # what begins in it is dropped as if it began in a command. ``_spans`` parts the two again. That
    # the last command may yet have a reply makes all from 26 on undecided.
    n = block.n
    data = np.zeros(n + 4, np.uint8)
    data[:n] = block.data
    start = np.flatnonzero(block.data == HEADER)
    kind = _commands(data, n + 2, start)
    live = kind != NONE
    live |= start + PARAMS > n
    start, kind = start[live], kind[live]
    limit = np.broadcast_to(block.limit(start), start.shape)
    length = LENGTH[kind.astype(np.intp)]
    sync = np.flatnonzero(kind == SYNC)
    length[sync] += data[start[sync] + DATA2] & ID_BITS
    motion = np.flatnonzero(kind == MOTION)
    count = data[start[motion] + PARAMS].astype(np.int64)
    length[motion] += 2 * count
    end = start + length
    fits = np.ones(len(start), bool)
    fits[motion] = count <= MOTION_MOST
    whole = fits & (end <= limit)
    waiting = start[fits & (end > limit) & block.open(limit)]
    start, end, kind = start[whole], end[whole], kind[whole]
    good = XOR7.good(block.data, start + np.where(kind == SYNC, PARAMS, DATA1), end - 1)
    other = np.flatnonzero(~good & (kind == READ_10BIT))
    good[other] = _text_sum(data, start[other]) == data[end[other] - 1]
    start, end, kind = start[good], end[good], kind[good]
    begun, done, torn = controller.find(block)
    heads = np.concatenate([start, begun]) if len(begun) else start
    waiting = numbers(np.concatenate([waiting, torn])) if len(torn) else waiting
    has, unsure = _replies(block, data, start, end, kind, heads, waiting)
    if unsure.any():
        waiting = numbers(np.concatenate([waiting, start[unsure]]))
        sure = ~unsure
        start, end, has = start[sure], end[sure], has[sure]
    if len(begun):
        order = np.argsort(start := np.concatenate([start, begun]), kind="stable")
        start, end = start[order], np.concatenate([end, done])[order]
        has = np.concatenate([has, np.zeros(len(begun), bool)])[order]
    rows, decided = settle(start, end + REPLY * has, waiting, n)
    start, end, replies = start[rows], end[rows], has[rows].astype(np.int64)
    # Nearly always each command that has an answer has it: only where two stand together it lacks.
    if len(start) and (not replies[-1] or (end[:-1] == start[1:]).any()):
        kind = _commands(data, n + 2, start)
        decided = _in_turn(block, start, end, _ASKS[kind], replies, decided)
    told = int(np.searchsorted(start, decided))
    return _spans(start[:told], end[:told], replies[:told]), decided


def _in_turn(block: Block, start: I64, end: I64, asks: Mask, replies: I64, decided: int) -> int:
    """Add the replies behind the first one, where commands stood in a row without any between.

    One pair of bytes a command at most, none with an FF, of the last ``DEPTH`` of the row. Returns
    how far every byte has its fate: a row to which bytes that come may belong has none yet.
    """
    # Three reads in a row and two replies behind them (12 to 15), then a read with its own:
    #
    #     start      0  4  8  16
    #     end        4  8  12 20
    #     linked     0  1  1  0     asks right behind one that asks and has no reply
    #     replies    0  0  1  1     as the greedy walk left it: one pair, for the last command
    #     then       0  0  2  1     at most as many as the row has commands; the next byte is an FF
    #
    # All of them are counted to the row's last command, behind which they stand; whose each is,
    # pairing tells. They cannot be part of the greedy walk: how many there are depends on which
    # commands it kept.
    n = len(start)
    limit = np.broadcast_to(block.limit(start), start.shape)
    linked = np.zeros(n, bool)
    linked[1:] = asks[1:] & asks[:-1] & (replies[:-1] == 0) & (start[1:] == end[:-1])
    linked[1:] &= limit[1:] == limit[:-1]
    waits = n > 0 and bool(asks[-1]) and not replies[-1] and end[-1] == decided
    if waits and block.open(limit[-1]):
        decided = _row_begins(start, linked, n - 1)
    if not linked.any():
        return decided
    data = block.data
    for row in np.flatnonzero(linked & (replies > 0)).tolist():
        first = row
        while linked[first] and row - first < DEPTH - 1:
            first -= 1
        at, stop, most = int(end[row]) + REPLY, int(limit[row]), row - first + 1
        while replies[row] < most and at + REPLY <= stop:
            if HEADER in (data[at], data[at + 1]):
                break
            replies[row] += 1
            at += REPLY
        waits = replies[row] < most and at + REPLY > stop and stop == block.n and not block.final
        if waits and HEADER not in data[at:stop]:
            decided = min(decided, int(start[first]))
            break
        decided = max(decided, at) if row == n - 1 and decided < at else decided
    return decided


def _row_begins(start: I64, linked: Mask, row: int) -> int:
    """Return where that begins which bytes behind a row of commands may still answer."""
    first = row
    while linked[first] and row - first < DEPTH - 1:
        first -= 1
    return int(start[first])


def _text_sum(data: U8, start: I64) -> U8:
    """Return the checksum of a 10-bit read as its section has it: without byte 4, the id."""
    folded = data[start + DATA1] ^ data[start + DATA2] ^ data[start + PARAMS + 1]
    return np.asarray(XOR7.seal(folded))


def _replies(
    block: Block, data: U8, start: I64, end: I64, kind: U8, heads: I64, waiting: I64
) -> tuple[Mask, Mask]:
    """Tell which commands (good ones) have a reply, and for which more bytes must be seen.

    ``heads`` are where good commands and packets begin. An FF is no reply byte unless the command's
    reply may hold one there; and not even then if one of those begins with it. Of that only a reply
    that repeats its command is excepted.
    """
    # FF where a reply may hold one (its wheel count, a port's bits), and where it begins a command:
    #
    #     start   0      6         14      18     24
    #     kind    wheel  io_write  wheel   read   read
    #     behind  FF 05  FF FF     FF A1   08 09  FF 05
    #     may     1      1         1              -       by the command's reply: a read's has no FF
    #     echo    0      1         0                      io_write FF FF is answered by the same
    #     taken   0      0         1                      a good command begins there, at 18
    #     plain   1      1         0       1      0     has a reply
    limit = block.limit(start)
    room = limit - end
    of = kind.astype(np.intp)
    asks, ff0, ff1 = _ASKS[of], data[end] == HEADER, data[end + 1] == HEADER
    unsure = asks & (room < REPLY) & block.open(limit)
    unsure &= (room < 1) | ~ff0 | _FF0[of]
    has = asks & (room >= REPLY)
    rare = np.flatnonzero(has & (ff0 & _FF0[of] | ff1 & _FF1[of]))
    plain = has & ~ff0 & ~ff1
    if len(rare):
        begin, k = end[rare], kind[rare]
        first, second = ff0[rare], ff1[rare]
        echo = (_ECHO0[k] > 0) & _TWICE[k] & (data[begin] == data[start[rare] + _ECHO0[k]])
        echo &= data[begin + 1] == data[begin]
        may = (~first | _FF0[k]) & (~second | _FF1[k])
        taken = first & within(begin, heads) & ~echo | second & within(begin + 1, heads)
        waits = first & within(begin, waiting) & ~echo | second & within(begin + 1, waiting)
        plain[rare] = may & ~taken
        unsure[rare] = may & ~taken & waits
    return plain, unsure


def _spans(start: I64, end: I64, replies: I64) -> Spans:
    """Lay commands and replies out in wire order."""
    if len(start) and replies.max() <= 1:
        return _spans_of_pairs(start, end, replies)
    # A command's row is its number plus the replies before it: 0 0 2 1 replies put four at 0 1 2 5.
    at = np.arange(len(start)) + np.cumsum(replies) - replies
    total = len(start) + int(replies.sum())
    first, last = np.empty(total, np.int64), np.empty(total, np.int64)
    kind = np.full(total, RESPONSE, np.uint8)
    first[at], last[at], kind[at] = start, end, REQUEST
    behind = np.flatnonzero(kind == RESPONSE)
    command = np.repeat(np.arange(len(start)), replies)
    first[behind] = end[command] + REPLY * (behind - at[command] - 1)
    last[behind] = first[behind] + REPLY
    return Spans(first, last, kind)


def _spans_of_pairs(start: I64, end: I64, has: I64) -> Spans:
    """Do the same where no command has more than one reply."""
    answered = np.flatnonzero(has)
    at = np.arange(len(start)) + np.cumsum(has) - has
    total = len(start) + len(answered)
    first, last = np.empty(total, np.int64), np.empty(total, np.int64)
    kind = np.full(total, REQUEST, np.uint8)
    first[at], last[at] = start, end
    reply = at[answered] + 1
    first[reply], last[reply] = end[answered], end[answered] + REPLY
    kind[reply] = RESPONSE
    return Spans(first, last, kind)


def describe(block: Block, spans: Spans) -> Frames:
    """Tell who is meant, what is expected, and whether a reply repeats what it should.

    For example, servo 0 is read and answers, then all are moved at once::

        bytes       FF A0 00 20 | 07 63 | FF 1F 02 10 20 30
        start       0  4  6
        command     0  0  6            the reply is looked up where its command begins
        kind        2  2  1            READ, READ, SYNC
        servo_id    0  0  -1           a move of all names none
        reply       4  0  0            MUST, NEVER, NEVER
        token       2  2  0            bytes of the answer

    What holds: a reply says nothing of itself, so a column is one look-up by its command's kind.
    To describe commands first and copy that to their replies would touch each column twice.
    """
    data, start, n = block.data, spans.start, len(spans)
    request = spans.kind == REQUEST
    answer = np.flatnonzero(~request)
    command = start.copy()
    command[answer] = start[in_order(~request)[answer]]
    kind = _commands(data, block.n - DATA2, command) if n else np.empty(0, np.uint8)
    servo_id = (data[command + DATA1] & ID_BITS).astype(np.int16)
    ten = np.flatnonzero((kind == MOVE_10BIT) | (kind == READ_10BIT))
    servo_id[ten] = data[command[ten] + PARAMS]
    rbc = request & (kind == NONE)
    servo_id[(kind == SYNC) | (kind == TO_CONTROLLER) | rbc] = -1
    breaks = np.flatnonzero(kind == BREAK)
    servo_id[breaks] = np.where(request[breaks], -1, data[start[breaks]].astype(np.int64))
    of = kind.astype(np.intp)
    op = of.copy()
    strange = np.flatnonzero(kind == UNKNOWN_OP)
    op[strange] = UNKNOWN_BASE + data[command[strange] + DATA2].astype(np.int64)
    op[rbc] = controller.BASE + data[start[rbc] + controller.TYPE_AT].astype(np.int64)
    length = spans.end - start
    may_ask = _ASKS[of]
    reply = _NEVER_OR_MUST[(may_ask & request).view(np.uint8).astype(np.intp)]
    way, token = spans.kind, may_ask * np.int64(REPLY)
    data_start = start + request * _DATA_AT[of]
    data_length = np.where(request, length + _MORE_DATA[of], REPLY)
    if rbc.any():
        answered = controller.answers(block, start, spans.end, rbc, op)
        way = np.where(answered, RESPONSE, way)
        reply[rbc] = np.where(answered[rbc], NEVER, OPTIONAL)
        token[rbc] = op[rbc]
        data_start[rbc] = start[rbc] + controller.PLAN.tail_at
        data_length[rbc] = length[rbc] - controller.OVERHEAD
    alt = np.full(n, NO_ALT, np.int16)
    alt[breaks] = ANY_ID
    return Frames.stating(
        start=start,
        length=length,
        kind=way,
        servo_id=servo_id,
        op=op,
        data_start=data_start,
        data_length=data_length,
        reply=reply,
        token=token,
        alt_id=alt,
        flags=_flags(data, spans, command, of, request, answer),
    )


def _flags(data: U8, spans: Spans, command: I64, kind: I64, request: Mask, answer: I64) -> U8:
    flags: U8 = (request & (kind == UNKNOWN_OP)) * np.uint8(UNKNOWN)
    again = np.flatnonzero(request & (_AGAIN[kind] > 0))
    at = spans.start[again] + _AGAIN[kind[again]]
    flags[again[data[at] != data[at - 1]]] |= UNUSUAL
    ten = np.flatnonzero(request & (kind == READ_10BIT))
    first, last = spans.start[ten] + DATA1, spans.end[ten] - 1
    flags[ten[~XOR7.good(data, first, last)]] |= UNUSUAL
    checked = answer[_CHECKED[kind[answer]]]
    at, asked, k = spans.start[checked], command[checked], kind[checked]
    byte0, byte1 = data[at], data[at + 1]
    differs = (_ECHO0[k] > 0) & ((byte0 ^ data[asked + _ECHO0[k]]) & _MASK[k] > 0)
    differs |= (_ECHO1[k] > 0) & (byte1 != data[asked + _ECHO1[k]])
    differs |= _TWICE[k] & (byte1 != byte0)
    differs |= byte0 > _MOST[k]
    flags[checked[differs]] |= ECHO_DIFFERS
    return flags
