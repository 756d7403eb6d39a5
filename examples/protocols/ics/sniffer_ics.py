"""Kondo ICS 3.5 serial servos, written by hand: no header, no checksum, code and id in one byte.

    command   1 c c i i i i i | parameters          reply   0 c c i i i i i | what is answered

Only the first byte of a command has bit 7 set. A reply begins with that byte without the bit, and
is told by standing right behind its command. The packet family has no form for that: this file says
itself what a protocol must (docs/plugins.md, "By hand", goes through it). Source: users' libraries
for ICS 3.0 and 3.5 (sizes, codes, waiting times); the manual by Kondo is known by its names only.
"""

from __future__ import annotations

import io
import itertools
from pathlib import Path
from typing import TYPE_CHECKING, Any, Final

import numpy as np
from construct import Byte, Bytes, Check, ConstructError, Struct

from sniffer.ground.codes import MUST, NEVER, REQUEST, RESPONSE, WHOLE
from sniffer.ground.model import ANY_ID, NO_ALT, UNKNOWN, Frames, Gap, Spans
from sniffer.ground.registers import RegisterMap
from sniffer.protocols.base import FieldSpan, SlowFrame, Values
from sniffer.protocols.by_hand import ByHand

if TYPE_CHECKING:
    from sniffer.ground.framing import Block
    from sniffer.ground.model import I64, U8, Mask
    from sniffer.protocols.base import FrameView, State

FIRST: Final = 0x80
"""Bit 7: a command begins."""

POSITION, READ, WRITE, IDENTIFY = 4, 5, 6, 7  # the upper three bits
NAMES: Final = {POSITION: "position", READ: "read", WRITE: "write", IDENTIFY: "id"}
EEPROM: Final = 0
"""The subcommand that is about 64 bytes, and not about one."""

MODELS: Final = (RegisterMap.from_toml(Path(__file__).with_name("krs.toml")),)
REGISTER: Final = MODELS[0].index
VALUES: Final[dict[tuple[int, int], dict[int | None, str]]] = {
    (POSITION, REQUEST): {None: "goal_position"},
    (POSITION, RESPONSE): {None: "position"},
    (READ, RESPONSE): {1: "stretch", 2: "speed", 3: "current", 4: "temperature"},
    (WRITE, REQUEST): {1: "stretch", 2: "speed", 3: "current_limit", 4: "temperature_limit"},
}
"""What a command, or its reply, states: by subcommand, None where it has none."""

# -- the grammar: what the oracle parses, and `explain` shows ----

LOW: Final = Check(lambda fields: all(b < FIRST for b in fields.rest))
FORMS: Final = {  # (code, is about the EEPROM): the command, and its reply
    (POSITION, False): (Struct("command" / Byte, "rest" / Bytes(2), LOW), 3),
    (READ, False): (Struct("command" / Byte, "rest" / Bytes(1), LOW), 3),
    (READ, True): (Struct("command" / Byte, "rest" / Bytes(1), LOW), 66),
    (WRITE, False): (Struct("command" / Byte, "rest" / Bytes(2), LOW), 3),
    (WRITE, True): (Struct("command" / Byte, "rest" / Bytes(65), LOW), 2),
    (IDENTIFY, False): (Struct("command" / Byte, "rest" / Bytes(3), LOW), 1),
}


def _form(data: bytes, at: int, limit: int) -> tuple[Any, int] | None:
    """Return the grammar of the command that begins there, and the size of its reply."""
    code = data[at] >> 5
    if code < POSITION:
        return None
    about = code in (READ, WRITE) and at + 1 < limit and data[at + 1] == EEPROM
    return FORMS[code, about]


# -- framing in columns ----


def _table(of: Any) -> I64:
    """Return a number of each form, by code and by whether it is about the EEPROM."""
    out = np.zeros((8, 2), np.int64)
    for (code, about), form in FORMS.items():
        out[code, int(about)] = of(form)
    return out


SIZE: Final = _table(lambda form: form[0].sizeof())
REPLY: Final = _table(lambda form: form[1])


