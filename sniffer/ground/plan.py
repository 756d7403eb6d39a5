"""Grammar -> plan: a length-prefixed wire grammar, walked once, in the form block framing needs.

The grammar stays the only place where a layout is written: header, field offsets, guards, length
expression and checksum are read from it. What the walker does not know it refuses.
"""

from __future__ import annotations

from collections.abc import Callable, Mapping
from types import MappingProxyType
from typing import TYPE_CHECKING, Any, NamedTuple

import construct as c
import numpy as np

from sniffer.ground.sealed import Edge, Sealed, Stretch
from sniffer.ground.wire import ByCode, Order, Seal, order_of

if TYPE_CHECKING:
    from sniffer.ground.checksums import Sum
    from sniffer.ground.model import I64, U8, Mask

Expression = Callable[[Any], Any]


class Plan(NamedTuple):
    """Numbers and expressions of one wire grammar; offsets count from the frame's first byte."""

    header: bytes
    at: Mapping[str, int]
    checks: tuple[Expression, ...]
    tail: Expression  # length of the one variable field
    tail_at: int
    prefix: int  # bytes needed before length and guards can be read
    width: Mapping[str, int]  # bytes of each field; those of two have the low byte first
    behind: int  # bytes behind the variable field, if that has any
    alone: int  # and if it has none: a check of nothing may be left out
    size: str  # the field that the length follows from; empty: all packets are as long
    seals: tuple[Sealed, ...]  # all checks, the cheap ones first
    constants: tuple[tuple[Edge, bytes], ...]  # those behind the header

    @property
    def checksum(self) -> Sum:
        """The checksum, of several the dearest."""
        told: Sum = self.seals[-1].checksum
        return told

    def checksum_of(self, raw: bytes) -> tuple[Sum, bytes, int]:
        """Return the checksum of one packet, the bytes it covers, and what was sent."""
        seal = next(seal for seal in reversed(self.seals) if seal.stands_in(raw))
        return seal.checksum, seal.covered(raw), seal.sent(raw)

    def size_with(self, tail: Any) -> Any:
        """Return how many bytes packets have whose variable field has so many."""
        if self.alone == self.behind:
            return tail + (self.tail_at + self.behind)
        return tail + self.tail_at + np.where(tail, self.behind, self.alone)

    def sizes(self, most: int) -> I64:
        """Return how many bytes packets have, by the field that tells it; -1: none has."""
        told = np.arange(most + 1 if self.size else 1)
        tail = np.asarray(self.tail({self.size: told})) + 0 * told
        return np.where(tail >= 0, self.size_with(tail), -1)

    def tail_in(self, size: I64) -> I64:
        """Return how many bytes the variable field has in packets of so many."""
        tail = size - (self.tail_at + self.behind)
        return tail if self.alone == self.behind else np.maximum(tail, 0)

    def tail_of(self, raw: bytes) -> bytes:
        """Return the variable field of one packet."""
        return raw[self.tail_at : max(len(raw) - self.behind, self.tail_at)]

    @property
    def sum_from(self) -> int:
        """First byte under the checksum."""
        return self.seals[-1].over[0][0].bytes

    @property
    def sum_width(self) -> int:
        """Bytes of the checksum."""
        return self.seals[-1].width

    def columns(self, block: U8, start: I64) -> c.Container:
        """Read the fields that length and guards depend on, for frames beginning at ``start``."""
        out = c.Container()
        for name, at in self.at.items():
            if at < self.prefix:
                out[name] = block[start + at].astype("i8")
                if self.width[name] == 2:
                    out[name] += block[start + at + 1].astype("i8") << 8
        return out

    def holds(self, data: U8, start: I64, end: I64) -> Mask:
        """Tell which packets ``data[start:end]`` hold what they should: constants and checks."""
        if not self.constants:
            return self.sound(data, start, end)
        good = np.ones(len(start), bool)
        for edge, value in self.constants:
            at = edge.of(start, end)
            for k, byte in enumerate(value):
                good &= data[at + k] == byte
        rows = np.flatnonzero(good)
        good[rows] = self.sound(data, start[rows], end[rows])
        return good

    def sound(self, data: U8, start: I64, end: I64) -> Mask:
        """Tell in which packets all checks hold."""
        # What is cheap comes first: of false headers few are left for a sum over the whole packet.
        first, *more = self.seals
        good = first.good(data, start, end)
        for seal in more:
            rows = np.flatnonzero(good)
            good[rows] = seal.good(data, start[rows], end[rows])
        return good

    def broken(self, data: U8, start: I64, end: I64) -> tuple[I64, I64]:
        """Return what the first check should be, and is, that does not hold; -1: all hold."""
        want, got = np.full(len(start), -1), np.full(len(start), -1)
        left = np.arange(len(start))
        for seal in self.seals:
            bad = ~seal.good(data, start[left], end[left])
            rows, left = left[bad], left[~bad]
            if len(rows):
                want[rows], got[rows] = seal.numbers(data, start[rows], end[rows])
        return want, got


