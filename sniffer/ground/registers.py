"""Register tables: what a span of bytes means, read from TOML.

A table is one servo model; rules for its authors stand in ``schemas/README.md``. The tables of the
protocols that are built in lie in ``schemas/registers/``, others where their authors put them.
"""

from __future__ import annotations

import functools
import re
from dataclasses import fields, replace
from pathlib import Path
from typing import TYPE_CHECKING, Any, Final, NamedTuple

from sniffer.ground.codes import COMMANDED, CONFIG, MEASURED, ROLES
from sniffer.ground.entries import impossible, raw_range
from sniffer.ground.model import SnifferError
from sniffer.ground.register import TYPES, Register, bit_names, scale_limit, unseen_scale
from sniffer.ground.toml import quick, text_of

if TYPE_CHECKING:
    from collections.abc import Iterable, Mapping, Sequence


class Entry(NamedTuple):
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
    """One model's table; ``first`` is where its registers begin in the protocol's joint list.

    ``protocol`` is the name of the one that the model speaks, ``text`` the TOML it was read from:
    recordings attach it.
    """

    def __init__(
        self,
        model: str,
        registers: tuple[Register, ...],
        *,
        title: str = "",
        source: str = "",
        first: int = 0,
        identity: Identity | None = None,
        protocol: str = "",
        text: str = "",
    ) -> None:
        self.model = model
        self.title = title
        self.source = source
        self.protocol = protocol
        self.text = text
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

    @classmethod
    def from_toml(cls, path: Path | str) -> RegisterMap:
        """Read the table of a model from a file anywhere; its head names the model.

        Raises:
            SnifferError: the file cannot be read, or a line of it cannot be understood.
        """
        file = Path(path)
        return cls.from_text(text_of(file, "a register table is"), str(file))

    @classmethod
    def from_text(cls, text: str, name: str) -> RegisterMap:
        """Read a table from TOML; ``name`` is what complaints call it.

        Raises:
            SnifferError: a line of it cannot be understood.
        """
        table = _parsed(text, name)
        model = table.head.get("model", Path(name).stem)
        if not isinstance(model, str) or not _MODEL.fullmatch(model):
            raise SnifferError(f"{name}: no name of a model: {str(model)[:40]!r}")
        return _map(model, table)

    def placed(self, first: int, numbers: Mapping[int, str]) -> RegisterMap:
        """Return the table as it stands among its siblings.

        Its registers are counted from ``first``; the one that identifies it has the names of all
        siblings' ``numbers``.
        """
        registers, identity = self.registers, self.identity
        if identity is not None and identity.values:
            registers = tuple(
                replace(r, values=numbers) if r.name == identity.register else r for r in registers
            )
        return RegisterMap(
            self.model,
            registers,
            title=self.title,
            source=self.source,
            first=first,
            identity=identity,
            protocol=self.protocol,
            text=self.text,
        )

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


class _Toml(NamedTuple):
    """A file that is read: what it says of the model, its registers, and itself."""

    head: Mapping[str, Any]
    registers: tuple[Register, ...]
    identity: Identity | None
    text: str


_HEAD: Final = {"model", "protocol", "title", "source", "identifies"}
_ROLE: Final = {name: i for i, name in enumerate(ROLES)}
_KEYS: Final = {field.name for field in fields(Register)} - {"model"}
_EFFECTS: Final = ("", "servo_id", "baud", "feedback", "protocol")
_MODEL: Final = re.compile(r"[A-Za-z0-9][A-Za-z0-9_.-]{0,63}")


def _parsed(text: str, name: str) -> _Toml:
    """Read a table; a model that its head does not name is called like the file."""
    try:
        head = quick(text)
        if head is None:
            import tomllib

            head = tomllib.loads(text)
        entries = head.pop("register", [])
        model = str(head.get("model", Path(name).stem))
        if unknown := sorted(head.keys() - _HEAD):
            raise ValueError(f"there is no key {', '.join(unknown)!r:.80}")
        if not isinstance(entries, list) or not all(isinstance(e, dict) for e in entries):
            raise ValueError("each register begins with a line [[register]]")
        registers = tuple(_register(e, model, n) for n, e in enumerate(entries, 1))
        _agree(registers)
        return _Toml(head, registers, _identity(head.get("identifies")), text)
    except ValueError as error:  # also one of TOML itself
        raise SnifferError(f"{name}: {error}") from None


def _register(entry: Mapping[str, Any], model: str, nth: int) -> Register:
    """Read one entry; what cannot be is told with the register's name."""
    known = dict(entry)
    who = f"register {known.get('name', nth)!s:.40}"
    if unknown := sorted(known.keys() - _KEYS):
        raise ValueError(f"{who}: there is no key {', '.join(unknown)!r:.80}")
    if not isinstance(known.get("name"), str) or not known["name"]:
        raise ValueError(f"{who}: it has no name")
    for key, choice in (("type", TYPES), ("role", _ROLE), ("effect", _EFFECTS)):
        if key in known and known[key] not in tuple(choice):
            raise ValueError(f"{who}: no {key} {known[key]!r:.40}: one of {', '.join(choice)}")
    try:
        made = _made(known, model)
    except (KeyError, TypeError, ValueError, AttributeError) as error:
        raise ValueError(f"{who}: {error}") from error
    if wrong := impossible(made):
        raise ValueError(f"{who}: {wrong}")
    return made


