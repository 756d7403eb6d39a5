"""Second answers to one request, each with the requests before it."""

from __future__ import annotations

from typing import TYPE_CHECKING, Final, NamedTuple

import numpy as np

from sniffer.anomalies.found import NUMBER, Anomalies

if TYPE_CHECKING:
    from collections.abc import Sequence

    from sniffer.diagnosis.ledger.likes import Likes, RequestBefore
    from sniffer.ground.model import Batch

KEPT: Final = 1000
"""So many are kept: whose they are is known long before."""


class SecondAnswer(NamedTuple):
    """An answer behind one to the same request, which ``asked_before`` begins with.

    ``times`` are when the first and when it began and ended, in ns.
    """

    at: int
    length: int
    servo_id: int
    times: tuple[tuple[int, int], tuple[int, int]]
    asked_before: tuple[RequestBefore, ...]


class SecondAnswers:
    """Keeps the first second answers of a bus."""

    def __init__(self) -> None:
        self._kept: list[SecondAnswer] = []

    @property
    def kept(self) -> Sequence[SecondAnswer]:
        """The first of them, in the order of the stream."""
        return self._kept

    def add(self, batch: Batch, likes: Likes) -> None:
        """Take those of a batch; ``likes`` has the batches before it."""
        found = Anomalies.of(batch.anomalies)
        mine = np.flatnonzero(found.code == NUMBER["duplicate-response"])
        f = batch.frames
        for k in mine[: KEPT - len(self._kept)].tolist():
            row = int(np.searchsorted(f.t_end, found.t_ns[k]))
            if row >= len(f) or f.t_end[row] != found.t_ns[k] or f.uncertainty[row] < 0:
                continue  # it is no frame, but bytes behind one; or nobody knows when it was
            before = likes.asked_before(batch, row - 1)
            if not before:
                continue  # what it answers was asked before the capture, or long ago
            self._kept.append(
                SecondAnswer(
                    int(f.start[row]) + batch.base,
                    int(f.length[row]),
                    int(found.servo_id[k]),
                    (likes.times(batch, row - 1), likes.times(batch, row)),
                    before,
                )
            )
