"""Cases decoded, and held against their labels.

Many cases go through one decoder, silences between them: a pass costs some milliseconds, however
much it holds. What one case leaves behind (a staged id, a return mode) is another's beginning, so a
case that fails among others counts only if it fails alone too.
"""

from __future__ import annotations

import itertools
from dataclasses import dataclass, field
from typing import TYPE_CHECKING, Final

import numpy as np

from sniffer.decoding.decoder import Decoder
from sniffer.ground.codes import KINDS, OUTCOMES, RESPONSE
from sniffer.ground.model import Chunk, Clock
from sniffer.ground.timing import byte_time_ns

if TYPE_CHECKING:
    from collections.abc import Sequence

    from sniffer.ground.model import Batch
    from sniffer.protocols.base import BusProtocol
    from sniffer.testing.case import Pair, Stated, TalkCase

BEGIN_NS: Final = 1_700_000_000_000_000_000
"""Any moment will do, but one that is a time stamp."""

PASS: Final = 200
"""Cases that go through one decoder."""


@dataclass(slots=True)
class Heard:
    """What a decoder made of one case, offsets counted from the case's first byte."""

    frames: list[tuple[int, int, int, str]] = field(default_factory=list)
    servos: list[int] = field(default_factory=list)
    pairs: list[tuple[int, int, int, int]] = field(default_factory=list)
    """Request and response by where they start, the servo that is asked, and the outcome."""
    values: set[tuple[int, str, int]] = field(default_factory=set)
    errors: set[str] = field(default_factory=set)


def laid_out(protocol: BusProtocol, cases: Sequence[TalkCase]) -> list[Chunk]:
    """Return the cases one after the other, as chunks with times, silences between them."""
    byte_ns, silence_ns = byte_time_ns(protocol.baud), 2 * protocol.tail_ns
    t, out = BEGIN_NS, []
    for case in cases:
        edges = [0, *case.silences, len(case.data)]
        for a, b in itertools.pairwise(edges):
            if b > a:
                t += silence_ns + (b - a) * byte_ns
                out.append(Chunk(case.data[a:b], t, Clock.READ))
    return out


def decoder_of(protocol: BusProtocol, model: str) -> Decoder:
    """Return a decoder that reads all servos by one table, whatever the wire shows."""
    return Decoder(protocol, models={None: model} if model else None)


def hear(protocol: BusProtocol, cases: Sequence[TalkCase], model: str) -> list[Heard]:
    """Decode the cases in one pass."""
    decoder = decoder_of(protocol, model)
    out = [Heard() for _ in cases]
    begins = np.cumsum([0, *(len(c.data) for c in cases)])
    for batch in (decoder.feed(*laid_out(protocol, cases)), decoder.close()):
        _split(protocol, batch, begins, out)
    return out


def _split(
    protocol: BusProtocol,
    batch: Batch,
    begins: np.ndarray[tuple[int, ...], np.dtype[np.int64]],
    out: list[Heard],
) -> None:
    f, t = batch.frames, batch.transactions
    start = f.start + batch.base
    case = np.searchsorted(begins, start, "right") - 1
    own = (start - begins[case]).tolist()
    names = [protocol.op_name(op) for op in f.op.tolist()]
    of = case.tolist()
    rows = zip(of, own, f.length.tolist(), f.kind.tolist(), names, strict=True)
    for (c, *frame), servo, status in zip(
        rows, f.servo_id.tolist(), f.status.tolist(), strict=True
    ):
        at, length, kind, name = frame
        out[c].frames.append((at, length, kind, name))
        out[c].servos.append(servo)
        if kind == RESPONSE and status > 0:
            out[c].errors.update(protocol.status_names(status))
    who = np.full(len(t), -1)
    who[t.request != -1] = batch.asked(t.request[t.request != -1]).servo_id
    for asked, answer, servo, outcome in zip(
        batch.rows_of(t.request).tolist(),
        t.response.tolist(),
        who.tolist(),
        t.outcome.tolist(),
        strict=True,
    ):
        c = of[asked if asked >= 0 else answer]
        places = (own[row] if row >= 0 else -1 for row in (asked, answer))
        out[c].pairs.append((*places, servo, outcome))
    s = batch.samples
    for servo, register, raw, row in zip(
        s.servo_id.tolist(), s.register.tolist(), s.raw.tolist(), s.row.tolist(), strict=True
    ):
        out[of[row]].values.add((servo, protocol.registers[register].name, raw))


