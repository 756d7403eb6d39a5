"""JSON lines of whole batches.

They say what ``decoding.rows`` says, byte for byte. There each record is an object, and its line is
made anew; here lines are pieces of text (``pieced``) with numbers between them.
"""

from __future__ import annotations

import re
from typing import TYPE_CHECKING, Final

import numpy as np

from sniffer.decoding.called import SERVO_NAME
from sniffer.decoding.fields import value_ranges
from sniffer.decoding.rows import (
    OF_ANOMALIES,
    OF_FRAMES,
    OF_SAMPLES,
    OF_TRANSACTIONS,
    TransactionRow,
    beside,
    frame_row,
    shown,
)
from sniffer.protocols.base import telling_bytes
from sniffer.sinks.kept import packed
from sniffer.sinks.pieced import BARE, FRAME, SAMPLE, TRANSACTION, LineTexts, cut, encode

if TYPE_CHECKING:
    from collections.abc import Iterator, Mapping, Sequence, Set

    from sniffer.decoding.called import ServoNames
    from sniffer.decoding.sink import Part
    from sniffer.ground.model import I64, Batch

    Placed = tuple[int, I64, list[str]]
    """What the lines are of (``OF_FRAMES`` ...), the place of each in the stream, and they."""


_WHO: Final = re.compile(r'"servo_id":(\d+)')
"""Whose a record is. In a text that stands in front of it quotes are escaped."""


def lines(bus: str, parts: Sequence[Part], names: ServoNames | None = None) -> str:
    """Return what several protocols said in one pass as JSON lines, in wire order.

    What servos are called stands behind their ids, where ``names`` are known.
    """
    known = names.on_bus(bus) if names else {}
    called = {str(servo): f',"{SERVO_NAME}":{encode(name)}' for servo, name in known.items()}
    places: list[I64] = [np.empty(0, np.int64)]
    texts: list[str] = []
    for protocol, batch in parts:
        for kind, at, told in _found(bus, LineTexts.of(protocol), batch, called):
            places.append(at * 4 + kind)
            texts += told
    order = np.argsort(np.concatenate(places), kind="stable")
    return "".join(map(texts.__getitem__, order.tolist()))


def _found(
    bus: str, pieces: LineTexts, batch: Batch, called: Mapping[str, str]
) -> Iterator[Placed]:
    """Yield a batch's lines kind by kind; ``called``: by id, what stands behind it."""
    told = pieces.values(batch.values)
    for placed in (
        _frames(bus, pieces, batch, [value.field for value in told]),
        _samples(bus, pieces, batch, [value.sample for value in told]),
        _transactions(bus, pieces, batch),
        *([_anomalies(bus, pieces, batch)] if len(batch.anomalies) else ()),
    ):
        yield _named(placed, called) if called else placed
    if len(batch.gaps):  # a gap is nobody's for sure: whose it may be stands in its detail
        yield _gaps(bus, pieces, batch)


def _named(placed: Placed, called: Mapping[str, str]) -> Placed:
    """Return lines with names of servos; only samples are several in one text."""
    kind, at, texts = placed
    most = 0 if kind == OF_SAMPLES else 1

    def behind(who: re.Match[str]) -> str:
        return who[0] + called.get(who[1], "")

    return kind, at, [_WHO.sub(behind, text, most) for text in texts]


def _frames(bus: str, pieces: LineTexts, batch: Batch, values: Sequence[str]) -> Placed:
    f, v, base = batch.frames, batch.values, batch.base
    rows, beside_them = _with_those_beside(batch, "frames", len(f))
    if not len(rows):
        return OF_FRAMES, np.empty(0, np.int64), []
    telling = telling_bytes(pieces.protocol, f, np.frombuffer(batch.data, np.uint8))
    columns_of, size = packed(batch, telling)
    registers = (v.register.astype(np.int32) << 2 | v.part).tobytes()
    columns = (f.start, f.end, f.start + telling, f.t_end, f.t_start, f.uncertainty)
    each = zip(*(c[rows].tolist() for c in columns), strict=True)
    edges = value_ranges(v, len(f))
    known, data, hexed = pieces.heads.known, batch.data, batch.data.hex()
    first, of_offset, of_length, of_hex, _, _, of_spread, _ = cut(
        frame_row(batch, pieces.protocol, bus, 0, {}), FRAME
    )
    out: list[str] = []
    for i, (start, end, until, t_ns, t_start_ns, spread) in zip(rows, each, strict=True):
        a, b = edges[i], edges[i + 1]
        key = columns_of[i * size : i * size + size], data[start:until], registers[4 * a : 4 * b]
        head = known.get(key) or pieces.head(key, batch, i, range(a, b))
        before, behind, end_of_line, form = head
        if form > BARE:
            inner = pieces.inner(head, batch, i, range(a, b), values)
        else:
            inner = "" if a == b else values[a] if b - a == 1 else "".join(values[a:b])
            if form == BARE:
                inner = inner[1:]
        out.append(
            f"{first}{t_ns}{of_offset}{base + start}{of_length}{end - start}"
            f'{of_hex}"{hexed[2 * start : 2 * end]}{before}{inner}{behind}{t_start_ns}'
            f"{of_spread}{spread if spread >= 0 else 'null'}{end_of_line}"
        )
    return OF_FRAMES, f.start[rows] + base, _marked(out, rows, beside_them)


