"""Rules about framing, pairing, timing, the protocol's forms and the capture itself."""

from __future__ import annotations

from typing import TYPE_CHECKING, Any, Final

import numpy as np

from sniffer.diagnostics.catalogue import CATALOGUE
from sniffer.diagnostics.found import CODES, NONE, NUMBER, Anomalies
from sniffer.ground import gaps
from sniffer.ground.codes import RESPONSE
from sniffer.ground.memory import Remembering
from sniffer.ground.model import (
    ECHO,
    ECHO_DIFFERS,
    MALFORMED,
    UNKNOWN,
    UNUSUAL,
    Anomaly,
    Batch,
    Clock,
    Direction,
    Gap,
)

if TYPE_CHECKING:
    from collections.abc import Iterator

    from sniffer.protocols.base import BusProtocol


def anomaly(
    code: str, t_ns: int, servo_id: int, detail: str, *evidence: tuple[int, int]
) -> Anomaly:
    """Make an anomaly of a catalogued code; a negative servo id stands for none."""
    known = CATALOGUE[code]
    who = None if servo_id < 0 else servo_id
    return Anomaly(t_ns, known.severity, known.group, code, who, detail, evidence)


def _hex(value: Any) -> str:
    return f"{value:02X}" if isinstance(value, int) else str(value)


_GAP_CODES: Final = np.array(
    [
        NUMBER[code]
        for code in (
            "noise",
            "noise",
            "bad-checksum",
            "damaged-frame",
            "truncated-frame",
            "idle-tail",
        )
    ]
)
"""The code of each kind of gap."""


def gap_anomalies(batch: Batch) -> Anomalies:
    """Report every run of bytes that no frame claims, with the numbers of its explanation."""
    if not len(batch.gaps):
        return NONE
    found = gaps.Gaps.of(batch.gaps)
    rows = np.flatnonzero(found.kind != gaps.BLANK)
    at = batch.base + found.start[rows]
    code = _GAP_CODES[found.kind[rows]]
    if not batch.base and len(rows) and not at[0] and found.kind[rows[0]] == gaps.NOISE:
        code[0] = NUMBER["capture-start"]

    def make(i: int) -> Anomaly:
        row = rows.item(i)
        gap = found[row]
        span = batch.base + gap.start, gap.length
        who = found.servo_id.item(row)
        return anomaly(CODES[code.item(i)], gap.t_ns, who, _gap_text(batch, gap), span)

    return Anomalies(code, found.t_ns[rows], found.servo_id[rows], at, found.length[rows], at, make)


def _gap_text(batch: Batch, gap: Gap) -> str:
    d = gap.detail
    run = batch.data[gap.start : gap.start + gap.length]
    shown = run[:24].hex(" ").upper() + (" ..." if len(run) > 24 else "")
    if "line_errors" in d:
        shown += f" (the UART told {d['line_errors']} line errors here)"
    if gap.reason == "damaged":
        if "checksum_expected" in d:
            return (
                f"checksum should be {_hex(d['checksum_expected'])} but is "
                f"{_hex(d['checksum_got'])} in {shown}"
            )
        why = ", ".join(f"{k} {v}" for k, v in d.items() if k not in ("fields", "line_errors"))
        return f"not a whole frame ({why}): {shown}"
    if gap.reason in ("truncated", "idle_tail"):
        need = f" of {d['need']}" if "need" in d else ""
        how = "then the next one begins" if gap.reason == "truncated" else "then nothing more"
        return f"{d.get('have', gap.length)}{need} bytes of a frame, {how}: {shown}"
    if batch.base + gap.start == 0:
        return f"{gap.length} bytes before the first frame: {shown}"
    plural = "byte" if gap.length == 1 else "bytes"
    return f"{gap.length} {plural} that no frame claims: {shown}"


def protocol_anomalies(batch: Batch, protocol: BusProtocol) -> Iterator[Anomaly]:
    """Report frames that hold but are not as the manual has them."""
    f = batch.frames
    if not f.flags.any():
        return
    odd = (f.flags & (MALFORMED | UNKNOWN | UNUSUAL | ECHO_DIFFERS) > 0) & (f.flags & ECHO == 0)
    for i in np.flatnonzero(odd).tolist():
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


class CaptureRules(Remembering):
    """What the capture itself shows: clocks that step back, taps that are swapped."""

    LASTING = ("_echo_told", "_wires")
    PASSING = ("_last",)

    def __init__(self) -> None:
        self._last: int | None = None
        self._echo_told = False
        self._wires = np.zeros(len(Direction), bool)

    def judge(self, batch: Batch) -> Iterator[Anomaly]:
        """Report frames on the wrong wire, and time going backwards."""
        f = batch.frames
        if not len(f):
            return
        yield from self._echoes(batch)
        if f.direction.any():
            response = f.kind == RESPONSE
            # One tap hears both ways, whatever its lines are called: two must have been heard.
            both = np.ones(len(f), bool)
            for wire in (Direction.TX, Direction.RX):
                both &= np.logical_or.accumulate(f.direction == wire) | self._wires[wire]
                self._wires[wire] |= bool((f.direction == wire).any())
            expected = np.where(response, Direction.RX, Direction.TX)
            swapped = both & (f.direction != Direction.UNKNOWN) & (f.direction != expected)
            swapped &= f.flags & ECHO == 0  # an adapter hears its own requests where it listens
            for i in np.flatnonzero(swapped).tolist():
                name = Direction(int(f.direction[i])).name
                kind = "response" if response[i] else "request"
                at = (batch.base + int(f.start[i]), int(f.length[i]))
                yield anomaly(
                    "direction-mismatch",
                    int(f.t_end[i]),
                    int(f.servo_id[i]),
                    f"a {kind} on the {name} wire",
                    at,
                )
        if batch.clock == Clock.READ:
            return  # the recorder's own clock never steps; a read that came late looks like it
        if batch.clock == Clock.NONE:
            self._last = int(f.t_end[-1])
            return  # counted from the bytes
        rows = np.flatnonzero(f.uncertainty >= 0)
        if not len(rows):
            return  # nominal times say nothing of the clock
        t_end = f.t_end[rows]
        step = np.diff(t_end, prepend=t_end[0] if self._last is None else self._last)
        back = np.flatnonzero(step < -f.uncertainty[rows] - 1_000_000)
        for i, by in zip(rows[back].tolist(), (-step[back]).tolist(), strict=True):
            at = (batch.base + int(f.start[i]), int(f.length[i]))
            text = f"time steps back by {by / 1e6:.1f} ms"
            yield anomaly("clock-step", int(f.t_end[i]), -1, text, at)
        self._last = int(t_end[-1])

    def _echoes(self, batch: Batch) -> Iterator[Anomaly]:
        """Report once that the requests of this bus are echoed."""
        f = batch.frames
        if self._echo_told or not f.flags.any() or not (f.flags & ECHO).any():
            return
        self._echo_told = True
        i = int(np.flatnonzero(f.flags & ECHO)[0])
        at = (batch.base + int(f.start[i]), int(f.length[i]))
        text = "every request stands there twice: the second is taken for the adapter's echo"
        yield anomaly("adapter-echo", int(f.t_end[i]), -1, text, at)
