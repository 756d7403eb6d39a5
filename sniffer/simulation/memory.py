"""A simulated servo's registers: read and written in spans of bytes, by the model's table."""

from __future__ import annotations

import functools
from types import MappingProxyType
from typing import TYPE_CHECKING, Final

from sniffer.ground.codes import WHOLE
from sniffer.ground.registers import TYPES, Register, RegisterMap

if TYPE_CHECKING:
    from collections.abc import Mapping

    from sniffer.ground.registers import Entry
    from sniffer.simulation.talk import Value

NOTHING: Final[Mapping[str, int]] = MappingProxyType({})


@functools.cache
def _form(kind: str) -> tuple[int, bool, bool]:
    """Return size, big-endianness and signedness of a wire type, as the register tables name it."""
    dtype = TYPES[kind]
    return dtype.itemsize, dtype.byteorder == ">", dtype.kind == "i"


def pack(kind: str, raw: int) -> bytes:
    """Return a register's bytes; ``kind`` as the register tables name it."""
    size, big, signed = _form(kind)
    return raw.to_bytes(size, "big" if big else "little", signed=signed)


def unpack(kind: str, data: bytes) -> int:
    """Return the raw value of a register's bytes."""
    _, big, signed = _form(kind)
    return int.from_bytes(data, "big" if big else "little", signed=signed)


class Memory:
    """A servo's registers by name; ``shipped`` are values that the table has no default for."""

    def __init__(self, table: RegisterMap, shipped: Mapping[str, int] = NOTHING) -> None:
        self.table = table
        self._registers = {r.name: r for r in table.registers}
        self._shipped = shipped
        self.raw: dict[str, int] = {}
        self._spans: dict[tuple[int, int], list[tuple[Entry, Register]]] = {}
        self.reset(volatile_only=False)

    def reset(self, *, volatile_only: bool) -> None:
        """Take what a servo is shipped with; some registers come back with the power."""
        for register in self.table.registers:
            if register.volatile or not volatile_only:
                self.raw[register.name] = self.default(register.name)

    def default(self, name: str) -> int:
        """Return what a servo is shipped with: zero where neither table nor ``shipped`` says."""
        register = self.register(name)
        low, high = register.range or (0, 0)
        nothing = 0 if low <= 0 <= high else low  # no servo holds what its manual does not allow
        told = nothing if register.default is None else register.default
        return self._shipped.get(name, told)

    def has(self, name: str) -> bool:
        """Tell whether the model has a register of that name."""
        return name in self._registers

    def adopt(self, values: Mapping[str, int]) -> None:
        """Take values as they were seen, but for the id; those of other models are left out."""
        known = {n: v for n, v in values.items() if self.has(n) and n != "servo_id"}
        self.raw |= known

    def choose(self, name: str, text: str) -> None:
        """Set a register to the code that its table names so, if there is one."""
        codes = {named: raw for raw, named in self.register(name).values.items()}
        self.raw[name] = codes.get(text, self.raw[name])

    def register(self, name: str) -> Register:
        """Return a register's entry in the table."""
        return self._registers[name]

    def put(self, name: str, value: float) -> None:
        """Set a register to ``value`` in its unit, as its table codes it, within its range.

        Nothing is set in a model that has no such register.
        """
        if not self.has(name):
            return
        r = self.register(name)
        raw = round(value / r.scale)
        if r.sign_bit is not None:
            top = (1 << r.sign_bit) - 1
            raw = min(abs(raw), top) | (raw > 0) << r.sign_bit
        elif r.range is not None:
            raw = min(max(raw, r.range[0]), r.range[1])
        self.raw[name] = raw

    def read(self, address: int, length: int) -> bytes:
        """Return the bytes of a span; those of no register are zero."""
        out = bytearray(length)
        for e, r in self._span(address, length):
            data = pack(r.type, self.raw[r.name])
            if e.part:
                at = address + e.at - r.address
                data = data[at : at + 1]
            out[e.at : e.at + len(data)] = data
        return bytes(out)

    def values(self, servo_id: int, address: int, length: int) -> tuple[Value, ...]:
        """Return what a span states about the registers that lie in it whole."""
        raw = self.raw
        return tuple(
            (servo_id, r.name, raw[r.name])
            for e, r in self._span(address, length)
            if e.part == WHOLE
        )

    def written(self, address: int, data: bytes) -> dict[str, int]:
        """Return what bytes written to a span make of the registers in it, without storing it.

        Half of a register keeps its other half; registers that can only be read are left out.
        """
        out: dict[str, int] = {}
        for e, r in self._span(address, len(data)):
            if r.access == "r":
                continue
            held = bytearray(pack(r.type, out.get(r.name, self.raw[r.name])))
            at = address + e.at - r.address
            new = data[e.at : e.at + (len(held) if e.part == WHOLE else 1)]
            held[at : at + len(new)] = new
            out[r.name] = unpack(r.type, bytes(held))
        return out

    def allows(self, values: dict[str, int]) -> bool:
        """Tell whether all values lie in the ranges that the table gives."""
        ranges = ((self.register(name).range, raw) for name, raw in values.items())
        return all(r is None or r[0] <= raw <= r[1] for r, raw in ranges)

    def _span(self, address: int, length: int) -> list[tuple[Entry, Register]]:
        key = address, length
        found = self._spans.get(key)
        if found is None:
            table = self.table
            entries = table.span(address, length)
            found = [(e, table.registers[e.register - table.first]) for e in entries]
            self._spans[key] = found
        return found
