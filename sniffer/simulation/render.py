"""Frames on a wire -> what recording tools write: raw bytes, log lines with times, hex dumps.

Pure: text and bytes in memory. All of them show the bytes as seen on the line, not as meant.
"""

from __future__ import annotations

from typing import TYPE_CHECKING

from sniffer.ground.model import NS

if TYPE_CHECKING:
    from collections.abc import Iterable, Iterator

    from sniffer.simulation.talk import TrueFrame

Read = tuple[int, bytes]
"""Bytes as a reader got them, and when it had the last of them, in ns."""

USB_PACKET = 62
"""Payload of a full-speed packet of an FTDI adapter: 64 bytes less two of status."""


def raw(frames: Iterable[TrueFrame]) -> bytes:
    """Return the bytes back to back."""
    return b"".join(frame.wire for frame in frames)


def frame_reads(frames: Iterable[TrueFrame]) -> Iterator[Read]:
    """Yield each frame when its last byte was on the line, as a logic analyser shows it."""
    for frame in frames:
        if frame.wire:
            yield frame.t_end_ns, frame.wire


def usb_reads(
    frames: Iterable[TrueFrame], baud: int, *, latency_ns: int = 1_000_000
) -> Iterator[Read]:
    """Yield what a USB adapter delivers: frames are merged, and cut in two.

    It collects bytes until its packet is full or ``latency_ns`` has passed since the first of them.
    """
    held = bytearray()
    due_ns = 0
    for frame in frames:
        for k, byte in enumerate(frame.wire, 1):
            t_ns = frame.t_start_ns + -(-k * 10 * NS // baud)
            if held and t_ns > due_ns:
                yield due_ns, bytes(held)
                held.clear()
            if not held:
                due_ns = t_ns + latency_ns
            held.append(byte)
            if len(held) == USB_PACKET:
                yield t_ns, bytes(held)
                held.clear()
    if held:
        yield due_ns, bytes(held)


def candump(reads: Iterable[Read], bus: str = "bus0") -> str:
    """Return log lines in the manner of ``candump -L``, with microseconds."""
    lines = []
    for t_ns, data in reads:
        seconds, us = divmod(-(-t_ns // 1000), 1_000_000)
        lines.append(f"({seconds}.{us:06d}) {bus} #{data.hex().upper()}\n")
    return "".join(lines)


def _gutter(data: bytes) -> str:
    return "".join(chr(byte) if 32 <= byte < 127 else "." for byte in data)


def xxd(data: bytes) -> str:
    """Return the dump that ``xxd`` prints."""
    lines = []
    for at in range(0, len(data), 16):
        row = data[at : at + 16]
        pairs = " ".join(row[k : k + 2].hex() for k in range(0, len(row), 2))
        lines.append(f"{at:08x}: {pairs:<39}  {_gutter(row)}\n")
    return "".join(lines)


def hexdump(data: bytes) -> str:
    """Return the dump that ``hexdump -C`` prints; a ``*`` stands for rows like the one before."""
    lines = []
    before, starred = b"", False
    for at in range(0, len(data), 16):
        row = data[at : at + 16]
        if row == before:
            if not starred:
                lines.append("*\n")
            starred = True
            continue
        before, starred = row, False
        halves = f"{row[:8].hex(' '):<23}  {row[8:].hex(' '):<23}"
        lines.append(f"{at:08x}  {halves}  |{_gutter(row)}|\n")
    if data:
        lines.append(f"{len(data):08x}\n")
    return "".join(lines)
