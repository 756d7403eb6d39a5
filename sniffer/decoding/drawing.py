"""Bytes drawn field by field: a frame that holds, or bytes that are none and what is known of them.

Slow and rare: ``sniffer explain`` asks for a few frames, a report for those that are evidence.
"""

from __future__ import annotations

import math
from collections.abc import Mapping
from dataclasses import dataclass, replace
from typing import TYPE_CHECKING, Any, Final

from sniffer.decoding.decoder import Decoder
from sniffer.ground.codes import OUTCOMES, WHOLE
from sniffer.ground.model import Batch, Chunk
from sniffer.ground.units import word_of
from sniffer.ground.wording import sums_in_hex
from sniffer.protocols.base import BusProtocol, FieldSpan, view

if TYPE_CHECKING:
    from collections.abc import Iterator

    from sniffer.decoding.called import ServoNames
    from sniffer.ground.model import Gap
    from sniffer.ground.wire import Order

SUM_FORMS: Final[tuple[tuple[int, Order], ...]] = ((1, "little"), (2, "little"), (2, "big"))
"""Bytes of checksums, and which is the first: no protocol has another (CRC-16 is the longest)."""


@dataclass(frozen=True, slots=True)
class Drawn:
    """Bytes with what they are.

    ``title`` says it in a line; ``spans`` are the fields, none where nothing tells them; ``values``
    are registers in words, ``checksum`` is its arithmetic and ``sealed`` the name of the field that
    it is in, ``outcome`` what became of the exchange, all empty where there is none. ``known`` is
    what is known of bytes that are no frame, ``wrong`` the name of the field that does not hold.
    """

    offset: int
    raw: bytes
    t_ns: int
    title: str
    holds: bool
    spans: tuple[FieldSpan, ...] = ()
    values: tuple[str, ...] = ()
    checksum: str = ""
    outcome: str = ""
    known: Mapping[str, Any] | None = None
    wrong: str = ""
    sealed: str = ""

    def named(self, names: ServoNames, bus: str) -> Drawn:
        """Return it with the names of the servos that it speaks of."""
        values = tuple(names.sentence(bus, value) for value in self.values)
        return replace(self, title=names.sentence(bus, self.title), values=values)

    @property
    def lines(self) -> list[str]:
        """The drawing as text: a line for the title, the bytes and each field."""
        out = [self.title, f"  {self.raw.hex(' ').upper()}"]
        if not self.holds:
            return out + list(_told(self.known or {}))
        width = max((len(s.name) for s in self.spans), default=8)
        for s in self.spans:
            shown = self.raw[s.offset : s.offset + s.length].hex(" ").upper()
            if len(shown) > 23:
                shown = shown[:20] + "..."
            note = f"   {s.note}" if s.note else ""
            out.append(f"  {s.offset:3}  {shown:23}  {s.name:{width}}  {s.value}{note}")
        out += [f"       {value}" for value in self.values]
        if self.checksum:
            out.append(f"       checksum: {self.checksum}")
        if self.outcome:
            out.append(f"  exchange: {self.outcome}")
        return out


def draw_frame(batch: Batch, protocol: BusProtocol, i: int) -> Drawn:
    """Draw frame ``i`` of a batch."""
    f = batch.frames
    start, n = int(f.start[i]), int(f.length[i])
    raw = batch.data[start : start + n]
    row = view(f, i, batch.values.register[batch.values.row == i].tolist())
    kind = "response" if row.kind else "request"
    who = f", servo {row.servo_id}" if row.servo_id >= 0 else ""
    t = batch.transactions
    became = [OUTCOMES[o].replace("_", " ") for o in t.outcome[t.response == i].tolist()]
    spans = tuple(protocol.dissect(raw, row))
    return Drawn(
        batch.base + start,
        raw,
        int(f.t_end[i]),
        f"{kind}: {protocol.op_name(row.op)}{who}",
        holds=True,
        spans=spans,
        values=tuple(_values(batch, protocol, i)),
        checksum=_checksum(protocol, raw),
        outcome=", ".join(became),
        sealed=_sealed(protocol, raw, spans),
    )


def _sealed(protocol: BusProtocol, raw: bytes, spans: tuple[FieldSpan, ...]) -> str:
    """Return the name of the field that the checksum is in: another byte there changes it alone."""
    found = protocol.checksum_of(raw)
    if found is None:
        return ""
    for span in reversed(spans):
        at = span.offset
        other = raw[:at] + bytes([raw[at] ^ 0xFF]) + raw[at + 1 :]
        changed = protocol.checksum_of(other)
        if changed is not None and changed[1] == found[1] and changed[2] != found[2]:
            return span.name
    return ""


