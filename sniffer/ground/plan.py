"""Grammar -> plan: a length-prefixed wire grammar, walked once, in the form block framing needs.

The grammar stays the only place where a layout is written: header, field offsets, guards, length
expression and checksum are read from it. What the walker does not know it refuses.
"""

from __future__ import annotations

from collections.abc import Callable, Mapping
from dataclasses import dataclass
from types import MappingProxyType
from typing import TYPE_CHECKING, Any

import construct as c

if TYPE_CHECKING:
    from sniffer.ground.checksums import Sum
    from sniffer.ground.model import I64, U8

Expression = Callable[[Any], Any]


@dataclass(frozen=True, slots=True)
class Plan:
    """Numbers and expressions of one wire grammar; offsets count from the frame's first byte."""

    header: bytes
    at: Mapping[str, int]
    checks: tuple[Expression, ...]
    tail: Expression  # length of the one variable field
    tail_at: int
    sum_from: int  # first byte under the checksum
    checksum: Sum
    prefix: int  # bytes needed before length and guards can be read
    width: Mapping[str, int]  # bytes of each field; those of two have the low byte first
    sum_width: int  # bytes of the checksum

    def columns(self, block: U8, start: I64) -> c.Container:
        """Read the fields that length and guards depend on, for frames beginning at ``start``."""
        out = c.Container()
        for name, at in self.at.items():
            if at < self.prefix:
                out[name] = block[start + at].astype("i8")
                if self.width[name] == 2:
                    out[name] += block[start + at + 1].astype("i8") << 8
        return out


def plan_of(grammar: Any) -> Plan:
    r"""Walk ``grammar``: header, fields of one or two bytes, one variable field, checksum.

    For example mightyZAP's ``FF FF FF | id | size | code | factors | checksum``::

        header   b"\xff\xff\xff"        the Consts at the front
        at       id 3, size 4, code 5   each field's offset
        checks   id != 255, size >= 2   the grammar's own Checks, evaluated on columns
        tail     size - 2               length of ``factors``, which begins at ``tail_at`` 6
        sum_from 3                      where the RawCopy under the checksum begins
        prefix   5                      bytes that show length and guards: ``code`` is not needed

    ``prefix`` is found by trying: the expressions are evaluated on a dict that notes which fields
    they ask for. A number beside the grammar would be one more place to keep right.

    Raises:
        TypeError: the grammar holds something no plan can express; give the protocol a scanner
            of its own.
    """
    header = b""
    at: dict[str, int] = {}
    checks: list[Expression] = []
    tail: Expression | None = None
    checksum: Sum | None = None
    tail_at = sum_from = -1
    pos = sum_width = 0
    width: dict[str, int] = {}

    def walk(con: Any, name: str = "") -> None:
        nonlocal header, tail, tail_at, sum_from, checksum, pos, sum_width
        match con:
            case c.Renamed():
                walk(con.subcon, con.name)
            case c.Struct():
                for sub in con.subcons:
                    walk(sub)
            case c.RawCopy():
                sum_from = pos
                walk(con.subcon)
            case c.Const() if pos == len(header):
                header += con.value
                pos += len(con.value)
            case c.Check():
                checks.append(con.func)
            case c.Checksum():
                checksum, sum_width = con.hashfunc, con.checksumfield.sizeof()
            case c.Bytes() if callable(con.length) and tail is None:
                tail, tail_at = con.length, pos
            case c.FormatField() if con.fmtstr in (">B", "<H") and tail is None:
                at[name], width[name] = pos, con.length
                pos += con.length
            case c.Enum() | c.FlagsEnum():
                walk(con.subcon, name)
            case _:
                raise TypeError(
                    f"no plan for {con!r}: a packet is Const, fields of Byte or Int16ul, one "
                    "Bytes(length by this), then a Checksum; any other wants a block scanner of "
                    "its own"
                )

    walk(grammar)
    if tail is None or checksum is None or tail_at != pos:
        raise TypeError("a plan needs one variable field, the last before the checksum")
    seen: set[str] = set()

    class Probe(dict[str, int]):
        def __missing__(self, key: str) -> int:
            seen.add(key)
            return 4

    for expression in (tail, *checks):
        expression(Probe())
    prefix = max(at[k] + width[k] for k in seen)
    return Plan(
        header,
        MappingProxyType(at),
        tuple(checks),
        tail,
        tail_at,
        sum_from,
        checksum,
        prefix,
        MappingProxyType(width),
        sum_width,
    )
