"""A bus as rules see it: tables of what its ledger remembers, and words for places and moments."""

from __future__ import annotations

import functools
from typing import TYPE_CHECKING, Any, Final, TypeVar

import numpy as np

from sniffer.anomalies.found import CODES, NUMBER
from sniffer.decoding.pacing import ASSUMED
from sniffer.diagnosis.ledger.buckets import BUCKET_NS
from sniffer.diagnosis.ledger.damage import HELD
from sniffer.diagnosis.ledger.events import ANOMALY, REMARK, SETTING, Happenings
from sniffer.diagnosis.model import Place
from sniffer.diagnosis.physics.misread import misread
from sniffer.ground.distinct import among, numbers
from sniffer.ground.milli import MILLI
from sniffer.ground.model import NS, Clock
from sniffer.ground.register import unseen_scale
from sniffer.ground.timing import LATENCY_NS
from sniffer.ground.units import word_of
from sniffer.protocols.ids import leading_ids

if TYPE_CHECKING:
    from collections.abc import Callable, Mapping, Sequence, Set

    from sniffer.diagnosis.ledger.damage import Damage
    from sniffer.diagnosis.ledger.ledger import Ledger
    from sniffer.diagnosis.physics.misread import Misread
    from sniffer.ground.model import F64, I64, Mask
    from sniffer.ground.register import Register
    from sniffer.protocols.base import BusProtocol

Table = dict[str, "I64"]
T = TypeVar("T")

ITS_NAME: Final = 3
"""Answers that come in the name of a servo: one or two may be torn ones that hold by chance."""

QUIET_NS: Final = 2 * NS
"""Moments closer than that are one episode."""


class Series:
    """One quantity of one servo over time, a row a bucket; numbers in its unit.

    ``t`` is the last moment in the bucket, ``mean``, ``low``, ``high``, ``first`` and ``last`` are
    what was stated in it, ``step`` the greatest change from one statement to the next, ``n`` how
    many there were, ``at`` the byte of the first.
    """

    def __init__(self, register: Register, rows: Table, index: int = -1) -> None:
        self.register = register
        self.index = index
        self.bucket = rows["bucket"]
        self.t, self.t_first, self.at, self.n = (
            rows["t_last"],
            rows["t_first"],
            rows["at"],
            rows["n"],
        )
        self.low, self.high, self.first, self.last, self.step = (
            rows[name] / MILLI for name in ("low", "high", "first", "last", "step")
        )
        self.mean: F64 = rows["total"] / np.maximum(rows["n"], 1) / MILLI

    def __len__(self) -> int:
        return len(self.t)

    @property
    def unit(self) -> str:
        """The unit of its numbers, empty where they are raw."""
        return self.register.unit

    @property
    def scale(self) -> float:
        """What one step of the raw number is, in the unit; where a mode scales it, the finest."""
        return abs(unseen_scale(self.register))

    def told(self, value: float) -> str:
        """Return a number with the unit."""
        return f"{value:.4g} {word_of(self.unit)}".rstrip()