def draw_gap(batch: Batch, protocol: BusProtocol, gap: Gap) -> Drawn:
    """Draw bytes of a batch that are no frame; where only the checksum is wrong, field by field."""
    raw = batch.data[gap.start : gap.start + gap.length]
    spans, wrong = _meant(raw, protocol, gap)
    return Drawn(
        batch.base + gap.start,
        raw,
        gap.t_ns,
        f"no frame: {gap.reason.replace('_', ' ')}",
        holds=False,
        spans=spans,
        known=gap.detail,
        wrong=wrong,
    )


def _meant(raw: bytes, protocol: BusProtocol, gap: Gap) -> tuple[tuple[FieldSpan, ...], str]:
    """Return the fields that the bytes have, and which of them is the checksum that does not hold.

    They are those of the frame that the bytes are with the checksum that they should have. A wrong
    one says that a byte is wrong, not which: the fields are those that stand there. Where the
    checksum stands is tried: wherever the bytes are the one that was sent.
    """
    right, sent = gap.detail.get("checksum_expected"), gap.detail.get("checksum_got")
    if not (isinstance(right, int) and isinstance(sent, int)):
        return (), ""
    for size, order in SUM_FORMS:
        if max(right, sent) >> 8 * size:
            continue
        expected, got = right.to_bytes(size, order), sent.to_bytes(size, order)
        at = raw.rfind(got)
        while at >= 0:
            decoder = Decoder(protocol)
            meant = raw[:at] + expected + raw[at + size :]
            for batch in (decoder.feed(Chunk(meant)), decoder.close()):
                if batch.frames.length.tolist() == [len(raw)]:
                    spans = draw_frame(batch, protocol, 0).spans
                    return spans, next((s.name for s in spans if s.offset == at), "")
            at = raw.rfind(got, 0, at + size - 1)
    return (), ""


def _told(detail: Mapping[str, Any]) -> Iterator[str]:
    """Yield what is known of bytes that are no frame, a line each."""
    told = detail_in_words(detail)
    for key, value in detail.items():
        title = key.replace("_", " ")
        if isinstance(value, Mapping):
            yield f"  {title}, as they were read:"
            for name, entry in value.items():
                yield f"    {name.replace('_', ' ')}: {in_words(entry)}"
        else:
            yield f"  {title}: {told[key]}"


def detail_in_words(detail: Mapping[str, Any]) -> dict[str, str]:
    """Return the details of a gap as people read them, checksums in hex."""
    sums = {k: v for k, v in detail.items() if k.startswith("checksum") and isinstance(v, int)}
    in_hex = zip(sums, sums_in_hex(*sums.values()), strict=True)
    return {k: in_words(v) for k, v in detail.items()} | dict(in_hex)


def in_words(value: Any) -> str:
    """Return a detail of a gap as people read it."""
    if isinstance(value, Mapping):
        return ", ".join(f"{k} {in_words(v)}" for k, v in value.items())
    if isinstance(value, list | tuple):
        return " ".join(in_words(v) for v in value) or "none"
    return str(value) if value not in ("", None) else "none"


def _values(batch: Batch, protocol: BusProtocol, i: int) -> Iterator[str]:
    v = batch.values
    for k in (v.row == i).nonzero()[0].tolist():
        r = protocol.registers[int(v.register[k])]
        raw, value = int(v.raw[k]), float(v.value[k])
        text = f"raw {raw}"
        if not math.isnan(value) and (r.unit or value != raw):
            text += f" = {value:.6g} {word_of(r.unit)}".rstrip()
        names = r.names(raw) if int(v.part[k]) == WHOLE else "part of the register"
        if names:
            text += f" ({', '.join(names) if isinstance(names, list) else names})"
        who = int(v.servo_id[k])
        owner = f"servo {who} " if who != int(batch.frames.servo_id[i]) and who >= 0 else ""
        yield f"{owner}{r.name}: {text}"


def _checksum(protocol: BusProtocol, raw: bytes) -> str:
    found = protocol.checksum_of(raw)
    if found is None:
        return ""
    checksum, body, got = found
    shown = " ".join(f"{b:02X}" for b in body[:24]) + (" ..." if len(body) > 24 else "")
    should, sent = sums_in_hex(checksum(body), got)
    return f"{checksum.formula} of [{shown}] = {should}, sent {sent}"
