"""One frame in words, byte by byte: what ``sniffer explain`` prints."""

from __future__ import annotations

import contextlib
import re
from typing import TYPE_CHECKING

from sniffer.decoding.detect import detect
from sniffer.decoding.drawing import draw_frame, draw_gap
from sniffer.decoding.mixed import decoder_of, parts_of
from sniffer.decoding.names import protocols_named
from sniffer.decoding.options import AUTO, Options
from sniffer.ground.model import Batch, Chunk, Gap, InputError, SnifferError
from sniffer.ground.wording import Sentence
from sniffer.protocols import PROTOCOLS
from sniffer.protocols.tables import owner_of, with_tables

if TYPE_CHECKING:
    from collections.abc import Iterator, Sequence

    from sniffer.ground.registers import RegisterMap
    from sniffer.protocols.base import BusProtocol

_LSS = re.compile(r"[#*][0-9A-Za-z*. -]+")

_ENDED = re.compile(r"(\\[rn])+$")
"""The end of a line as it stands in a program."""


def read_hex(text: str) -> bytes:
    """Return the bytes of a hex text, of an LSS line given as text, or as programs print them.

    Those are decimal numbers of which one has three digits, and whatever a capture's lines may be:
    lines of logs, arrays of C, bytes and lists as Python shows them.

    Raises:
        InputError: it is neither.
    """
    plain = _ENDED.sub("", text.strip())
    if _LSS.fullmatch(plain):
        return plain.encode("ascii") + b"\r"
    numbers = re.split(r"[\s,;]+", plain)
    if any(len(n) == 3 for n in numbers) and all(n.isdecimal() and int(n) < 256 for n in numbers):
        return bytes(map(int, numbers))
    squeezed = re.sub(r"0[xX]|[\s,;:]", "", plain)
    with contextlib.suppress(ValueError):
        return bytes.fromhex(squeezed)
    from sniffer.sources import open_source  # takes its time: for what is no plain hex

    with contextlib.suppress(InputError), contextlib.closing(open_source(plain.encode())) as source:
        return b"".join(chunk.data for group in source for chunk in group)
    odd = len(squeezed) % 2 and re.fullmatch(r"[0-9A-Fa-f]+", squeezed)
    why = "an odd number of hex digits" if odd else "not hex digits"
    told = "write bytes as FF FF FF 01 02 F1 0B"
    if re.fullmatch(r"[0-9]+", squeezed):
        told += f", a place in a capture as FILE@{squeezed}"
    raise InputError(f"{text!r}: {why}; {told}")


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
    # one that is damaged within what is no more than the beginning of another one is none
    all_of_it = {name: size for name, size in torn.items() if size == len(data)}
    rest = 2 * max(damaged.values(), default=0) <= len(data)
    for sizes in (all_of_it if rest else {}, damaged, torn):
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
    pieces = [draw_frame(batch, protocol, i) for i in range(len(batch.frames))]
    pieces += [draw_gap(batch, protocol, gap) for gap in batch.gaps]
    found = {a.evidence[0][0]: a for a in batch.anomalies if a.group not in ("pairing", "capture")}
    for piece in sorted(pieces, key=lambda p: p.offset):
        lines = piece.lines
        if piece.offset in found and piece.holds:
            lines.append(f"  ! {found[piece.offset].detail}")
        yield piece.offset, lines, piece.holds