class Case:
    """All that a rule may ask about one bus; nothing in here changes while it is judged."""

    def __init__(self, ledger: Ledger, *, speaks_first: bool = True) -> None:
        self.ledger = ledger
        self.speaks_first = speaks_first
        """Of protocols that share a bus: what concerns both is told of this one."""
        self.bus = ledger.bus
        self.protocol: BusProtocol = ledger.protocol
        self._found: dict[Callable[[Case], Any], Any] = {}

    def once(self, find: Callable[[Case], T]) -> T:
        """Return what ``find`` finds in this case; it looks once, however many rules ask."""
        if find not in self._found:
            self._found[find] = find(self)
        found: T = self._found[find]
        return found

    # ------------------------------------------------------------------- what is known of the whole

    @property
    def has_clock(self) -> bool:
        """Whether times are measured: else they are counted from the bytes, and tell nothing."""
        return self.ledger.clock != Clock.NONE

    @property
    def first_ns(self) -> int:
        """When the first frame began."""
        return self.ledger.first_ns or 0

    @property
    def last_ns(self) -> int:
        """When the last frame ended."""
        return self.ledger.last_ns

    @property
    def seconds(self) -> float:
        """How long it was listened to."""
        return self.ledger.heard.ns / NS

    @property
    def has_checksum(self) -> bool:
        """Whether answers have one: else damage may pass for a value."""
        return self.ledger.has_checksum is not False

    @property
    def has_bare_answers(self) -> bool:
        """Whether answers are bytes without a header or a checksum, of whoever was asked (wCK)."""
        return self.protocol.ordered and not self.has_checksum

    def since(self, t_ns: int) -> str:
        """Return when it was, counted from the first frame, in words."""
        return f"{(t_ns - self.first_ns) / NS:.3f} s"

    @property
    def baud(self) -> int:
        """By which rate the bus is decoded."""
        return self.ledger.pace.baud if self.ledger.pace is not None else self.protocol.baud

    @property
    def rate_is_known(self) -> bool:
        """Whether that rate was stated or measured; else it is the protocol's usual one."""
        return self.ledger.pace is not None and self.ledger.pace.rate != ASSUMED

    @property
    def latency_ns(self) -> int:
        """By how much a stamp may lag behind its bytes."""
        told = None if self.ledger.pace is None else self.ledger.pace.latency_ns
        return LATENCY_NS[self.ledger.clock] if told is None else told

    @property
    def has_prompt_stamps(self) -> bool:
        """Whether stamps tell how soon one thing is said behind another; a late host's do not.

        To one USB frame, as those of a text file are taken: later ones may hand on a request before
        the answer that came first.
        """
        return self.has_clock and self.latency_ns <= LATENCY_NS[Clock.FILE]

    # ----------------------------------------------------------------------------------- tables

    @functools.cached_property
    def traffic(self) -> Table:
        """Frames by bucket and servo."""
        return self.ledger.traffic.table()

    @functools.cached_property
    def answers(self) -> Table:
        """What became of requests, by bucket and servo asked."""
        return self.ledger.answers.table()

    @functools.cached_property
    def line(self) -> Table:
        """Bytes, unclaimed bytes, gaps and the longest pause between requests, by bucket."""
        return self.ledger.line.table()

    @functools.cached_property
    def lost_ns(self) -> tuple[int, int] | None:
        """From when to when bytes were in no frame; None: never, or they may be another one's."""
        torn = self.line["gap_bytes"] > 0
        if self.ledger.is_shared or not torn.any():
            return None
        return int(self.line["t_first"][torn].min()), int(self.line["t_last"][torn].max())

    @functools.cached_property
    def alarms(self) -> Table:
        """Anomalies by bucket, code and servo."""
        return self.ledger.alarms.table()

    @functools.cached_property
    def writes(self) -> Table:
        """What requests stated, by servo and register."""
        return self.ledger.settings.written()

    @functools.cached_property
    def orders(self) -> Table:
        """Commands that end a goal, by bucket, servo and kind (``protocols.base.LETS_GO`` ...)."""
        return self.ledger.orders.counted()

    def order_times(self, servo_id: int, *kinds: int) -> I64:
        """Return when a servo was last given such commands, a moment a bucket and kind."""
        o = self.orders
        to_it = among(o["servo_id"], [servo_id, *self.everyone])
        return np.sort(o["t_last"][to_it & among(o["kind"], kinds)])

    @functools.cached_property
    def damage(self) -> Table:
        """Damaged places by bucket, servo and turn (``damage.TURNS``)."""
        return self.ledger.damages.counted()

    @property
    def held_bytes(self) -> int:
        """How many bytes are one value over and over, of a line that is held at a level."""
        return int(self.damage["bytes"][self.damage["turn"] == HELD].sum())

    @functools.cached_property
    def line_errors(self) -> Table:
        """Bytes without a stop bit by bucket, servo and place (``lineerrors``)."""
        return self.ledger.line_errors.counted()

    @functools.cached_property
    def damages(self) -> Sequence[Damage]:
        """The first damaged places with their bytes."""
        return self.ledger.damages.kept

    @functools.cached_property
    def misreads(self) -> Sequence[Misread]:
        """The first torn frames of each sender by their bits."""
        return misread(self.protocol, self.damages, self.ledger.damages.likes.known)

    @functools.cached_property
    def happenings(self) -> Happenings:
        """Events one by one: anomalies, settings, remarks."""
        return self.ledger.events.rows()

    @functools.cached_property
    def _values(self) -> Table:
        return self.ledger.values.table()

    # -------------------------------------------------------------------------------------- views

    @functools.cached_property
    def servos(self) -> tuple[int, ...]:
        """Single servos that were asked, told something or heard, in order."""
        told = (self.traffic, self._values, self.answers)  # whom a list names is only asked
        met = numbers(np.concatenate([table["servo_id"] for table in told]))
        nobody = (*self.everyone, *leading_ids(self.protocol))
        return tuple(i for i in met.tolist() if i >= 0 and i not in nobody)

    @functools.cached_property
    def everyone(self) -> tuple[int, ...]:
        """Ids that address all servos here: one that answers come in the name of is a servo's.

        A mightyZAP leaves the factory with id 0, by which others are reached, too.
        """
        return tuple(i for i, n in self.ledger.own_names.items() if n < ITS_NAME)

    @functools.cached_property
    def answering(self) -> tuple[int, ...]:
        """Servos that answered at least once."""
        ok = sums(self.answers, "servo_id", "ok")
        return tuple(i for i in self.servos if ok.get(i, 0))

    def total(self, column: str, servo_id: int | None = None) -> int:
        """Return the sum of a column of ``answers``, of one servo or of all."""
        rows = slice(None) if servo_id is None else self.answers["servo_id"] == servo_id
        return int(self.answers[column][rows].sum())

    @functools.cached_property
    def _series(self) -> Mapping[tuple[int, str], Sequence[Series]]:
        values = self._values
        out: dict[tuple[int, str], list[Series]] = {}
        key = values["servo_id"] * len(self.protocol.registers) + values["register"]
        order = np.argsort(key, kind="stable")
        edges = np.flatnonzero(np.diff(key[order], prepend=-2, append=-2))
        for a, b in zip(edges[:-1].tolist(), edges[1:].tolist(), strict=True):
            rows = order[a:b]
            index = int(values["register"][rows[0]])
            register = self.protocol.registers[index]
            who = int(values["servo_id"][rows[0]]), register.quantity
            series = Series(
                register, {name: column[rows] for name, column in values.items()}, index
            )
            out.setdefault(who, []).append(series)
        for several in out.values():
            several.sort(key=lambda s: (-len(s), s.index))
        return out

    def series(self, servo_id: int, quantity: str) -> Series | None:
        """Return a quantity of a servo (``Register.quantity``) over time; None: never stated.

        Of registers that state one quantity it is the one stated oftener.
        """
        several = self._series.get((servo_id, quantity))
        return several[0] if several else None

    def every(self, servo_id: int, quantity: str) -> Sequence[Series]:
        """Return a quantity of a servo by each register that states it, the most stated first."""
        return self._series.get((servo_id, quantity), ())

    def measured_by(self, quantity: str) -> tuple[int, ...]:
        """Return the servos of which a quantity was stated."""
        return tuple(sorted(servo for servo, what in self._series if what == quantity))

    def alarm_rows(self, *codes: str, servo_id: int | None = None) -> I64:
        """Return the rows of ``alarms`` with one of some codes, of one servo or of all."""
        mine = among(self.alarms["code"], [NUMBER[code] for code in codes])
        if servo_id is not None:
            mine &= self.alarms["servo_id"] == servo_id
        return np.flatnonzero(mine)

    def count(self, *codes: str, servo_id: int | None = None) -> int:
        """Return how many anomalies of some codes there are."""
        return int(self.alarms["n"][self.alarm_rows(*codes, servo_id=servo_id)].sum())

    def anomalies(self, *codes: str, servo_id: int | None = None) -> Happenings:
        """Return anomalies of some codes one by one (of many, the first and the last thousand)."""
        h = self.happenings
        mine = (h.kind == ANOMALY) & among(h.what, [NUMBER[code] for code in codes])
        return h.take(self._of(h, mine, servo_id))

    def settings(self, *quantities: str, servo_id: int | None = None) -> Happenings:
        """Return changes of settings, of registers whose quantity, name or effect is among some."""
        h, some = self.happenings, frozenset(quantities)
        mine = h.kind == SETTING
        if some:
            mine[mine] = self._are_among(some)[h.what[mine]]
        return h.take(self._of(h, mine, servo_id))

    def _are_among(self, some: Set[str]) -> Mask:
        """Tell of each register whether its quantity, name or effect is among some."""
        names = ((r.quantity, r.name, r.effect) for r in self.protocol.registers)
        return np.array([not some.isdisjoint(of) for of in names], bool)

    def registers_of(self, servo_id: int, quantity: str) -> list[Register]:
        """Return the registers of a quantity that a servo may have, by its model if it is known."""
        model, _ = self.ledger.models.get(servo_id, ("", 0))
        return [
            r for r in self.protocol.registers if r.quantity == quantity and model in ("", r.model)
        ]

    def remarks(self, *kinds: int) -> Happenings:
        """Return what the tap remarked, of some ``MarkKind``; ``after`` is the count."""
        h = self.happenings
        return h.take((h.kind == REMARK) & among(h.what, [int(k) for k in kinds]))

    def _of(self, h: Happenings, mine: Mask, servo_id: int | None) -> Mask:
        return mine if servo_id is None else mine & (h.servo_id == servo_id)

    def places(self, h: Happenings, what: str, most: int = 3) -> tuple[Place, ...]:
        """Return the first few of some events as places."""
        rows = h.take(slice(0, most))
        return tuple(
            Place(at, length, t, what)
            for at, length, t in zip(
                rows.at.tolist(), rows.length.tolist(), rows.t_ns.tolist(), strict=True
            )
        )

    def code(self, number: int) -> str:
        """Return the name of an anomaly's code."""
        return CODES[number]


