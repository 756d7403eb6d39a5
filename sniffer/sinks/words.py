"""Values, times and frames in words, as tables for people have them."""

from __future__ import annotations

from typing import TYPE_CHECKING, Any

from sniffer.decoding.fields import frame_fields
from sniffer.ground.codes import WHOLE
from sniffer.ground.model import NS
from sniffer.ground.wording import plain

if TYPE_CHECKING:
    from sniffer.ground.model import Batch
    from sniffer.ground.registers import Register
    from sniffer.protocols.base import BusProtocol


def short_value(register: Register, raw: int, value: float) -> str:
    """Return a register value as the table shows it: with its unit, its name, or plainly."""
    names = register.names(raw)
    if names is not None:
        return ",".join(names) or "none" if isinstance(names, list) else names
    if value != value:  # NaN: nothing in units
        return f"raw {raw}"
    if register.unit:
        unit = "°C" if register.unit == "degC" else register.unit
        return f"{value:.4g} {unit}" if abs(value) < 1000 else f"{value:.0f} {unit}"
    return f"{value:.10g}"


def fit(text: str, width: int) -> str:
    """Cut or pad to a width; a list loses whole items, bytes whole bytes."""
    if len(text) <= width:
        return text.ljust(width)
    for between in (", ", " "):
        at = text.rfind(between, 0, width - 1)
        if at > 0:
            return (text[: at + len(between)] + "…").ljust(width)
    return text[: width - 1] + "…"


def values_in_words(protocol: BusProtocol, batch: Batch, i: int, values: range) -> str:
    """Return what frame ``i`` states in a line; ``values`` are its rows in the batch's."""
    f, v = batch.frames, batch.values
    own = int(f.servo_id[i])
    mine: list[str] = []
    others: dict[int, list[str]] = {}
    for k in values:
        number = int(v.register[k])
        register = protocol.registers[number]
        who = int(v.servo_id[k])
        text = short_value(register, int(v.raw[k]), float(v.value[k]))
        if int(v.part[k]) != WHOLE:
            text = f"raw {int(v.raw[k])} (part)"
        if who == own or who < 0:
            mine.append(f"{register.name.removeprefix('present_')} {text}")
        else:
            others.setdefault(number, []).append(f"{who}: {text}")
    told = mine
    for number in sorted(others, key=lambda r: not protocol.registers[r].unit):
        first, *rest = others[number]
        told += [f"{protocol.registers[number].name} {first}", *rest]
    status = int(f.status[i])
    if status > 0:
        told.insert(0, "+".join(protocol.status_names(status)).replace("_", " "))
    if not told:
        op = protocol.op_name(int(f.op[i]))
        fields = frame_fields(batch, protocol, i, values)
        if fields.get("text") == fields.get("value"):
            fields = {k: x for k, x in fields.items() if k != "value"}
        told = [text for k, x in fields.items() if (text := _plainly(k, x, op, own))]
    return ", ".join(told)


def took_in_words(ns: int, spread: int, word: str) -> str:
    """Return a reply time; shorter than the clock can tell, it is a bound."""
    if ns < 0:
        return "ok"
    if spread > ns:
        return f"<{(ns + spread) / 1e6:.2f} ms"
    digits = 0 if ns >= 100 * NS // 1000 else 1 if word else 2
    return f"{word}{ns / 1e6:.{digits}f} ms"


def _plainly(key: str, value: Any, op: str, servo_id: int) -> str:
    """Return a field in words; nothing where another column says it, or where nothing is set."""
    if isinstance(value, dict):
        if "names" in value:
            names = "+".join(map(str, value["names"]))
            return f"{key} {names}" if names else ""
        return f"{key} {value.get('name', value.get('value', value.get('raw', value)))}"
    if value is True:
        return key
    if (
        value is None
        or value is False
        or value in ("", op)
        or (key in ("id", "servo_id") and value == servo_id)
    ):
        return ""
    return plain(f"{key} {value}")