def _made(known: dict[str, Any], model: str) -> Register:
    scale_by = None
    if "scale_by" in known:
        by = known.pop("scale_by")
        scale_by = (str(by["register"]), {k: float(v) for k, v in _ints(by["scale"]).items()})
    for key in ("values", "bits", "special"):
        if key in known:
            known[key] = _ints(known[key])
    if "range" in known:
        known["range"] = raw_range(known["range"])
    known["role"] = _ROLE[known.get("role", "config")]
    for key in ("alarms", "aliases", "queries", "modifies"):
        known[key] = tuple(known.get(key, ()))
    known["scale"] = float(known.get("scale", 1.0))
    if known.setdefault("address", -1) not in range(-1, 1 << 16):
        raise ValueError(f"no address {known['address']!r:.40}: 0..0xFFFF")
    return Register(**known, scale_by=scale_by, model=model)


def _ints(table: Mapping[str, Any]) -> dict[int, Any]:
    return {int(k, 0): v for k, v in table.items()}


def _agree(registers: Sequence[Register]) -> None:
    """Refuse registers that cannot stand in one table."""
    names: set[str] = set()
    taken: dict[int, str] = {}
    for r in registers:
        if r.name in names:
            raise ValueError(f"register {r.name}: there are two of that name")
        names.add(r.name)
        for byte in range(r.address, r.address + r.width if r.address >= 0 else -1):
            if byte in taken:
                raise ValueError(f"register {r.name}: it overlaps {taken[byte]}")
            taken[byte] = r.name
    for r in registers:
        if r.scale_by is not None and r.scale_by[0] not in names:
            raise ValueError(f"register {r.name}: no register {r.scale_by[0]} to select its scale")
        if r.on_with and r.on_with not in names:
            raise ValueError(f"register {r.name}: no register {r.on_with} that switches it on")
        if r.bounds and not any(g.quantity == r.bounds and g.unit == r.unit for g in registers):
            raise ValueError(
                f"register {r.name}: no {r.bounds} in {r.unit or 'steps'} that it bounds"
            )
    _known_quantities(registers)


def _known_quantities(registers: Sequence[Register]) -> None:
    """Refuse a register that is a limit of what none in its table states."""
    stated = {(r.quantity, r.unit) for r in registers}
    for r in registers:
        for key, quantity in (("least_of", r.least_of), ("most_of", r.most_of)):
            if quantity and (quantity, r.unit) not in stated:
                what = f"{quantity} in {r.unit or 'steps'}"
                raise ValueError(f"register {r.name}: {key} is {what}, which no register has")


def _identity(told: Any) -> Identity | None:
    """Read what identifies a model, None where no source says it."""
    if told is None:
        return None
    if (
        not isinstance(told, dict)
        or not told.keys() <= set(Identity._fields)
        or "register" not in told
    ):
        raise ValueError(f"identifies: a register and {Identity._fields[1:]}")
    values, texts, begins = (tuple(told.get(key, ())) for key in Identity._fields[1:])
    return Identity(told["register"], values, texts, begins)


def _map(model: str, table: _Toml) -> RegisterMap:
    head = table.head
    return RegisterMap(
        model,
        table.registers,
        title=str(head.get("title", "")),
        source=str(head.get("source", "")),
        identity=table.identity,
        protocol=str(head.get("protocol", "")),
        text=table.text,
    )


@functools.cache
def _built_in(model: str) -> _Toml:
    path = schema_path("registers", f"{model}.toml")
    if not path.is_file():
        raise SnifferError(f"no register table for {model!r}: see `sniffer registers`")
    return _parsed(path.read_bytes().decode("utf-8"), path.name)


def read_table(model: str) -> tuple[Mapping[str, Any], tuple[Register, ...]]:
    """Read the table of a model that is built in: its head (title, source ...) and its registers.

    Raises:
        SnifferError: there is no such table, or a line of it cannot be understood.
    """
    table = _built_in(model)
    return table.head, table.registers


def read_identity(model: str) -> Identity | None:
    """Read what identifies a model that is built in, None where no source says it.

    Raises:
        SnifferError: there is no such table, or a line of it cannot be understood.
    """
    return _built_in(model).identity


def load_models(*models: str | Path) -> tuple[RegisterMap, ...]:
    """Read the tables of one protocol's models, the default first; rows are numbered through.

    A name is that of a table which is built in, a path that of any other.

    Raises:
        SnifferError: there is no such table, or a line of it cannot be understood.
    """
    return numbered(
        RegisterMap.from_toml(m) if isinstance(m, Path) else _map(m, _built_in(m)) for m in models
    )


def numbered(tables: Iterable[RegisterMap]) -> tuple[RegisterMap, ...]:
    """Return the tables of one protocol's models as siblings, the default first."""
    given = tuple(tables)
    numbers = {raw: m.model for m in given if m.identity for raw in m.identity.values}
    out: list[RegisterMap] = []
    first = 0
    for table in given:
        out.append(table.placed(first, numbers))
        first += len(table)
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
    "numbered",
    "read_identity",
    "read_table",
    "scale_limit",
    "schema_path",
    "unseen_scale",
]
