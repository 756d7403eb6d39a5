"""What the JSON lines of one protocol are made of: pieces of text, kept by what they depend on.

Values and the heads of frames come again and again. The pieces are cut from the lines of rows, so
keys and their order are written down once, in ``decoding.rows``.
"""

from __future__ import annotations

import json
import math
from typing import TYPE_CHECKING, Any, Final, NamedTuple

import numpy as np

from sniffer.decoding.fields import frame_fields, tidy, value_entry, value_name, value_width
from sniffer.decoding.rows import (
    GapRow,
    SampleRow,
    TransactionRow,
    anomaly_row,
    as_dict,
    frame_row,
)
from sniffer.ground.codes import OUTCOMES, PARTS, PROVENANCES, ROLES, WHOLE
from sniffer.ground.model import Clock
from sniffer.protocols.base import view
from sniffer.sinks.kept import Kept, OfProtocol

if TYPE_CHECKING:
    from collections.abc import Hashable, Sequence

    from sniffer.decoding.rows import Row
    from sniffer.ground.model import Anomaly, Batch, Samples
    from sniffer.ground.registers import Register
    from sniffer.protocols.base import BusProtocol

SHAPES_MOST: Final = 1 << 12
"""Forms of a frame's or a transaction's line that are kept."""

FRAME: Final = ("t_ns", "offset", "length", "hex", "fields", "t_start_ns", "uncertainty_ns")
SAMPLE: Final = ("t_ns", "servo_id", "raw", "value", "name", "offset")
TRANSACTION: Final = (
    *("request_offset", "response_offset"),
    *("response_time_ns", "uncertainty_ns"),
)
"""Keys of what differs from one line of a kind to the next, in order."""

GAP: Final = ("t_ns", "offset", "length", "hex", "detail")
ANOMALY: Final = ("t_ns", "servo_id", "detail", "evidence")

JOINED, BARE, LEFTOVER, OTHERS, SLOWLY = range(5)
"""How register values join the fields that the protocol tells: behind them; there are none of the
protocol's; behind all comes the data, of which some is no register's; some values are of other
servos; or two have one name, and the fields are made as those of a row are."""

encode: Final = json.JSONEncoder(separators=(",", ":"), ensure_ascii=False, allow_nan=False).encode


def cut(row: Row, holes: Sequence[str]) -> list[str]:
    """Return a row's line as the pieces around the values of some keys."""
    pieces: list[str] = []
    text, between = "{", ""
    run: dict[str, Any] = {}
    for key, value in as_dict(row).items():
        if key not in holes:
            run[key] = value
            continue
        if run:
            text += between + encode(run)[1:-1]
            run, between = {}, ","
        pieces.append(f"{text}{between}{encode(key)}:")
        text, between = "", ","
    pieces.append(text + (between + encode(run)[1:-1] if run else "") + "}\n")
    return pieces


class Head(NamedTuple):
    """A frame's line around its register values, from behind its bytes on."""

    before: str
    behind: str
    end: str
    form: int


class ValueText(NamedTuple):
    """A register value as a sample's line, from its servo to its place, and among fields.

    The field has the comma before it.
    """

    sample: str
    field: str


class _ValueKind(NamedTuple):
    """What values of one kind have in common; ``unit`` is empty where none is told."""

    register: Register
    part: int
    sample: tuple[str, ...]
    name: str
    unit: str


