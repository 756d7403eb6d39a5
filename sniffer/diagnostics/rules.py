"""Rules about framing, pairing, timing, the protocol's forms and the capture itself."""

from __future__ import annotations

from typing import TYPE_CHECKING, Any

import numpy as np

from sniffer.diagnostics.catalogue import CATALOGUE
from sniffer.model import (
    ANY_ID,
    DAMAGED,
    ECHO_DIFFERS,
    MALFORMED,
    MISMATCHED,
    NO_RESPONSE,
    OK,
    RESPONSE,
    UNKNOWN,
    UNSOLICITED,
    UNUSUAL,
    Anomaly,
    Batch,
    Direction,
    Gap,
)

if TYPE_CHECKING:
    from collections.abc import Iterator

    from sniffer.protocols.base import BusProtocol

LATE_SPAN_NS = 3_000_000_000
"""An unasked answer this long after an unanswered request is still taken for its answer: the
longest time-out met in clients (wCK's original library waits 3 s)."""


def anomaly(
    code: str, t_ns: int, servo_id: int, detail: str, *evidence: tuple[int, int]
) -> Anomaly:
    """Make an anomaly of a catalogued code; a negative servo id stands for none."""
    known = CATALOGUE[code]
    who = None if servo_id < 0 else servo_id
    return Anomaly(t_ns, known.severity, known.group, code, who, detail, evidence)


def _hex(value: Any) -> str:
    return f"{value:02X}" if isinstance(value, int) else str(value)


def gap_anomalies(batch: Batch) -> Iterator[Anomaly]:
    """Report every run of bytes that no frame claims, with the numbers of its explanation."""
    for gap in batch.gaps:
        if gap.detail.get("blank"):
            continue
        code, text = _gap_text(batch, gap)
        fields = gap.detail.get("fields", {})
        who = fields.get("servo_id", -1) if isinstance(fields, dict) else -1
        yield anomaly(
            code,
            gap.t_ns,
            who if isinstance(who, int) else -1,
            text,
            (batch.base + gap.start, gap.length),
        )


def _gap_text(batch: Batch, gap: Gap) -> tuple[str, str]:
    d = gap.detail
    run = batch.data[gap.start : gap.start + gap.length]
    shown = run[:24].hex(" ").upper() + (" ..." if len(run) > 24 else "")
    if gap.reason == "damaged":
        if "checksum_expected" in d:
            return "bad-checksum", (
                f"checksum should be {_hex(d['checksum_expected'])} but is "
                f"{_hex(d['checksum_got'])} in {shown}"
            )
        why = ", ".join(f"{k} {v}" for k, v in d.items() if k != "fields")
        return "damaged-frame", f"not a whole frame ({why}): {shown}"
    if gap.reason in ("truncated", "idle_tail"):
        code = "truncated-frame" if gap.reason == "truncated" else "idle-tail"
        need = f" of {d['need']}" if "need" in d else ""
        how = "then the next one begins" if gap.reason == "truncated" else "then nothing more"
        return code, f"{d.get('have', gap.length)}{need} bytes of a frame, {how}: {shown}"
    if batch.base + gap.start == 0:
        return "capture-start", f"{gap.length} bytes before the first frame: {shown}"
    plural = "byte" if gap.length == 1 else "bytes"
    return "noise", f"{gap.length} {plural} that no frame claims: {shown}"


def protocol_anomalies(batch: Batch, protocol: BusProtocol) -> Iterator[Anomaly]:
    """Report frames that hold but are not as the manual has them."""
    f = batch.frames
    if not f.flags.any():
        return
    for i in np.flatnonzero(f.flags & (MALFORMED | UNKNOWN | UNUSUAL | ECHO_DIFFERS)).tolist():
        flags, op = int(f.flags[i]), protocol.op_name(int(f.op[i]))
        at = (batch.base + int(f.start[i]), int(f.length[i]))
        shown = batch.data[int(f.start[i]) : int(f.start[i]) + at[1]][:32].hex(" ").upper()
        who, t = int(f.servo_id[i]), int(f.t_end[i])
        if flags & MALFORMED:
            yield anomaly("malformed-body", t, who, f"{op} with a body it cannot have: {shown}", at)
        if flags & UNKNOWN:
            yield anomaly("unknown-command", t, who, f"{op} stands in no manual: {shown}", at)
        if flags & UNUSUAL:
            yield anomaly("unusual-form", t, who, f"{op} not in the manual's form: {shown}", at)
        if flags & ECHO_DIFFERS:
            yield anomaly(
                "echo-mismatch", t, who, f"the answer to {op} does not repeat it: {shown}", at
            )


