"""Logs that print bytes in blocks: what is left of a message stands in a line alone."""

from __future__ import annotations

import pytest

from tests.inputs import chunks, notes
from tests.streams import mightyzap

REQUEST = mightyzap.packet(1, 0xF2, b"\x8c\x02")
ANSWER = mightyzap.packet(1, 0, b"\xd0\x07")
LONG = mightyzap.packet(0xFE, 0x73, bytes([0x86, 2, 1, 0xD0, 7, 2, 0xD0, 7, 3, 0xD0, 7]))

HEADS = ["I (1000) uart_events: ", "I (1000) servo: ", "[INFO] [17321.100] [bus]: "]


def dumped(head: str, frames: list[bytes], size: int, *, text: bool = False) -> bytes:
    """Return what a program prints that writes so many bytes a line, with them as text or not."""
    lines = []
    for frame in frames:
        for k in range(0, len(frame), size):
            block = frame[k : k + size]
            column = "  |" + "." * len(block) + "|" if text else ""
            lines.append(f"{head}{block.hex(' '):{3 * size - 1 if text else 0}}{column}\n")
    return "".join(lines).encode()


@pytest.mark.parametrize("head", HEADS)
@pytest.mark.parametrize("text", [False, True])
@pytest.mark.parametrize(("frames", "size"), [([REQUEST, ANSWER] * 5, 8), ([LONG] * 5, 16)])
def test_the_rest_of_a_block_is_read_where_one_byte_is_left(
    head: str, frames: list[bytes], size: int, *, text: bool
) -> None:
    assert len(frames[0]) % size in (1, 2)
    log = dumped(head, frames, size, text=text)
    assert b"".join(c.data for c in chunks(log)) == b"".join(frames)


def test_a_number_behind_no_block_is_none() -> None:
    head = "I (1000) servo: "
    ping = mightyzap.packet(1, 0xF1)
    log = dumped(head, [ping] * 5, 16) + f"{head}12\n".encode()
    assert b"".join(c.data for c in chunks(log)) == ping * 5
    assert "left out" in notes(log)