def plan_of(grammar: Any) -> Plan:
    r"""Walk ``grammar``: header, fields of one or two bytes, one variable field, checksum.

    For example mightyZAP's ``FF FF FF | id | size | code | factors | checksum``::

        header   b"\xff\xff\xff"        the Consts at the front
        at       id 3, size 4, code 5   each field's offset
        checks   id != 255, size >= 2   the grammar's own Checks, evaluated on columns
        tail     size - 2               length of ``factors``, which begins at ``tail_at`` 6
        seals    [3, end - 1)           what the checksum covers: the RawCopy's bytes
        prefix   5                      bytes that show length and guards: ``code`` is not needed

    In a ``Packet`` checks may stand anywhere. For example HerkuleX's, where two stand before what
    they cover, ``FF FF | size | id | cmd | sum1 | sum2 | data``::

        seals    sum2 over [5, 6), sum1 over [2, 5) and [7, end)      the cheap one first
        behind   0                                                    bytes behind ``data``

    ``prefix`` is found by trying: the expressions are evaluated on a dict that notes which fields
    they ask for. A number beside the grammar would be one more place to keep right.

    Raises:
        TypeError: the grammar holds something no plan can express; give the protocol a scanner
            of its own.
    """
    walk = _PacketWalk()
    walk.walk(grammar)
    return walk.plan()