def judged(case: TalkCase, heard: Heard) -> str:
    """Return what is wrong about a case, empty where nothing is."""
    if len(heard.frames) != len(case.frames):
        return _frames(case.frames, heard)
    for want, got in zip(case.frames, heard.frames, strict=True):
        if tuple(want[:3]) != got[:3] or (want.name and want.name != got[3]):
            return _frames(case.frames, heard)
    left = list(heard.pairs)
    for pair in sorted(case.pairs, key=lambda pair: pair.servo_id < 0):  # those of one servo first
        found = next((x for x in left if _is_meant(pair, x)), None)
        if found is None:
            return _pairs(case.pairs, heard)
        left.remove(found)
    if left:
        return _pairs(case.pairs, heard)
    if not case.valued:
        return ""
    labels = [e.values for e in case.exchanges]
    if None not in labels:
        asked = dict(zip((f.start for f in case.frames), heard.servos, strict=True))
        wanted, at = set(), 0
        for e in case.exchanges:
            for label, raw in (e.values or {}).items():
                servo, name = (asked[at], label) if isinstance(label, str) else label
                wanted.add((servo, name, raw))
            at += len(e.data)
        if wanted != heard.values:
            return f"values {_some(wanted)}, decoded as {_some(heard.values)}"
    errors = [e.errors for e in case.exchanges]
    if None not in errors:
        reported = {name for some in errors for name in some or ()}
        if reported != heard.errors:
            return f"errors {sorted(reported)}, decoded as {sorted(heard.errors)}"
    return ""


def _some(values: set[tuple[int, str, int]]) -> str:
    text = ", ".join(f"{servo}.{name} = {raw}" for servo, name, raw in sorted(values)[:12])
    return (text or "none") + (" ..." if len(values) > 12 else "")


def _frames(want: Sequence[Stated], heard: Heard) -> str:
    def told(frames: Sequence[tuple[int, int, int, str]]) -> str:
        return ", ".join(f"{a}+{n} {KINDS[k]} {name}".strip() for a, n, k, name in frames)

    return f"frames {told(want) or 'none'}; decoded as {told(heard.frames) or 'none'}"


def _is_meant(pair: Pair, found: tuple[int, int, int, int]) -> bool:
    request, response, servo_id, outcome = found
    same = (pair.request, pair.response) == (request, response) and outcome in pair.outcomes
    return same and pair.servo_id in (-1, servo_id)


def _pairs(want: Sequence[Pair], heard: Heard) -> str:
    named = any(p.servo_id >= 0 for p in want)

    def told(request: int, response: int, servo_id: int, outcomes: Sequence[int]) -> str:
        ends = (f"{x}" if x >= 0 else "none" for x in (request, response))
        who = f" of servo {servo_id}" if named and servo_id >= 0 else ""
        return " > ".join(ends) + who + " " + " or ".join(OUTCOMES[k] for k in outcomes)

    wanted = ", ".join(told(p.request, p.response, p.servo_id, sorted(p.outcomes)) for p in want)
    got = ", ".join(told(a, b, who, [how]) for a, b, who, how in sorted(heard.pairs))
    return f"pairs {wanted or 'none'}; decoded as {got or 'none'}"


def wrong_of(protocol: BusProtocol, cases: Sequence[TalkCase], model: str) -> dict[int, str]:
    """Return which cases are not decoded as they are labelled, and how.

    A case that fails among others is decoded once more by itself, and that counts.
    """
    out: dict[int, str] = {}
    for a in range(0, len(cases), PASS):
        some = cases[a : a + PASS]
        try:
            wrong = [judged(c, h) for c, h in zip(some, hear(protocol, some, model), strict=True)]
        except Exception:  # which of them raises, each alone will tell
            wrong = ["raises"] * len(some)
        for k, case in enumerate(some):
            if wrong[k] and (why := judged_alone(protocol, case, model)):
                out[a + k] = why
    return out


def judged_alone(protocol: BusProtocol, case: TalkCase, model: str) -> str:
    """Return what is wrong about a case that nothing stands before, empty where nothing is."""
    try:
        return judged(case, hear(protocol, [case], model)[0])
    except Exception as error:  # a protocol must not raise, whatever it is given
        return f"raises {type(error).__name__}: {error}"
