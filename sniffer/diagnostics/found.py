"""Anomalies in columns: what was found, where and of whom is known at once, the sentences later.

A rule that finds a lot gives columns and how to make one anomaly of a row; one that finds little
gives anomalies. Sorting, counting and looking for codes takes the columns; the objects are made for
those who look at them.
"""

from __future__ import annotations

from typing import TYPE_CHECKING, Final

import numpy as np

from sniffer.diagnostics.catalogue import CATALOGUE
from sniffer.ground.gaps import Lazy
from sniffer.ground.model import Anomaly

if TYPE_CHECKING:
    from collections.abc import Callable, Iterator, Sequence

    from sniffer.ground.model import I64

CODES: Final = tuple(sorted(CATALOGUE))
"""All codes in the order of their names; columns hold the number."""

NUMBER: Final = {code: i for i, code in enumerate(CODES)}

SEVERITY: Final = tuple(CATALOGUE[code].severity for code in CODES)


class Anomalies(Lazy[Anomaly]):
    """Anomalies, a row each.

    ``code`` is a row of ``CODES``, ``servo_id`` -1 where it is nobody's; ``at`` and ``length`` are
    the first piece of evidence, in bytes of the stream, ``known_at`` is where the last one begins,
    ``told_at`` the same, or where it was let go if it was held back.
    """

    __slots__ = (
        "_makers",
        "_part",
        "_row",
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
        make: Callable[[int], Anomaly],
    ) -> None:
        """Take the columns, and what makes the anomaly of a row."""
        super().__init__(len(code))
        self.code, self.t_ns, self.servo_id = code, t_ns, servo_id
        self.at, self.length, self.known_at, self.told_at = at, length, known_at, known_at
        self._part = np.zeros(len(code), np.int64)
        self._row = np.arange(len(code))
        self._makers: tuple[Callable[[int], Anomaly], ...] = (make,)

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
        return cls(code, t_ns, who, at, length, known_at, found.__getitem__)

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
        makers: list[Callable[[int], Anomaly]] = []
        of = []
        for part in some:
            of.append(part._part + len(makers))
            makers += part._makers
        out._part, out._makers = np.concatenate(of), tuple(makers)
        return out

    def take(self, rows: I64) -> Anomalies:
        """Return some rows, in the order asked for."""
        out = Anomalies.__new__(Anomalies)
        Lazy.__init__(out, len(rows))
        for name in self.__slots__:
            if name != "_makers":
                setattr(out, name, getattr(self, name)[rows])
        out._makers = self._makers
        return out

    def rows(self, code: str) -> I64:
        """Return the rows of one code."""
        return np.flatnonzero(self.code == NUMBER[code])

    def _one(self, i: int) -> Anomaly:
        return self._makers[int(self._part[i])](int(self._row[i]))

    def _all(self) -> Iterator[Anomaly]:
        for part, row in zip(self._part.tolist(), self._row.tolist(), strict=True):
            yield self._makers[part](row)


def _none(row: int) -> Anomaly:
    raise IndexError(row)


_EMPTY: Final = np.empty(0, np.int64)

NONE: Final = Anomalies(_EMPTY, _EMPTY, _EMPTY, _EMPTY, _EMPTY, _EMPTY, _none)
"""No anomalies."""
