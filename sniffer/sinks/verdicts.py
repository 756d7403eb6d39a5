"""What a line of the table says in the end: how long the reply took, or what is wrong."""

from __future__ import annotations

from typing import TYPE_CHECKING

from sniffer.ground.codes import NOT_EXPECTED, OK, OUTCOMES
from sniffer.ground.model import Severity
from sniffer.sinks.words import took_in_words

if TYPE_CHECKING:
    from sniffer.ground.model import Batch


def verdicts_of(batch: Batch) -> list[tuple[str, str]]:
    """Return for each frame how long the reply took or what is wrong, and the style of its line."""
    out = [("", "")] * len(batch.frames)
    t = batch.transactions
    late = {a.evidence[0][0] for a in batch.anomalies if a.code == "late-response"}
    columns = (
        batch.rows_of(t.request),
        t.response,
        t.outcome,
        t.response_time_ns,
        t.uncertainty_ns,
    )
    for q, r, outcome, took, spread in zip(*(c.tolist() for c in columns), strict=True):
        if outcome == OK:
            slow = q >= 0 and batch.base + int(batch.frames.start[q]) in late
            out[r] = (took_in_words(took, spread, "late " if slow else ""), "warn" if slow else "")
        elif outcome != NOT_EXPECTED:
            out[r if r >= 0 else q] = (OUTCOMES[outcome].replace("_", " "), "error")
    marks = {a.evidence[0][0]: a for a in batch.anomalies if a.group in ("protocol", "device")}
    for i, start in enumerate((batch.frames.start + batch.base).tolist()):
        found = marks.get(start)
        if found is not None and found.severity > Severity.NOTE and out[i][1] != "error":
            code = found.code.removeprefix("device-").replace("-", " ")
            out[i] = (code, found.severity.name.lower())
    return out
