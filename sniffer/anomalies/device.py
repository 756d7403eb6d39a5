"""What servos report about themselves: status bits, alarm states, values out of range, new ids."""

from __future__ import annotations

from typing import TYPE_CHECKING, Any, Final

import numpy as np

from sniffer.anomalies.catalogue import CATALOGUE
from sniffer.anomalies.edges import Edges
from sniffer.anomalies.found import NONE, NUMBER, Anomalies
from sniffer.anomalies.rules import anomaly, of_frames
from sniffer.ground.codes import REQUEST, WHOLE
from sniffer.ground.columns import columns_of
from sniffer.ground.memory import Remembering
from sniffer.protocols.ids import shared_ids
from sniffer.protocols.reports import error_number, meaning_of

if TYPE_CHECKING:
    from collections.abc import Iterator, Mapping, Sequence

    from sniffer.anomalies.learned import Change, Meaning
    from sniffer.ground.model import I16, I64, Anomaly, Batch, Mask, Samples
    from sniffer.ground.registers import Register
    from sniffer.protocols.base import BusProtocol, Extremes

STATUS_BITS: Final = 15
"""Status bytes have 8 bits; protocols may add bits of their own above them."""

STATUS_BYTE: Final = 0xFF


def device_code(name: str) -> str:
    """Return the code of a status name: ``device-alarm`` where it has none of its own."""
    code = f"device-{name.replace('_', '-')}"
    return code if code in CATALOGUE else "device-alarm"


def _reported(
    batch: Batch,
    name: str,
    slug: str,
    rows: I64,
    t_ns: I64,
    servo_id: I16,
    is_over: Mask,
    status: I64 | None,
) -> Anomalies:
    """Return what frames report of a fault, and that it is over; ``status``: the bytes, if any."""
    words = name.replace("_", " ")

    def tell(mine: Sequence[int]) -> list[str]:
        behind = [""] * len(mine)
        if status is not None:
            behind = [f" (status {byte:02X})" for byte in status[mine].tolist()]
        return [
            f"servo {who} no longer reports {words}"
            if over
            else f"servo {who} reports {words}{more}"
            for who, over, more in zip(
                servo_id[mine].tolist(), is_over[mine].tolist(), behind, strict=True
            )
        ]

    code = np.where(is_over, NUMBER["device-recovered"], NUMBER[slug])
    return of_frames(batch, rows, code, t_ns, servo_id, tell)


def _out_of_range(register: Register, raw: int) -> str:
    low, high = register.range or (0, 0)
    return f"{register.name} is {raw}, the manual has {low}..{high}"


