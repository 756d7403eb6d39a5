"""Grammar -> shape: where the fields of a command's parameters lie, walked once, for columns.

What the walker does not know it refuses when the protocol is made, it guesses nothing.
"""

from __future__ import annotations

from types import MappingProxyType
from typing import TYPE_CHECKING, Any, Final, NamedTuple

import construct as c

from sniffer.ground.plan import asked_by

if TYPE_CHECKING:
    from collections.abc import Callable, Mapping

Place = tuple[int, int]
"""Offset and bytes of a field."""

MEANT: Final = frozenset({"address", "length", "option", "servo_id", "data", "targets"})
"""Names that mean something to the columns."""

LIKE_ADDRESS: Final = frozenset({"addr", "adr", "reg", "register", "start", "start_address"})
"""Names that a manual may have for it."""

LIKE_LENGTH: Final = frozenset({"len", "size", "count", "number", "n", "quantity", "bytes"})
"""And for how many bytes are asked for."""

ROOM: Final = 256
"""Counts of parameter bytes that are told apart; only open ends are longer."""


class Targets(NamedTuple):
    """One of several servos: its fields from its first byte on, ``size`` bytes beside its data."""

    at: Mapping[str, Place]
    size: int
    data: bool


class Shape(NamedTuple):
    """Where the fields lie, from the first byte of the parameters on.

    ``fixed`` bytes stand before ``data`` or ``targets``; from ``least`` to ``most`` there are.
    ``checks`` are expressions on the fields, for columns as for numbers, ``constants`` bytes that
    must stand there. ``begin``: all bytes of a target are registers from that address on;
    ``stride`` and ``space``: what an address that is named is multiplied by, and what is added;
    ``counted``: ``length`` is that of the
    data.
    """

    at: Mapping[str, Place]
    fixed: int
    data: bool
    targets: Targets | None
    least: int
    most: int
    checks: tuple[Callable[[Any], Any], ...]
    constants: tuple[tuple[int, bytes], ...]
    begin: int = -1
    stride: int = 1
    space: int = 0
    counted: bool = False

    @property
    def reads(self) -> bool:
        """It asks one servo for ``length`` bytes."""
        return "length" in self.at and not self.data and self.targets is None

    @property
    def brings_several(self) -> bool:
        """It brings several servos bytes for their registers."""
        return self.targets is not None and (self.targets.data or self.begin >= 0)

    @property
    def writes(self) -> bool:
        """It brings one servo bytes for its registers."""
        return "address" in self.at and self.data


