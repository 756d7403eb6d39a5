"""The values of the slow decoder: one frame at a time, by all that the frames before it told.

Register modes, the tables of models, staged writes and new ids are followed in the obvious way.
"""

from __future__ import annotations

import math
from typing import TYPE_CHECKING

import numpy as np

from sniffer.anomalies.evidence import Evidence, loose_counts
from sniffer.ground.clues import Clues
from sniffer.ground.codes import ASSUMED, OBSERVED, REQUEST, WHOLE
from sniffer.ground.model import ECHO, RELEASES, RESETS, STAGED
from sniffer.ground.registers import scale_limit
from sniffer.protocols.base import BusProtocol, SlowFrame, State

if TYPE_CHECKING:
    from collections.abc import Mapping

    from sniffer.ground.model import Mask

SampleRow = tuple[int, int, int, int, int, str, int, int, int, bool]


class SlowValues:
    """What the registers of a bus hold; ``samples`` are those of all frames read so far."""

    def __init__(self, protocol: BusProtocol, models: Mapping[int | None, str] | None) -> None:
        self.protocol = protocol
        self.state = State(protocol, models)
        self.clues = Clues(protocol.models)
        self.evidence = Evidence(protocol, self.state)
        self.staged: dict[tuple[int, str], tuple[int, int, int]] = {}
        self.moves: list[tuple[int, int]] = []
        self.samples: list[SampleRow] = []

    def refused(self, status: int) -> bool:
        """Tell whether a servo's status says that it did not do as it was told."""
        return bool(self.protocol.refused(np.array([status], np.int16))[0])

    def read(
        self, f: SlowFrame, t_ns: int, answers: bool, accepted: bool, answered_by: int
    ) -> list[tuple[int, int, int]]:
        """Record the samples of one frame; return what it tells about return modes.

        That is (servo or -1 for all, mode, new id or -1).
        """
        if (f.kind != REQUEST and not answers) or f.flags & ECHO:
            return []
        told: list[tuple[int, int, int]] = []
        registers = self.protocol.registers
        self._weigh(f, accepted)
        rows = self.protocol.slow_values(f, self.state) if f.data else []
        loose = self._loose(f)
        for n, (servo, index, raw, part) in enumerate(rows):
            r = registers[index]
            sound = part == WHOLE and accepted
            value, provenance = self._scaled(servo, index, raw, sound=sound)
            if part != WHOLE or raw in r.special:
                value = math.nan
            stated = (servo, index, r.role, raw, repr(float(value)), provenance, part)
            self.samples.append((t_ns, *stated, f.start, accepted))
            asked = f.kind == REQUEST
            to_all = asked and servo in self.protocol.everyone
            if not sound:
                continue
            known = not asked and loose_counts(int(self.state.origin[servo & 255]))
            if r.name in self.state.modes and loose and loose[n] and not known:
                continue
            source = servo
            if r.effect == "servo_id":
                if not asked or not 0 <= raw <= 255:
                    continue
                others = (-1, raw, *self.protocol.everyone)
                source = answered_by if to_all and answered_by not in others else servo
            if f.flags & STAGED:
                key = servo, r.name if r.name in self.state.modes else r.effect
                self.staged.pop(key, None)
                self.staged[key] = index, source, raw
            else:
                self._take(index, servo, source, raw, told, to_all=to_all)
        everyone = self.protocol.everyone
        if accepted and f.flags & RESETS:
            told.append((-1 if f.servo_id in everyone else f.servo_id, -1, -1))
            self._forget(slice(None) if f.servo_id in everyone else f.servo_id & 255)
            if f.alt_id >= 0 and f.servo_id not in everyone:
                self._renumber(f.servo_id, f.alt_id, told)
        if accepted and f.flags & RELEASES:
            for key in list(self.staged):
                servo = key[0]
                if f.servo_id in everyone or servo == f.servo_id:
                    index, source, raw = self.staged.pop(key)
                    self._take(index, servo, source, raw, told, to_all=servo in everyone)
        for old, new in self.moves:
            self.evidence.move(old, new)
            self.evidence.settle(0, ())
        self.moves = []
        return told

    def _weigh(self, f: SlowFrame, accepted: bool) -> None:
        """Count what tells models apart; from this frame on values are read accordingly."""
        asked = f.kind == REQUEST
        if not f.data or not accepted or (not asked and f.status >= 0 and self.refused(f.status)):
            return
        met = False
        for servo, address, data in self.protocol.slow_parts(f):
            for found in self.clues.of(address, data, written=asked):
                to_all = asked and servo in self.protocol.everyone
                self.evidence.weigh(servo, found.clue, to_all=to_all)
                met = True
        for clue in self.protocol.slow_clues(f):
            self.evidence.weigh(f.servo_id, clue, to_all=False)
            met = True
        if met:
            before = self.state.model.copy()
            self.evidence.settle(0, ())
            self._forget(before != self.state.model)

    def _loose(self, f: SlowFrame) -> list[bool]:
        """Tell for each value whether its servo's table leaves bytes beside it without a name."""
        out: list[bool] = []
        for servo, address, data in self.protocol.slow_parts(f) if f.data else []:
            table = self.protocol.models[int(self.state.model[servo & 255])]
            named = [table.at(a) is not None for a in range(address, address + len(data))]
            out += [not all(named)] * len(table.span(address, len(data)))
        return out

    def _take(
        self,
        index: int,
        servo: int,
        source: int,
        raw: int,
        told: list[tuple[int, int, int]],
        *,
        to_all: bool,
    ) -> None:
        """Let a register's value take effect on what comes after it."""
        r = self.protocol.registers[index]
        if r.name in self.state.modes:
            where = slice(None) if to_all else servo & 255
            self.state.modes[r.name][where] = raw
            self.state.seen[r.name][where] = True
        elif r.effect == "feedback":
            told.append((-1 if to_all else servo, raw, -1))
        elif r.effect == "servo_id":
            self._renumber(source, raw, told)

    def _renumber(self, old: int, new: int, told: list[tuple[int, int, int]]) -> None:
        for known in (*self.state.modes.values(), *self.state.seen.values()):
            known[new] = known[old & 255]
        told.append((old, -1, new))
        self.moves.append((old, new))  # the rest of the frame is still read as it was sent

    def _forget(self, where: slice | int | Mask) -> None:
        for name, known in self.state.modes.items():
            known[where] = -1
            self.state.seen[name][where] = False

    def _scaled(self, servo: int, index: int, raw: int, *, sound: bool) -> tuple[float, int]:
        r = self.protocol.registers[index]
        provenance = int(self.state.origin[servo & 255])
        if r.scale_by is not None:
            name, table = r.scale_by
            known, seen = self.state.modes[name], self.state.seen[name]
            mode = int(known[servo & 255])
            if sound and mode >= 0 and raw > scale_limit(r, mode & 255):
                # this cannot be: the mode is not believed any more
                mode = known[servo & 255] = -1
                seen[servo & 255] = False
            if seen[servo & 255]:
                provenance = OBSERVED
            elif provenance == OBSERVED:
                provenance = ASSUMED
            if mode < 0:
                return raw * (r.scale if r.scale != 1.0 else next(iter(table.values()))), provenance
            return raw * table.get(mode & 255, math.nan), provenance
        if r.sign_bit is not None:
            magnitude = raw & ((1 << r.sign_bit) - 1)
            sign = 1.0 if raw >> r.sign_bit & 1 else -1.0
            return (sign * magnitude if magnitude else 0.0) * r.scale + 0.0, provenance
        return raw * r.scale, provenance
