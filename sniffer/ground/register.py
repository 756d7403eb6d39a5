"""One register of a servo: where it stands, how its bytes make a number, what the number means."""

from __future__ import annotations

import math
from dataclasses import dataclass, field
from types import MappingProxyType
from typing import TYPE_CHECKING, Any, Final

import numpy as np

from sniffer.ground.codes import CONFIG

if TYPE_CHECKING:
    from collections.abc import Mapping

TYPES: Final[Mapping[str, np.dtype[Any]]] = MappingProxyType(
    {
        "u8": np.dtype("u1"),
        "i8": np.dtype("i1"),
        "u16le": np.dtype("<u2"),
        "i16le": np.dtype("<i2"),
        "u16be": np.dtype(">u2"),
        "i16be": np.dtype(">i2"),
        "u32": np.dtype("<u4"),
        "i32": np.dtype("<i4"),
        "u32be": np.dtype(">u4"),
        "i32be": np.dtype(">i4"),
        "i64": np.dtype("<i8"),
        # where registers go by words instead of addresses (LSS)
        "decimal": np.dtype("i8"),
        "text": np.dtype("S0"),
        "none": np.dtype("V0"),
    }
)
"""Wire types of a register, by the name the tables use."""

MEMORIES: Final = "volatile", "non-volatile"
"""Where registers stand: in what a loss of power clears, or in what outlasts it and wears."""


@dataclass(frozen=True, slots=True)
class Register:
    """One entry of a table. ``scale`` turns raw into ``unit``.

    ``scale_by`` names the register whose value selects the scale. ``sign_bit`` marks sign and
    magnitude coding (bit set: positive). ``special`` are raw values that are no measurement,
    ``alarms`` those of ``values``, or numbers of ``bits``, that report a fault.
    ``effect`` is what a write changes about the bus: servo_id, baud, feedback or protocol (the
    servo leaves the one it speaks). ``on_with`` names the register whose write brings this one to 1
    by itself, ``bounds`` the quantity that is kept between this one and another, ``least_of`` and
    ``most_of`` that of which the servo complains below or above this one.

    Registers that go by a word (LSS) have more:

    - ``kind``: action, query, configuration, modifier or unclear,
    - ``queries``: the queries, with selector, whose replies state the register,
    - ``modifies``: the actions that a modifier belongs to,
    - ``texts``: what may stand in place of a number,
    - ``label``: the name of the value, with its unit, among a frame's fields.
    """

    name: str
    address: int = -1
    type: str = "u8"
    unit: str = ""
    scale: float = 1.0
    scale_by: tuple[str, Mapping[int, float]] | None = None
    sign_bit: int | None = None
    quantity: str = ""
    role: int = CONFIG
    access: str = "rw"
    volatile: bool = True
    range: tuple[int, int] | None = None
    default: int | None = None
    values: Mapping[int, str] = field(default_factory=dict)
    bits: Mapping[int, str] = field(default_factory=dict)
    special: Mapping[int, str] = field(default_factory=dict)
    alarms: tuple[int, ...] = ()
    effect: str = ""
    on_with: str = ""
    bounds: str = ""
    least_of: str = ""
    most_of: str = ""
    source: str = ""
    doubt: str = ""
    model: str = ""
    word: str = ""
    aliases: tuple[str, ...] = ()
    kind: str = ""
    queries: tuple[str, ...] = ()
    modifies: tuple[str, ...] = ()
    texts: Mapping[str, str] = field(default_factory=dict)
    label: str = ""

    @property
    def width(self) -> int:
        """Bytes on the wire."""
        return TYPES[self.type].itemsize

    @property
    def memory(self) -> str:
        """Where it stands, one of ``MEMORIES``."""
        return MEMORIES[not self.volatile]

    def names(self, raw: int) -> str | list[str] | None:
        """Name an enumerated value, the set bits, or a special value; None: nothing is named."""
        if raw in self.special:
            return self.special[raw]
        if self.bits:
            return bit_names(self.bits, raw)
        if self.values:
            return self.values.get(raw, "unknown")
        return None


BEYOND: Final = 1.1
"""A position this much beyond the whole stroke contradicts its scale. A rod that stands at its end
is measured a little outside, never by a tenth; the next finer resolution is a factor of two."""


def scale_limit(register: Register, mode: int) -> float:
    """Return the highest raw value that fits the register's range under a mode of its scale."""
    if register.scale_by is None or register.range is None:
        return math.inf
    table = register.scale_by[1]
    scale = table.get(mode)
    return (
        math.inf if scale is None else BEYOND * register.range[1] * unseen_scale(register) / scale
    )


def unseen_scale(register: Register) -> float:
    """Return the scale that is assumed until the mode is seen."""
    if register.scale_by is None or register.scale != 1.0:
        return register.scale
    return next(iter(register.scale_by[1].values()))


def bit_names(bits: Mapping[int, str], raw: int) -> list[str]:
    """Name the bits set in ``raw``, lowest first; a bit without a name is ``bit<n>``."""
    return [bits.get(k, f"bit{k}") for k in range(raw.bit_length()) if raw >> k & 1]