class _Walk:
    """One walk; ``inside``: of a target."""

    def __init__(self, *, inside: bool) -> None:
        self.inside = inside
        self.at: dict[str, Place] = {}
        self.pos = 0
        self.data = self.some = self.counted = False
        self.targets: Targets | None = None
        self.checks: list[Callable[[Any], Any]] = []
        self.constants: list[tuple[int, bytes]] = []

    def walk(self, con: Any, name: str = "") -> None:
        match con:
            case c.Renamed():
                self.walk(con.subcon, con.name or name)
            case c.Struct():
                for sub in con.subcons:
                    self.walk(sub)
            case c.Check():
                self._check(con)
            case c.Enum() | c.FlagsEnum():
                self.walk(con.subcon, name)
            case _ if con is c.Terminated:
                pass
            case _ if self.data or self.targets is not None:
                raise TypeError(f"no columns for {name or con!r} behind bytes of any number")
            case c.FormatField() if con.fmtstr in (">B", "<H"):
                self.at[name] = self.pos, con.length
                self.pos += con.length
            case c.FormatField() | c.BytesInteger() if name not in MEANT:
                # shown as the grammar reads it; nothing but the reader asks what it is
                self.pos += con.sizeof()
            case c.Const() if isinstance(con.value, bytes) and not self.inside:
                self.constants.append((self.pos, con.value))
                self.pos += len(con.value)
            case c.GreedyRange() if name == "targets" and not self.inside:
                one = _Walk(inside=True)
                one.walk(con.subcon)
                if one.at.get("servo_id", (0, 0))[1] != 1:
                    raise TypeError("each of several targets needs a servo_id of one byte")
                self.targets = Targets(MappingProxyType(one.at), one.pos, one.data)
            case c.Bytes() if self.inside and name == "data" and callable(con.length):
                self.data = True
            case c.Bytes() if name == "data" and repr(con.length) == "this['length']":
                self.data = self.counted = True
            case _ if con is c.GreedyBytes and name == "data" and not self.inside:
                self.data = True
            case _ if self.inside and name == "data":
                raise TypeError(
                    "the data of each of several targets are as many as a field says, "
                    '"data" / Bytes(this._.length); where they are always the same, write the '
                    'numbers that they are, as "position" / Int16ul, and at= where they stand in '
                    "the table"
                )
            case _:
                raise TypeError(
                    f"no columns for {name} {con!r}: fields are numbers, Enum or FlagsEnum of Byte "
                    "or Int16ul, Const of bytes; at the end data / GreedyBytes or targets / "
                    "GreedyRange; address, length and option are Byte or Int16ul (signs are a "
                    "matter of the register table)"
                )

    def _check(self, con: Any) -> None:
        """Keep what columns can be asked, and remember that there must be some data or targets."""
        if self.inside or not isinstance(con.func, c.ExprMixin):
            raise TypeError(f"no columns for {con.func!r}: say it of the fields outside, by `this`")
        if repr(con.func) in ("this['data']", "this['targets']"):
            self.some = True
        elif strange := sorted(asked_by(con.func) - self.at.keys()):
            raise TypeError(
                "a Check asks fields of Byte or Int16ul before it, by this.NAME: "
                f"{strange[0]} is none"
            )
        else:
            self.checks.append(con.func)


def shape_of(grammar: Any, at: int = -1, stride: int = 1, space: int = 0) -> Shape:
    """Walk the parameters of one command.

    Args:
        grammar: of its parameters.
        at: the address of what it is about, where no packet names one.
        stride: what an address that is named is multiplied by.
        space: what is added then.

    Raises:
        TypeError: the grammar holds something that columns have no form for.
    """
    w = _Walk(inside=False)
    w.walk(grammar)
    least, many = w.pos, w.data or w.targets is not None
    if w.targets is not None:
        least += w.targets.size if w.some else 0
    elif w.some:
        least += 1
    if least >= ROOM or ("address" in w.at and w.at["address"][0]):
        raise TypeError("an address stands first, and not behind hundreds of bytes")
    t = w.targets
    if at >= 0 and ("address" in w.at or (t is not None and ("address" in t.at or t.data))):
        raise TypeError("its packets name an address themselves: leave out `at`")
    likely = sorted(LIKE_ADDRESS & w.at.keys())
    if at < 0 and "address" not in w.at and t is None and (w.data or "length" in w.at) and likely:
        raise TypeError(
            f"it has no address, by which registers are known, but {likely[0]}: call that address"
        )
    likely = sorted(LIKE_LENGTH & w.at.keys())
    if "address" in w.at and t is None and not w.data and "length" not in w.at and likely:
        raise TypeError(
            f"it has an address and no length, by which it would read, but {likely[0]}: call that "
            "length"
        )
    if (space or stride != 1) and "address" not in {*w.at, *(() if t is None else t.at)}:
        raise TypeError("no packet of it names an address that `space` or `stride` could move")
    if t is not None and at < 0 and not {"address", "length"} <= {*w.at, *t.at}:
        raise TypeError(
            "several targets need an address and a length, each its own or all alike, or `at`"
        )
    return Shape(
        MappingProxyType(w.at),
        w.pos,
        w.data,
        w.targets,
        least,
        ROOM * ROOM if many else least,
        tuple(w.checks),
        tuple(w.constants),
        at if t is not None else -1,
        stride,
        space,
        w.counted,
    )
