"""What a frame states, as fields of names and values: rows and the table for people have them."""

from __future__ import annotations

import math
from typing import TYPE_CHECKING, Any, Final

import numpy as np

from sniffer.ground.codes import PARTS, WHOLE
from sniffer.protocols.base import view

if TYPE_CHECKING:
    from sniffer.ground.model import F64, Batch, Samples
    from sniffer.ground.registers import Register
    from sniffer.protocols.base import BusProtocol


_FINE: Final = 2.0**32


def tidy(value: float) -> float | None:
    """Return a value as people read it: NaN is none, rounding dust is swept off."""
    return None if math.isnan(value) else round(value, 6)


def tidied(values: F64) -> F64:
    """Return many values as ``tidy`` does one, NaN as it is: 60.800000000000004 is 60.8 everywhere.

    A value of more than 2^32 has its millionths below what a float is exact to.
    """
    large = np.abs(values) >= _FINE
    if not np.count_nonzero(large):  # of few values in less time than any()
        swept = values * 1e6
        np.rint(swept, out=swept)
        swept /= 1e6
        return swept
    return np.where(large, values, tidied(np.where(large, 0.0, values)))


def value_entry(register: Register, raw: int, value: float, part: int) -> dict[str, Any]:
    """Return one register value as ``fields`` show it."""
    out: dict[str, Any] = {"raw": raw}
    if part == WHOLE and register.unit:
        out |= {"value": tidy(value), "unit": register.unit}
    if part == WHOLE:
        names = register.names(raw)
        if names is not None:
            out["names" if isinstance(names, list) else "name"] = names
    return out


def value_name(register: Register, part: int) -> str:
    """Return what ``fields`` call a register, or the part of it that a frame carries."""
    return register.name if part == WHOLE else f"{register.name} ({PARTS[part]})"


def value_width(register: Register, part: int) -> int:
    """Return how many of a frame's bytes a value takes."""
    return register.width if part == WHOLE else 1


def frame_fields(batch: Batch, protocol: BusProtocol, i: int, values: range) -> dict[str, Any]:
    """Return every value that frame ``i`` states; ``values`` are its rows in the batch's."""
    f, v = batch.frames, batch.values
    start, length = int(f.start[i]), int(f.length[i])
    row = view(f, i, v.register[values.start : values.stop].tolist())
    out = protocol.fields(batch.data[start : start + length], row)
    targets: dict[str, dict[str, Any]] = {}
    covered = 0
    for k in values:
        register = protocol.registers[int(v.register[k])]
        part = int(v.part[k])
        name = value_name(register, part)
        entry = value_entry(register, int(v.raw[k]), float(v.value[k]), part)
        covered += value_width(register, part)
        if int(v.servo_id[k]) == row.servo_id:
            out[name] = entry
        else:
            targets.setdefault(str(int(v.servo_id[k])), {})[name] = entry
    if targets:
        out["targets"] = targets
    elif row.address >= 0 and covered < row.data_length and "data" not in out:
        # registers no table names: shown as the bytes they are
        at = start + row.data_start
        out["data"] = batch.data[at : at + row.data_length].hex()
    return out


def value_ranges(v: Samples, n: int) -> list[int]:
    """Return for each frame where its values begin; one more entry ends the last."""
    edges: list[int] = np.searchsorted(v.row, np.arange(n + 1)).tolist()
    return edges
