"""Rules about framing, pairing, timing, the protocol's forms and the capture itself."""

from __future__ import annotations

from types import MappingProxyType
from typing import TYPE_CHECKING, Any, Final

import numpy as np

from sniffer.anomalies.catalogue import CATALOGUE
from sniffer.anomalies.found import NONE, NUMBER, Anomalies
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
)
from sniffer.ground.wording import counted, sums_in_hex

if TYPE_CHECKING:
    from collections.abc import Callable, Iterator, Mapping, Sequence

    from sniffer.anomalies.found import Told
    from sniffer.ground.model import I16, I64
    from sniffer.protocols.base import BusProtocol


def anomaly(
    code: str, t_ns: int, servo_id: int, detail: str, *evidence: tuple[int, int]
) -> Anomaly:
    """Make an anomaly of a catalogued code; a negative servo id stands for none."""
    known = CATALOGUE[code]
    who = None if servo_id < 0 else servo_id
    return Anomaly(t_ns, known.severity, known.group, code, who, detail, evidence)


SHOWN: Final = 24
"""Bytes of a gap that are shown."""

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

    def tell(mine: Sequence[int]) -> list[Told]:
        return _told_gaps(batch, found, rows[mine])

    return Anomalies(code, found.t_ns[rows], found.servo_id[rows], at, found.length[rows], at, tell)


def _told_gaps(batch: Batch, found: gaps.Gaps, rows: I64) -> list[Told]:
    """Return what is said of some gaps; of most their columns tell it, and no object is made."""
    base, data = batch.base, batch.data
    names = ("start", "length", "kind", "expected", "got", "is_told")
    columns = [getattr(found, name)[rows].tolist() for name in names]
    out: list[Told] = []
    for row, start, length, kind, expected, got, is_told in zip(
        rows.tolist(), *columns, strict=True
    ):
        shown = data[start : start + min(length, SHOWN)].hex(" ").upper()
        if length > SHOWN:
            shown += " ..."
        if is_told:
            text = _gap_text(kind, base + start, length, expected, got)
        else:
            detail = found[row].detail
            text = _gap_text(kind, base + start, length, *gaps.numbers_in(detail, kind), detail)
            if gaps.ERRORS_HERE in detail:
                shown += f" (the UART told {counted(detail[gaps.ERRORS_HERE], 'line error')} here)"
        out.append((f"{text}{shown}", ((base + start, length),)))
    return out


def _gap_text(
    kind: int,
    at: int,
    length: int,
    expected: Any,
    got: Any,
    detail: Mapping[str, Any] = MappingProxyType({}),
) -> str:
    """Return a sentence up to the bytes; numbers as in ``Gaps``, ``detail`` of what has none."""
    match kind:
        case gaps.CHECKSUM:
            both = expected, got  # a plug-in may tell them as it likes
            told = sums_in_hex(*both) if all(isinstance(v, int) for v in both) else both
            should, sent = told
            return f"checksum should be {should} but is {sent} in "
        case gaps.DAMAGED:
            beside = ("fields", gaps.ERRORS_HERE)
            why = ", ".join(
                f"{k} {v:02X}" if k == "code" else f"{k} {v}"
                for k, v in detail.items()
                if k not in beside
            )
            return f"not a whole frame ({why}): "
        case gaps.TRUNCATED | gaps.IDLE_TAIL:
            need = "" if expected == gaps.UNTOLD else f" of {expected}"
            how = "then the next one begins" if kind == gaps.TRUNCATED else "then nothing more"
            return f"{length if got == gaps.UNTOLD else got}{need} bytes of a frame, {how}: "
        case _ if not at:
            return f"{counted(length, 'byte')} at the start that no frame claims: "
        case _:
            return f"{counted(length, 'byte')} that no frame claims: "


_DOUBTED: Final = (
    "doubtful-response",
    "an answer that could be the command {op} as well: no values are taken from it: {shown}",
)

