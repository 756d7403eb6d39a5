"""Which field of ServoState holds a register, and what became known of such fields."""

from __future__ import annotations

from typing import TYPE_CHECKING, Final, NamedTuple

if TYPE_CHECKING:
    from collections.abc import Mapping

    from sniffer.ground.model import F64, I64, Mask
    from sniffer.ground.registers import Register

UNITS: Final[Mapping[str, str]] = {
    "mm": "mm",
    "deg": "deg",
    "deg/s": "deg_per_s",
    "us/s": "us_per_s",
    "V": "v",
    "mA": "ma",
    "degC": "degc",
    "us": "us",
    "ms": "ms",
    "s": "s",
    "%": "percent",
}
"""How a register table's unit ends the name of a field."""


def unit_of(field: str) -> str:
    """Return the unit as it ends the name of a field, empty where there is none."""
    ends = [end for end in UNITS.values() if field.endswith(f"_{end}")]
    return max(ends, key=len, default="")


def quantity_of(field: str) -> str:
    """Return the quantity of a field, without the unit."""
    unit = unit_of(field)
    return field.removesuffix(f"_{unit}") if unit else field


FIRST_VALUE: Final = 10
"""Number of the first field of a ServoState that is a register's: a table may name its quantities
like one of those before."""


def state_field(register: Register) -> str | None:
    """Return the field of ServoState that holds a register, None for a mere setting."""
    return field_name(register.quantity, register.unit) if register.quantity else None


def field_name(quantity: str, unit: str) -> str:
    """Return the name of a field: ``position_deg``, or the quantity alone where it has no unit."""
    return f"{quantity}_{UNITS.get(unit, unit)}" if unit else quantity


class KnownValues(NamedTuple):
    """Values that frames made known, in their order: of which frame, of whom, what.

    ``field`` is a place in ``States.names``.
    """

    row: I64
    servo: I64
    field: I64
    value: F64

    def take(self, which: Mask | I64) -> KnownValues:
        """Return some of them."""
        return KnownValues(self.row[which], self.servo[which], self.field[which], self.value[which])
