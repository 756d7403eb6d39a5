"""Packed inputs: read as what is in them, in memory that does not depend on what they unpack to."""

from __future__ import annotations

import gzip
import zlib
from pathlib import Path
from random import Random
from typing import TYPE_CHECKING, Final

import pytest
import zstandard

from sniffer.ground.model import DamagedInputError
from sniffer.sources import open_source
from sniffer.sources.opening import File, Pipe
from sniffer.sources.packed import RATIO_MOST, SMALL, unpacked
from sniffer.sources.recognise import HEAD
from tests.commands import sniffer, within

if TYPE_CHECKING:
    from collections.abc import Callable, Iterable, Mapping, Sequence

    from sniffer.ground.model import Chunk

CAPTURE: Final = Path(__file__).parents[1] / "sample_captures" / "wck_damaged.log"

PACKINGS: Final[Mapping[str, Callable[[bytes], bytes]]] = {
    ".gz": gzip.compress,
    ".zst": zstandard.compress,
}


@pytest.mark.parametrize("suffix", PACKINGS)
def test_a_packed_log_is_read_as_the_log(suffix: str, tmp_path: Path) -> None:
    plain = CAPTURE.read_bytes()
    path = tmp_path / f"walk.log{suffix}"
    half = plain.index(b"\n", len(plain) // 2) + 1
    pack = PACKINGS[suffix]
    path.write_bytes(pack(plain[:half]) + pack(plain[half:]))  # as two parts joined by `cat`
    whole = sniffer("decode", CAPTURE, "--summary", "--format", "jsonl").out
    assert sniffer("decode", path, "--summary", "--format", "jsonl").out == whole
    piped = sniffer("decode", "-", "--summary", "--format", "jsonl", data=path.read_bytes())
    assert piped.out == whole


@pytest.mark.parametrize("suffix", PACKINGS)
@pytest.mark.parametrize("piped", [False, True])
def test_what_hardly_packs_is_recognised_though_its_first_block_is_longer_than_a_head(
    suffix: str, *, piped: bool, tmp_path: Path
) -> None:
    # as a recording is, which is packed already: zstd has 128 KiB of it in one block
    data = b"\x89MCAP0\r\n" + Random(0).randbytes(3 * HEAD)
    path = tmp_path / f"walk.mcap{suffix}"
    path.write_bytes(PACKINGS[suffix](data))
    stream = path.open("rb", buffering=0)
    origin = unpacked(Pipe(stream, "a pipe", owned=True) if piped else File(path))
    assert data.startswith(origin.head)
    assert origin.head.startswith(b"\x89MCAP0")
    with origin.open() as opened:
        assert b"".join(iter(lambda: opened.read(1 << 14), b"")) == data
    origin.close()
    stream.close()


@pytest.mark.parametrize("suffix", PACKINGS)
def test_the_suffix_inside_counts_where_the_content_leaves_it_open(
    suffix: str, tmp_path: Path
) -> None:
    path = tmp_path / f"x.bin{suffix}"
    path.write_bytes(PACKINGS[suffix](b"0123"))
    assert open_source(path).format == "bin"
    assert open_source(path.rename(tmp_path / f"x.txt{suffix}")).format == "hex"


@pytest.mark.parametrize("suffix", PACKINGS)
def test_a_packed_file_that_is_cut_off_is_read_as_far_as_it_goes(
    suffix: str, tmp_path: Path
) -> None:
    path = tmp_path / f"walk.log{suffix}"
    path.write_bytes(PACKINGS[suffix](CAPTURE.read_bytes() * 9)[:-9])
    ran = sniffer("decode", path, "--summary")
    assert ran.status == 3
    assert "is cut off" in ran.err
    assert "in 0 frames" not in ran.out
    assert "frames" in ran.out


def test_a_packed_recording_that_is_cut_off_is_read_as_far_as_it_goes(
    tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    """It is read here and there, so it is unpacked first: nothing was left of it."""
    recording, plain = tmp_path / "a.mcap", tmp_path / "plain.mcap"
    within(capsys, "convert", CAPTURE, recording, "--quiet")
    packed = gzip.compress(recording.read_bytes())[:40_000]
    plain.write_bytes(zlib.decompressobj(wbits=31).decompress(packed))
    cut = tmp_path / "cut.mcap.gz"
    cut.write_bytes(packed)
    whole, ran = (within(capsys, "decode", path, "--format", "jsonl") for path in (plain, cut))
    assert ran.status == 0
    assert ran.out == whole.out != ""
    assert "cut recording" in ran.err


@pytest.mark.parametrize("pack", PACKINGS.values(), ids=PACKINGS)
def test_a_bomb_is_given_up_before_it_goes_off(pack: Callable[[bytes], bytes]) -> None:
    packed = pack(bytes(2 * SMALL))
    assert RATIO_MOST * len(packed) < 2 * SMALL
    read: list[int] = []

    def take(groups: Iterable[Sequence[Chunk]]) -> None:
        read.extend(len(chunk.data) for group in groups for chunk in group)

    with pytest.raises(DamagedInputError, match="no capture does"):
        take(open_source(packed))
    assert sum(read) <= SMALL + (1 << 24)


def test_what_was_recorded_is_compared_in_an_unpacked_file_only(tmp_path: Path) -> None:
    recording = tmp_path / "run.mcap"
    assert sniffer("decode", CAPTURE, "-o", recording, "--quiet").status == 0
    packed = tmp_path / "run.mcap.gz"
    packed.write_bytes(gzip.compress(recording.read_bytes()))
    ran = sniffer("replay", packed, "--redecode")
    assert ran.status == 2
    assert ran.complaint == (
        f"{packed} is packed: unpack it first (gunzip, unzstd); its frames are read in place"
    )
