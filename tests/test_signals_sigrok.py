"""sigrok beside the edge decoder: the same bytes of the same captures, and its files read."""

from __future__ import annotations

import shutil
import subprocess
from typing import TYPE_CHECKING, Final

import numpy as np
import pytest

from sniffer.ground.wiring import Wiring
from sniffer.sources import open_source
from tests.waves import Wire, sampled, spoken, sr

if TYPE_CHECKING:
    from pathlib import Path

    from sniffer.ground.model import U8

SIGROK: Final = shutil.which("sigrok-cli")

pytestmark = pytest.mark.skipif(SIGROK is None, reason="needs sigrok-cli (Debian: sigrok-cli)")

RATE: Final = 1_000_000
BAUD: Final = 115_200
RNG: Final = np.random.default_rng(11)
DATA: Final = bytes.fromhex("FFFFFF0104F28C027A FFFFFF010400FF07F4") * 8 + RNG.bytes(120)


def sigrok(*arguments: str | Path) -> bytes:
    """Run sigrok-cli; return what it prints."""
    assert SIGROK is not None
    done = subprocess.run(
        [SIGROK, *map(str, arguments)], capture_output=True, check=True, timeout=300
    )
    return done.stdout


def by_sigrok(path: Path, *options: str) -> bytes:
    told = ":".join(("uart", "rx=D0", f"baudrate={BAUD}", *options))
    return sigrok("-i", path, "-P", told, "-B", "uart=rx")


def by_us(path: Path, wiring: Wiring | None = None) -> bytes:
    with open_source(path, wiring=wiring) as opened:
        return b"".join(chunk.data for group in opened for chunk in group)


def noisy(levels: U8, count: int, length: int) -> U8:
    out = levels.copy()
    for at in RNG.choice(len(out) - length, count, replace=False).tolist():
        out[at : at + length] ^= 1
    return out


def with_errors() -> Wire:
    wire = Wire(0.001)
    for nth in range(12):
        wrong = "stop" if nth % 4 == 3 else ""
        wire.say(DATA[9 * nth : 9 * nth + 9], BAUD, after=0.0006, wrong=wrong)
        if nth % 5 == 4:
            wire.low(20 / BAUD, after=0.0004)
    wire.now += 0.001
    return wire


@pytest.mark.parametrize(
    ("levels", "rate", "options"),
    [
        (sampled(spoken(DATA, BAUD), RATE), RATE, ()),
        (sampled(spoken(DATA, BAUD * 1.02, pause_bits=0), 8 * BAUD), 8 * BAUD, ()),
        (sampled(spoken(DATA, BAUD * 0.98), 4 * BAUD), 4 * BAUD, ()),
        (sampled(spoken(DATA, BAUD), RATE, invert=True), RATE, ("invert_rx=yes",)),
        (sampled(with_errors(), 2 * RATE), 2 * RATE, ()),
    ],
    ids=["plain", "2 % fast", "2 % slow, four samples a bit", "inverted", "errors and breaks"],
)
def test_the_bytes_are_those_of_sigrok(
    levels: U8, rate: int, options: tuple[str, ...], tmp_path: Path
) -> None:
    path = sr(tmp_path / "wave.sr", {"D0": levels}, rate)
    theirs = by_sigrok(path, *options)
    assert by_us(path) == theirs
    assert len(theirs) > 100


def test_of_a_capture_with_glitches_no_less_is_read(tmp_path: Path) -> None:
    levels = noisy(sampled(spoken(DATA, BAUD), 2 * RATE), 60, 3)
    path = sr(tmp_path / "wave.sr", {"D0": levels}, 2 * RATE)
    assert by_us(path) == DATA
    assert by_sigrok(path) != DATA
    # without the filter a glitch is an edge to both
    assert by_us(path, Wiring(glitch_us=0, baud=BAUD, channels={"D0": ""})) != DATA


FORMS: Final = {
    "vcd": "wave.vcd",
    "srzip": "again.sr",
    "csv": "dense.csv",
    "csv:dedup=true:time=true": "changes.csv",
    "csv:time=true:label=off": "headless.csv",
    "csv:time=true:label=channel": "named.csv",
    "csv:trigger=true": "triggered.csv",
    "csv:time=true:trigger=true": "timed.csv",
}


def test_what_sigrok_writes_is_read_with_the_same_times(tmp_path: Path) -> None:
    channels = {
        "RX": sampled(spoken(DATA[:90], BAUD), RATE),
        "TX": sampled(spoken(DATA[90:180], BAUD, pause_bits=43), RATE),
    }
    path = sr(tmp_path / "wave.sr", channels, RATE, chunk=4321)
    with open_source(path) as opened:
        expected = [chunk for group in opened for chunk in group]
    for form, name in FORMS.items():
        written = tmp_path / name
        sigrok("-i", path, "-O", form, "-o", written)
        with open_source(written) as opened:
            assert [chunk for group in opened for chunk in group] == expected, form


def test_a_session_that_sigrok_made_of_samples_is_read(tmp_path: Path) -> None:
    raw = tmp_path / "wave.raw"
    raw.write_bytes(sampled(spoken(DATA, BAUD), RATE).tobytes())
    path = tmp_path / "wave.sr"
    given = ("-i", raw, "-I", f"binary:numchannels=1:samplerate={RATE}")
    sigrok(*given, "-o", path)
    assert by_us(path) == DATA
    table = tmp_path / "wave.csv"  # the rate is not in its comments: it is learned on the way
    sigrok(*given, "-O", "csv", "-o", table)
    assert b"META samplerate" in table.read_bytes()
    assert by_us(table) == DATA