def sums(table: Table, by: str, column: str) -> dict[int, int]:
    """Return the sum of a column for each number of another."""
    keys, which = np.unique(table[by], return_inverse=True)
    total = np.zeros(len(keys), np.int64)
    np.add.at(total, which, table[column])
    return dict(zip(keys.tolist(), total.tolist(), strict=True))


def episodes(t_first: I64, t_last: I64, quiet_ns: int = QUIET_NS) -> tuple[tuple[int, int], ...]:
    """Return stretches of time, in order, joined where they are close."""
    order = np.argsort(t_first, kind="stable")
    out: list[tuple[int, int]] = []
    for a, b in zip(t_first[order].tolist(), t_last[order].tolist(), strict=True):
        if out and a - out[-1][1] <= quiet_ns:
            out[-1] = out[-1][0], max(out[-1][1], b)
        else:
            out.append((a, b))
    return tuple(out)


def runs(flag: Mask, t: I64, least_ns: int) -> list[tuple[int, int]]:
    """Return the stretches of rows (first, behind the last) in which a flag holds for long."""
    edges = np.flatnonzero(np.diff(np.concatenate([[0], flag.astype(np.int8), [0]])))
    return [
        (a, b)
        for a, b in zip(edges[::2].tolist(), edges[1::2].tolist(), strict=True)
        if t[b - 1] - t[a] >= least_ns
    ]


__all__ = ["BUCKET_NS", "Case", "Series", "episodes", "runs", "sums"]
