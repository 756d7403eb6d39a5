"""One frame in words, byte by byte: what ``sniffer explain`` prints."""

from __future__ import annotations

import math
import re
from collections.abc import Mapping
from typing import TYPE_CHECKING, Any

from sniffer.decoding.detect import detect
from sniffer.decoding.mixed import decoder_of, parts_of
from sniffer.decoding.names import protocols_named
from sniffer.decoding.options import AUTO, Options
from sniffer.ground.codes import OUTCOMES, WHOLE
from sniffer.ground.model import Batch, Chunk, Gap, InputError, SnifferError
from sniffer.ground.wording import Sentence
from sniffer.protocols import PROTOCOLS
from sniffer.protocols.base import BusProtocol, view
from sniffer.protocols.tables import owner_of, with_tables

if TYPE_CHECKING:
    from collections.abc import Iterator, Sequence

    from sniffer.ground.registers import RegisterMap

_LSS = re.compile(r"[#*][0-9A-Za-z*. -]+")


def read_hex(text: str) -> bytes:
    """Return the bytes of a hex text, or of an LSS line given as text.

    Raises:
        InputError: it is neither.
    """
    plain = text.strip()
    if _LSS.fullmatch(plain):
        return plain.encode("ascii") + b"\r"
    squeezed = re.sub(r"0[xX]|[\s,;:]", "", plain)
    try:
        return bytes.fromhex(squeezed)
    except ValueError:
        pass
    odd = len(squeezed) % 2 and re.fullmatch(r"[0-9A-Fa-f]+", squeezed)
    why = "an odd number of hex digits" if odd else "not hex digits"
    raise InputError(f"{text!r}: {why}; write bytes as FF FF FF 01 02 F1 0B")


def explain_bytes(
    data: bytes,
    before: bytes = b"",
    *,
    protocol: str | BusProtocol = AUTO,
    model: str | None = None,
    tables: Sequence[RegisterMap] = (),
) -> tuple[bool, list[str]]:
    """Return whether every byte belongs to a frame that holds, and the drawing.

    ``tables`` are models beside those that the protocol has.

    Raises:
        InputError: no bytes, or the protocol cannot be told.
        SnifferError: unknown protocol or model.
    """
    if not data:
        raise InputError("no bytes to explain: write them as FF FF FF 01 02 F1 0B")
    Options(protocol, models={None: model} if model else {}, tables=tuple(tables)).check()
    if protocol == AUTO:
        owner = None if model is None else owner_of(model, tables)
        protocol = owner or _told(before + data)
    chosen = [with_tables(p, tables) for p in protocols_named(protocol)]
    decoder = decoder_of(chosen, models={None: model} if model else None)
    out = [f"{' and '.join(p.title for p in chosen)}, {len(data)} bytes"]
    held = True
    for told in (decoder.feed(Chunk(before + data)), decoder.close()):
        pieces = [each for p, batch in parts_of(decoder, told) for each in _pieces(batch, p)]
        for at, lines, good in sorted(pieces, key=lambda piece: piece[0]):
            if at >= len(before):
                held = held and good
                out += ["", *lines]
    return held, out


def _told(data: bytes) -> str:
    try:
        return detect([Chunk(data)]).protocol
    except SnifferError:
        return _likely(data)


def _likely(data: bytes) -> str:
    """Take the protocol that sees the longest damaged frame in the bytes, or else a torn one.

    What a frame's beginning belongs to, who knows less of it takes for noise before a shorter one.

    Raises:
        InputError: none does, or two do alike.
    """
    seen = {p.name: p.explain(data, 0) for p in PROTOCOLS.candidates()}
    damaged = {name: sum(g.length for g in gaps if _sums(g)) for name, gaps in seen.items()}
    torn = {name: gaps[0].length for name, gaps in seen.items() if gaps and _begins(gaps[0])}
    for sizes in (damaged, torn):
        most = max(sizes.values(), default=0)
        best = [name for name, size in sizes.items() if size == most > 0]
        if len(best) == 1:
            return best[0]
        if best:
            break
    alike = f" ({' and '.join(best)} would explain them alike)" if best else ""
    told = "cannot tell the protocol of these bytes{alike}: name it with {protocol}"
    raise InputError(Sentence(told, alike=alike))


def _sums(gap: Gap) -> bool:
    return gap.reason == "damaged" and "checksum_expected" in gap.detail


