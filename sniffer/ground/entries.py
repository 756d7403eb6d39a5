"""What an entry of a register table cannot say: told to its author, not shown to a reader."""

from __future__ import annotations

import math
from typing import TYPE_CHECKING, Any, Final

import numpy as np

from sniffer.ground.register import TYPES
from sniffer.ground.wording import nearly

if TYPE_CHECKING:
    from collections.abc import Iterable, Iterator, Sequence

    from sniffer.ground.register import Register

LAST: Final = 0xFFFF
"""The last address that a packet of any protocol names."""

UNITS: Final = ("mm", "deg", "deg/s", "V", "mA", "degC", "us", "us/s", "ms", "s", "%")
"""Spellings of units that everything above knows. Source: schemas/README.md."""

QUANTITIES: Final = (
    *("position", "goal_position", "speed", "goal_speed", "load", "current", "goal_current"),
    *("voltage", "temperature", "torque_enable", "moving", "force_limit", "torque_limit"),
    *("operating_rate", "goal_time", "elapsed_time", "status"),
)
"""Quantities that something is known of. Source: the same."""

_WORDS: Final = ("unit", "quantity", "source", "doubt", "word", "kind", "label")
_ACCESS: Final = ("r", "rw", "w")


def impossible(register: Register) -> str:
    """Return what about an entry cannot be, in a sentence; empty where it can."""
    return next(_wrong(register), "")


def doubtful(registers: Sequence[Register]) -> list[str]:
    """Return what is odd about entries that can be, a sentence each: nobody is refused for it."""
    out = []
    for r in registers:
        if r.unit and r.unit not in UNITS:
            out.append(
                f"{r.name}: the unit {r.unit!r:.40} is none that is known: one of "
                f"{', '.join(UNITS)}, and scale"
            )
        if r.quantity and r.quantity not in QUANTITIES:
            out.append(
                f"{r.name}: nothing is known of the quantity {r.quantity!r:.40}, so it is shown "
                f"and not diagnosed{nearly(r.quantity, QUANTITIES)}"
            )
    without = [r.name for r in registers if not r.source]
    if without:
        more = f" and {len(without) - 1} more" if len(without) > 1 else ""
        out.append(f"{without[0]}{more}: no source says where the manual has it")
    return out


def raw_range(told: Any) -> tuple[int, int]:
    """Return the lowest and the highest raw number that a table says.

    Raises:
        ValueError: they are no two whole numbers.
    """
    whole = isinstance(told, list) and all(type(number) is int for number in told)
    if not whole or len(told) != 2:
        raise ValueError(f"range = {told!r:.40}: the lowest and the highest raw number, [0, 1023]")
    return told[0], told[1]


def limits_of(kind: str) -> tuple[int, int] | None:
    """Return the least and the greatest number of a wire type; None: it is none of a number."""
    dtype: np.dtype[Any] = TYPES[kind]
    if dtype.kind not in "iu":
        return None
    known = np.iinfo(dtype)
    return int(known.min), int(known.max)


def _wrong(r: Register) -> Iterator[str]:
    yield from _misspelt(r)
    if r.address + r.width - 1 > LAST:
        yield f"its {r.width} bytes from 0x{r.address:X} on end behind 0x{LAST:X}, the last address"
    scales = [r.scale, *(r.scale_by[1].values() if r.scale_by else ())]
    if not all(scale and math.isfinite(scale) for scale in scales):
        yield "a scale of 0, or of no number, gives no value: leave it out where none is known"
    yield from _numbers(r)
    yield from _bits(r)


def _misspelt(r: Register) -> Iterator[str]:
    """Yield what is of another kind than its key has."""
    for key in _WORDS:
        if not isinstance(getattr(r, key), str):
            yield f"{key} = {getattr(r, key)!r:.40} is no text: write it in quotes"
    if r.access not in _ACCESS:
        yield f"no access {r.access!r:.40}: one of {', '.join(_ACCESS)}"
    if not isinstance(r.volatile, bool):
        yield f"volatile = {r.volatile!r:.40}: true or false, without quotes"
    for key in ("default", "sign_bit"):
        value = getattr(r, key)
        if value is not None and not isinstance(value, int):
            yield f"{key} = {value!r:.40} is no whole number: it is a raw one"


def _numbers(r: Register) -> Iterator[str]:
    """Yield which raw numbers its type does not have, or its range."""
    known = limits_of(r.type)
    if known is None:
        return
    least, most = known
    if r.range is not None and r.range[0] > r.range[1]:
        yield f"range = {list(r.range)}: the lowest raw number comes first"
    named: tuple[tuple[str, Iterable[int]], ...] = (
        ("range", r.range or ()),
        ("default", () if r.default is None else (r.default,)),
        ("values", r.values),
        ("special", r.special),
    )
    for key, numbers in named:
        for number in numbers:
            if not least <= number <= most:
                yield f"{key} has {number}, and a {r.type} is from {least} to {most}"
    if r.range is None or r.default is None or r.default in r.special:
        return
    if not r.range[0] <= r.default <= r.range[1]:
        yield f"default = {r.default} is beyond its range, {r.range[0]} to {r.range[1]}"


def _bits(r: Register) -> Iterator[str]:
    """Yield which bits it does not have, and which faults it does not name."""
    count = 8 * r.width
    if count and (beyond := [bit for bit in r.bits if not 0 <= bit < count]):
        yield f"bits has {beyond[0]}, and a {r.type} has the bits 0 to {count - 1}"
    if r.sign_bit is not None:
        if not r.type.startswith("u"):
            yield f"sign_bit goes with unsigned types, and a {r.type} has a sign of its own"
        elif not 0 < r.sign_bit < count:
            yield f"sign_bit = {r.sign_bit}, and a {r.type} has the bits 0 to {count - 1}"
    if unnamed := [number for number in r.alarms if number not in (r.bits or r.values)]:
        has = next((f"{key} has no" for key in ("bits", "values") if getattr(r, key)), "")
        has = has or "neither values nor bits has a"
        yield f"alarms has {unnamed[0]!r:.40}, for which {has} name"