class LineTexts(OfProtocol):
    """The pieces of a protocol."""

    def __init__(self, protocol: BusProtocol) -> None:
        super().__init__(protocol)
        self.heads: Kept[Head] = Kept(lambda head: len(head.before))
        self._values: Kept[ValueText] = Kept(lambda told: len(told.sample) + len(told.field))
        self._kinds: dict[int, _ValueKind] = {}
        self._shapes: dict[tuple[Hashable, ...], list[str]] = {}
        self._transactions: dict[tuple[int, int, int], list[str]] = {}
        self._rare: dict[tuple[Hashable, ...], list[str]] = {}

    def values(self, v: Samples) -> list[ValueText]:
        """Return how each value reads."""
        known = self._values.known
        kind = v.register.astype(np.int64)
        for code in (v.role, v.provenance, v.part):
            kind = kind << 8 | code
        bits = np.ascontiguousarray(v.value).view(np.int64)  # equal floats may read differently
        keys = list(zip(kind.tolist(), v.raw.tolist(), bits.tolist(), strict=True))
        found = list(map(known.get, keys))
        return [
            told or known.get(keys[k]) or self._value(keys[k], v, k) for k, told in enumerate(found)
        ]

    def _value(self, key: tuple[int, int, int], v: Samples, k: int) -> ValueText:
        found = self._values.again(key)
        if found is not None:
            return found
        kind, raw, _ = key
        of = self._kinds.get(kind)
        if of is None:
            of = self._kinds[kind] = self._kind(v, k)
        stated = float(v.value[k])
        value = tidy(stated)
        number = repr(value) if value is not None and math.isfinite(value) else encode(value)
        names = of.register.names(raw) if of.part == WHOLE else None
        if names is not None:
            name, entry = encode(names), encode(value_entry(of.register, raw, stated, of.part))
        else:  # most, and five times as fast
            name = "null"
            in_units = f',"value":{number}{of.unit}' if of.unit else ""
            entry = f'{{"raw":{raw}{in_units}}}'
        _, of_raw, of_value, of_name, behind = of.sample
        told = ValueText(f"{of_raw}{raw}{of_value}{number}{of_name}{name}{behind}", of.name + entry)
        return self._values.keep(key, told)

    def _kind(self, v: Samples, k: int) -> _ValueKind:
        register, part = self.protocol.registers[int(v.register[k])], int(v.part[k])
        _, *sample, _ = cut(self.sample("", None, v, k), SAMPLE)
        unit = f',"unit":{encode(register.unit)}' if part == WHOLE and register.unit else ""
        name = f",{encode(value_name(register, part))}:"
        return _ValueKind(register, part, tuple(sample), name, unit)

    def sample(self, bus: str, beside: str | None, v: Samples, k: int) -> SampleRow:
        """Return a value as a row, but for what differs from one to the next."""
        r = self.protocol.registers[int(v.register[k])]
        return SampleRow(
            *(bus, 0, None, r.name, r.quantity, ROLES[int(v.role[k])], 0, None, r.unit),
            *(PROVENANCES[int(v.provenance[k])], None, PARTS[int(v.part[k])] or None, 0, beside),
        )

    def transaction(self, servo: int, op: int, outcome: int) -> list[str]:
        """Return the pieces of a transaction's line behind its bus; the last may have more."""
        key = servo, op, outcome
        found = self._transactions.get(key)
        if found is None:
            if len(self._transactions) >= SHAPES_MOST:
                self._transactions.clear()
            who, name = servo if servo >= 0 else None, self.protocol.op_name(op)
            row = TransactionRow("", None, None, who, name, OUTCOMES[outcome], None, None)
            found = self._transactions[key] = cut(row, TRANSACTION)
        return found

    def gap(self, bus: str, reason: str, clock: int, beside: str | None) -> list[str]:
        """Return the pieces of a gap's line."""
        key = bus, reason, clock, beside
        found = self._rare.get(key)
        if found is None:
            named = Clock(clock).name.lower()
            found = self._keep(key, GapRow(bus, 0, 0, 0, "", reason, {}, named, beside), GAP)
        return found

    def anomaly(self, bus: str, a: Anomaly, beside: str | None) -> list[str]:
        """Return the pieces of an anomaly's line; most of it is what the catalogue says."""
        key = bus, a.code, a.severity, a.group, a.remedy, beside
        found = self._rare.get(key)
        if found is None:
            found = self._keep(key, anomaly_row(a, bus, beside), ANOMALY)
        return found

    def _keep(self, key: tuple[Hashable, ...], row: Row, holes: Sequence[str]) -> list[str]:
        if len(self._rare) >= SHAPES_MOST:
            self._rare.clear()
        found = self._rare[key] = cut(row, holes)
        return found

    def head(self, key: Hashable, batch: Batch, i: int, values: range) -> Head:
        """Return the head of frame ``i``, and keep it for those that have its key."""
        found = self.heads.again(key)
        if found is not None:
            return found
        f, v, protocol = batch.frames, batch.values, self.protocol
        start = int(f.start[i])
        numbers = v.register[values.start : values.stop].tolist()
        row = view(f, i, numbers)
        raw = batch.data[start : start + int(f.length[i])]
        fields = protocol.fields(raw, row)
        read = [
            (protocol.registers[r], part)
            for r, part in zip(numbers, v.part[values.start : values.stop].tolist(), strict=True)
        ]
        names = {value_name(register, part) for register, part in read}
        own = encode(fields)[1:-1]
        form = JOINED if own else BARE
        if (v.servo_id[values.start : values.stop] != row.servo_id).any():
            form = OTHERS
        elif len(names) < len(read):
            form = SLOWLY
        elif row.address >= 0 and "data" not in fields:
            covered = sum(value_width(register, part) for register, part in read)
            form = LEFTOVER if covered < row.data_length else form
        if names & {*fields, "targets", "data"} or "targets" in fields:
            form = SLOWLY
        shape = (
            *(row.kind, row.servo_id, row.op, row.flags, int(f.direction[i]), batch.clock),
            protocol.checksum_of(raw) is None,
        )
        pieces = self._shapes.get(shape)
        if pieces is None:
            if len(self._shapes) >= SHAPES_MOST:
                self._shapes.clear()
            cuts = cut(frame_row(batch, protocol, "", i, {}), FRAME)
            pieces = self._shapes[shape] = [f'"{cuts[4]}{{', "}" + cuts[5], cuts[7]]
        before, behind, end = pieces
        told = Head(before + own * (form != SLOWLY), behind, end, form)
        return self.heads.keep(key, told)

    def inner(self, head: Head, batch: Batch, i: int, values: range, told: Sequence[str]) -> str:
        """Return the fields of frame ``i`` behind the protocol's; they are not just joined."""
        if head.form == SLOWLY:
            return encode(frame_fields(batch, self.protocol, i, values))[1:-1]
        if head.form == LEFTOVER:
            f = batch.frames
            at, size = int(f.data_start[i]), int(f.data_length[i])
            text = "".join(told[values.start : values.stop])
            text += f',"data":"{batch.data[at : at + size].hex()}"'
        else:
            text = self._others(batch, i, values, told)
        return text[1:] if head.before.endswith("{") else text

    def _others(self, batch: Batch, i: int, values: range, told: Sequence[str]) -> str:
        """Return values of which some are other servos'.

        What is told twice of a servo counts as it does in a row: the last, where the first stood.
        """
        v, registers = batch.values, self.protocol.registers
        who, stated = int(batch.frames.servo_id[i]), slice(values.start, values.stop)
        columns = (v.servo_id[stated], v.register[stated], v.part[stated])
        own: dict[str, str] = {}
        targets: dict[int, dict[str, str]] = {}
        for text, servo, register, part in zip(
            told[stated], *(c.tolist() for c in columns), strict=True
        ):
            of = own if servo == who else targets.setdefault(servo, {})
            of[value_name(registers[register], part)] = text
        each = (f'"{s}":{{{"".join(of.values())[1:]}}}' for s, of in targets.items())
        return f'{"".join(own.values())},"targets":{{{",".join(each)}}}'
