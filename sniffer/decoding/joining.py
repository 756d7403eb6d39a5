"""Batches in a row as one: what costs the same for a little as for a lot then costs less."""

from __future__ import annotations

from dataclasses import replace
from typing import TYPE_CHECKING

import numpy as np

from sniffer.anomalies.found import Anomalies
from sniffer.ground.gaps import Gaps
from sniffer.ground.model import Batch, Frames, Samples, Transactions

if TYPE_CHECKING:
    from collections.abc import Iterator, Sequence


def runs(batches: Sequence[Batch]) -> Iterator[list[Batch]]:
    """Yield the batches that follow on each other, each lot a list."""
    run: list[Batch] = []
    for batch in batches:
        if run and run[-1].base + len(run[-1].data) != batch.base:
            yield run
            run = []
        run.append(batch)
    if run:
        yield run


def joined(batches: Sequence[Batch]) -> Batch:
    """Return batches that follow on each other as one."""
    if len(batches) == 1:
        return batches[0]
    first, last = batches[0], batches[-1]
    frames, transactions, values, before = [], [], [], [Frames.empty()]
    models: dict[int, tuple[str, int]] = {}
    rows = earlier = 0
    for b in batches:
        shift = b.base - first.base
        f, t, v = b.frames, b.transactions, b.values
        frames.append(replace(f, start=f.start + shift, data_start=f.data_start + shift))
        request = np.where(t.request < 0, t.request, t.request + rows)
        request[t.request < -1] -= earlier
        if b.before is not None:
            asked = b.before
            before.append(
                replace(asked, start=asked.start + shift, data_start=asked.data_start + shift)
            )
            earlier += len(asked)
        response = np.where(t.response < 0, -1, t.response + rows)
        transactions.append(replace(t, request=request, response=response))
        values.append(replace(v, row=v.row + rows))
        models.update(b.models)
        rows += len(f)
    return Batch(
        first.base,
        b"".join(b.data for b in batches),
        last.clock,
        Frames.concat(frames),
        Gaps.joined([(Gaps.of(b.gaps), b.base - first.base) for b in batches if len(b.gaps)]),
        Transactions.concat(transactions),
        Samples.concat(values),
        Anomalies.joined([Anomalies.of(b.anomalies) for b in batches]),
        tuple(remark for b in batches for remark in b.remarks),
        last.cut,
        before=Frames.concat(before) if earlier else None,
        slower_ns=last.slower_ns,
        models=models,
        is_shared=any(b.is_shared for b in batches),
    )
