"""Batches as plain tuples, in the form the reference decoder gives, so that the two compare."""

from __future__ import annotations

from typing import TYPE_CHECKING, Any

import numpy as np

from sniffer.decoding.reference import Result, in_order

if TYPE_CHECKING:
    from collections.abc import Iterable, Sequence

    from sniffer.decoding.decoder import Decoder
    from sniffer.ground.model import Batch, Chunk


def batches(decoder: Decoder, groups: Iterable[Sequence[Chunk]]) -> list[Batch]:
    """Feed each group in one call, then close."""
    return [*(decoder.feed(*group) for group in groups), decoder.close()]


def records(parts: Iterable[Batch]) -> Result:
    """Return frames, transactions and samples with absolute offsets."""
    out = Result()
    for b in parts:
        f, t, v = b.frames, b.transactions, b.values

        def at(row: int, b: Batch = b) -> int:
            return b.base + int(b.frames.start[row]) if row >= 0 else -1

        names = ("status", "reply", "token", "alt_id", "flags", "t_start", "t_end")
        for i in range(len(f)):
            data = b.data[int(f.data_start[i]) : int(f.data_start[i] + f.data_length[i])]
            head = (int(getattr(f, n)[i]) for n in ("length", "kind", "servo_id", "op", "address"))
            tail = (int(getattr(f, n)[i]) for n in names)
            row: Any = (at(i), *head, data, *tail)
            out.frames.append(row)
        for i in range(len(t)):
            out.transactions.append(
                (
                    asked_at(b, int(t.request[i])),
                    at(int(t.response[i])),
                    int(t.outcome[i]),
                    int(t.response_time_ns[i]),
                    who_is_asked(b, int(t.request[i])),
                )
            )
        for i in range(len(v)):
            out.samples.append(
                (
                    int(v.t_ns[i]),
                    int(v.servo_id[i]),
                    int(v.register[i]),
                    int(v.role[i]),
                    int(v.raw[i]),
                    repr(float(v.value[i])),
                    int(v.provenance[i]),
                    int(v.part[i]),
                    at(int(v.row[i])),
                    bool(v.accepted[i]),
                )
            )
    out.transactions.sort(key=in_order)
    return out


def asked_at(batch: Batch, request: int) -> int:
    """Return the offset in the stream of a transaction's request, -1 for none."""
    if request == -1:
        return -1
    return batch.base + int(batch.asked(np.array([request])).start[0])


def who_is_asked(batch: Batch, request: int) -> int:
    """Return whom a transaction's request is to, -1 where there is none."""
    return -1 if request == -1 else int(batch.asked(np.array([request])).servo_id[0])


def gaps(parts: Iterable[Batch]) -> list[tuple[int, int, str, str]]:
    """Return (absolute offset, length, reason, detail) of every gap."""
    return [
        (b.base + g.start, g.length, g.reason, repr(dict(g.detail))) for b in parts for g in b.gaps
    ]
