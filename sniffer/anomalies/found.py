"""Anomalies in columns: what was found, where and of whom is known at once, the sentences later.

A rule that finds a lot gives columns, and how to tell what is in none of them (sentence and
evidence) of some of its rows; one that finds little gives anomalies. Sorting, counting and looking
for codes takes the columns; a table takes the sentences beside them; objects are made for those who
look at them.

A batch's five rows, from two rules (``part``), whose own rows (``row``) are told in one call each::

    code              at   part  row        tell
    bad-checksum       9    0     0     \
    no-response       18    1     0      |  part 0: rows 0, 1, 2 -> three sentences
    truncated-frame   40    0     1      |  part 1: rows 0, 1    -> two
    no-response       52    1     1      |
    noise             70    0     2     /
"""

from __future__ import annotations

from typing import TYPE_CHECKING, Final, NamedTuple

import numpy as np

from sniffer.anomalies.catalogue import CATALOGUE
from sniffer.ground.gaps import Lazy
from sniffer.ground.model import Anomaly

if TYPE_CHECKING:
    from collections.abc import Callable, Iterator, Sequence

    from sniffer.ground.model import I64

    Told = tuple[str, tuple[tuple[int, int], ...]]
    """The sentence and the evidence of an anomaly."""

    Tell = Callable[[Sequence[int]], Sequence[Told]]
    """Tells them of some rows."""

CODES: Final = tuple(sorted(CATALOGUE))
"""All codes in the order of their names; columns hold the number."""

NUMBER: Final = {code: i for i, code in enumerate(CODES)}

SEVERITY: Final = tuple(CATALOGUE[code].severity for code in CODES)

GROUP: Final = tuple(CATALOGUE[code].group for code in CODES)


class _Origin(NamedTuple):
    """Where rows come from: what tells the rest of them, and objects that are there already."""

    tell: Tell
    made: Sequence[Anomaly] | None = None


class Anomalies(Lazy[Anomaly]):
    """Anomalies, a row each.

    ``code`` is a row of ``CODES``, ``servo_id`` -1 where it is nobody's; ``at`` and ``length`` are
    the first piece of evidence, in bytes of the stream, ``known_at`` is where the last one begins,
    ``told_at`` the same, or where it was let go if it was held back.
    """

    __slots__ = (
        "_part",
        "_parts",
        "_row",
        "_told",
        "at",
        "code",
        "known_at",
        "length",
        "servo_id",
        "t_ns",
        "told_at",
    )

    def __init__(
        self,
        code: I64,
        t_ns: I64,
        servo_id: I64,
        at: I64,
        length: I64,
        known_at: I64,
        tell: Tell,
    ) -> None:
        """Take the columns, and what tells sentence and evidence of some rows."""
        super().__init__(len(code))
        self.code, self.t_ns, self.servo_id = code, t_ns, servo_id
        self.at, self.length, self.known_at, self.told_at = at, length, known_at, known_at
        self._part = np.zeros(len(code), np.int64)
        self._row = np.arange(len(code))
        self._parts: tuple[_Origin, ...] = (_Origin(tell),)
        self._told: list[Told] | None = None

    @classmethod
    def of(cls, found: Sequence[Anomaly]) -> Anomalies:
        """Return anomalies that are objects already with their columns."""
        if isinstance(found, cls):
            return found
        if not found:
            return NONE
        code, t_ns, who, at, length, known_at = np.array(
            [
                (
                    NUMBER[a.code],
                    a.t_ns,
                    -1 if a.servo_id is None else a.servo_id,
                    *a.evidence[0],
                    a.known_at,
                )
                for a in found
            ],
            np.int64,
        ).T

        def tell(rows: Sequence[int]) -> list[Told]:
            return [(found[i].detail, found[i].evidence) for i in rows]

        out = cls(code, t_ns, who, at, length, known_at, tell)
        out._parts = (_Origin(tell, found),)
        return out

    @classmethod
    def joined(cls, parts: Sequence[Anomalies]) -> Anomalies:
        """Return the rows of all parts, in order."""
        some = [part for part in parts if len(part)]
        if len(some) < 2:
            return some[0] if some else NONE
        out = cls.__new__(cls)
        Lazy.__init__(out, sum(map(len, some)))
        for name in ("code", "t_ns", "servo_id", "at", "length", "known_at", "told_at", "_row"):
            setattr(out, name, np.concatenate([getattr(part, name) for part in some]))
        parts_of_all: list[_Origin] = []
        of = []
        for part in some:
            of.append(part._part + len(parts_of_all))
            parts_of_all += part._parts
        out._part, out._parts = np.concatenate(of), tuple(parts_of_all)
        out._told = None
        return out

    def take(self, rows: I64) -> Anomalies:
        """Return some rows, in the order asked for."""
        out = Anomalies.__new__(Anomalies)
        Lazy.__init__(out, len(rows))
        for name in self.__slots__:
            if name not in ("_parts", "_told"):
                setattr(out, name, getattr(self, name)[rows])
        out._parts, out._told = self._parts, None
        return out

    def timed(self, t_ns: I64) -> Anomalies:
        """Return the same ones with other times in the column."""
        out = self.take(np.arange(len(self)))
        out.t_ns = t_ns
        return out

    def rows(self, code: str) -> I64:
        """Return the rows of one code."""
        return np.flatnonzero(self.code == NUMBER[code])

    def told(self) -> list[Told]:
        """Return sentence and evidence of every row, put together once and without objects."""
        if self._told is None:
            self._told = self._tell()
        return self._told

    def _tell(self) -> list[Told]:
        if self._made is not None:
            return [(a.detail, a.evidence) for a in self._made]
        out: list[Told] = [("", ())] * len(self)
        for number, part in enumerate(self._parts):
            mine = np.flatnonzero(self._part == number)
            if len(mine):
                told = part.tell(self._row[mine].tolist())
                for i, one in zip(mine.tolist(), told, strict=True):
                    out[i] = one
        return out

    def _one(self, i: int) -> Anomaly:
        part, row = self._parts[self._part.item(i)], self._row.item(i)
        if part.made is not None:
            return part.made[row]
        (told,) = part.tell([row])
        return _anomaly(self.code.item(i), self.t_ns.item(i), self.servo_id.item(i), told)

    def _all(self) -> Iterator[Anomaly]:
        made = [part.made for part in self._parts]
        columns = (self._part, self._row, self.code, self.t_ns, self.servo_id)
        each = zip(*(column.tolist() for column in columns), strict=True)
        for (part, row, code, t_ns, who), told in zip(each, self.told(), strict=True):
            objects = made[part]
            yield _anomaly(code, t_ns, who, told) if objects is None else objects[row]


def _anomaly(code: int, t_ns: int, servo_id: int, told: Told) -> Anomaly:
    who = None if servo_id < 0 else servo_id
    return Anomaly(t_ns, SEVERITY[code], GROUP[code], CODES[code], who, *told)


def _none(rows: Sequence[int]) -> Sequence[Told]:
    raise IndexError(rows)


_EMPTY: Final = np.empty(0, np.int64)

NONE: Final = Anomalies(_EMPTY, _EMPTY, _EMPTY, _EMPTY, _EMPTY, _EMPTY, _none)
"""No anomalies."""