class PairingRules:
    """Missing, late, unasked and ill-fitting answers."""

    def __init__(self, protocol: BusProtocol) -> None:
        self._protocol = protocol
        self._unanswered: tuple[int, int, int, int, str, tuple[int, int]] | None = None
        self._answered: tuple[int, tuple[int, int]] | None = None

    def judge(self, batch: Batch) -> Iterator[Anomaly]:
        """Report the transactions that went wrong, and answers beyond their window."""
        f, t = batch.frames, batch.transactions
        bad = t.outcome != OK
        silent = (t.outcome == NO_RESPONSE) | (t.outcome == DAMAGED)
        wrong = silent | (t.outcome == MISMATCHED) | (t.outcome == UNSOLICITED)
        window = self._protocol.window_ns(f.take(t.request)) if len(t) else t.response_time_ns
        late = ~bad & (t.response_time_ns - t.uncertainty_ns > window) & (t.response_time_ns >= 0)
        for i in np.flatnonzero(wrong | late).tolist():
            yield from self._one(batch, i, int(window[i]))
        last = np.flatnonzero(~bad)
        if len(last):
            r = int(t.response[last[-1]])
            self._answered = (int(f.servo_id[r]), (batch.base + int(f.start[r]), int(f.length[r])))

    def _one(self, batch: Batch, i: int, window: int) -> Iterator[Anomaly]:
        f, t = batch.frames, batch.transactions
        q, r, outcome = int(t.request[i]), int(t.response[i]), int(t.outcome[i])
        row = q if q >= 0 else r
        op, who = self._protocol.op_name(int(f.op[row])), int(f.servo_id[row])
        name = f"servo {who}" if who >= 0 else "no servo"
        spans = [(batch.base + int(f.start[k]), int(f.length[k])) for k in (q, r) if k >= 0]
        t_ns = int(f.t_end[r if r >= 0 else q])
        if outcome in (NO_RESPONSE, DAMAGED):
            self._remember(batch, q, op)
        if outcome == NO_RESPONSE:
            yield anomaly("no-response", t_ns, who, f"{name} did not answer {op}", *spans)
        elif outcome == DAMAGED:
            yield anomaly(
                "damaged-response", t_ns, who, f"torn bytes where {name} should answer {op}", *spans
            )
        elif outcome == MISMATCHED:
            yield anomaly("mismatched-response", t_ns, who, self._misfit(batch, q, r, op), *spans)
        elif outcome == UNSOLICITED:
            yield self._unasked(batch, i, r, t_ns, spans)
        else:
            took, spread = int(t.response_time_ns[i]) / 1e6, int(t.uncertainty_ns[i]) / 1e6
            text = (
                f"{name} answered {op} after {took:.2f} ms (± {spread:.2f}); "
                f"the manual promises {window / 1e6:.2f} ms"
            )
            yield anomaly("late-response", t_ns, int(f.servo_id[r]), text, *spans)

    def _remember(self, batch: Batch, q: int, op: str) -> None:
        f = batch.frames
        where = (batch.base + int(f.start[q]), int(f.length[q]))
        who = -1 if int(f.alt_id[q]) == ANY_ID else int(f.servo_id[q])
        self._unanswered = (who, int(f.token[q]), int(f.t_end[q]), int(f.reply[q]), op, where)

    def _misfit(self, batch: Batch, q: int, r: int, op: str) -> str:
        f = batch.frames
        asked, got = int(f.servo_id[q]), int(f.servo_id[r])
        if asked != got:
            return f"servo {asked} was asked ({op}), servo {got} answered"
        return (
            f"the answer of servo {got} does not fit {op}: {int(f.data_length[r])} data bytes, "
            f"{batch.data[int(f.start[r]) : int(f.start[r] + f.length[r])][:32].hex(' ').upper()}"
        )

    def _unasked(
        self, batch: Batch, i: int, r: int, t_ns: int, spans: list[tuple[int, int]]
    ) -> Anomaly:
        f, t = batch.frames, batch.transactions
        who, token = int(f.servo_id[r]), int(f.token[r])
        previous = self._answered
        if i and int(t.outcome[i - 1]) == OK:
            p = int(t.response[i - 1])
            previous = (int(f.servo_id[p]), (batch.base + int(f.start[p]), int(f.length[p])))
        if previous is not None and previous[0] == who and sum(previous[1]) == spans[0][0]:
            return anomaly(
                "duplicate-response",
                t_ns,
                who,
                f"servo {who} answered twice in a row",
                previous[1],
                *spans,
            )
        asked = self._unanswered
        if asked is not None and int(f.uncertainty[r]) >= 0:
            servo, wanted, t_asked, _, op, where = asked
            took = int(f.t_start[r]) - t_asked
            if servo in (-1, who) and token in (-1, wanted) and 0 < took <= LATE_SPAN_NS:
                self._unanswered = None
                text = f"servo {who} answered {op} only after {took / 1e6:.2f} ms"
                return anomaly("late-response", t_ns, who, text, *spans, where)
        name = f"servo {who}" if who >= 0 else "a servo"
        return anomaly(
            "unsolicited-response", t_ns, who, f"{name} answered, but nothing was asked", *spans
        )


class CaptureRules:
    """What the capture itself shows: clocks that step back, taps that are swapped."""

    def __init__(self) -> None:
        self._last: int | None = None

    def judge(self, batch: Batch) -> Iterator[Anomaly]:
        """Report frames on the wrong wire, and time going backwards."""
        f = batch.frames
        if not len(f):
            return
        if f.direction.any():
            response = f.kind == RESPONSE
            swapped = ((f.direction == Direction.TX) & response) | (
                (f.direction == Direction.RX) & ~response
            )
            for i in np.flatnonzero(swapped).tolist():
                wire = Direction(int(f.direction[i])).name
                kind = "response" if response[i] else "request"
                at = (batch.base + int(f.start[i]), int(f.length[i]))
                yield anomaly(
                    "direction-mismatch",
                    int(f.t_end[i]),
                    int(f.servo_id[i]),
                    f"a {kind} on the {wire} wire",
                    at,
                )
        before = f.t_end[0] if self._last is None else self._last
        step = np.diff(f.t_end, prepend=before)
        for i in np.flatnonzero(step < -f.uncertainty - 1_000_000).tolist():
            at = (batch.base + int(f.start[i]), int(f.length[i]))
            text = f"time steps back by {-int(step[i]) / 1e6:.1f} ms"
            yield anomaly("clock-step", int(f.t_end[i]), -1, text, at)
        self._last = int(f.t_end[-1])


__all__ = ["CaptureRules", "PairingRules", "anomaly", "gap_anomalies", "protocol_anomalies"]
