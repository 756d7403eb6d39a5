"""Reading an input in a test: its chunks, its bytes, its damage, its refusal."""

from __future__ import annotations

import itertools
import shutil
import subprocess
from pathlib import Path
from typing import TYPE_CHECKING

import pytest
from hypothesis import strategies as st

from sniffer.ground.model import Chunk, DamagedInputError, InputError
from sniffer.sources import open_source

if TYPE_CHECKING:
    from collections.abc import Callable, Iterator

SAMPLES = Path(__file__).parent / "data" / "formats"
BUS = (SAMPLES / "bus.bin").read_bytes()


def chunks(text: bytes | Path, input_format: str = "auto") -> list[Chunk]:
    return [chunk for group in open_source(text, input_format) for chunk in group]


def read(text: bytes | Path, input_format: str = "auto") -> bytes:
    return b"".join(chunk.data for chunk in chunks(text, input_format))


def notes(log: bytes) -> str:
    """Return what is told of a log that was read to its end."""
    source = open_source(log)
    list(source)
    return "; ".join(source.notes)


def until_damage(text: bytes, input_format: str = "auto") -> tuple[bytes, str]:
    """Return what is read before the damage, and the message."""
    got: list[bytes] = []
    groups = iter(open_source(text, input_format))

    def rest() -> None:
        got.extend(chunk.data for group in groups for chunk in group)

    with pytest.raises(DamagedInputError) as caught:
        rest()
    return b"".join(got), str(caught.value)


def refusal(text: bytes | str | Path, input_format: str = "auto") -> str:
    with pytest.raises(InputError) as caught:
        list(open_source(text, input_format))
    message = str(caught.value)
    assert "\n" not in message
    return message


ROW = b"00000000  fa af 01 00 1e 02 01 84  03 9b fa af 01 0f 2a 02  |..............*.|\n"

# bytes as captures have them: runs of one value (idle, stars in dumps) between anything
PAYLOADS = st.lists(
    st.one_of(
        st.binary(max_size=40),
        st.tuples(st.binary(min_size=1, max_size=1), st.integers(0, 100)).map(
            lambda p: p[0] * p[1]
        ),
        st.just(b"|1443..fa af|  >00 <\n0000: 4142 * "),
    ),
    max_size=12,
).map(b"".join)


# --- the tools, and the same in Python where a tool is not installed --------------------------


def shown(data: bytes) -> str:
    return "".join(chr(byte) if 32 <= byte < 127 else "." for byte in data)


def lines_of(data: bytes) -> Iterator[tuple[int, bytes]]:
    return ((at, data[at : at + 16]) for at in range(0, len(data), 16))


def starred(lines: list[tuple[int, bytes]], draw: Callable[[int, bytes], str]) -> list[str]:
    """Leave out lines equal to the one before, as hexdump and od do."""
    out: list[str] = []
    for (_, before), (at, data) in itertools.pairwise([(-1, b""), *lines]):
        if data != before or len(data) < 16:
            out.append(draw(at, data))
        elif out[-1] != "*":
            out.append("*")
    return out


def xxd(data: bytes) -> bytes:
    rows = [f"{at:08x}: {row.hex(' ', -2):<39}  {shown(row)}\n" for at, row in lines_of(data)]
    return "".join(rows).encode()


def hexdump(data: bytes) -> bytes:
    def draw(at: int, row: bytes) -> str:
        return f"{at:08x}  {row[:8].hex(' '):<23}  {row[8:].hex(' '):<23}  |{shown(row)}|"

    rows = starred(list(lines_of(data)), draw)
    return "".join(f"{row}\n" for row in [*rows, f"{len(data):08x}"] if data).encode()


def od(data: bytes) -> bytes:
    rows = starred(list(lines_of(data)), lambda at, row: f"{at:07o} {row.hex(' ')}")
    return "".join(f"{row}\n" for row in [*rows, f"{len(data):07o}"]).encode()


TOOLS: dict[str, tuple[list[str], Callable[[bytes], bytes], str]] = {
    "xxd": (["xxd"], xxd, "xxd.txt"),
    "hexdump": (["hexdump", "-C"], hexdump, "hexdump-C.txt"),
    "od": (["od", "-tx1"], od, "od-tx1.txt"),
}


def rendered(tool: str, data: bytes, *options: str) -> bytes:
    command, ours, _ = TOOLS[tool]
    if shutil.which(command[0]) and data:  # a fork costs: see the stored samples for the rest
        command = [*command[:1], *(options or command[1:])]
        return subprocess.run(command, input=data, capture_output=True, check=True).stdout
    if options:
        pytest.skip(f"{tool} is not installed")
    return ours(data)
