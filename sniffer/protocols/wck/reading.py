"""What the bytes of wCK frames say of registers, in columns; a reply says what was asked for."""

from __future__ import annotations

from typing import TYPE_CHECKING, Final, NamedTuple

import numpy as np

from sniffer.ground.codes import REQUEST, RESPONSE
from sniffer.protocols.base import State, Values
from sniffer.protocols.wck.block import DATA1, DATA2, ID_BITS, PARAMS, SYNC
from sniffer.protocols.wck.grammar import MASKS, OPS, REGISTERS, UNKNOWN_OP, Bits

if TYPE_CHECKING:
    from sniffer.ground.framing import Block
    from sniffer.ground.model import I64, Frames, Mask


class ByteRead(NamedTuple):
    """A register's value in a frame: the byte at ``at``, shifted and masked; or H3 and L7 there."""

    register: int
    at: int
    shift: int = 0
    mask: int = 0xFF
    servo: int | None = None

    @property
    def is_ten_bits(self) -> bool:
        """Whether H3 and L7 stand there, whose value only the bus tells wholly."""
        return self.register in (_GOAL_10BIT, _POSITION_10BIT)


_GOAL_10BIT, _POSITION_10BIT = REGISTERS["goal_position_10bit"], REGISTERS["position_10bit"]
_SYNC_KEYS: Final = 128
"""Key of a frame's shape: row of OPS * 2 + kind; of a synchronized move this plus its count."""


def _bit_reads(bits: tuple[Bits, ...], at: int) -> list[ByteRead]:
    out: list[ByteRead] = []
    shift = 8
    for b in bits:
        shift -= b.width
        if b.name in REGISTERS:
            out.append(ByteRead(REGISTERS[b.name], at, shift, (1 << b.width) - 1))
    return out


def _byte_reads(names: tuple[str, ...], at: int) -> list[ByteRead]:
    named = {**REGISTERS, "target_h3": _GOAL_10BIT, "h3": _POSITION_10BIT}
    return [
        ByteRead(named[name], at + i, mask=MASKS.get(name, 0xFF))
        for i, name in enumerate(names)
        if name in named
    ]


def _reads() -> list[list[ByteRead]]:
    out: list[list[ByteRead]] = [[] for _ in range(_SYNC_KEYS + ID_BITS + 1)]
    for i, op in enumerate(OPS):
        out[2 * i + REQUEST] = [
            *_bit_reads(op.data1, DATA1),
            *_bit_reads(op.data2, DATA2),
            *_byte_reads(op.params, PARAMS),
        ]
        out[2 * i + RESPONSE] = _byte_reads(op.reply, 0)
    torque = out[2 * SYNC + REQUEST][0]
    goal = REGISTERS["goal_position"]
    for count in range(1, ID_BITS + 1):
        out[_SYNC_KEYS + count] = [
            read
            for k in range(count)
            for read in (
                ByteRead(torque.register, torque.at, torque.shift, torque.mask, servo=k),
                ByteRead(goal, PARAMS + k, servo=k),
            )
        ]
    return out


_READS: Final = _reads()


def reads_of(op: int, kind: int, count: int = 0) -> list[ByteRead]:
    """Return which registers the bytes of a command (row of OPS) or of its reply are, in order.

    ``count`` is that of the targets of a synchronized move.
    """
    return _READS[_SYNC_KEYS + count if count else 2 * op + kind]


_COUNT: Final = np.array([len(reads) for reads in _READS], np.int64)
_BEGIN: Final = np.cumsum(_COUNT) - _COUNT
_EACH: Final = [read for reads in _READS for read in reads]
"""The reads of all keys behind each other: those of key ``k`` from row ``_BEGIN[k]`` on."""

_AT: Final = np.array([read.at for read in _EACH], np.int64)
_REGISTER: Final = np.array([read.register for read in _EACH], np.int16)
_SHIFT: Final = np.array([read.shift for read in _EACH], np.uint8)
_MASK: Final = np.array([read.mask for read in _EACH], np.uint8)
_SERVO: Final = np.array([-1 if read.servo is None else read.servo for read in _EACH], np.int16)


def states_itself(frames: Frames) -> Mask:
    """Tell nothing. A reply is two bytes: what they are, only the command says."""
    return np.zeros(len(frames), bool)


def values(block: Block, frames: Frames, rows: I64, state: State) -> Values:
    """Read register values; rows of one shape carry the same registers at the same places."""
    # A reply to a read, a move of servos 0 and 1 at once, a 10-bit move and its reply, another
    # reply:
    #
    #     row        1        2                  3          4         6
    #     key        5        130                52         53        5     2 * op + kind, or
    #     per_row    2        4                  2          1         2     128 + targets
    #     first      0        2                  6          8         9     place of its first value
    #     servo      1 1      0 0 1 1            31 31      31        2 2
    #     raw        7 99     2 16 2 32          0 808      808       8 100
    #     in the end 7 99     2 16 2 32          0 404      404       8 100
    #
    # ``of`` is the row that a value is of (0 0 1 1 1 1 2 2 3 4 4), ``read`` its row in the table of
    # all reads: where its byte stands, how it is masked, which register it is. So values are in
    # wire order without sorting, however many shapes there are. Only then are 10-bit positions put
    # right: what their low byte means depends on those before it, of whatever command.
    data = block.data
    op = np.minimum(frames.op[rows], UNKNOWN_OP)
    key = 2 * op + frames.kind[rows]
    sync = np.flatnonzero(op == SYNC)
    key[sync] = _SYNC_KEYS + frames.data_length[rows[sync]]
    per_row = _COUNT[key]
    first = np.cumsum(per_row) - per_row
    of = np.repeat(np.arange(len(rows)), per_row)
    total = len(of)
    read = (_BEGIN[key] - first).take(of) + np.arange(total)
    at = frames.start[rows].take(of) + _AT.take(read)
    register = _REGISTER.take(read)
    raw = (data.take(at) >> _SHIFT.take(read) & _MASK.take(read)).astype(np.int64)
    servo = frames.servo_id[rows].take(of)
    if len(sync):
        told = _SERVO.take(read)
        servo = np.where(told >= 0, told, servo)
    ten = np.flatnonzero((register == _GOAL_10BIT) | (register == _POSITION_10BIT))
    if len(ten):
        raw[ten] = _aligned(raw[ten] << 8 | data[at[ten] + 1], state)
    return Values(rows.take(of), servo, register, raw, np.zeros(total, np.uint8))


def _aligned(pair: I64, state: State) -> I64:
    """Return 10-bit positions from H3 << 8 | L7, in stream order; see ``slow.aligned``."""
    # Four positions of a bus that has shown nothing yet:
    #
    #     L7          28   50   29   D0
    #     seen_low    0    0    1    1      bit 0 was set in this one or before
    #     seen_high   0    0    0    1      bit 7
    #     low         20   40   41   104    bits 7..1, except the third: bits 6..0
    #     position    404  424  41   488    H3 is 3, 3, 0, 3
    #
    # Once seen, always seen: that is what accumulate says, and what the next block begins with.
    seen_high = np.logical_or.accumulate(pair & 0x80 > 0) | bool(state.notes.get("l7_bit7", 0))
    seen_low = np.logical_or.accumulate(pair & 0x01 > 0) | bool(state.notes.get("l7_bit0", 0))
    state.notes["l7_bit7"], state.notes["l7_bit0"] = int(seen_high[-1]), int(seen_low[-1])
    low = np.where(seen_low & ~seen_high, pair & 0x7F, pair >> 1 & 0x7F)
    return (pair >> 8 & 7) << 7 | low
