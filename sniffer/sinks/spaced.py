"""Values on a grid of time: what was said last, at every multiple of a step."""

from __future__ import annotations

import itertools
from typing import TYPE_CHECKING, Final, TypeAlias

import numpy as np

from sniffer.ground.amounts import time_as
from sniffer.ground.heard import was_set
from sniffer.ground.model import NS, OutputError
from sniffer.ground.wording import Sentence

if TYPE_CHECKING:
    from collections.abc import Sequence

    from sniffer.ground.model import F64, I64

FINEST_NS: Final = 1_000_000
"""The shortest step that can be asked for: no servo bus says a servo's values more often."""

MOST: Final = 1 << 26
"""Rows that may come at a time: 15 days at 50 Hz. A clock that was set makes more of them."""


_Rows: TypeAlias = "tuple[I64, I64, I64, F64]"


class Spaced:
    """Turns the values of one bus, in the order of time, into rows that are a step apart.

    A row stands at a multiple of the step (by the second: with the seconds of the clock) and has
    of each column what was said last in the step that ends there, never what comes later::

        step 20 ms, said at 3, 17, 21, 65: rows 20 (has 17's), 40 (21's), 60 (nothing), 80 (65's)

    So rows do not depend on where a stream begins or how it is cut. Where the clock was set back,
    what was said until then is done, and rows go on with the times from there.
    """

    def __init__(self, step_ns: int) -> None:
        self._step = step_ns
        self._next: int | None = None
        self._last_ns = 0
        self._slot = np.empty(0, np.int64)
        self._column = np.empty(0, np.int64)
        self._value = np.empty(0)

    def take(self, t_ns: I64, column: I64, value: F64) -> _Rows:
        """Take values; return rows that nothing can change any more, and the values in them.

        They are the times of the rows, and of each value its row, its column and itself.

        Raises:
            OutputError: there are too many rows, for the clock leaps.
        """
        breaks = was_set(t_ns, self._last_ns).tolist()
        self._last_ns = int(t_ns[-1])
        made = []
        for begin, stop in itertools.pairwise([0, *breaks, len(t_ns)]):
            if stop > begin:
                made.append(self._go_on(t_ns[begin:stop], column[begin:stop], value[begin:stop]))
            if stop < len(t_ns) and self._next is not None:
                made.append(self.rest())
                self._next = None
        return _joined(made)

    def _go_on(self, t_ns: I64, column: I64, value: F64) -> _Rows:
        # stamps of two reads may overlap by some ms: what was said later stands in no earlier row
        slot = np.maximum.accumulate(np.concatenate([self._slot, -(-t_ns // self._step)]))
        self._slot = slot
        self._column = np.concatenate([self._column, column])
        self._value = np.concatenate([self._value, value])
        if self._next is None:
            self._next = int(slot[0])
        return self._rows_before(int(slot[-1]))

    def rest(self) -> _Rows:
        """Return the last row."""
        return self._rows_before(int(self._slot[-1]) + 1)

    def _rows_before(self, stop: int) -> _Rows:
        assert self._next is not None, "values came before"
        begin, self._next = self._next, stop
        if stop - begin > MOST:
            raise OutputError(
                Sentence(
                    "{rows} rows of {step} are too many: the clock leaps by {leap} s; take a "
                    "part with {start} and {stop}",
                    rows=stop - begin,
                    step=time_as(self._step),
                    leap=f"{(stop - begin) * self._step / NS:.6g}",
                )
            )
        n = int(np.searchsorted(self._slot, stop))
        made = self._slot[:n] - begin, self._column[:n], self._value[:n]
        self._slot, self._column, self._value = self._slot[n:], self._column[n:], self._value[n:]
        return np.arange(begin, stop) * self._step, *made


def _joined(made: Sequence[_Rows]) -> _Rows:
    """Return rows behind each other, each value with its row among all."""
    begins = np.cumsum([0, *(len(times) for times, *_ in made)])
    times, rows, columns, values = zip(*made, strict=True)
    return (
        np.concatenate(times),
        np.concatenate([row + n for row, n in zip(rows, begins[:-1], strict=True)]),
        np.concatenate(columns),
        np.concatenate(values),
    )
