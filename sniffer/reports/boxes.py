"""Bytes drawn field by field on a page: a box a field, its name above, its value below.

Boxes flow from line to line, so that a frame can be read on a phone and on paper.
"""

from __future__ import annotations

from typing import TYPE_CHECKING, Final

from sniffer.decoding.drawing import detail_in_words
from sniffer.reports.markup import Markup, joined, tag

if TYPE_CHECKING:
    from collections.abc import Iterator

    from sniffer.decoding.drawing import Drawn
    from sniffer.protocols.base import FieldSpan

SHOWN: Final = 32
"""Bytes of a field, or of a gap without fields, that are shown; the others are counted."""

VALUE: Final = 48
"""Characters of a value in a box; the rest stands in its title."""

WRONG: Final = "✗"


def drawing(piece: Drawn) -> Markup:
    """Return a frame or a gap as boxes, with what is known of it below."""
    lines = [tag("div", *_boxes(piece), cls="boxes")]
    told = [*piece.values]
    if piece.outcome not in ("", "ok"):
        told.append(f"exchange: {piece.outcome}")
    if piece.known and not piece.spans:
        known = detail_in_words(piece.known)
        told += [f"{k.replace('_', ' ')}: {v}" for k, v in known.items()]
    if told:
        lines.append(tag("ul", *(tag("li", line) for line in told), cls="known"))
    title = tag("p", tag("b", piece.title), f" at byte {piece.offset}", cls="piece")
    return tag("div", title, *lines, cls="drawn" if piece.holds else "drawn torn")


def _boxes(piece: Drawn) -> Iterator[Markup]:
    """Yield the boxes of a piece, with the bytes that no field covers."""
    at = 0
    for span in piece.spans:
        if span.offset > at:
            yield _box(piece.raw[at : span.offset], "", "")
        at = max(at, span.offset + span.length)
        yield _field(piece, span)
    if at < len(piece.raw):
        yield _box(piece.raw[at:], "", "", wrong=not piece.holds and not piece.spans)


def _field(piece: Drawn, span: FieldSpan) -> Markup:
    raw = piece.raw[span.offset : span.offset + span.length]
    if piece.checksum and span.name == piece.sealed and piece.holds:
        return _box(raw, span.name, "holds", piece.checksum)
    if span.name != piece.wrong or piece.known is None:
        return _box(raw, span.name, span.value, span.note)
    expected = detail_in_words(piece.known).get("checksum_expected", "00")
    return _box(raw, span.name, f"should be {expected}", wrong=True)


def _box(raw: bytes, name: str, value: str, note: str = "", *, wrong: bool = False) -> Markup:
    shown = raw[:SHOWN].hex(" ").upper()
    if len(raw) > SHOWN:
        shown += f" … {len(raw) - SHOWN} more"
    short = value if len(value) <= VALUE else f"{value[: VALUE - 1]}…"
    if value.replace(" ", "").upper() == raw.hex().upper():
        short = ""  # it says the bytes once more
    return tag(
        "div",
        tag("span", joined([WRONG + " " if wrong else "", name.replace("_", " ")]), cls="name"),
        tag("code", shown),
        tag("span", short, cls="value"),
        cls="box wrong" if wrong else "box",
        title=", ".join(t for t in (name, value, note) if t) or None,
    )
