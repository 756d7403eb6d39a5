"""One line taken apart: its fields, its bytes, what was found in it."""

from __future__ import annotations

from dataclasses import dataclass
from typing import TYPE_CHECKING, Literal

import numpy as np

from sniffer.anomalies.catalogue import CATALOGUE
from sniffer.decoding.drawing import draw_frame, draw_gap
from sniffer.inside.columns import GAP
from sniffer.inside.places import like_before

if TYPE_CHECKING:
    from collections.abc import Iterator

    from sniffer.decoding.drawing import Drawn
    from sniffer.inside.index import CaptureIndex


@dataclass(frozen=True, slots=True)
class DetailField:
    """A line of the field pane; ``offset`` and ``length`` are its bytes (length 0: none)."""

    part: int
    offset: int
    length: int
    text: str
    is_title: bool = False
    severity: int = 0


@dataclass(frozen=True, slots=True)
class DetailPart:
    """A frame, or bytes that are none; ``changed`` are offsets that differ from ``like``."""

    line: int
    drawn: Drawn
    like: int
    like_ns: int
    changed: frozenset[int]


@dataclass(frozen=True, slots=True)
class Detail:
    """What is shown of a line: one part, or of an exchange two."""

    parts: tuple[DetailPart, ...]
    fields: tuple[DetailField, ...]


def detail_of(index: CaptureIndex, number: int, *, exchange: bool = False) -> Detail:
    """Take a line apart; ``exchange``: with its answer."""
    numbers = [number]
    partner = int(index.lines["partner"][number])
    if exchange and partner >= 0:
        numbers.append(partner)
    parts = tuple(_part(index, n) for n in numbers)
    fields = [f for i, part in enumerate(parts) for f in _fields(index, i, part)]
    return Detail(parts, tuple(fields))


def raw_of(index: CaptureIndex, number: int) -> bytes:
    """Return the bytes of a line."""
    one = index.lines[number]
    batch = index.pages.get(int(one["page"])).batch
    start = int(one["at"]) - batch.base
    return batch.data[start : start + int(one["length"])]


def drawn_of(index: CaptureIndex, number: int) -> Drawn:
    """Return a line drawn field by field."""
    one = index.lines[number]
    page, row = index.pages.get(int(one["page"])), int(one["row"])
    if int(one["kind"]) == GAP:
        return draw_gap(page.batch, page.protocol, page.batch.gaps[row])
    drawn = draw_frame(page.batch, page.protocol, row)
    return drawn.named(index.names, index.buses[page.bus])


def _part(index: CaptureIndex, number: int) -> DetailPart:
    drawn = drawn_of(index, number)
    like = -1 if int(index.lines["kind"][number]) == GAP else like_before(index, number)
    if like < 0:
        return DetailPart(number, drawn, -1, 0, frozenset())
    before = raw_of(index, like)
    changed = frozenset(i for i, (a, b) in enumerate(zip(before, drawn.raw, strict=True)) if a != b)
    lines = index.lines
    return DetailPart(number, drawn, like, int(lines["t"][number] - lines["t"][like]), changed)


def _fields(index: CaptureIndex, i: int, part: DetailPart) -> list[DetailField]:
    """Return what a pane of few lines has room for first: what was found, and the values."""
    drawn = part.drawn
    out = [DetailField(i, 0, len(drawn.raw), drawn.title, is_title=True)]
    found = _findings(index, i, part)
    out += [told for told, _ in found]
    spans = _value_spans(index, part)
    for text, (at, length) in zip(drawn.values, spans, strict=False):
        out.append(DetailField(i, at, length, text))
    width = max((len(s.name) for s in drawn.spans), default=8)
    for s in drawn.spans:
        note = f"  {s.note}" if s.note else ""
        wrong = 3 if s.name == drawn.wrong else 0
        text = f"{s.name:{width}}  {s.value}{note}"
        out.append(DetailField(i, s.offset, s.length, text, severity=wrong))
    told = []
    if drawn.checksum:
        told.append(f"checksum: {drawn.checksum}")
    if drawn.outcome:
        told.append(f"exchange: {drawn.outcome}")
    if not drawn.holds:
        told += [text.strip() for text in drawn.lines[2:]]
    out += [DetailField(i, 0, 0, text) for text in told]
    return out + [field for _, advice in found for field in advice]


def _value_spans(index: CaptureIndex, part: DetailPart) -> Iterator[tuple[int, int]]:
    """Yield where the bytes of each register value stand; of length 0 where that is not plain.

    A register stands as far behind the first one as their addresses are apart. What it says is
    compared with the value: a place that does not hold it is none.
    """
    one = index.lines[part.line]
    page, row = index.pages.get(int(one["page"])), int(one["row"])
    if int(one["kind"]) == GAP:
        return
    f, v, raw = page.batch.frames, page.batch.values, part.drawn.raw
    first, asked = int(one["address"]), int(one["partner"])
    if first < 0 and asked >= 0:
        first = int(index.lines["address"][asked])
    begin = int(f.data_start[row] - f.start[row])
    for k in np.flatnonzero(v.row == row).tolist():
        register = page.protocol.registers[int(v.register[k])]
        at = begin + register.address - first
        shown = raw[at : at + register.width] if first >= 0 and at >= begin else b""
        orders: tuple[Literal["little", "big"], ...] = ("little", "big")
        said = {int.from_bytes(shown, o, signed=s) for o in orders for s in (False, True)}
        held = len(shown) == register.width and int(v.raw[k]) in said
        yield (at, register.width) if held else (0, 0)


def _findings(
    index: CaptureIndex, i: int, part: DetailPart
) -> list[tuple[DetailField, list[DetailField]]]:
    """Return what was found in a line, each with what it means and what to try."""
    found = index.found
    out = []
    for row in np.flatnonzero(found["line"] == part.line).tolist():
        one = found[row]
        page = index.pages.get(int(one["page"]))
        anomaly = page.batch.anomalies[int(one["row"])]
        anomaly = index.names.on(index.buses[page.bus], anomaly)
        known = CATALOGUE[anomaly.code]
        severity = int(one["severity"])
        at, length = _within(index, part, anomaly.evidence[0])
        word = anomaly.severity.name.lower()
        told = f"{word} {anomaly.code}: {anomaly.detail}"
        advice = (f"{anomaly.code} means: {known.means}", f"try: {anomaly.remedy or known.remedy}")
        fields = [DetailField(i, at, length, f"  {text}") for text in advice]
        out.append((DetailField(i, at, length, told, severity=severity), fields))
    return out


def _within(index: CaptureIndex, part: DetailPart, span: tuple[int, int]) -> tuple[int, int]:
    """Return a piece of evidence as bytes of the part."""
    first = int(index.lines["at"][part.line])
    at = max(span[0] - first, 0)
    return at, max(min(span[1], len(part.drawn.raw) - at), 0)