def frame(block: Block) -> tuple[Spans, int]:
    """Frame commands, each up to the next one, and their replies right behind them."""
    data, n = block.data, block.n
    start = np.flatnonzero(data >= FIRST)
    limit = np.minimum(np.append(start[1:], n), block.limit(start))
    size, reply = _sizes(data, start, limit)
    # The last command of an open block: what it is, and whether it is answered, may still come.
    waits = block.open(limit) & (start + size + reply > limit)
    decided = int(start[waits][0]) if waits.any() else n
    keep = ~waits & (start + size <= limit)
    start, limit, size, reply = start[keep], limit[keep], size[keep], reply[keep]
    end = start + size
    has = (end + reply <= limit) & _answers(data, start, np.minimum(end, n - 1), limit)
    # A command and its reply are two rows, in the order of the wire.
    at = np.arange(len(start)) + np.cumsum(has) - has
    begins, ends = np.empty((2, len(start) + int(has.sum())), np.int64)
    kind = np.full(len(begins), RESPONSE, np.uint8)
    begins[at], ends[at], kind[at] = start, end, REQUEST
    begins[at[has] + 1], ends[at[has] + 1] = end[has], end[has] + reply[has]
    return Spans(begins, ends, kind), decided


def _sizes(data: U8, start: I64, limit: I64) -> tuple[I64, I64]:
    """Return the sizes of commands and of their replies."""
    code = (data[start] >> 5).astype(np.intp)
    second = data[np.minimum(start + 1, len(data) - 1)]
    about = ((code == READ) | (code == WRITE)) & (start + 1 < limit) & (second == EEPROM)
    return SIZE[code, about.astype(np.intp)], REPLY[code, about.astype(np.intp)]


def _answers(data: U8, start: I64, end: I64, limit: I64) -> Mask:
    """Tell which commands are answered at ``end``: by the same byte, and subcommand, less bit 7."""
    code, own = data[start] >> 5, data[end] == data[start] & (FIRST - 1)
    own |= (code == IDENTIFY) & (data[end] >> 5 == IDENTIFY - 4)  # by whom is what it asks
    about = (code == READ) | (code == WRITE)
    last = len(data) - 1
    same = data[np.minimum(end + 1, last)] == data[np.minimum(start + 1, last)]
    return np.asarray(own & (~about | same) & (end < limit))


def describe(block: Block, spans: Spans) -> Frames:
    """Say whom each frame names, what it states, and that each command is answered."""
    data, start, kind = block.data, spans.start, spans.kind
    request = kind == REQUEST
    code = (data[start] >> 5 & 3).astype(np.int64) + POSITION
    sub = np.where((code == READ) | (code == WRITE), data[np.minimum(start + 1, block.n - 1)], 0)
    head = np.where(code == POSITION, 1, np.where(code == IDENTIFY, 1, 2))
    length = spans.end - start
    return Frames.stating(
        start=start,
        length=length,
        kind=kind,
        servo_id=data[start] & 31,
        op=code,
        data_start=start + np.minimum(head, length),
        data_length=np.maximum(length - head, 0),
        reply=np.where(request, np.uint8(MUST), np.uint8(NEVER)),
        token=code << 8 | sub,
        alt_id=np.where(request & (code == IDENTIFY), ANY_ID, NO_ALT),
        flags=np.where(request & (sub > 4), np.uint8(UNKNOWN), np.uint8(0)),
    )


def values(block: Block, frames: Frames, rows: I64, state: State) -> Values:
    """Read what frames state: a position of 14 bits, seven a byte, or one byte."""
    del state  # one table, whatever servo
    sub, code, kind = frames.token[rows] & 255, frames.op[rows], frames.kind[rows]
    register = np.full(len(rows), -1, np.int16)
    for (of, way), names in VALUES.items():
        for number, name in names.items():
            mine = (code == of) & (kind == way)
            register[mine & ((sub == number) | (number is None))] = REGISTER[name]
    found = np.flatnonzero((register >= 0) & (frames.data_length[rows] > 0))
    rows, at = rows[found], frames.data_start[rows[found]]
    raw = block.data[at].astype(np.int64)
    wide = np.flatnonzero(code[found] == POSITION)
    raw[wide] = raw[wide] << 7 | block.data[at[wide] + 1]
    part = np.full(len(found), WHOLE, np.uint8)
    return Values(rows, frames.servo_id[rows], register[found], raw, part)


# -- the oracle: the same one frame at a time, from the grammar ----


def slow_parse(data: bytes, at: int, limit: int) -> list[tuple[int, int, int]] | None:
    """Parse a command, and the reply right behind it."""
    form = _form(data, at, limit)
    if form is None:
        return None
    grammar, size = form
    stream = io.BytesIO(data[at:limit])
    try:
        command = grammar.parse_stream(stream)
    except ConstructError:
        return None
    end = at + stream.tell()
    reply, code = data[end : min(end + size, limit)], command.command >> 5
    if len(reply) < size or any(byte >= FIRST for byte in reply):
        return [(at, end, REQUEST)]
    own = reply[0] == command.command - FIRST
    if code == IDENTIFY:
        own = reply[0] >> 5 == IDENTIFY - 4
    if code in (READ, WRITE):
        own = own and reply[1] == command.rest[0]
    return [(at, end, REQUEST), (end, end + size, RESPONSE)] if own else [(at, end, REQUEST)]