def _begins(gap: Gap) -> bool:
    return gap.reason == "truncated" and "fields" in gap.detail


def _pieces(batch: Batch, protocol: BusProtocol) -> Iterator[tuple[int, list[str], bool]]:
    pieces: list[tuple[int, list[str], bool]] = []
    for i, start in enumerate(batch.frames.start.tolist()):
        pieces.append((batch.base + start, _frame(batch, protocol, i), True))
    for g in batch.gaps:
        raw = batch.data[g.start : g.start + g.length]
        lines = [f"no frame: {g.reason.replace('_', ' ')}", f"  {raw.hex(' ').upper()}"]
        lines += _detail(g.detail)
        pieces.append((batch.base + g.start, lines, False))
    found = {a.evidence[0][0]: a for a in batch.anomalies if a.group not in ("pairing",)}
    for at, lines, good in sorted(pieces, key=lambda e: e[0]):
        if at in found and good:
            lines.append(f"  ! {found[at].detail}")
        yield at, lines, good


def _detail(detail: Mapping[str, Any]) -> Iterator[str]:
    """Yield what is known of bytes that are no frame, a line each."""
    for key, value in detail.items():
        title = key.replace("_", " ")
        if isinstance(value, Mapping):
            yield f"  {title}, as they were read:"
            for name, entry in value.items():
                yield f"    {name.replace('_', ' ')}: {_plainly(entry)}"
        elif key.startswith("checksum") and isinstance(value, int):
            yield f"  {title}: {value:02X}"
        else:
            yield f"  {title}: {_plainly(value)}"


def _plainly(value: Any) -> str:
    if isinstance(value, Mapping):
        return ", ".join(f"{k} {_plainly(v)}" for k, v in value.items())
    if isinstance(value, list | tuple):
        return " ".join(_plainly(v) for v in value) or "none"
    return str(value) if value not in ("", None) else "none"


def _frame(batch: Batch, protocol: BusProtocol, i: int) -> list[str]:
    f = batch.frames
    start, n = int(f.start[i]), int(f.length[i])
    raw = batch.data[start : start + n]
    row = view(f, i, batch.values.register[batch.values.row == i].tolist())
    kind = "response" if row.kind else "request"
    who = f", servo {row.servo_id}" if row.servo_id >= 0 else ""
    lines = [f"{kind}: {protocol.op_name(row.op)}{who}", f"  {raw.hex(' ').upper()}"]
    spans = protocol.dissect(raw, row)
    width = max((len(s.name) for s in spans), default=8)
    covered = 0
    for s in spans:
        covered = max(covered, s.offset + s.length)
        shown = raw[s.offset : s.offset + s.length].hex(" ").upper()
        if len(shown) > 23:
            shown = shown[:20] + "..."
        note = f"   {s.note}" if s.note else ""
        lines.append(f"  {s.offset:3}  {shown:23}  {s.name:{width}}  {s.value}{note}")
    lines += _values(batch, protocol, i)
    lines += _checksum(protocol, raw)
    t = batch.transactions
    for k in range(len(t)):
        if int(t.response[k]) == i:
            lines.append(f"  exchange: {OUTCOMES[int(t.outcome[k])].replace('_', ' ')}")
    return lines


def _values(batch: Batch, protocol: BusProtocol, i: int) -> list[str]:
    v = batch.values
    out = []
    for k in range(len(v)):
        if int(v.row[k]) != i:
            continue
        r = protocol.registers[int(v.register[k])]
        raw, value = int(v.raw[k]), float(v.value[k])
        text = f"raw {raw}"
        if not math.isnan(value) and r.unit:
            text += f" = {value:.6g} {r.unit}"
        names = r.names(raw) if int(v.part[k]) == WHOLE else "part of the register"
        if names:
            text += f" ({', '.join(names) if isinstance(names, list) else names})"
        who = int(v.servo_id[k])
        owner = f"servo {who} " if who != int(batch.frames.servo_id[i]) and who >= 0 else ""
        out.append(f"       {owner}{r.name}: {text}")
    return out


def _checksum(protocol: BusProtocol, raw: bytes) -> list[str]:
    found = protocol.checksum_of(raw)
    if found is None:
        return []
    checksum, body, got = found
    shown = " ".join(f"{b:02X}" for b in body[:24]) + (" ..." if len(body) > 24 else "")
    return [
        f"       checksum: {checksum.formula} of [{shown}] = {checksum(body):02X}, sent {got:02X}"
    ]
