"""Small batches made one: what a pass costs besides its rows is paid once for many of them."""

from __future__ import annotations

from typing import TYPE_CHECKING

import numpy as np

from sniffer.diagnostics.found import Anomalies
from sniffer.ground.gaps import Gaps
from sniffer.ground.model import Batch, Frames, Samples, Transactions

if TYPE_CHECKING:
    from collections.abc import Sequence

    from sniffer.ground.model import I64, Gap


def joined(batches: Sequence[Batch]) -> Batch:
    """Return batches that follow each other as one, with the offsets and rows of the first."""
    if len(batches) == 1:
        return batches[0]
    base = batches[0].base
    bytes_before = [b.base - base for b in batches]
    rows_before = _sums([len(b.frames) for b in batches])
    asked_before = _sums([0 if b.before is None else len(b.before) for b in batches])
    earlier = [
        b.before.having(start=b.before.start + shift)
        for b, shift in zip(batches, bytes_before, strict=True)
        if b.before is not None
    ]
    return Batch(
        base,
        b"".join(b.data for b in batches),
        batches[-1].clock,
        Frames.concat([_moved(b.frames, n) for b, n in zip(batches, bytes_before, strict=True)]),
        _gaps(batches, bytes_before),
        Transactions.concat(
            [
                b.transactions.having(
                    request=_requests(b.transactions.request, rows, asked),
                    response=np.where(
                        b.transactions.response >= 0, b.transactions.response + rows, -1
                    ),
                )
                for b, rows, asked in zip(batches, rows_before, asked_before, strict=True)
            ]
        ),
        Samples.concat(
            [
                b.values.having(row=b.values.row + rows)
                for b, rows in zip(batches, rows_before, strict=True)
            ]
        ),
        Anomalies.joined([Anomalies.of(b.anomalies) for b in batches]),
        tuple(remark for b in batches for remark in b.remarks),
        batches[-1].cut,
        Frames.concat(earlier) if earlier else None,
        batches[-1].slower_ns,
        {servo: told for b in batches for servo, told in b.models.items()},
        batches[-1].is_shared,
    )


def _sums(sizes: Sequence[int]) -> list[int]:
    """Return how many there are before each."""
    return [0, *np.cumsum(sizes[:-1]).tolist()]


def _moved(frames: Frames, shift: int) -> Frames:
    return frames.having(start=frames.start + shift, data_start=frames.data_start + shift)


def _requests(request: I64, rows: int, asked: int) -> I64:
    """Move rows of frames, and those of earlier requests, which count down from -2."""
    return np.where(request >= 0, request + rows, np.where(request < -1, request - asked, -1))


def _gaps(batches: Sequence[Batch], bytes_before: Sequence[int]) -> Gaps:
    parts = [Gaps.of(b.gaps) for b in batches]
    of = np.repeat(np.arange(len(parts)), [len(p) for p in parts])
    row = np.concatenate([np.arange(len(p)) for p in parts])

    def explain(i: int) -> Sequence[Gap]:
        part = int(of[i])
        gap = parts[part][int(row[i])]
        return (gap._replace(start=gap.start + bytes_before[part]),)

    return Gaps(
        np.concatenate([p.start + n for p, n in zip(parts, bytes_before, strict=True)]),
        np.concatenate([p.length for p in parts]),
        np.concatenate([p.kind for p in parts]),
        np.concatenate([p.servo_id for p in parts]),
        np.concatenate([p.t_ns for p in parts]),
        np.arange(len(row)),
        explain,
    )
