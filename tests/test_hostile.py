"""Input that was made to do harm, or that bad luck made.

One line, the right status, no more memory than there is reason for, nothing lost that was decoded.
"""

from __future__ import annotations

import json
import struct
import sys
from pathlib import Path
from typing import TYPE_CHECKING, Final

import pytest
from mcap.opcode import Opcode

from sniffer.ground.limits import BUSES_MOST
from sniffer.sources.hexdump import REPEATED
from tests import hostile
from tests.hostile import MEMORY, PAIR, Victim, decoded, sound

if TYPE_CHECKING:
    from collections.abc import Callable

pytestmark = pytest.mark.skipif(sys.platform == "win32", reason="limits memory as POSIX does")

CAPTURES: Final = Path(__file__).parents[1] / "sample_captures"


def smallest_messages(base: bytes) -> bytes:
    """Return the records of a recording's first chunk, then many messages with nothing."""
    head = hostile.unpacked(base)
    message = struct.pack("<BQHIQQ", Opcode.MESSAGE, 22, 1, 0, 0, 0)
    return head + message * (1 << 17)


PACKED: Final[dict[str, tuple[Callable[[bytes], bytes], str]]] = {
    "a bomb in a torn chunk": (
        lambda base: hostile.with_chunk(
            base, hostile.bomb(128), size=1 << 28, packing="zstd", missing=1000
        ),
        "it breaks off",
    ),
    "a bomb in a torn chunk that names its size": (
        lambda base: hostile.with_chunk(
            base, hostile.bomb(128), size=128 << 20, packing="zstd", missing=1000
        ),
        "it breaks off",
    ),
    "255 MB of zeros": (
        lambda base: hostile.with_chunk(base, hostile.bomb(255), size=255 << 20, packing="zstd"),
        "a chunk claims to have 267386880 bytes",
    ),
    "63 MB of zeros": (
        lambda base: hostile.with_chunk(base, hostile.bomb(63), size=63 << 20, packing="zstd"),
        "there are zeros where a record should begin",
    ),
    "a chunk that unpacks to more than it says": (
        lambda base: hostile.with_chunk(base, hostile.bomb(100), size=1000, packing="zstd"),
        "a chunk cannot be unpacked",
    ),
    "messages with nothing in them": (
        lambda base: hostile.with_chunk(
            base,
            hostile.bomb(1, smallest_messages(base)),
            size=len(smallest_messages(base)),
            packing="zstd",
        ),
        "bytes 360 to 0 of bus0 are missing",
    ),
    "a packing that nobody knows": (
        lambda base: hostile.with_chunk(base, b"", size=0, packing="x" * 10_000),
        "which is not known here",
    ),
    "metadata of 200 MB that are not there": (
        lambda base: (
            base[: next(hostile.places(base, Opcode.CHUNK))]
            + struct.pack("<BQ", Opcode.METADATA, 200 << 20)
        ),
        "it breaks off",
    ),
    "a header of 200 MB": (
        lambda base: base[:8] + struct.pack("<BQ", Opcode.HEADER, 200 << 20) + bytes(1000),
        "a record claims to have 209715200 bytes",
    ),
}


@pytest.mark.parametrize("name", PACKED)
def test_what_is_packed_takes_no_more_memory_than_a_recording_of_ours(
    name: str, victim: Victim, base: bytes, tmp_path: Path
) -> None:
    make, why = PACKED[name]
    answer, told = decoded(victim, tmp_path / "x.mcap", make(base), "--protocol", "mightyzap")
    assert answer.status in (0, 3)
    assert len(told) == 1
    assert why in told[0]
    recovered = victim.run("recover", tmp_path / "x.mcap", "-o", tmp_path / "whole.mcap")
    assert recovered.status in (0, 2)
    assert recovered.memory < MEMORY


@pytest.mark.parametrize(
    ("dump", "line"),
    [
        ("00000000  {}  |...|\n*\n40000000  ff\n", 3),
        ("00000000  {}  |...|\n*\n3fffffff\n", 3),
        ("0000000 {}\n*\n7777777777\n", 3),
        ("00000000: {}  ....\n*\n40000000: ff  .\n", 3),
        (
            "".join(
                ["00000000" + "  ff" * 16 + "\n*\n", *(f"{n << 21:08x}\n*\n" for n in range(1, 9))]
            ),
            7,
        ),
    ],
)
def test_a_star_stands_for_no_more_than_a_line_ever_repeats(
    dump: str, line: int, victim: Victim, tmp_path: Path
) -> None:
    text = dump.replace("{}", "ff ff ff 01 04 f2 8c 02 7a ff ff ff 01 04 00 ff")
    path = tmp_path / "x.txt"
    path.write_text(text, encoding="utf-8")
    answer = victim.run("decode", path, "--protocol", "mightyzap", "--quiet")
    assert answer.status == 3
    told = sound(answer)
    assert told[0].startswith(f"{path}, line {line}: by offset ")
    assert told[0].endswith("bytes: not credible")


def test_a_star_may_stand_for_minutes_of_a_line_at_rest(victim: Victim, tmp_path: Path) -> None:
    row = "00000000  ff ff ff ff ff ff ff ff  ff ff ff ff ff ff ff ff  |...|\n"
    path = tmp_path / "x.txt"
    path.write_text(f"{row}*\n{REPEATED // 2:08x}\n", encoding="utf-8")
    answer = victim.run(
        *("decode", path, "--protocol", "mightyzap", "--summary", "--format", "jsonl")
    )
    assert answer.status == 0
    assert json.loads(answer.out)["bytes"] == REPEATED // 2


@pytest.mark.parametrize("form", ["jsonl", "log"])
def test_more_buses_than_there_can_be_end_the_input_in_one_line(
    form: str, victim: Victim, tmp_path: Path
) -> None:
    def line(n: int) -> str:
        if form == "log":
            return f"(1.{n:09d}) b{n} #{PAIR}\n"
        return json.dumps({"type": "frame", "hex": PAIR, "offset": 0, "bus": f"b{n}"}) + "\n"

    data = "".join(map(line, range(10_000))).encode()
    answer, told = decoded(victim, tmp_path / f"x.{form}", data, "--protocol", "mightyzap")
    assert answer.status == 3
    assert told == [
        f"{tmp_path / f'x.{form}'}: more than {BUSES_MOST} buses: are they names of one?"
    ]
    assert len(json.loads(answer.out.splitlines()[-1])["buses"]) == BUSES_MOST


@pytest.mark.parametrize(
    "text",
    [
        b'{"type":"frame","hex":"' + b"ff" * (1 << 21) + b'","offset":0}\n',
        b"(1.5) bus0 #" + b"ff" * (1 << 21) + b"\n",
        b"00000000  " + b"ff " * (1 << 20) + b"\n",
    ],
)
def test_an_endless_line_is_no_line(text: bytes, victim: Victim, tmp_path: Path) -> None:
    for data in (text, b'{"type":"frame","hex":"ff","offset":0}\n' * 20 + text):
        answer, told = decoded(victim, tmp_path / "x", data, "--protocol", "mightyzap")
        assert answer.status in (2, 3)
        assert len(told) == 1