class DeviceRules(Remembering):
    """Remembers which faults each servo is reporting."""

    LASTING = ("_reported", "_any_outside")
    PARTS = ("_edges",)

    def __init__(self, protocol: BusProtocol) -> None:
        self._protocol = protocol
        self._known = known = columns_of(protocol.registers)
        self._status = [Edges(256) for _ in range(STATUS_BITS)]
        self._reported = 0  # bits any servo has set so far
        bits = np.array([1 << bit for bit in range(STATUS_BITS)], np.int16)
        self._refusal = protocol.refused(bits).tolist()
        self._outside = Edges(256 * len(known.low))
        self._any_outside = False
        self._alarms = {i: (r, [Edges(256) for _ in r.alarms]) for i, r in known.alarms.items()}
        alarms = [one for _, edges in self._alarms.values() for one in edges]
        self._number = error_number(protocol)
        self._numbers = Edges(256, np.int64)
        self._edges = [*self._status, self._numbers, self._outside, *alarms]

    def matters(self, at: int) -> Mapping[str, Any]:
        """Return nothing beside the edges: the others only tell where nothing is to be done."""
        del at
        return {}

    def judge(self, batch: Batch, meaning: Meaning | None = None) -> Iterator[Anomalies]:
        """Report what began, what ended, and what a servo was told about the bus."""
        if meaning is not None:
            yield Anomalies.of([*self._reset_ids(batch, meaning.resets)])
        yield from self._status_bits(batch)
        v = batch.values
        if len(v):
            if self._any_outside or meaning is None or not self._is_within(meaning.extremes):
                yield self._ranges(batch, v)
            yield from self._alarm_values(batch, v)
            yield Anomalies.of([*self._bus_changes(batch, v)])

    def _at(self, batch: Batch, row: int) -> tuple[int, int]:
        return batch.base + int(batch.frames.start[row]), int(batch.frames.length[row])

    def _status_bits(self, batch: Batch) -> Iterator[Anomalies]:
        f = batch.frames
        rows = np.flatnonzero(f.status >= 0)
        if not len(rows):
            return
        status = f.status[rows].astype(np.int64)
        servo = (f.servo_id[rows] & 255).astype(np.int64)
        self._reported |= int(np.bitwise_or.reduce(status))
        if self._reported & self._number:
            yield from self._status_numbers(batch, rows, servo, status)
        for bit, edges in enumerate(self._status):
            if not (self._reported & ~self._number) >> bit & 1:
                continue
            flag = (status >> bit & 1).astype(bool)
            # An answer without a status byte (its bits lie above one) says nothing about faults.
            tells = np.flatnonzero((status <= STATUS_BYTE) | (bit >= STATUS_BYTE.bit_length()))
            rise, fall = np.zeros(len(flag), bool), np.zeros(len(flag), bool)
            rise[tells], fall[tells] = edges.feed(servo[tells], flag[tells])
            mask = 1 << bit
            if self._refusal[bit]:
                rise, fall = flag, np.zeros(len(flag), bool)  # a refusal is an event, not a state
            turned = np.flatnonzero(rise | fall)
            if len(turned):
                name = (*self._protocol.status_names(mask), f"bit{bit}")[0]
                row = rows[turned]
                columns = f.t_end[row], f.servo_id[row], fall[turned], status[turned]
                yield _reported(batch, name, self._code(name), row, *columns)

    def _code(self, name: str) -> str:
        return device_code(meaning_of(self._protocol, name))

    def _status_numbers(
        self, batch: Batch, rows: I64, servo: I64, status: I64
    ) -> Iterator[Anomalies]:
        """Report errors that are numbers: a refusal each time, others where they begin and end."""
        f, number = batch.frames, np.where(status <= STATUS_BYTE, status & self._number, 0)
        refused = self._protocol.refused(number.astype(np.int16)) & (number > 0)
        rise, fall = self._numbers.feed(servo, np.where(refused, 0, number))
        rise |= refused
        for one in np.unique(number[rise]).tolist():
            mine = np.flatnonzero(rise & (number == one))
            name = (*self._protocol.status_names(one), f"error {one}")[0]
            row, is_over = rows[mine], np.zeros(len(mine), bool)
            columns = f.t_end[row], f.servo_id[row], is_over, status[mine]
            yield _reported(batch, name, self._code(name), row, *columns)
        over = np.flatnonzero(fall)
        if len(over):
            row = rows[over]
            columns = f.t_end[row], f.servo_id[row], fall[over], status[over]
            yield _reported(batch, "an error", "device-alarm", row, *columns)

    def _is_within(self, extremes: Mapping[int, Extremes] | None) -> bool:
        """Tell whether no value can be out of range, as the extremes of none are."""
        low, high = self._known.low, self._known.high
        return extremes is not None and all(
            low[k] <= least and most <= high[k] for k, (least, most) in extremes.items()
        )

    def _ranges(self, batch: Batch, v: Samples) -> Anomalies:
        """Report what was written out of range each time, what was measured when it begins."""
        register = v.register.astype(np.intp)  # as numpy looks up fastest
        if not self._any_outside:
            out = (v.raw < self._known.low[register]) | (v.raw > self._known.high[register])
            if not out.any():
                return NONE
        mine = np.flatnonzero(self._known.has_range[register] & (v.part == WHOLE))
        if not len(mine):
            return NONE
        register, raw = register[mine], v.raw[mine]
        outside = (raw < self._known.low[register]) | (raw > self._known.high[register])
        for i, codes in self._known.special.items():
            outside &= ~((register == i) & np.isin(raw, codes))
        written = batch.frames.kind[v.row[mine]] == REQUEST
        rise = outside & written
        measured = np.flatnonzero(~written)
        key = (v.servo_id[mine[measured]] & 255).astype(np.int64) * len(self._known.low)
        rise[measured] = self._outside.feed(key + register[measured], outside[measured])[0]
        self._any_outside |= bool(outside.any())
        out_of = mine[rise]
        registers = self._protocol.registers

        def tell(some: Sequence[int]) -> list[str]:
            at = out_of[some]
            told = zip(v.register[at].tolist(), v.raw[at].tolist(), strict=True)
            return [_out_of_range(registers[number], value) for number, value in told]

        code = np.full(len(out_of), NUMBER["value-out-of-range"])
        return of_frames(batch, v.row[out_of], code, v.t_ns[out_of], v.servo_id[out_of], tell)

    def _alarm_values(self, batch: Batch, v: Samples) -> Iterator[Anomalies]:
        for index, (register, edges) in self._alarms.items():
            mine = np.flatnonzero((v.register == index) & v.accepted)
            servo = (v.servo_id[mine] & 255).astype(np.int64)
            for raw, one in zip(register.alarms, edges, strict=True):
                now = v.raw[mine]
                rise, fall = one.feed(servo, now >> raw & 1 > 0 if register.bits else now == raw)
                name = (register.bits or register.values).get(raw, f"{register.name} {raw}")
                turned = np.flatnonzero(rise | fall)
                if len(turned):
                    k = mine[turned]
                    columns = v.t_ns[k], v.servo_id[k], fall[turned], None
                    yield _reported(batch, name, self._code(name), v.row[k], *columns)

    def _reset_ids(self, batch: Batch, resets: Sequence[Change]) -> Iterator[Anomaly]:
        for c in resets:
            if c.value != c.named:
                to_all = c.named in self._protocol.everyone
                who = "all servos were" if to_all else f"servo {c.named} was"
                text = f"{who} given the id {c.value} by a factory reset"
                t_ns = int(batch.frames.t_end[c.row])
                yield anomaly("id-changed", t_ns, c.named, text, self._at(batch, c.row))

    def _bus_changes(self, batch: Batch, v: Samples) -> Iterator[Anomaly]:
        if not self._known.effects:
            return
        told = self._known.has_effect[v.register.astype(np.intp)]
        if not told.any():
            return
        told &= v.accepted & (v.part == WHOLE)
        told &= batch.frames.kind[v.row] == REQUEST
        shared = shared_ids(self._protocol)
        for i in np.flatnonzero(told).tolist():
            r = self._known.effects[int(v.register[i])]
            who, raw, at = int(v.servo_id[i]), int(v.raw[i]), self._at(batch, int(v.row[i]))
            whom = f"all servos ({who}) were" if who in shared else f"servo {who} was"
            if r.effect == "servo_id":
                if raw != who:
                    text = f"{whom} given the id {raw}"
                    yield anomaly("id-changed", int(v.t_ns[i]), who, text, at)
            else:
                rate = r.values.get(raw)
                named = f"of code {raw}" if rate is None else f"{rate} (code {raw})"
                text = f"{whom} told the baud rate {named}"
                yield anomaly("baud-changed", int(v.t_ns[i]), who, text, at)
