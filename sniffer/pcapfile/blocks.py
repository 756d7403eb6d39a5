"""Blocks of pcapng as bytes, written in the order of bytes of most machines."""

from __future__ import annotations

import struct
from typing import TYPE_CHECKING, Final

from sniffer.pcapfile.layout import (
    BYTE_ORDER,
    CHUNK_ENDS,
    COMMENT,
    ENHANCED,
    EPB_FLAGS,
    FACTS,
    IF_DESCRIPTION,
    IF_NAME,
    IF_SPEED,
    IF_TSOFFSET,
    IF_TSRESOL,
    INTERFACE,
    SECTION,
    USER_APPLICATION,
)

if TYPE_CHECKING:
    from collections.abc import Sequence

OPTION_MOST: Final = 65_000
"""Bytes of an option: its length has 16 bits."""

_Option = tuple[int, bytes]


def section(application: str, facts: bytes, comment: str) -> bytes:
    """Return the block that a file begins with, of unknown length."""
    fixed = struct.pack("<IHHq", BYTE_ORDER, 1, 0, -1)
    options = [(COMMENT, _text(comment)), (USER_APPLICATION, _text(application))]
    return _block(SECTION, fixed + _options([*options, (FACTS, facts)]))


def interface(
    link: int, name: str, description: str, *, speed: int, since_s: int, facts: bytes
) -> bytes:
    """Return the block of a bus: times in ns, counted from ``since_s`` (Unix seconds)."""
    options = [
        (IF_NAME, _text(name)),
        (IF_DESCRIPTION, _text(description)),
        (IF_SPEED, struct.pack("<Q", speed)),
        (IF_TSRESOL, b"\x09"),
    ]
    if since_s:
        options.append((IF_TSOFFSET, struct.pack("<q", since_s)))
    return _block(INTERFACE, struct.pack("<HHI", link, 0, 0) + _options([*options, (FACTS, facts)]))


def packet(
    face: int,
    t_ns: int,
    data: bytes,
    *,
    flags: int = 0,
    comments: Sequence[str] = (),
    ends: Sequence[bytes] = (),
) -> bytes:
    """Return the block of a packet of the interface number ``face``."""
    options: list[_Option] = [(COMMENT, _text(comment)) for comment in comments]
    if flags:
        options.append((EPB_FLAGS, struct.pack("<I", flags)))
    options += [(CHUNK_ENDS, told) for told in ends]
    size = len(data)
    fixed = struct.pack("<IIIII", face, t_ns >> 32, t_ns & 0xFFFFFFFF, size, size)
    return _block(ENHANCED, fixed + data + bytes(-size % 4) + _options(options))


def _block(kind: int, body: bytes) -> bytes:
    size = 12 + len(body)
    return struct.pack("<II", kind, size) + body + struct.pack("<I", size)


def _options(options: Sequence[_Option]) -> bytes:
    told = (
        struct.pack("<HH", code, len(value)) + value + bytes(-len(value) % 4)
        for code, value in options
    )
    return b"".join(told) + bytes(4) if options else b""


def _text(text: str) -> bytes:
    """Return a text as an option holds it: UTF-8, no half characters, no longer than it may be."""
    return text.encode("utf-8", "backslashreplace")[:OPTION_MOST].decode("utf-8", "ignore").encode()
