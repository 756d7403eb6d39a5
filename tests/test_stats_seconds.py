"""Seconds that are printed are those that ``--from`` takes."""

from __future__ import annotations

import re
from typing import TYPE_CHECKING

import pytest
from click.testing import CliRunner

from sniffer.cli import cli

if TYPE_CHECKING:
    from pathlib import Path

LATER = 10


def line(t: float, bus: str, *body: int) -> str:
    """Return the line of a packet with this body."""
    packet = bytes([0xFF, 0xFF, 0xFF, *body, ~sum(body) & 0xFF])
    return f"({1_795_215_300 + t:.6f}) {bus} #{packet.hex().upper()}\n"


def ping(servo: int, t: float, bus: str) -> str:
    """Return the lines of an echo and its answer, 1 ms apart."""
    return line(t, bus, servo, 2, 0xF1) + line(t + 0.001, bus, servo, 2, 0)


def said(*words: str) -> str:
    """Return what a command prints."""
    done = CliRunner().invoke(cli, words)
    assert done.exit_code == 0, done.output
    return done.stdout


@pytest.fixture
def capture(tmp_path: Path) -> Path:
    """A capture of two buses; servo 2 of the second answers 12 s after the first one's begin."""
    path = tmp_path / "two.log"
    times = [k / 10 for k in range(30)]
    early = "".join(ping(1, t, "arm") for t in times)
    late = "".join(ping(2 if t >= 2 else 1, LATER + t, "leg") for t in times)
    path.write_text(early + late)
    return path


@pytest.mark.parametrize(
    "asked",
    [
        pytest.param([], id="all of it"),
        pytest.param(["--from", "11"], id="a part"),
        pytest.param(["--servo", "2"], id="a selection"),
    ],
)
def test_stats_count_from_the_begin_of_the_capture(capture: Path, asked: list[str]) -> None:
    """Not from that of a bus that spoke later, of a part, or of what is selected."""
    told = said("stats", str(capture), "--protocol", "mightyzap", *asked).partition("leg: ")[2]
    heard = re.search(r"^ +2 +10 +(\d+\.\d+)", told, re.MULTILINE)
    assert heard is not None, told
    assert float(heard[1]) == pytest.approx(LATER + 2, abs=0.01)


def test_state_counts_from_the_begin_of_the_capture(capture: Path) -> None:
    """A table of a part says seconds of the whole."""
    goal = line(13, "leg", 1, 5, 0xF3, 0x86, 0, 8)
    capture.write_text(capture.read_text() + goal)
    told = said("state", str(capture), "--protocol", "mightyzap", "--from", "12.5")
    at = re.search(r"(\d+\.\d+)$", told.rstrip())
    assert at is not None, told
    assert float(at[1]) == pytest.approx(13, abs=0.02)


def test_a_bus_without_a_clock_leaves_the_seconds_of_the_others_as_they_are(
    capture: Path, tmp_path: Path
) -> None:
    goal = line(13, "leg", 1, 5, 0xF3, 0x86, 0, 8)
    capture.write_text(capture.read_text() + goal)
    bare = tmp_path / "bare.hex"
    bare.write_text(goal.partition("#")[2])
    alone = said("state", str(capture), "--protocol", "mightyzap")
    beside = said("state", str(capture), str(bare), "--protocol", "mightyzap")
    assert "bus0: mightyzap" in beside
    assert re.findall(r"(\d+\.\d+)$", alone, re.M) == re.findall(r"(\d+\.\d+)$", beside, re.M)
