"""What servos report about themselves: status bits, alarm states, values out of range, new ids."""

from __future__ import annotations

from typing import TYPE_CHECKING, Any, Final

import numpy as np

from sniffer.diagnostics.catalogue import CATALOGUE
from sniffer.diagnostics.edges import Edges
from sniffer.diagnostics.rules import anomaly
from sniffer.ground.codes import REQUEST, WHOLE
from sniffer.ground.columns import columns_of
from sniffer.ground.memory import Remembering

if TYPE_CHECKING:
    from collections.abc import Iterator, Mapping, Sequence

    from sniffer.diagnostics.learned import Change, Meaning
    from sniffer.ground.model import Anomaly, Batch, Samples
    from sniffer.protocols.base import BusProtocol, Extremes

STATUS_BITS: Final = 15
"""Status bytes have 8 bits; protocols may add bits of their own above them."""

STATUS_BYTE: Final = 0xFF


def device_code(name: str) -> str:
    """Return the code of a status name: ``device-alarm`` where it has none of its own."""
    code = f"device-{name.replace('_', '-')}"
    return code if code in CATALOGUE else "device-alarm"


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
        self._edges = [*self._status, self._outside, *alarms]

    def matters(self, at: int) -> Mapping[str, Any]:
        """Return nothing beside the edges: the others only tell where nothing is to be done."""
        del at
        return {}

    def judge(self, batch: Batch, meaning: Meaning | None = None) -> Iterator[Anomaly]:
        """Report what began, what ended, and what a servo was told about the bus."""
        if meaning is not None:
            yield from self._reset_ids(batch, meaning.resets)
        yield from self._status_bits(batch)
        v = batch.values
        if len(v):
            if self._any_outside or meaning is None or not self._is_within(meaning.extremes):
                yield from self._ranges(batch, v)
            yield from self._alarm_values(batch, v)
            yield from self._bus_changes(batch, v)

    def _at(self, batch: Batch, row: int) -> tuple[int, int]:
        return batch.base + int(batch.frames.start[row]), int(batch.frames.length[row])

    def _status_bits(self, batch: Batch) -> Iterator[Anomaly]:
        f = batch.frames
        rows = np.flatnonzero(f.status >= 0)
        if not len(rows):
            return
        status = f.status[rows].astype(np.int64)
        servo = (f.servo_id[rows] & 255).astype(np.int64)
        self._reported |= int(np.bitwise_or.reduce(status))
        for bit, edges in enumerate(self._status):
            if not self._reported >> bit & 1:
                continue
            flag = (status >> bit & 1).astype(bool)
            # An answer without a status byte (its bits lie above one) says nothing about faults.
            tells = np.flatnonzero((status <= STATUS_BYTE) | (bit >= STATUS_BYTE.bit_length()))
            rise, fall = np.zeros(len(flag), bool), np.zeros(len(flag), bool)
            rise[tells], fall[tells] = edges.feed(servo[tells], flag[tells])
            mask = 1 << bit
            if self._refusal[bit]:
                rise, fall = flag, np.zeros(len(flag), bool)  # a refusal is an event, not a state
            for i in np.flatnonzero(rise | fall).tolist():
                row, who = int(rows[i]), int(f.servo_id[rows[i]])
                name = (*self._protocol.status_names(mask), f"bit{bit}")[0]
                words, at = name.replace("_", " "), self._at(batch, row)
                if fall[i]:
                    code, text = "device-recovered", f"servo {who} no longer reports {words}"
                else:
                    code = device_code(name)
                    text = f"servo {who} reports {words} (status {int(status[i]):02X})"
                yield anomaly(code, int(f.t_end[row]), who, text, at)

    def _is_within(self, extremes: Mapping[int, Extremes] | None) -> bool:
        """Tell whether no value can be out of range, as the extremes of none are."""
        low, high = self._known.low, self._known.high
        return extremes is not None and all(
            low[k] <= least and most <= high[k] for k, (least, most) in extremes.items()
        )

    def _ranges(self, batch: Batch, v: Samples) -> Iterator[Anomaly]:
        """Report what was written out of range each time, what was measured when it begins."""
        register = v.register.astype(np.intp)  # as numpy looks up fastest
        if not self._any_outside:
            out = (v.raw < self._known.low[register]) | (v.raw > self._known.high[register])
            if not out.any():
                return
        mine = np.flatnonzero(self._known.has_range[register] & (v.part == WHOLE))
        if not len(mine):
            return
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
        rise = mine[rise]
        for i in rise.tolist():
            r = self._protocol.registers[int(v.register[i])]
            low, high = r.range or (0, 0)
            who, row = int(v.servo_id[i]), int(v.row[i])
            text = f"{r.name} is {int(v.raw[i])}, the manual has {low}..{high}"
            yield anomaly("value-out-of-range", int(v.t_ns[i]), who, text, self._at(batch, row))

    def _alarm_values(self, batch: Batch, v: Samples) -> Iterator[Anomaly]:
        for index, (register, edges) in self._alarms.items():
            mine = np.flatnonzero((v.register == index) & v.accepted)
            servo = (v.servo_id[mine] & 255).astype(np.int64)
            for raw, one in zip(register.alarms, edges, strict=True):
                rise, fall = one.feed(servo, v.raw[mine] == raw)
                name = register.values.get(raw, f"{register.name} {raw}")
                for i in np.flatnonzero(rise | fall).tolist():
                    k = int(mine[i])
                    who, at = int(v.servo_id[k]), self._at(batch, int(v.row[k]))
                    words = name.replace("_", " ")
                    if rise[i]:
                        yield anomaly(
                            device_code(name),
                            int(v.t_ns[k]),
                            who,
                            f"servo {who} reports {words}",
                            at,
                        )
                    else:
                        text = f"servo {who} no longer reports {words}"
                        yield anomaly("device-recovered", int(v.t_ns[k]), who, text, at)

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
        for i in np.flatnonzero(told).tolist():
            r = self._known.effects[int(v.register[i])]
            who, raw, at = int(v.servo_id[i]), int(v.raw[i]), self._at(batch, int(v.row[i]))
            if r.effect == "servo_id":
                if raw != who:
                    text = f"servo {who} was given the id {raw}"
                    yield anomaly("id-changed", int(v.t_ns[i]), who, text, at)
            else:
                rate = r.values.get(raw, str(raw))
                text = f"servo {who} was told the baud rate {rate} (code {raw})"
                yield anomaly("baud-changed", int(v.t_ns[i]), who, text, at)