def slow_describe(raw: bytes, kind: int, before: SlowFrame | None) -> SlowFrame:
    """Describe one frame."""
    del before  # the first byte tells
    code, servo_id = POSITION + (raw[0] >> 5 & 3), raw[0] & 31
    out = SlowFrame(0, len(raw), kind, servo_id, code, raw)
    sub = raw[1] if code in (READ, WRITE) else 0
    head = 2 if code in (READ, WRITE) else 1
    out.data_start, out.data = head, raw[head:]
    out.token, out.alt_id, out.reply = code << 8 | sub, NO_ALT, NEVER
    if kind == REQUEST:
        out.reply = MUST
        out.alt_id = ANY_ID if code == IDENTIFY else NO_ALT
        out.flags = UNKNOWN if sub > 4 else 0
    return out


def slow_values(frame: SlowFrame, state: State) -> list[tuple[int, int, int, int]]:
    """Return what one frame states."""
    del state
    names = VALUES.get((frame.op, frame.kind), {})
    name = names.get(None, names.get(frame.token & 255))
    if name is None or not frame.data:
        return []
    raw = frame.data[0]
    if frame.op == POSITION:
        raw = raw * 128 + frame.data[1]
    return [(frame.servo_id, REGISTER[name], raw, WHOLE)]


# -- the protocol: these, and words ----


class Ics(ByHand):
    """See ``sniffer.protocols.by_hand.ByHand``: what it has is not written here."""

    name = "ics"
    title = "Kondo ICS 3.5"
    bauds: tuple[int, ...] = (115200, 625000, 1250000)
    baud = 115200
    longest = 66
    reach = 0  # a reply is right behind its command, or it is none
    tail_ns = 1_000_000_000  # above the 600 ms that a client waits for a write of the EEPROM
    models = MODELS

    frame = staticmethod(frame)
    describe = staticmethod(describe)
    values = staticmethod(values)
    slow_parse = staticmethod(slow_parse)
    slow_describe = staticmethod(slow_describe)
    slow_values = staticmethod(slow_values)

    def window_ns(self, frames: Frames) -> I64:
        """Return 5 ms, which clients wait, and 600 ms for what is about the EEPROM."""
        about = (frames.token & 255 == EEPROM) & np.isin(frames.op, (READ, WRITE))
        return np.where(about, 600_000_000, 5_000_000).astype(np.int64)

    def op_name(self, op: int) -> str:
        """Return the command's name."""
        return NAMES.get(op, "reply")

    def fields(self, raw: bytes, row: FrameView) -> dict[str, Any]:
        """Return the subcommand, and bytes that are no register."""
        about = {"subcommand": raw[1]} if row.op in (READ, WRITE) else {}
        return about | super().fields(raw, row)

    def dissect(self, raw: bytes, row: FrameView) -> list[FieldSpan]:
        """Return the first byte in words, then the others."""
        what = f"{raw[0]:02X} {self.op_name(row.op)}, servo {raw[0] & 31}"
        out = [FieldSpan(0, 1, "command" if row.kind == REQUEST else "reply", what)]
        if row.data_start > 1:
            out.append(FieldSpan(1, 1, "subcommand", str(raw[1])))
        if row.data_length:
            rest = raw[row.data_start :]
            out.append(FieldSpan(row.data_start, len(rest), "data", rest.hex(" ").upper()))
        return out

    def explain(self, run: bytes, start: int, *, awaited: bool = False) -> list[Gap]:
        """Say that a command was cut where one begins; what is awaited and torn; else noise."""
        edges = [i for i, byte in enumerate(run) if byte >= FIRST]
        stop = edges[0] if edges else len(run)
        out = super().explain(run[:stop], start, awaited=awaited) if stop else []
        for at, stop in itertools.pairwise([*edges, len(run)]):
            fields = {"servo_id": run[at] & 31, "op": NAMES[run[at] >> 5]}
            out.append(
                Gap(start + at, stop - at, "truncated", {"have": stop - at, "fields": fields})
            )
        return out


PROTOCOL: Final = Ics()