def _samples(bus: str, pieces: LineTexts, batch: Batch, values: list[str]) -> Placed:
    """Return the samples; those that one frame states of a servo are one text."""
    v = batch.values
    is_told = v.accepted if batch.chosen is None else batch.chosen("samples")
    rows = np.flatnonzero(is_told)
    if not len(rows):
        return OF_SAMPLES, rows, []
    if len(rows) < len(v):
        values = [values[k] for k in rows.tolist()]
    row, times, who = v.row[rows], v.t_ns[rows], v.servo_id[rows]
    anew = (row[1:] != row[:-1]) | (times[1:] != times[:-1]) | (who[1:] != who[:-1])
    begins = np.concatenate([[0], np.flatnonzero(anew) + 1])
    places = batch.frames.start[row[begins]] + batch.base
    named = beside(pieces.protocol, batch)
    first, of_servo, *_, end = cut(pieces.sample(bus, named, v, int(rows[0])), SAMPLE)
    out = []
    columns = (begins, np.append(begins[1:], len(rows)), places, times[begins], who[begins])
    for a, b, at, t_ns, servo in zip(*(c.tolist() for c in columns), strict=True):
        begin = f"{first}{t_ns}{of_servo}{servo if servo >= 0 else 'null'}"
        behind = f"{at}{end}"
        if b - a == 1:
            out.append(f"{begin}{values[a]}{behind}")
        else:
            out.append(begin + (behind + begin).join(values[a:b]) + behind)
    return OF_SAMPLES, places, out


def _gaps(bus: str, pieces: LineTexts, batch: Batch) -> Placed:
    base, hexed, named = batch.base, batch.data.hex(), beside(pieces.protocol, batch)
    places: list[int] = []
    out: list[str] = []
    rows, beside_them = _with_those_beside(batch, "gaps", len(batch.gaps))
    for gap in (batch.gaps[i] for i in rows):
        start, length, reason, detail, t_ns = gap
        around = pieces.gap(bus, reason, batch.clock, named)
        first, of_offset, of_length, of_hex, of_detail, end = around
        places.append(base + start)
        told, raw = encode(dict(detail)), hexed[2 * start : 2 * (start + length)]
        out.append(
            f"{first}{t_ns}{of_offset}{base + start}{of_length}{length}"
            f'{of_hex}"{raw}"{of_detail}{told}{end}'
        )
    return OF_FRAMES, np.array(places, np.int64), _marked(out, rows, beside_them)


def _with_those_beside(batch: Batch, table: str, count: int) -> tuple[Sequence[int], Set[int]]:
    """Return which frames or gaps are told, and which of them stand beside a selection only."""
    rows = shown(batch, table, count)
    if batch.around is None:
        return rows, frozenset()
    frames, gaps = batch.around
    told: list[int] = np.flatnonzero(frames if table == "frames" else gaps).tolist()
    return told, set(told) - set(rows)


def _marked(texts: list[str], rows: Sequence[int], beside_them: Set[int]) -> list[str]:
    """Return lines, of which those that stand beside a selection only say so."""
    if not beside_them:
        return texts
    return [
        f'{text[:-2]},"context":true}}\n' if row in beside_them else text
        for row, text in zip(rows, texts, strict=True)
    ]


def _anomalies(bus: str, pieces: LineTexts, batch: Batch) -> Placed:
    found, named = batch.anomalies, beside(pieces.protocol, batch)
    places: list[int] = []
    out: list[str] = []
    for a in (found[i] for i in shown(batch, "anomalies", len(found))):
        first, of_servo, of_detail, of_evidence, end = pieces.anomaly(bus, a, named)
        evidence = ",".join([f"[{at},{length}]" for at, length in a.evidence])
        places.append(a.known_at)
        out.append(
            f"{first}{a.t_ns}{of_servo}{'null' if a.servo_id is None else a.servo_id}"
            f"{of_detail}{encode(a.detail)}{of_evidence}[{evidence}]{end}"
        )
    return OF_ANOMALIES, np.array(places, np.int64), out


def _transactions(bus: str, pieces: LineTexts, batch: Batch) -> Placed:
    f, t, base = batch.frames, batch.transactions, batch.base
    if batch.chosen is not None:
        t = t.take(batch.chosen("transactions"))
    if not len(t):
        return OF_TRANSACTIONS, np.empty(0, np.int64), []
    is_asked, is_answered = t.request != -1, t.response >= 0
    frames, rows = batch.asking(np.where(is_asked, t.request, t.response))
    told = np.where(is_answered, t.response, batch.rows_of(t.request))
    who = frames.servo_id[rows]
    who = np.where(who >= 0, who, f.servo_id[told])
    asked = np.where(is_asked, frames.start[rows] + base, -1)
    answered = np.where(is_answered, f.start[t.response] + base, -1)
    took = t.response_time_ns
    spread = np.where(took >= 0, t.uncertainty_ns, -1)
    named = beside(pieces.protocol, batch)
    row = TransactionRow(bus, None, None, None, "", "", None, None, named)
    first, *_, end = cut(row, TRANSACTION)
    columns = (who, frames.op[rows], t.outcome, asked, answered, took, spread)
    out = []
    for servo, op, outcome, at, behind, ns, more in zip(
        *(c.tolist() for c in columns), strict=True
    ):
        _, of_answer, of_time, of_spread, _ = pieces.transaction(servo, op, outcome)
        out.append(
            f"{first}{at if at >= 0 else 'null'}{of_answer}{behind if behind >= 0 else 'null'}"
            f"{of_time}{ns if ns >= 0 else 'null'}{of_spread}{more if more >= 0 else 'null'}{end}"
        )
    return OF_TRANSACTIONS, f.start[told] + base, out
