"""What answers say of themselves: where the fields of each stand, walked once, and read in columns.

Most families answer with a code, an error and data, which ``columns`` reads by itself. Here is what
says more: an error behind the data, address and length once more, other fields, a code that tells
which command it answers. For example HerkuleX, ``44`` answers ``04``::

    44 | address length | data ... | error detail        front 2, behind 2
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import TYPE_CHECKING, Any, Final

import construct as c
import numpy as np

from sniffer.ground.codes import ON_ITS_OWN
from sniffer.ground.model import MALFORMED
from sniffer.ground.wire import AllBut
from sniffer.protocols.packets.declare import ADDRESS_AT, ANY, CODE_AT, KEY
from sniffer.protocols.packets.listed import column

if TYPE_CHECKING:
    from collections.abc import Mapping

    from sniffer.ground.model import I16, I64, U8, Mask
    from sniffer.protocols.packets.declare import PacketFamily
    from sniffer.protocols.packets.listed import Bytes
    from sniffer.protocols.packets.walk import Place


MEANT: Final = frozenset({"address", "length", "data", "error"})
"""Names that mean something to the columns."""


@dataclass(frozen=True, slots=True)
class AnswerShape:
    """Where the fields of an answer lie: from its first parameter on, ``last`` from its end."""

    at: Mapping[str, Place]
    last: Mapping[str, Place]
    constants: tuple[tuple[int, bytes], ...]
    front: int
    behind: int
    data: bool

    @property
    def is_any_length(self) -> bool:
        """Whether nothing but its size tells how many data there are."""
        return self.data and "length" not in self.at

    def field(self, name: str, data: U8, at: I64, count: I64) -> I64 | None:
        """Return what a field says in each answer; None where they have none of that name.

        ``at`` is where the parameters of each begin in ``data``, ``count`` how many bytes they are.
        """
        if name in self.at:
            where, width = self.at[name]
            return column(data, at + where, width)
        if name in self.last:
            where, width = self.last[name]
            return column(data, at + count - where, width)
        return None


def answer_of(grammar: Any) -> AnswerShape:
    """Walk what an answer has for parameters.

    Raises:
        TypeError: the grammar holds something that columns have no form for.
    """
    at: dict[str, Place] = {}
    last: dict[str, Place] = {}
    constants: list[tuple[int, bytes]] = []
    pos, front, keeps = 0, -1, -1

    def walk(con: Any, name: str = "") -> None:
        nonlocal pos, front, keeps
        match con:
            case c.Renamed():
                walk(con.subcon, con.name or name)
            case c.Struct():
                for sub in con.subcons:
                    walk(sub)
            case c.Enum() | c.FlagsEnum():
                walk(con.subcon, name)
            case _ if con is c.Terminated:
                pass
            case c.FormatField() if con.fmtstr in (">B", "<H"):
                (at if front < 0 else last)[name] = pos, con.length
                pos += con.length
            case c.FormatField() | c.BytesInteger() if name not in MEANT:
                pos += con.sizeof()  # shown as the grammar reads it, and asked by nobody else
            case c.Const() if isinstance(con.value, bytes) and front < 0:
                constants.append((pos, con.value))
                pos += len(con.value)
            case _ if name == "data" and front < 0 and _is_rest(con):
                front, pos = pos, 0
                keeps = con.behind if isinstance(con, AllBut) else -1
            case _:
                raise TypeError(
                    f"no columns for {name} {con!r}: an answer has numbers, Enum or FlagsEnum of "
                    'Byte or Int16ul, and one "data" / Bytes(this.length), AllBut(n) of the '
                    "n bytes behind it, or GreedyBytes at the end; address, length and error are "
                    "Byte or Int16ul"
                )

    walk(grammar)
    data, behind = front >= 0, pos if front >= 0 else 0
    if keeps not in (-1, behind):
        raise TypeError(f"AllBut({keeps}) leaves {keeps} bytes, and {behind} stand behind the data")
    if data and keeps < 0 and behind and "length" not in at:
        raise TypeError(f'write "data" / AllBut({behind}): {behind} bytes stand behind the data')
    if (at | last).get("error", (0, 1))[1] != 1:
        raise TypeError("the error is one byte; name what else there is otherwise")
    ends = {name: (behind - start, width) for name, (start, width) in last.items()}
    return AnswerShape(at, ends, tuple(constants), front if data else pos, behind, data)


def _is_rest(con: Any) -> bool:
    if isinstance(con, c.Bytes):
        return repr(con.length) == "this['length']"
    return isinstance(con, AllBut) or con is c.GreedyBytes


class ToldAnswers:
    """The answers of a family by their codes."""

    def __init__(self, family: PacketFamily) -> None:
        self.asked = np.full(256, -1, np.int64)
        for code, asked in family.asked_by.items():
            self.asked[code] = asked
        self.shapes: dict[int, AnswerShape] = {}
        if family.answers is not None:
            self.shapes[family.answers] = answer_of(family.feedback_of(-1))
        for code, asked in family.asked_by.items():
            self.shapes[code] = answer_of(family.feedback_of(asked))
        told = {code: family.commands[k] for code, k in family.asked_by.items()}
        self._place = {code: (command.stride, command.space) for code, command in told.items()}
        self._at = {code: command.answer_at for code, command in told.items()}
        self._any = {code for code, command in told.items() if command.answer == ANY}
        self._later = {code: command.later for code, command in told.items()}
        self._own = {code for code, command in told.items() if command.on_its_own}
        self.states_address = any("address" in s.at for s in self.shapes.values())
        self._known = np.isin(np.arange(256), [*self.shapes])
        self._key, self._names_it = np.zeros(256, np.int64), np.zeros(256, bool)
        for code, asked in family.asked_by.items():
            self._key[asked] = KEY | asked << CODE_AT
            self._names_it[asked] = "address" in self.shapes[code].at

    def asks(self, code: I64, token: I64, address: I64, fits: Mask) -> I64:
        """Return the tokens of requests with the code, and the address where it is repeated."""
        known = self._key[code]
        named = self._names_it[code] & fits & (address >= 0)
        return np.where(known > 0, token | known | np.where(named, address << ADDRESS_AT, 0), token)

    def read(
        self, body: Bytes, code: U8, request: Mask, *, held: I64, length: I64, status: I16,
        address: I64, token: I64, flags: U8,
    ) -> None:  # fmt: skip
        """Fill in what the answers say, in the rows that are none of ``request``.

        For example HerkuleX, what stands behind the code of two answers: two bytes at 3A are read,
        and a write is not done (error 2)::

            44 | 3A 02 | 7F 03 | 00 40     held 2, length 2, status 0, address 3A
            43 | 02 00 |                   held 2, length 0, status 2, address -1

        Args:
            body: the parameters of all rows, as they were meant.
            code: of all rows.
            request: the rows that are requests, which stay as they are.
            held: filled in, like all that follow: bytes before the data.
            length: data bytes.
            status: the error, -1 where there is none.
            address: where the data stand in the table, -1 where nothing says it.
            token: what the answer has in common with its request.
            flags: MALFORMED where it is not as its grammar has it.
        """
        answers = np.flatnonzero(~request)
        flags[answers[~self._known[code[answers]]]] = MALFORMED
        for k, shape in self.shapes.items():
            rows = answers[code[answers] == k]
            if len(rows):
                self._read(body, rows, k, shape, held, length, status, address, token, flags)

    def _read(
        self, body: Bytes, rows: I64, code: int, shape: AnswerShape, held: I64, length: I64,
        status: I16, address: I64, token: I64, flags: U8,
    ) -> None:  # fmt: skip
        data, at, count = body.data, body.params[rows], body.number[rows]
        own = count - shape.front - shape.behind
        good = own >= 0 if shape.data else own == 0
        for place, constant in shape.constants:
            for i, byte in enumerate(constant):
                good &= column(data, at + place + i, 1) == byte
        if "length" in shape.at:
            where, width = shape.at["length"]
            good &= column(data, at + where, width) == own
        key = int(self._key[self.asked[code]]) if self.asked[code] >= 0 else 0
        flags[rows[~good]] = MALFORMED
        held[rows], length[rows] = np.where(good, shape.front, 0), np.where(good, own, count)
        token[rows] = key | (0 if code in self._any else length[rows])
        if self._at.get(code, -1) >= 0:
            address[rows] = np.where(good, self._at[code], -1)
        if "address" in shape.at:
            where, width = shape.at["address"]
            stride, space = self._place.get(code, (1, 0))
            named = column(data, at + where, width) * stride + space
            address[rows] = np.where(good, named, -1)
            token[rows] |= np.where(good, named << ADDRESS_AT, 0)
        error = shape.field("error", data, at, count)
        if error is not None:
            status[rows] = np.where(good, error, -1)
            if shape.is_any_length:  # an error needs no data: it answers any request
                token[rows[good & (error > 0) & (own == 0)]] = -1
        for name, values in self._later.get(code, {}).items():
            said = shape.field(name, data, at, count)
            if said is not None:
                token[rows[good & np.isin(said, values)]] = ON_ITS_OWN
        if code in self._own:
            token[rows[good]] = ON_ITS_OWN
