"""The largest of every few seconds: what a long recording is overlooked by.

Of eight servos and ten minutes the largest of each second is nearly solid ink. Used by
``sniffer.sinks.rerun.gauges``.
"""

from __future__ import annotations

from collections import Counter
from typing import TYPE_CHECKING, Final

import numpy as np

from sniffer.ground.model import NS
from sniffer.sinks.rerun.plots import TOGETHER

if TYPE_CHECKING:
    from collections.abc import Iterator

    from sniffer.sinks.rerun.derived import Rows

    Key = tuple[str, int, str]

MOST: Final = 64
"""Steps of a curve: eight curves of so many can be told apart in a plot of 700 pixels."""


class Overview:
    """Keeps the largest of every ``step_s`` seconds, of all curves alike.

    The steps grow twice as wide whenever there would be more than ``MOST``: it takes no more memory
    however long the recording is.
    """

    def __init__(self) -> None:
        self.step_s = 1
        self._peaks: dict[Key, dict[int, float]] = {}
        self._first = self._end = 0

    def add(self, key: Key, rows: Rows) -> None:
        """Take values of seconds; NaN where one has none."""
        times, values = rows
        known = ~np.isnan(values)
        seconds = (times[known] // NS).tolist()
        if not seconds:
            return
        if not self._peaks:
            self._first = seconds[0]
        self._first = min(self._first, *seconds)
        self._end = max(self._end, 1 + max(seconds))
        while -(-self._end // self.step_s) - self._first // self.step_s > MOST:
            self.step_s *= 2
            self._peaks = {k: _halved(peaks) for k, peaks in self._peaks.items()}
        peaks = self._peaks.setdefault(key, {})
        for second, value in zip(seconds, values[known].tolist(), strict=True):
            step = second // self.step_s
            peaks[step] = max(value, peaks.get(step, value))

    def curves(self) -> Iterator[tuple[Key, Rows]]:
        """Yield the curves of buses with many of them, unless the steps are seconds still."""
        many = Counter(bus for bus, *_ in self._peaks)
        for key, peaks in self._peaks.items():
            if self.step_s == 1 or many[key[0]] <= TOGETHER:
                continue
            pairs: list[tuple[int, float]] = []
            for step, value in sorted(peaks.items()):
                end = min((step + 1) * self.step_s, self._end)
                pairs.append((max(step * self.step_s, self._first), value))
                if step + 1 not in peaks:
                    # the last one, or one before a hole, is drawn to where it ends
                    pairs += [(end, value), (end, np.nan)]
            yield (
                key,
                (
                    np.array([second * NS for second, _ in pairs], np.int64),
                    np.array([value for _, value in pairs]),
                ),
            )


def _halved(peaks: dict[int, float]) -> dict[int, float]:
    out: dict[int, float] = {}
    for step, value in peaks.items():
        out[step // 2] = max(value, out.get(step // 2, value))
    return out
