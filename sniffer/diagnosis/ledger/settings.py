"""Settings of servos as the wire shows them: who wrote them, and which changed without a write."""

from __future__ import annotations

from typing import TYPE_CHECKING, Final

import numpy as np

from sniffer.diagnosis.ledger.buckets import Buckets, in_groups
from sniffer.diagnosis.ledger.events import SETTING, Happenings
from sniffer.ground.codes import MEASURED, REQUEST, WHOLE
from sniffer.ground.distinct import within
from sniffer.ground.model import NEVER_NS

if TYPE_CHECKING:
    from sniffer.ground.model import I64, Batch, Mask
    from sniffer.ground.register import Register
    from sniffer.protocols.base import BusProtocol

MOVING: Final = frozenset(
    {"goal_position", "goal_speed", "goal_time", "goal_current", "speed", "position"}
)
"""Quantities that a controller states anew with every goal: no settings."""

_WRITES: Final = {
    "n": "sum",
    "parts": "sum",
    "part_first": "min",
    "part_last": "max",
    "part_at": "min",
    "refused": "sum",
    "low": "min",
    "high": "max",
    "at": "first",
    "length": "first",
    "t_first": "first",
    "t_last": "last",
}


def _is_setting(register: Register) -> bool:
    """Tell whether a register keeps what it is until something happens.

    A reason that a servo gives for its state is one of few words, too.
    """
    if register.role == MEASURED:
        return bool(register.values) and not register.quantity
    return register.quantity not in MOVING


def kept_addresses(protocol: BusProtocol) -> I64:
    """Return the addresses whose registers are written to memory that lasts with each write."""
    kept = [r.address for r in protocol.registers if not r.volatile and r.address >= 0]
    return np.array([] if getattr(protocol, "keeps", "") else sorted(set(kept)), np.int64)


class Settings:
    """Counts writes by servo and register, and remembers what each setting was last."""

    def __init__(self, protocol: BusProtocol) -> None:
        registers = protocol.registers
        self._count = len(registers)
        self._is_setting = np.array([_is_setting(r) for r in registers], bool)
        self._known: dict[int, int] = {}
        # 0 may be a servo of its own
        self._everyone = np.array([who for who in protocol.everyone if who], np.int64)
        self.writes = Buckets(_WRITES)
        """By servo and register: every value that a request states, of whatever register."""

    def changes(self, batch: Batch) -> Happenings:
        """Return the settings that are not what they were, or that were not known before."""
        v, f = batch.values, batch.frames
        asks = f.kind[v.row] == REQUEST
        self._count_writes(batch, np.flatnonzero(asks))
        # What a request states becomes true if the servo takes it; an answer tells what is true.
        mine = np.flatnonzero(self._is_setting[v.register] & (v.part == WHOLE) & v.accepted)
        if not len(mine):
            return Happenings.empty()
        mine, servo = self._for_each(
            mine, v.servo_id[mine].astype(np.int64), v.register[mine].astype(np.int64)
        )
        key = (servo + 1) * self._count + v.register[mine]
        order, first = in_groups(key)
        late = self._overtaken(batch, mine[order], first)
        if late.any():
            there = np.sort(order[~late])
            mine, servo, key = mine[there], servo[there], key[there]
            order, first = in_groups(key)
        raw = v.raw[mine]
        last = np.append(first[1:], len(order)) - 1
        k, r = key[order], raw[order]
        before = np.concatenate([[0], r[:-1]])
        before[first] = [self._known.get(one, -1) for one in k[first].tolist()]
        self._known.update(zip(k[last].tolist(), r[last].tolist(), strict=True))
        changed = np.flatnonzero(before != r)
        rows = np.sort(order[changed])
        was = np.empty(len(mine), np.int64)
        was[order] = before
        at = mine[rows]
        row = v.row[at]
        return Happenings(
            np.full(len(at), SETTING, np.int64),
            v.register[at].astype(np.int64),
            servo[rows],
            v.t_ns[at],
            f.start[row] + batch.base,
            f.length[row],
            was[rows],
            raw[rows],
            asks[at].astype(np.int64),
        )

    @staticmethod
    def _overtaken(batch: Batch, values: I64, first: I64) -> Mask:
        """Tell which answers, grouped by what they tell, were asked for before the last write.

        Who does not wait writes before he has what he asked for: it tells what was so until then.
        """
        v, t = batch.values, batch.transactions
        is_answer = batch.frames.kind[v.row[values]] != REQUEST
        asked = np.arange(len(batch.frames))
        paired = (t.request != -1) & (t.response != -1)
        asked[t.response[paired]] = batch.rows_of(t.request[paired])
        row = v.row[values]
        before = np.roll(row, 1)
        late: Mask = is_answer & ~np.roll(is_answer, 1) & (before > asked[row])
        late[first] = False
        return late

    def _for_each(self, mine: I64, servo: I64, register: I64) -> tuple[I64, I64]:
        """Let what all are told stand for each servo whose setting is known, right behind it.

        Else who is switched off with all others, and on by itself, would be on all the time.
        """
        to_all = within(servo, self._everyone)
        if not to_all.any():
            return mine, servo
        holders: dict[int, dict[int, None]] = {}
        for key in self._known:
            if key // self._count - 1 not in self._everyone:
                holders.setdefault(key % self._count, {})[key // self._count - 1] = None
        rows: list[int] = []
        ids: list[int] = []
        for row in np.flatnonzero(within(register, register[to_all])).tolist():
            who = holders.setdefault(int(register[row]), {})
            if to_all[row]:
                ids += who
                rows += [row] * len(who)
            else:
                who[int(servo[row])] = None
        told = np.concatenate([np.arange(len(mine)), np.array(rows, np.int64)])
        order = np.argsort(told, kind="stable")
        return mine[told[order]], np.concatenate([servo, np.array(ids, np.int64)])[order]

    def _count_writes(self, batch: Batch, asked: I64) -> None:
        if not len(asked):
            return
        v, f = batch.values, batch.frames
        row, raw, t_ns = v.row[asked], v.raw[asked], v.t_ns[asked]
        is_part, at = v.part[asked] != WHOLE, f.start[row] + batch.base
        self.writes.add(
            (v.servo_id[asked].astype(np.int64) + 1) * self._count + v.register[asked],
            n=1,
            parts=is_part,
            part_first=np.where(is_part, t_ns, NEVER_NS),
            part_last=np.where(is_part, t_ns, 0),
            part_at=np.where(is_part, at, NEVER_NS),
            refused=~v.accepted[asked],
            low=raw,
            high=raw,
            at=at,
            length=f.length[row],
            t_first=t_ns,
            t_last=t_ns,
        )

    def written(self) -> dict[str, I64]:
        """Return the writes as columns, with ``servo_id`` and ``register``."""
        key, columns = self.writes.table()
        return {**columns, "servo_id": key // self._count - 1, "register": key % self._count}
