"""Values, times and frames in words, as tables for people have them."""

from __future__ import annotations

import itertools
from typing import TYPE_CHECKING, Any

import numpy as np

from sniffer.decoding.fields import frame_fields, value_ranges
from sniffer.ground.codes import WHOLE
from sniffer.ground.model import NS
from sniffer.ground.units import word_of
from sniffer.ground.wording import plain
from sniffer.sinks.kept import Kept, OfProtocol, packed

if TYPE_CHECKING:
    from collections.abc import Iterable, Iterator, Mapping, Sequence

    from sniffer.ground.model import Batch, Samples
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
        unit = word_of(register.unit)
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


def laid_out(
    cells: Sequence[str], widths: Sequence[int], whole: int | None, *, is_cut: bool
) -> str:
    """Return cells beside each other, each as wide as its column.

    Args:
        cells: what stands in them.
        widths: those of the columns.
        whole: the cell that is never cut: what it lacks the next one gives; None: there is none.
        is_cut: whether what is longer than its column is cut.
    """
    if not is_cut:
        return " ".join(map(str.ljust, cells, widths))
    room = [*widths]
    if whole is not None:
        given = min(max(len(cells[whole]) - room[whole], 0), room[whole + 1] - 1)
        room[whole : whole + 2] = room[whole] + given, room[whole + 1] - given
    return " ".join(map(fit, cells, room))


def told_apart(shown: Mapping[str, str], room: int) -> dict[str, str]:
    """Return names that have room, by what they are of: where they begin alike, their ends."""
    begins = {one: fit(name, room).rstrip() for one, name in shown.items()}
    ends = {one: n if len(n) <= room else f"…{n[1 - room :]}" for one, n in shown.items()}
    return max(begins, ends, key=lambda names: len(set(names.values())))


def _value(register: Register, raw: int, value: float, part: int) -> str:
    return short_value(register, raw, value) if part == WHOLE else f"raw {raw} (part)"


def _named(register: Register, text: str) -> str:
    """Return a value behind the name of its register; once where they are one word: moving."""
    name = register.name.removeprefix("present_")
    return text if text == name else f"{name} {text}"


def errors_in_words(protocol: BusProtocol, status: int) -> str:
    """Return what a servo complains of."""
    return "+".join(protocol.status_names(status)).replace("_", " ")


def values_in_words(protocol: BusProtocol, batch: Batch, i: int, values: range) -> str:
    """Return what frame ``i`` states in a line; ``values`` are its rows in the batch's."""
    f = batch.frames
    own = int(f.servo_id[i])
    told = _stated(protocol, batch, i, values)
    status = int(f.status[i])
    if status > 0:
        told.insert(0, errors_in_words(protocol, status))
    if not told:
        op = protocol.op_name(int(f.op[i]))
        fields = frame_fields(batch, protocol, i, values)
        if fields.get("text") == fields.get("value"):
            fields = {k: x for k, x in fields.items() if k != "value"}
        told = [text for k, x in fields.items() if (text := _plainly(k, x, op, own))]
    return ", ".join(told)


def selected_in_words(protocol: BusProtocol, batch: Batch) -> dict[int, str]:
    """Return, of frames that are shown for some of their values only, these values in a line."""
    if batch.chosen is None:
        return {}
    mine = np.flatnonzero(batch.chosen("samples") & ~batch.chosen("frames")[batch.values.row])
    row = batch.values.row[mine]
    edges = np.flatnonzero(np.diff(row, prepend=-1, append=-1)).tolist()
    return {
        int(row[a]): ", ".join(_stated(protocol, batch, int(row[a]), mine[a:b].tolist()))
        for a, b in itertools.pairwise(edges)
    }


def _stated(protocol: BusProtocol, batch: Batch, i: int, values: Iterable[int]) -> list[str]:
    """Return some of the values of frame ``i``, those of its own servo first."""
    v = batch.values
    own = int(batch.frames.servo_id[i])
    mine: list[str] = []
    others: dict[int, list[str]] = {}
    for k in values:
        number = int(v.register[k])
        register = protocol.registers[number]
        who = int(v.servo_id[k])
        text = _value(register, int(v.raw[k]), float(v.value[k]), int(v.part[k]))
        if who == own or who < 0:
            mine.append(_named(register, text))
        else:
            others.setdefault(number, []).append(f"{who}: {text}")
    told = mine
    for number in sorted(others, key=lambda r: not protocol.registers[r].unit):
        first, *rest = others[number]
        told += [f"{protocol.registers[number].name} {first}", *rest]
    return told


class FrameWords(OfProtocol):
    """What frames of a protocol state, in words, batch by batch: as ``values_in_words`` says it."""

    def __init__(self, protocol: BusProtocol) -> None:
        super().__init__(protocol)
        self._values: Kept[str] = Kept(len)
        self._frames: Kept[str] = Kept(len)

    def told(self, batch: Batch, rows: Sequence[int]) -> Iterator[str]:
        """Yield what some of the frames state."""
        f, v, protocol = batch.frames, batch.values, self.protocol
        edges = value_ranges(v, len(f))
        stating = any(edges[i] < edges[i + 1] for i in rows)
        values = self.each_value(v) if stating else []
        columns, size = packed(batch, f.length)
        own = v.servo_id == f.servo_id[v.row]
        plain = np.ones(len(f), bool)
        plain[v.row[~own & (v.servo_id >= 0)]] = False
        asked = (c[rows].tolist() for c in (f.start, f.end, f.status, plain))
        for i, start, end, status, is_plain in zip(rows, *asked, strict=True):
            a, b = edges[i], edges[i + 1]
            if not is_plain:
                yield values_in_words(protocol, batch, i, range(a, b))
            elif status > 0:
                yield ", ".join([errors_in_words(protocol, status), *values[a:b]])
            elif a < b:
                yield values[a] if b - a == 1 else ", ".join(values[a:b])
            else:
                key = columns[i * size : i * size + size], batch.data[start:end]
                found = self._frames.known.get(key)
                if found is None:  # not where it states nothing: that is known, too
                    found = self._frames.again(key)
                if found is None:
                    words = values_in_words(protocol, batch, i, range(a, b))
                    found = self._frames.keep(key, words)
                yield found

    def each_value(self, v: Samples) -> list[str]:
        """Return each value with the name of its register."""
        known = self._values.known
        kind = v.register.astype(np.int64) << 8 | v.part
        bits = np.ascontiguousarray(v.value).view(np.int64)  # not a number equals nothing
        keys = list(zip(kind.tolist(), v.raw.tolist(), bits.tolist(), strict=True))
        out = []
        for k, (found, key) in enumerate(zip(map(known.get, keys), keys, strict=True)):
            words = found or self._values.again(key)
            if words is None:
                register = self.protocol.registers[key[0] >> 8]
                text = _value(register, key[1], float(v.value[k]), key[0] & 0xFF)
                words = _named(register, text)
                self._values.keep(key, words)
            out.append(words)
        return out


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
