"""Values become samples: scaled, and accepted or not.

The only memory is what changes the meaning of later bytes: *mode registers* (a resolution that
scales positions), a servo's id, and which model it is. They are applied as stretches between the
rare rows that set them.
"""

from __future__ import annotations

import itertools
from typing import TYPE_CHECKING

import numpy as np

from sniffer.anomalies.evidence import loose_counts
from sniffer.anomalies.learned import FeedbackWrite, Meaning, ScaleMisfit
from sniffer.decoding.changes import EVERY, FEEDBACK, RESET, SET, Changes, new_id
from sniffer.decoding.weighing import Weighing
from sniffer.ground.codes import ASSUMED, OBSERVED, PROFILE, REQUEST, WHOLE
from sniffer.ground.columns import UNSEEN, columns_of
from sniffer.ground.distinct import numbers
from sniffer.ground.memory import Remembering
from sniffer.ground.model import (
    ECHO,
    F64,
    I64,
    RELEASES,
    RESETS,
    STAGED,
    U8,
    Frames,
    Mask,
    Samples,
    Transactions,
)
from sniffer.protocols.base import BusProtocol, State, Turn, Values

if TYPE_CHECKING:
    from collections.abc import Mapping, Sequence

    from sniffer.anomalies.learned import Change
    from sniffer.decoding.pairing import Paired
    from sniffer.ground.framing import Block


SIGNED, SPECIAL, MODED, EVENT = 1, 2, 4, 8
CHANGES = RESETS | RELEASES | STAGED
PROVENANCE = (ASSUMED, PROFILE, OBSERVED)