_ODD: Final = (
    (MALFORMED, "malformed-body", "{op} with a body it cannot have: {shown}"),
    (UNKNOWN, "unknown-command", "{op} stands in no manual: {shown}"),
    (UNUSUAL, "unusual-form", "{op} not in the manual's form: {shown}"),
    (ECHO_DIFFERS, "echo-mismatch", "the answer to {op} does not repeat it: {shown}"),
)
"""What flags of a frame that holds are called, and what is said of it."""


def protocol_anomalies(batch: Batch, protocol: BusProtocol) -> Anomalies:
    """Report frames that hold but are not as the manual has them."""
    f = batch.frames
    if not f.flags.any():
        return NONE
    own = f.flags & ECHO == 0
    found = []
    for flag, code, text in _ODD:
        rows = np.flatnonzero(own & (f.flags & flag > 0))
        if flag == UNUSUAL and len(getattr(protocol, "doubtful", ())):
            is_answer = f.kind[rows] == RESPONSE
            doubted, rows = rows[is_answer], rows[~is_answer]
            found.append(_odd(batch, protocol, doubted, f.status[doubted], *_DOUBTED))
        found.append(_odd(batch, protocol, rows, f.op[rows], code, text))
    return Anomalies.joined(found)


def _odd(
    batch: Batch, protocol: BusProtocol, rows: I64, op: I16 | I64, code: str, text: str
) -> Anomalies:
    f, data = batch.frames, batch.data

    def tell(mine: Sequence[int]) -> list[str]:
        at = rows[mine]
        start, ops = f.start[at], op[mine].tolist()
        stop = start + np.minimum(f.length[at], 32)
        names = {op: protocol.op_name(op) for op in set(ops)}
        return [
            text.format(op=names[op], shown=data[a:b].hex(" ").upper())
            for op, a, b in zip(ops, start.tolist(), stop.tolist(), strict=True)
        ]

    codes = np.full(len(rows), NUMBER[code])
    return of_frames(batch, rows, codes, f.t_end[rows], f.servo_id[rows], tell)


def of_frames(
    batch: Batch,
    rows: I64,
    code: I64,
    t_ns: I64,
    servo_id: I16 | I64,
    tell: Callable[[Sequence[int]], Sequence[str]],
) -> Anomalies:
    """Return anomalies of which each has one frame as evidence.

    ``rows`` are those of the frames; ``tell`` gives the sentences of some, by their places in it.
    """
    at = batch.frames.start[rows] + batch.base
    length = batch.frames.length[rows].astype(np.int64)

    def told(mine: Sequence[int]) -> list[Told]:
        places = zip(at[mine].tolist(), length[mine].tolist(), strict=True)
        return [(text, (place,)) for text, place in zip(tell(mine), places, strict=True)]

    who = np.maximum(servo_id.astype(np.int64), -1)
    return Anomalies(code, t_ns, who, at, length, at, told)


class CaptureRules(Remembering):
    """What the capture itself shows: clocks that step back, taps that are swapped."""

    LASTING = ("_echo_told", "_wires")
    PASSING = ("_last", "_spread")

    def __init__(self) -> None:
        self._last: int | None = None
        self._spread = 0
        """How much sooner the last frame may have been over."""
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
            self._last, self._spread = int(f.t_end[-1]), 0
            return  # counted from the bytes
        rows = np.flatnonzero(f.uncertainty >= 0)
        if not len(rows):
            return  # nominal times say nothing of the clock
        t_end = f.t_end[rows]
        step = np.diff(t_end, prepend=t_end[0] if self._last is None else self._last)
        # Either may have been over sooner: what was stamped before it was sent, by all it takes.
        spread = f.uncertainty[rows]
        spread = np.maximum(spread, np.concatenate([[self._spread], spread[:-1]]))
        back = np.flatnonzero(step < -spread - 1_000_000)
        for i, by in zip(rows[back].tolist(), (-step[back]).tolist(), strict=True):
            at = (batch.base + int(f.start[i]), int(f.length[i]))
            text = f"time steps back by {by / 1e6:.1f} ms"
            yield anomaly("clock-step", int(f.t_end[i]), -1, text, at)
        self._last, self._spread = int(t_end[-1]), int(f.uncertainty[rows[-1]])

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
