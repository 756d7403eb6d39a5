"""What is selected of a batch, as a batch of its own: for those who count, and for bytes.

Sinks that write records ask ``Batch.chosen`` which rows they show. Those that count and measure get
a batch that says what is selected and nothing else.
"""

from __future__ import annotations

from dataclasses import replace
from typing import TYPE_CHECKING

import numpy as np

from sniffer.anomalies.found import Anomalies

if TYPE_CHECKING:
    from collections.abc import Callable

    from sniffer.ground.model import Batch, Mask


def meant(batch: Batch, shown: Callable[[str], Mask] | None = None) -> Mask:
    """Return the frames that a selection shows, and those of its transactions and samples.

    ``shown`` gives the selected rows of a table; what the batch says of itself where None.
    """
    shown = shown or batch.chosen
    if shown is None:
        return np.ones(len(batch.frames), bool)
    frames = shown("frames").copy()
    of = batch.transactions.take(shown("transactions"))
    for rows in (batch.rows_of(of.request), of.response):
        frames[rows[rows >= 0]] = True
    frames[batch.values.row[shown("samples")]] = True
    return frames


def selected(batch: Batch) -> Batch:
    """Return what is selected of a batch, all of it shown; the batch itself where that is all.

    ``data`` stays, so offsets are those of the capture; what frames and gaps account for is less.
    """
    if batch.chosen is None:
        return batch
    mask = meant(batch)
    place = np.cumsum(mask) - 1
    t = batch.transactions.take(batch.chosen("transactions"))
    v = batch.values.take(batch.chosen("samples"))
    found = Anomalies.of(batch.anomalies)
    return replace(
        batch,
        frames=batch.frames.take(mask),
        gaps=tuple(batch.gaps[i] for i in np.flatnonzero(batch.chosen("gaps")).tolist()),
        transactions=replace(
            t,
            request=np.where(t.request >= 0, place[t.request], t.request) if len(t) else t.request,
            response=np.where(t.response >= 0, place[t.response], -1) if len(t) else t.response,
        ),
        values=replace(v, row=place[v.row]),
        anomalies=found.take(np.flatnonzero(batch.chosen("anomalies"))) if len(found) else (),
        chosen=None,
    )
