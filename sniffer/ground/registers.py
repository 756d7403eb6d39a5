"""Register tables: what a span of bytes means, read from ``schemas/registers/*.toml``.

Pure apart from reading the tables once. A table is one servo model; rules for its authors stand in
``schemas/README.md``.
"""

from __future__ import annotations

import functools
import math
import tomllib
from dataclasses import dataclass, field, replace
from pathlib import Path
from types import MappingProxyType
from typing import TYPE_CHECKING, Any, Final, NamedTuple

import numpy as np

from sniffer.ground.model import COMMANDED, CONFIG, MEASURED, ROLES, SnifferError

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
        # where registers go by words instead of addresses (LSS)
        "decimal": np.dtype("i8"),
        "text": np.dtype("S0"),
        "none": np.dtype("V0"),
    }
)
"""Wire types of a register, by the name the tables use."""


@dataclass(frozen=True, slots=True)
class Register:
    """One entry of a table. ``scale`` turns raw into ``unit``.

    ``scale_by`` names the register whose value selects the scale. ``sign_bit`` marks sign and
    magnitude coding (bit set: positive). ``special`` are raw values that are no measurement,
    ``alarms`` those of ``values`` that report a fault.
    ``effect`` is what a write changes about the bus: servo_id, baud or feedback.

    Registers that go by a word (LSS) have a ``kind`` (action, query, configuration, modifier or
    unclear). ``queries`` are the queries, with selector, whose replies state the register,
    ``modifies`` the actions a modifier belongs to, ``texts`` what may stand in place of a number,
    ``label`` the name of the value, with its unit, among a frame's fields.
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
"""A position this much beyond the whole stroke contradicts its scale: a rod that stands at its end
is measured a little outside, never by a tenth, and the next finer resolution is a factor of two."""


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


@dataclass(frozen=True, slots=True)
class Entry:
    """One register inside a packet's data: ``at`` counts from the data's first byte.

    ``loose``: it selects a scale, and other bytes of the span are not named by the table.
    """

    register: int
    at: int
    type: str
    part: int = 0
    loose: bool = False


class Identity(NamedTuple):
    """What a servo of one model answers where it is asked which it is.

    ``values`` are numbers, ``texts`` whole texts, ``begins`` what the texts of its family begin
    with: a text that nobody knows yet counts by them.
    """

    register: str
    values: tuple[int, ...] = ()
    texts: tuple[str, ...] = ()
    begins: tuple[str, ...] = ()

    def is_text(self, text: str) -> bool:
        """Tell whether a servo of the model says so."""
        return text in self.texts or (bool(self.begins) and text.startswith(self.begins))


class RegisterMap:
    """One model's table; ``first`` is where its registers begin in the protocol's joint list."""

    def __init__(
        self,
        model: str,
        registers: tuple[Register, ...],
        *,
        title: str = "",
        source: str = "",
        first: int = 0,
        identity: Identity | None = None,
    ) -> None:
        self.model = model
        self.title = title
        self.source = source
        self.registers = registers
        self.first = first
        self.identity = identity
        self.index = {r.name: first + i for i, r in enumerate(registers)}
        self._selects = {r.scale_by[0] for r in registers if r.scale_by is not None}
        self._by_byte = {
            r.address + k: i
            for i, r in enumerate(registers)
            if r.address >= 0
            for k in range(r.width)
        }

    def __len__(self) -> int:
        return len(self.registers)

    def register(self, name: str) -> Register:
        """Return the register of a name."""
        return self.registers[self.index[name] - self.first]

    def at(self, address: int) -> Register | None:
        """Return the register that owns the byte at ``address``."""
        i = self._by_byte.get(address)
        return None if i is None else self.registers[i]

    def span(self, address: int, length: int, at: int = 0) -> list[Entry]:
        """Split ``length`` bytes from ``address`` by the table; unnamed bytes are left out."""
        out: list[Entry] = []
        a, stop = address, address + length
        known = all(b in self._by_byte for b in range(address, stop))
        while a < stop:
            i = self._by_byte.get(a)
            if i is None:
                a += 1
                continue
            r = self.registers[i]
            end = min(r.address + r.width, stop)
            here = at + a - address
            if a == r.address and end == r.address + r.width:
                loose = not known and r.name in self._selects
                out.append(Entry(self.first + i, here, r.type, loose=loose))
            else:
                low = (a == r.address) != r.type.endswith("be")
                part = 3 if r.width != 2 else 1 if low else 2
                out.append(Entry(self.first + i, here, "u8", part))
            a = end
        return out


def _schemas() -> Path:
    """Return the folder of the schemas: inside an installed package, beside it in a checkout."""
    package = Path(__file__).parents[1]
    inside = package / "schemas"
    return inside if inside.is_dir() else package.parent / "schemas"


def schema_path(*parts: str) -> Path:
    """Return the path of a schema file, for example ``schema_path("registers", "lss.toml")``."""
    return _schemas().joinpath(*parts)


def _ints(table: Mapping[str, Any]) -> dict[int, Any]:
    return {int(k, 0): v for k, v in table.items()}


_ROLE: Final = {name: i for i, name in enumerate(ROLES)}


def _register(entry: Mapping[str, Any], model: str) -> Register:
    known = dict(entry)
    scale_by = None
    if "scale_by" in known:
        by = known.pop("scale_by")
        scale_by = (str(by["register"]), {k: float(v) for k, v in _ints(by["scale"]).items()})
    for key in ("values", "bits", "special"):
        if key in known:
            known[key] = _ints(known[key])
    if "range" in known:
        low, high = known["range"]
        known["range"] = (int(low), int(high))
    known["role"] = _ROLE[known.get("role", "config")]
    for key in ("alarms", "aliases", "queries", "modifies"):
        known[key] = tuple(known.get(key, ()))
    known["scale"] = float(known.get("scale", 1.0))
    return Register(**known, scale_by=scale_by, model=model)


@functools.cache
def read_table(model: str) -> tuple[Mapping[str, Any], tuple[Register, ...]]:
    """Read a model's table: its head (title, source ...) and its registers.

    Raises:
        SnifferError: there is no such table, or a line of it cannot be understood.
    """
    path = schema_path("registers", f"{model}.toml")
    if not path.is_file():
        raise SnifferError(f"no register table for {model!r}: see `sniffer registers`")
    table = tomllib.loads(path.read_text(encoding="utf-8"))
    entries = table.pop("register", [])
    try:
        registers = tuple(_register(e, model) for e in entries)
    except (KeyError, TypeError, ValueError) as error:
        raise SnifferError(f"{path.name}: {error}") from error
    return table, registers


def read_identity(model: str) -> Identity | None:
    """Read what identifies a model, None where no source says it.

    Raises:
        SnifferError: there is no such table, or a line of it cannot be understood.
    """
    told = read_table(model)[0].get("identifies")
    if told is None:
        return None
    if not told.keys() <= set(Identity._fields) or "register" not in told:
        raise SnifferError(f"{model}.toml: identifies: a register and {Identity._fields[1:]}")
    values, texts, begins = (tuple(told.get(key, ())) for key in Identity._fields[1:])
    return Identity(told["register"], values, texts, begins)


def load_models(*models: str) -> tuple[RegisterMap, ...]:
    """Read the tables of one protocol's models, the default first; rows are numbered through.

    The register that identifies a model has the names of all siblings' numbers.
    """
    out: list[RegisterMap] = []
    first = 0
    identities = {model: read_identity(model) for model in models}
    numbers = {raw: m for m, told in identities.items() if told for raw in told.values}
    for model in models:
        head, registers = read_table(model)
        identity = identities[model]
        if identity is not None and identity.values:
            registers = tuple(
                replace(r, values=numbers) if r.name == identity.register else r for r in registers
            )
        out.append(
            RegisterMap(
                model,
                registers,
                title=str(head.get("title", "")),
                source=str(head.get("source", "")),
                first=first,
                identity=identity,
            )
        )
        first += len(registers)
    return tuple(out)


__all__ = [
    "COMMANDED",
    "CONFIG",
    "MEASURED",
    "TYPES",
    "Entry",
    "Identity",
    "Register",
    "RegisterMap",
    "bit_names",
    "load_models",
    "read_identity",
    "read_table",
    "scale_limit",
    "schema_path",
    "unseen_scale",
]