class _PacketWalk:
    """One walk along the grammar of a packet."""

    def __init__(self) -> None:
        self.header = b""
        self.at: dict[str, int] = {}
        self.width: dict[str, int] = {}
        self.checks: list[Expression] = []
        self.tail: Expression | None = None
        self.tail_name = ""
        self.checksum: Sum | None = None
        self.order: Order = "little"
        self.tail_at = self.sum_from = -1
        self.pos = self.sum_width = 0
        self.places: dict[str, tuple[int, int, bool]] = {}  # offset, bytes, behind the tail
        self.seals: list[tuple[str, Seal]] = []
        self.constants: list[tuple[int, bytes, bool]] = []

    def walk(self, con: Any, name: str = "") -> None:
        match con:
            case c.Renamed():
                self.walk(con.subcon, con.name)
            case c.Struct():
                for sub in con.subcons:
                    self.walk(sub)
            case c.RawCopy():
                self.sum_from = self.pos
                self.walk(con.subcon)
            case c.Const() if isinstance(con.value, bytes):
                if self.tail is None and self.pos == len(self.header):
                    self.header += con.value
                else:
                    self.constants.append((self.pos, con.value, self.tail is not None))
                self._take(name, len(con.value))
            case c.Check():
                self.checks.append(con.func)
            case c.Checksum() if self.checksum is None:
                self.checksum, self.sum_width = con.hashfunc, con.checksumfield.sizeof()
                self.order = order_of(name, con.checksumfield, con.hashfunc)
                self._take(name, self.sum_width)
            case Seal():
                self.seals.append((name, con))
                self._take(name, con.sizeof())
            case c.Bytes() if self.tail is None:
                size = con.length
                self.tail = size if callable(size) else lambda _: size
                if isinstance(size, ByCode):
                    self.checks.append(size.knows)
                self.tail_at, self.tail_name = self.pos, name
                self.places[name] = self.pos, 0, False
                self.pos = 0
            case c.FormatField() if con.fmtstr in (">B", "<H") and self.tail is None:
                self.at[name], self.width[name] = self.pos, con.length
                self._take(name, con.length)
            case c.FormatField() if con.fmtstr in (">B", "<H"):
                self._take(name, con.length)
            case c.Enum() | c.FlagsEnum():
                self.walk(con.subcon, name)
            case _:
                raise TypeError(
                    " ".join(["no plan for", *filter(None, [name]), repr(con)])
                    + ": a packet is Const, fields of Byte or Int16ul, one Bytes(length by this, "
                    "a number, or BY_CODE), and Seal or one Checksum; any other wants a block "
                    "scanner of its own"
                )

    def _take(self, name: str, size: int) -> None:
        if name:
            self.places[name] = self.pos, size, self.tail is not None
        self.pos += size

    def plan(self) -> Plan:
        """Put together what was found.

        Raises:
            TypeError: something is missing, or a check covers what is no field.
        """
        behind, tail = self.pos, self.tail
        if tail is None or (self.checksum is None and not self.seals):
            raise TypeError("a plan needs one field of Bytes, and a Checksum or a Seal")
        if self.checksum is not None and behind != self.sum_width:
            raise TypeError("a Checksum is the last of a packet: elsewhere write Seal, in a Packet")
        asked = asked_by(tail)
        seen = asked | {name for check in self.checks for name in asked_by(check)}
        if unknown := sorted(seen - self.at.keys()):
            raise TypeError(
                f"the length and each Check ask fields before {self.tail_name}, by this.NAME: "
                f"{unknown[0]} is none"
            )
        prefix = max([len(self.header), *(self.at[k] + self.width[k] for k in seen)])
        seals = [self._sealed(name, seal) for name, seal in self.seals]
        if self.checksum is not None:
            seals.append(self._at_the_end(self.checksum))
        # The cheap ones first: those that the variable field has no part in.
        front = Edge(self.places[self.tail_name][0])
        seals.sort(key=lambda s: any(edge.last or edge == front for _, edge in s.over))
        constants = [
            (Edge(behind - at, last=True) if far else Edge(at), value)
            for at, value, far in self.constants
        ]
        return Plan(
            header=self.header,
            at=MappingProxyType(self.at),
            checks=tuple(self.checks),
            tail=tail,
            tail_at=self.tail_at,
            prefix=prefix,
            width=MappingProxyType(self.width),
            behind=behind,
            alone=behind - sum(seal.width for seal in seals if seal.some),
            size=min(asked, default=""),
            seals=tuple(seals),
            constants=tuple(constants),
        )

    def _stretch(self, name: str) -> Stretch:
        """Return where a field stands: by the packet's first byte, or by its end."""
        at, size, far = self.places[name]
        if far:
            return Edge(self.pos - at, last=True), Edge(self.pos - at - size, last=True)
        if not size and at == self.tail_at:
            return Edge(at), Edge(self.pos, last=True)
        return Edge(at), Edge(at + size)

    def _at_the_end(self, checksum: Sum) -> Sealed:
        """Return the check of a Struct: over its RawCopy, and the last of the packet."""
        at = Edge(self.sum_width, last=True)
        over = ((Edge(self.sum_from), at),)
        return Sealed("checksum", checksum, (at, Edge(0, last=True)), over, order=self.order)

    def _sealed(self, name: str, seal: Seal) -> Sealed:
        """Return a check with the stretches that its fields make."""
        over: list[Stretch] = []
        for other in seal.over:
            if other not in self.places:
                raise TypeError(f"{name} covers {other}, which is no field of the packet")
            first, last = self._stretch(other)
            if over and over[-1][1] == first:
                over[-1] = over[-1][0], last
            else:
                over.append((first, last))
        if not over:
            raise TypeError(f'{name} covers nothing: name fields, Seal(Byte, XOR8, "length", ...)')
        at, size, far = self.places[name]
        if seal.some and not (
            far and seal.over == (self.tail_name,) and at == 0 == self.pos - size
        ):
            raise TypeError(
                f"{name} is not always there: then it is the last of the packet, and covers "
                f"{self.tail_name}, right before it, and nothing else"
            )
        order = order_of(name, seal.subcon, seal.checksum)
        return Sealed(name, seal.checksum, self._stretch(name), tuple(over), seal.some, order)


def asked_by(expression: Expression) -> set[str]:
    """Return the fields that an expression asks for."""
    seen: set[str] = set()

    class Probe(dict[str, int]):
        def __missing__(self, key: str) -> int:
            seen.add(key)
            return 4

    try:
        expression(Probe())
    except AttributeError as error:
        told = f"a lambda cannot be read: write this.{error.name}, with construct's `this`"
        raise TypeError(told) from None
    return seen
