"""Verdicts on how bytes are delivered: in which pieces, and how far their times can be trusted."""

from __future__ import annotations

from dataclasses import dataclass
from typing import TYPE_CHECKING, Final

import numpy as np

from sniffer.decoding.mixed import decoder_of, parts_of
from sniffer.decoding.names import protocols_named
from sniffer.doctor.adapter import TIMER_MS
from sniffer.doctor.line import percent
from sniffer.doctor.records import Level, Listened, Observation
from sniffer.ground.codes import OK
from sniffer.ground.model import I64, Clock
from sniffer.ground.timing import LATENCY_NS

if TYPE_CHECKING:
    from collections.abc import Iterator

    from sniffer.decoding.understanding import Understanding

MERGED: Final = 0.5
"""Share of replies in the same read as their request from which on response times are lost."""

SOME: Final = 0.05
"""Share of them from which on it is worth a word."""

EXACT_NS: Final = 2_000_000
"""Times that are off by no more are as good as USB gives them."""

ENOUGH: Final = 5
"""Replies that are too few to judge by."""


@dataclass(frozen=True, slots=True)
class _Pairs:
    """Requests with their replies, and the times of all frames."""

    count: int
    merged: int
    response_ns: I64
    uncertainty_ns: I64


def about_reads(heard: Listened, found: Understanding) -> Iterator[Observation]:
    """Are request and reply still apart, and when were they?"""
    if not found.size:
        return
    pairs = _pairs(heard, found.protocol) if found.protocol else None
    yield _reads(heard, pairs)
    yield _times(heard, pairs)


def _pairs(heard: Listened, protocol: str) -> _Pairs:
    """Decode what was heard; look up in which read each request ended and its reply began."""
    decoder = decoder_of(protocols_named(protocol), baud=heard.baud, latency_ns=heard.latency_ns)
    ends = np.cumsum([len(chunk.data) for chunk in heard.chunks])
    count = merged = 0
    response, uncertainty = [np.empty(0, np.int64)], [np.empty(0, np.int64)]
    told = (decoder.feed(*heard.chunks), decoder.close())
    for batch in (batch for each in told for _, batch in parts_of(decoder, each)):
        f, t = batch.frames, batch.transactions
        request = batch.rows_of(t.request)
        rows = np.flatnonzero((t.outcome == OK) & (request >= 0) & (t.response >= 0))
        asked = batch.base + f.end[request[rows]] - 1
        answered = batch.base + f.start[t.response[rows]]
        same = np.searchsorted(ends, asked, "right") == np.searchsorted(ends, answered, "right")
        count += len(rows)
        merged += int(same.sum())
        known = rows[t.response_time_ns[rows] >= 0]
        response.append(t.response_time_ns[known])
        uncertainty.append(f.uncertainty[f.uncertainty >= 0])
    return _Pairs(count, merged, np.concatenate(response), np.concatenate(uncertainty))


def _reads(heard: Listened, pairs: _Pairs | None) -> Observation:
    sizes = np.array([len(chunk.data) for chunk in heard.chunks if chunk.data])
    times = np.array([c.t_ns for c in heard.chunks if c.data and c.t_ns is not None])
    gaps = np.diff(times) / 1e6
    numbers: dict[str, float | int | None] = {
        "reads": len(sizes),
        "read_bytes_median": float(np.median(sizes)),
        "read_bytes_max": int(sizes.max()),
        "gap_ms_median": round(float(np.median(gaps)), 3) if len(gaps) else None,
        "gap_ms_p90": round(float(np.quantile(gaps, 0.9)), 3) if len(gaps) else None,
        "pairs": pairs.count if pairs else None,
        "merged": pairs.merged if pairs else None,
    }
    text = (
        f"{len(sizes)} reads; bytes in each: {np.median(sizes):.0f} (median), {sizes.max()} at most"
    )
    if len(gaps):
        text += f"; {np.median(gaps):.1f} ms apart"
    if pairs is None or pairs.count < ENOUGH:
        text += "; too few requests with replies to tell whether they stay apart"
        return Observation(Level.NOTE, "reads", text, numbers=numbers)
    share = pairs.merged / pairs.count
    text += f"; {percent(share)} of {pairs.count} replies came in one read with their request"
    if share < SOME:
        return Observation(Level.OK, "reads", text, numbers=numbers)
    advice = "order is right all the same, response times are not"
    quick = heard.latency_ns is not None and heard.latency_ns <= (TIMER_MS + 1) * 1_000_000
    if share < MERGED or quick:
        return Observation(Level.NOTE, "reads", text, advice, numbers=numbers)
    if heard.latency_ns is None:
        advice += ": use an adapter with a latency timer (FTDI) at 1 ms, or a logic analyser"
    else:
        advice += ": lower the latency (see there)"
    return Observation(Level.WARN, "reads", text, advice, numbers=numbers)


def _times(heard: Listened, pairs: _Pairs | None) -> Observation:
    bound = LATENCY_NS[Clock.READ] if heard.latency_ns is None else heard.latency_ns
    known = pairs is not None and len(pairs.uncertainty_ns) > 0
    typical = float(np.median(pairs.uncertainty_ns)) if pairs and known else float(bound)
    numbers: dict[str, float | None] = {
        "uncertainty_ms": round(typical / 1e6, 3),
        "uncertainty_max_ms": round(bound / 1e6, 3),
        "response_ms_median": None,
    }
    text = f"a frame can have ended up to {typical / 1e6:.2f} ms earlier than told"
    text += f" (median; {bound / 1e6:.1f} ms at most"
    text += ", a guess: the adapter does not tell)" if heard.latency_ns is None else ")"
    merges = pairs is not None and pairs.merged >= MERGED * max(pairs.count, 1)
    if pairs is not None and len(pairs.response_ns) and not merges:
        response = float(np.median(pairs.response_ns))
        numbers["response_ms_median"] = round(response / 1e6, 3)
        text += f"; replies begin after {response / 1e6:.2f} ms (median)"
    if typical <= EXACT_NS:
        return Observation(Level.OK, "times", text, numbers=numbers)
    advice = "short response times cannot be measured here; a logic analyser's capture is exact"
    # A guess is nothing to warn of.
    level = Level.NOTE if heard.latency_ns is None else Level.WARN
    return Observation(level, "times", text, advice, numbers=numbers)