class Scaling(Remembering):
    """Turns raw register values into samples, with what the wire has shown so far."""

    PARTS = ("state", "_changes", "_weighing")

    def __init__(
        self, protocol: BusProtocol, models: Mapping[int | None, str] | None = None
    ) -> None:
        self.protocol = protocol
        self.state = State(protocol, models)
        self._changes = Changes(protocol)
        self._weighing = Weighing(protocol, self.state)
        self._known = known = columns_of(protocol.registers)
        # What there is to do for a register, as bits: one look-up tells it for all values.
        self._traits: U8 = (
            SIGNED * known.is_signed
            | SPECIAL * known.is_special
            | MODED * known.is_moded
            | EVENT * self._changes.traits
        ).astype(np.uint8)
        self._one_scale = not (known.is_signed & known.is_moded).any()
        bits = numbers(known.sign_bit[known.is_signed]).tolist()
        self._sign_bit = bits[0] if len(bits) == 1 else None
        self._turns_signs = bool((known.scale[known.is_signed] < 0).any())

    def decode(self, block: Block, paired: Paired, base: int = 0) -> Meaning:
        """Return every value the frames state, scaled; ``base`` is the block's offset.

        See ``Samples.accepted``.
        """
        frames, transactions = paired.frames, paired.transactions
        # The values are read twice where needed, since what they mean depends on what they say. Two
        # registers that only the 12Lf has (rows 1 and 2) make servo 1 one from row 2 on; it was
        # taken for an L12:
        #
        #     row                  0      1         2            3      5
        #     bytes of the value   00 01  00 02     20           00 01  2C 01
        #     read as an L12       speed  mode = 2  -            speed  speed     v, the first time
        #     turns                                 model 1                       by ``_weighing``
        #     read with the turns  speed  mode = 2  accel.       goal   current   v, the second time
        #     origin               0      0         2            2      2         ASSUMED, OBSERVED
        #
        # So the order is: read, find changes (a new id moves what is known of a servo), weigh, read
        # again if a servo turned, and only then say which changes take effect: the mode in row 1 is
        # loose, it stands beside a byte that the L12 does not name, and no known model vouches for
        # it. While values are read, ``state`` holds what was known before the block, and ``turns``
        # from which row on that is otherwise; behind it, ``state`` holds what is known after the
        # block. Reading row by row would need no second time, but nearly every block has no turn at
        # all.

        # What only comes again as an echo takes effect once.
        accepted = paired.accepted & (frames.flags & ECHO == 0)
        rows = np.flatnonzero(paired.readable)
        state = self.state
        v = self.protocol.values(block, frames, rows, state)
        register = v.register.astype(np.intp)  # as numpy looks up fastest
        traits = self._traits[register]
        present = int(np.bitwise_or.reduce(traits)) if len(traits) else 0
        is_eventful = bool(present & EVENT) or bool((frames.flags & CHANGES).any())
        changes: list[Change] = []
        if is_eventful:
            changes, staged = self._find(frames, transactions, v, traits, accepted)
        known = state.model.copy(), state.origin.copy()
        weighed = self._weighing.weigh(block, frames, v.sightings, accepted, changes, base)
        now = state.model, state.origin
        (state.model, state.origin), state.turns = known, weighed.turns
        if weighed.turns and len(self.protocol.models) > 1:
            v = self.protocol.values(block, frames, rows, state)
            register = v.register.astype(np.intp)
            traits = self._traits[register]
            present = int(np.bitwise_or.reduce(traits)) if len(traits) else 0
        origin = state.origins_of(v.row, v.servo_id)
        (state.model, state.origin), state.turns = now, ()
        if weighed.turns or v.loose is not None:
            trusted = np.array([loose_counts(o) for o in PROVENANCE])[origin]
            trusted &= frames.kind[v.row] != REQUEST
            changes, staged = self._find(frames, transactions, v, traits, accepted, trusted)
            is_eventful = True
        if is_eventful:
            self._changes.keep(staged)
        # Every value gets its register's own scale; what is otherwise is then put right for those
        # few that have the trait. A branch per register would touch each array once per register
        # instead.
        plain = bool(present & MODED) and not (changes or weighed.anew) and self._is_modeless()
        scale = self._known.unseen if plain else self._known.scale
        number = v.raw
        if present & SIGNED:
            mine = np.flatnonzero(traits & SIGNED > 0)
            raw, bit = number[mine], self._sign_bit
            if bit is None:
                bit = self._known.sign_bit[register[mine]]
            number = number.copy()
            # the magnitude, negative where the bit is clear
            number[mine] = (raw & ((1 << bit) - 1)) * ((raw >> bit & 1) * 2 - 1)
        value: F64 = np.multiply(number, scale[register], dtype=np.float64)
        if present & SIGNED and self._turns_signs:
            value[mine] += 0.0  # a scale that turns the sign makes zero -0.0
        takes = np.ones(len(v), bool) if accepted.all() else accepted[v.row]
        misfits: list[ScaleMisfit] = []
        if plain:
            observed = origin == OBSERVED
            if observed.any():
                origin = np.where(observed & (traits & MODED > 0), np.uint8(ASSUMED), origin)
        elif changes or weighed.anew or present & MODED:
            moved = [c for c in changes if c.what != FEEDBACK]
            misfits = self._apply_modes(v, traits, takes, moved, weighed.anew, value, origin)
        if present & SPECIAL:
            mine = np.flatnonzero(traits & SPECIAL)
            for i in np.flatnonzero(np.bincount(v.register[mine])).tolist():
                own = mine[v.register[mine] == i]
                value[own[np.isin(v.raw[own], self._known.special[i])]] = np.nan
        if v.part.any():
            value[v.part != WHOLE] = np.nan
        samples = Samples(
            t_ns=frames.t_end[v.row],
            servo_id=v.servo_id,
            register=v.register,
            role=self._known.role[register],
            raw=v.raw,
            value=value,
            provenance=origin,
            part=v.part,
            row=v.row,
            accepted=takes,
        )
        resets = [c for c in changes if c.what == RESET and c.value >= 0]
        feedback = _feedback(changes)
        return Meaning(samples, feedback, weighed.told, misfits, resets, v.extremes)

    def models(self, frames: Frames | None = None) -> dict[int, tuple[str, int]]:
        """Return model and grounds of the servos in ``frames``, where it is not just assumed.

        None: of all servos.
        """
        state = self.state
        if not state.origin.any():
            return {}
        met = np.ones(256, bool)
        if frames is not None:
            met = np.bincount(frames.servo_id[frames.servo_id >= 0], minlength=256) > 0
        met[[s for s in self.protocol.everyone if s]] = False
        return {
            servo: (self.protocol.models[int(state.model[servo])].model, int(state.origin[servo]))
            for servo in np.flatnonzero(met & (state.origin != ASSUMED)).tolist()
        }

    def _find(
        self,
        frames: Frames,
        transactions: Transactions,
        v: Values,
        traits: U8,
        accepted: Mask,
        trusted: Mask | None = None,
    ) -> tuple[list[Change], list[Change]]:
        hits = np.flatnonzero(traits & EVENT)
        return self._changes.find(
            frames,
            transactions,
            v,
            hits,
            accepted,
            trusted,
            each=self._may_misfit(v, traits, hits),
        )

    def _may_misfit(self, v: Values, traits: U8, hits: I64) -> bool:
        """Whether a value may contradict one of the modes that are, or may come to be, in force."""
        if not self.state.modes or not len(hits):
            return False
        modes = {int(m) & 255 for m in numbers(v.raw[hits])}
        modes |= {int(m) for known in self.state.modes.values() for m in numbers(known)}
        modes.discard(-1)
        mine = np.flatnonzero(traits & MODED)
        lowest = self._known.limit[:, sorted(modes)].min(axis=1, initial=np.inf)
        return bool((v.raw[mine] > lowest[v.register[mine]]).any())

    def _is_modeless(self) -> bool:
        """Whether no mode is in force, so that one look-up scales all values."""
        modes, seen = self.state.modes.values(), self.state.seen.values()
        return self._one_scale and all(
            bool((m < 0).all()) and not s.any() for m, s in zip(modes, seen, strict=True)
        )

    def _apply_modes(
        self,
        v: Values,
        traits: U8,
        takes: Mask,
        changes: Sequence[Change],
        anew: Sequence[Turn],
        value: F64,
        provenance: U8,
    ) -> list[ScaleMisfit]:
        """Scale what a mode scales, in stretches between the changes; return what fits no mode."""
        # Between two events no mode changes: all values of the stretch are scaled at once, by
        # servo. Servo 1 is heard, its mode is read as 2, then it is heard with a value that mode 2
        # forbids:
        #
        #     mine     0      2      3      4      5       row 1 of v is the mode itself
        #     servo    1      1      2      1      1
        #     raw      2040   2040   1000   3000   1000
        #     k        0                                   before the event, whose ``at`` is 2
        #     k        1  2  3  4                          behind it
        #     column   256    2      256    2      2       256 is UNSEEN
        #     over     0  0  1  0                          3000 is above ``limit`` of mode 2
        #     column   256    2      256    256    256     what holds: see below
        #     seen     0      1      0      0      0       only one is OBSERVED
        #     value    14.95  29.90  7.33   21.98  7.33    mm
        #
        # What holds: behind a misfit its servo has no mode until an event sets one, here and in
        # ``state``; so ``over`` drops all of that servo, and the loop runs at most once a servo.
        # One look-up by row for all values at once would need every change of a mode beforehand; a
        # misfit is one, and which values are misfits depends on the misfits before them.
        state = self.state
        events: list[tuple[int, int, Change | Turn | None]]
        events = [(c.at, c.row, c) for c in changes]
        events += [(int(np.searchsorted(v.row, t.row)), t.row, t) for t in anew]
        events.sort(key=lambda e: e[:2])
        mine = np.flatnonzero(traits & MODED)
        servo = (v.servo_id[mine] & 255).astype(np.int64)
        register, raw = v.register[mine], v.raw[mine]
        name_of = self._known.mode_of[register] if len(state.modes) > 1 else None
        column = np.full(len(mine), UNSEEN)
        seen = np.zeros(len(mine), bool)
        sound = takes[mine] & (v.part[mine] == WHOLE)
        misfits: list[ScaleMisfit] = []
        for (at, _, act), (until, _, _) in itertools.pairwise(
            [(0, -1, None), *events, (len(v), -1, None)]
        ):
            if act is not None:
                self._act(act)
            k = np.arange(*np.searchsorted(mine, [at, until]).tolist())
            if not len(k):
                continue
            for name, known in state.modes.items():
                own = k if name_of is None else k[name_of[k] == name]
                who = servo[own]
                mode = known[who]
                column[own] = np.where(mode < 0, UNSEEN, mode & 255)
                seen[own] = state.seen[name][who]
                over = sound[own] & (raw[own] > self._known.limit[register[own], column[own]])
                while over.any():
                    # From the first value that cannot be, the mode of its servo is not believed.
                    first = int(np.argmax(over))
                    one, index = int(who[first]), int(own[first])
                    misfits.append(
                        ScaleMisfit(
                            int(v.row[mine[index]]),
                            int(v.servo_id[mine[index]]),
                            int(register[index]),
                            int(raw[index]),
                            int(known[one]),
                        )
                    )
                    known[one], state.seen[name][one] = -1, False
                    gone = own[first:][who[first:] == one]
                    column[gone], seen[gone] = UNSEEN, False
                    over &= who != one
        value[mine] = raw * self._known.by_mode[register, column]
        origin = provenance[mine]
        provenance[mine] = np.where(seen, OBSERVED, np.where(origin == OBSERVED, ASSUMED, origin))
        return sorted(misfits)

    def _act(self, change: Change | Turn) -> None:
        """Let a change take effect on the modes."""
        modes, seen = self.state.modes, self.state.seen
        if isinstance(change, Turn):
            for name in modes:
                modes[name][change.servo], seen[name][change.servo] = -1, False
            return
        where = slice(None) if change.servo == EVERY else change.servo & 255
        if change.what == SET:
            modes[change.name][where], seen[change.name][where] = change.value, True
            return
        if change.what == RESET:
            for name in modes:
                modes[name][where], seen[name][where] = -1, False
        new = new_id(change)
        if new >= 0:
            for known in (*modes.values(), *seen.values()):
                known[new] = known[where]


def _feedback(changes: Sequence[Change]) -> list[FeedbackWrite]:
    """Return where a servo's return mode became known, unknown, or that of another id."""
    out = []
    for c in changes:
        if c.what in (FEEDBACK, RESET):
            out.append(FeedbackWrite(c.row, c.servo, c.value if c.what == FEEDBACK else -1))
        if new_id(c) >= 0:
            out.append(FeedbackWrite(c.row, c.servo, -1, new_id(c)))
    return out
