"""wCK in columns; every layout number comes from ``OPS``.

A reply has no header and no checksum, so it is decided for each command from the two bytes behind
it, and the command that has one ends two bytes later for the greedy walk. Time decides nothing
here: framing is a function of the bytes and of silences.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from typing import Any, Final

import numpy as np

from sniffer.checksums import XOR7
from sniffer.framing import Block, settle
from sniffer.model import (
    ANY_ID,
    ECHO_DIFFERS,
    I64,
    MUST,
    NEVER,
    NO_ALT,
    REQUEST,
    RESPONSE,
    U8,
    UNKNOWN,
    UNUSUAL,
    Frames,
    Mask,
    Spans,
)
from sniffer.protocols.base import State, Values
from sniffer.protocols.wck.grammar import (
    HEADER,
    INDEX,
    MASKS,
    MOTION_MOST,
    OPS,
    UNKNOWN_BASE,
    UNKNOWN_OP,
    Bits,
    Op,
    byte_values,
)
from sniffer.registers import load_models

MODELS: Final = load_models("wck")
REGISTERS: Final = MODELS[0].index

DATA1, DATA2, PARAMS = 1, 2, 3
"""Offsets in a command."""

REPLY: Final = 2
"""Bytes of every reply. Source: manual 1.07, A-6, Response Packet."""

SYNC, BREAK, MOTION = INDEX["sync_position_move"], INDEX["break"], INDEX["motion_data_write"]
MOVE_10BIT, READ_10BIT = INDEX["position_move_10bit"], INDEX["position_read_10bit"]
COUNT_BITS: Final = 31
"""Bits of a synchronized move's Data2 that count its targets: 'Arbitrary Value' stands above."""

_NONE: Final = 255
"""In KIND: no command begins so."""


def _table(of: Callable[[Op], Any], dtype: Any) -> Any:
    """Return a property of the commands as an array by row of OPS, with a row for none."""
    out = np.zeros(256, dtype)
    out[: len(OPS)] = [of(op) for op in OPS]
    return out


def _kinds() -> U8:
    out = np.full((256, 256), _NONE, np.uint8)
    for i, op in enumerate(OPS):
        out[np.ix_(byte_values(op.data2), byte_values(op.data1))] = i
    return out.ravel()


KIND: Final = _kinds()
"""Row of OPS by Data2 << 8 | Data1, as two bytes in wire order read as a little-endian number."""

LENGTH: Final = _table(lambda op: op.length, np.int64)
LENGTH[_NONE] = min(op.length for op in OPS)
ASKS: Final = _table(lambda op: bool(op.reply), bool)
SLOW: Final = _table(lambda op: op.slow, bool)
LONGEST: Final = OPS[SYNC].length + COUNT_BITS

_FF0 = _table(lambda op: op.reply_ff[0], bool)
_FF1 = _table(lambda op: op.reply_ff[1], bool)
_MOST = _table(lambda op: op.reply_most, np.uint8)


def _byte_at(op: Op, name: str) -> int:
    """Return the offset of a named byte in a command, 0 for none."""
    if name == "data2":
        return DATA2
    return PARAMS + op.params.index(name) if name in op.params and name != "again" else 0


def _echo(k: int) -> Any:
    return _table(lambda op: _byte_at(op, op.reply[k]) if op.reply else 0, np.int64)


_ECHO0, _ECHO1 = _echo(0), _echo(1)
_TWICE = _table(lambda op: op.reply[1:] == ("again",), bool)
_ECHO_MASK = _table(lambda op: MASKS.get(op.reply[0], 0xFF) if op.reply else 0, np.uint8)
_ECHOES = (_ECHO0 > 0) & ((_ECHO1 > 0) | _TWICE)
_CHECKED = (_ECHO0 > 0) | (_ECHO1 > 0) | _TWICE | (_MOST < 0xFF)
_TWIN = _table(lambda op: _at_again(op), np.int64)


def _at_again(op: Op) -> int:
    """Return the offset of the parameter that must repeat the one before it, 0 for none."""
    return PARAMS + op.params.index("again") if "again" in op.params else 0
