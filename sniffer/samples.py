"""Values become samples: scaled, and accepted or not.

The only memory is the *mode registers*: those that alter what later bytes mean (a resolution that
scales positions, a servo's id). They are applied as stretches between the rare rows that set them.
"""

from __future__ import annotations

import functools
import itertools
from typing import TYPE_CHECKING

import numpy as np

from sniffer.bus import FeedbackWrite
from sniffer.model import (
    ASSUMED,
    F64,
    I64,
    OBSERVED,
    PROFILE,
    RELEASES,
    REQUEST,
    RESETS,
    STAGED,
    U8,
    WHOLE,
    Frames,
    Mask,
    Samples,
)
from sniffer.protocols.base import BusProtocol, State, Values

if TYPE_CHECKING:
    from collections.abc import Callable, Mapping

    from sniffer.bus import Paired
    from sniffer.framing import Block


SIGNED, SPECIAL, MODED, EVENT, FEEDBACK = 1, 2, 4, 8, 16


class Scaling:
    """Turns raw register values into samples, with what the wire has shown so far."""

    def __init__(
        self, protocol: BusProtocol, models: Mapping[int | None, str] | None = None
    ) -> None:
        self.protocol = protocol
        self.state = State(protocol, models)
        registers = protocol.registers
        self._scale = np.array([r.scale for r in registers])
        self._role = np.array([r.role for r in registers], np.uint8)
        self._sign_bit = np.array([r.sign_bit or 0 for r in registers])
        self._special = {i: list(r.special) for i, r in enumerate(registers) if r.special}
        self._moded = {i: r.scale_by for i, r in enumerate(registers) if r.scale_by is not None}
        # Scale by register and mode; the last column is for a mode nobody has seen yet.
        self._by_mode = np.full((len(registers), 257), np.nan)
        for i, (_, table) in self._moded.items():
            self._by_mode[i, list(table)] = list(table.values())
            unseen = registers[i].scale
            self._by_mode[i, 256] = unseen if unseen != 1.0 else next(iter(table.values()))
        self._setters = {i: r.name for i, r in enumerate(registers) if r.name in self.state.modes}
        self._ids = {i for i, r in enumerate(registers) if r.effect == "servo_id"}
        self._feedback = {i for i, r in enumerate(registers) if r.effect == "feedback"}
        # What there is to do for a register, as bits: one look-up tells it for all values.
        self._traits = np.zeros(len(registers), np.uint8)
        for i, r in enumerate(registers):
            self._traits[i] = (
                SIGNED * (r.sign_bit is not None)
                | SPECIAL * bool(r.special)
                | MODED * (r.scale_by is not None)
                | EVENT * (i in self._setters or (i in self._ids and bool(self.state.modes)))
                | FEEDBACK * (i in self._feedback)
            )
        self._staged: list[tuple[int, str, int]] = []

    def decode(self, block: Block, paired: Paired) -> Samples:
        """Return every value the frames state, scaled; see ``Samples.accepted``."""
        frames, accepted = paired.frames, paired.accepted
        rows = np.flatnonzero(paired.readable)
        v = self.protocol.values(block, frames, rows, self.state)
        takes = accepted[v.row]
        value = v.raw * self._scale[v.register]
        traits = self._traits[v.register]
        present = int(np.bitwise_or.reduce(traits)) if len(traits) else 0
        if present & SIGNED:
            mine = np.flatnonzero(traits & SIGNED)
            raw, bit = v.raw[mine], self._sign_bit[v.register[mine]]
            magnitude = raw & ((1 << bit) - 1)
            signed = np.where(raw >> bit & 1, magnitude, -magnitude)
            value[mine] = signed * self._scale[v.register[mine]]
        provenance = np.full(len(v), ASSUMED, np.uint8)
        if self.state.chosen.any():
            provenance[self.state.chosen[v.servo_id & 255]] = PROFILE
        if self.state.modes:
            self._apply_modes(frames, v, traits, accepted, value, provenance)
        if present & SPECIAL:
            mine = np.flatnonzero(traits & SPECIAL)
            for i in np.unique(v.register[mine]).tolist():
                own = mine[v.register[mine] == i]
                value[own[np.isin(v.raw[own], self._special[i])]] = np.nan
        if v.part.any():
            value[v.part != WHOLE] = np.nan
        return Samples(
            t_ns=frames.t_end[v.row],
            servo_id=v.servo_id,
            register=v.register,
            role=self._role[v.register],
            raw=v.raw,
            value=value,
            provenance=provenance,
            part=v.part,
            row=v.row,
            accepted=takes,
        )

    def feedback_writes(self, frames: Frames, samples: Samples) -> list[FeedbackWrite]:
        """Return where a servo's return mode became known."""
        if not self._feedback:
            return []
        at = self._traits[samples.register] & FEEDBACK > 0
        at &= samples.accepted & (samples.part == WHOLE)
        out = []
        for i in np.flatnonzero(at).tolist():
            row, servo = int(samples.row[i]), int(samples.servo_id[i])
            told_all = int(frames.kind[row]) == REQUEST and servo in self.protocol.everyone
            out.append(FeedbackWrite(row, -1 if told_all else servo, int(samples.raw[i])))
        return out

    def _apply_modes(
        self,
        frames: Frames,
        v: Values,
        traits: U8,
        accepted: Mask,
        value: F64,
        provenance: U8,
    ) -> None:
        state = self.state
        events = self._events(frames, v, traits, accepted)
        mine = np.flatnonzero(traits & MODED)
        servo = (v.servo_id[mine] & 255).astype(np.int64)
        register = v.register[mine]
        modes = {name: known[servo] for name, known in state.modes.items()}
        seen = {name: known[servo] for name, known in state.seen.items()}
        for (at, act), (until, _) in itertools.pairwise([*events, (len(v), None)]):
            if act is not None:
                act()
            k = slice(*np.searchsorted(mine, [at, until]).tolist())
            for name, known in state.modes.items():
                modes[name][k], seen[name][k] = known[servo[k]], state.seen[name][servo[k]]
        for name, mode in modes.items():
            of_name = [i for i, (by, _) in self._moded.items() if by == name]
            one = np.isin(register, of_name) if len(modes) > 1 else slice(None)
            which, by = mine[one], mode[one]
            column = np.where(by < 0, 256, by & 255)
            value[which] = v.raw[which] * self._by_mode[register[one], column]
            provenance[which[seen[name][one]]] = OBSERVED

    def _events(
        self, frames: Frames, v: Values, traits: U8, accepted: Mask
    ) -> list[tuple[int, Callable[[], None] | None]]:
        """Return (position in the values, what happens before it), in order."""
        hits = np.flatnonzero(traits & EVENT)
        hits = hits[accepted[v.row[hits]] & (v.part[hits] == WHOLE)]
        flags = np.where(accepted, frames.flags & (RESETS | RELEASES | STAGED), 0)
        special = np.flatnonzero(flags & RESETS)
        if self._staged or (flags[v.row[hits]] & STAGED).any():
            special = np.union1d(special, np.flatnonzero(flags & RELEASES))
        if not len(special) and len(hits) > 16:
            hits = self._changes(frames, v, hits)
        out: list[tuple[int, int, Callable[[], None]]] = []
        for i in hits.tolist():
            row = int(v.row[i])
            out.append((i + 1, row, self._setter(frames, v, i, row)))
        for row in special.tolist():
            at = int(np.searchsorted(v.row, row, "right"))
            servo = int(frames.servo_id[row])
            act = self._reset if flags[row] & RESETS else self._release
            out.append((at, row, functools.partial(act, servo)))
        out.sort(key=lambda e: e[:2])
        return [(at, act) for at, _, act in out]

    def _changes(self, frames: Frames, v: Values, hits: I64) -> I64:
        """Drop events that repeat what is known already (a controller polling the register)."""
        servo, register, raw = v.servo_id[hits], v.register[hits], v.raw[hits]
        told_all = np.isin(servo, self.protocol.everyone) & (frames.kind[v.row[hits]] == REQUEST)
        if told_all.any() or np.isin(register, list(self._ids)).any():
            return hits
        order = np.lexsort((hits, register, servo))
        s, r, x = servo[order], register[order], raw[order]
        same = np.zeros(len(order), bool)
        same[1:] = (s[1:] == s[:-1]) & (r[1:] == r[:-1]) & (x[1:] == x[:-1])
        return np.sort(hits[order[~same]])

    def _setter(self, frames: Frames, v: Values, i: int, row: int) -> Callable[[], None]:
        register, raw, servo = int(v.register[i]), int(v.raw[i]), int(v.servo_id[i])
        asked = int(frames.kind[row]) == REQUEST
        if register in self._ids:
            return lambda: self._renumber(servo, raw) if asked else None
        name = self._setters[register]
        if int(frames.flags[row]) & STAGED:
            return lambda: self._staged.append((servo, name, raw))
        all_of_them = asked and servo in self.protocol.everyone
        return lambda: self._set(name, None if all_of_them else servo, raw)

    def _set(self, name: str, servo: int | None, raw: int) -> None:
        where = slice(None) if servo is None else servo & 255
        self.state.modes[name][where] = raw
        self.state.seen[name][where] = True

    def _renumber(self, old: int, new: int) -> None:
        """A servo took a new id: what is known about it moves along."""
        if not 0 <= new <= 255:
            return
        for known in (*self.state.modes.values(), *self.state.seen.values()):
            known[new] = known[old & 255]

    def _reset(self, servo: int) -> None:
        where = slice(None) if servo in self.protocol.everyone else servo & 255
        for name, known in self.state.modes.items():
            known[where] = -1
            self.state.seen[name][where] = False

    def _release(self, servo: int) -> None:
        """Staged writes take effect."""
        due = self._staged
        if servo not in self.protocol.everyone:
            due = [s for s in due if s[0] == servo]
        for who, name, raw in due:
            self._set(name, None if who in self.protocol.everyone else who, raw)
        self._staged = [s for s in self._staged if s not in due]
