"""A servo bus as a capture interface: Wireshark reads it live, and it is recorded."""

from __future__ import annotations

import os
import shutil
import signal
import subprocess
import sys
from pathlib import Path
from typing import TYPE_CHECKING

import pytest

import sniffer
from sniffer.cli.extcap import FOLDER, main, recording_of
from sniffer.pcapfile.layout import HEAD
from sniffer.wireshark.install import install
from sniffer.wireshark.places import Places
from tests.commands import Ran, environment
from tests.simulations import DEADLINE_S, running

if TYPE_CHECKING:
    from collections.abc import Iterator

pytestmark = pytest.mark.skipif(not hasattr(os, "mkfifo"), reason="needs named pipes")

Capsys = pytest.CaptureFixture[str]

CALLED = (sys.executable, "-m", "sniffer.cli.extcap")
FRAMES = 30


@pytest.fixture(scope="module")
def bus(tmp_path_factory: pytest.TempPathFactory) -> Iterator[str]:
    """A simulated bus that anyone may listen to."""
    link = tmp_path_factory.mktemp("bus") / "bus"
    with running("mightyzap", "--servos", "3", "--link", link) as simulated:
        yield simulated.ports[0]


def frames_of(path: Path) -> list[str]:
    """Return the frames of a capture as hexadecimal digits."""
    out: list[str] = []
    for _, _, batch in sniffer.decode(path).batches:
        f = batch.frames
        for start, length in zip(f.start.tolist(), f.length.tolist(), strict=True):
            out.append(batch.data[start : start + length].hex())
    return out


def answered(capsys: Capsys, *arguments: str | Path) -> Ran:
    """Call the program as Wireshark does, but within this process."""
    capsys.readouterr()
    status = main([str(a) for a in arguments])
    out, err = capsys.readouterr()
    return Ran(status, out, err)


def test_the_options_are_asked_for_with_their_values_and_defaults(capsys: Capsys) -> None:
    named = ("--extcap-interface", "servo-bus", "--extcap-version=4.0")
    ran = answered(capsys, *named, "--extcap-config")
    assert (ran.status, ran.err) == (0, "")
    lines = ran.out.splitlines()
    asked = [line for line in lines if line.startswith("arg ")]
    assert [line.split("{call=--")[1].split("}")[0] for line in asked] == [
        *("port", "path", "protocol", "baud", "recording", "no-recording")
    ]
    for number in (0, 2):  # every selector has one value that is chosen
        values = [line for line in lines if line.startswith(f"value {{arg={number}}}")]
        assert sum("{default=true}" in line for line in values) == 1
    assert {line.split("{")[0] for line in lines} == {"arg ", "value "}


def test_ports_are_looked_for_again_where_the_dialogue_asks_for_it(capsys: Capsys) -> None:
    lines = answered(capsys, "--extcap-config", "--extcap-reload-option", "port").out.splitlines()
    assert lines
    assert all(line.startswith("value {arg=0}") for line in lines)


@pytest.mark.parametrize(
    ("arguments", "told"),
    [
        (["--fifo", "x"], "choose a serial port, or give the path of one"),
        (["--path", "/dev/null"], "gave no --fifo"),
        (["--path", "/dev/null", "--fifo", "x", "--baud", "7"], "--baud 7: 300 to 10000000"),
        (["--path", "/dev/null", "--fifo", "x", "--protocol", "morse"], "there is no 'morse'"),
        (["--path", "/dev/null", "--fifo", "/no/such/x"], "there is no folder /no/such"),
    ],
)
def test_a_mistake_is_one_line_on_standard_error(
    arguments: list[str], told: str, capsys: Capsys
) -> None:
    ran = answered(capsys, "--capture", *arguments)
    assert (ran.status, ran.out) == (2, "")
    assert told in ran.complaint


def test_a_port_that_cannot_be_opened_is_told_and_nothing_is_left_behind(
    tmp_path: Path, capsys: Capsys
) -> None:
    fifo, recording = tmp_path / "fifo", tmp_path / "x.mcap"
    os.mkfifo(fifo)
    reader = os.open(fifo, os.O_RDONLY | os.O_NONBLOCK)
    port = tmp_path / "nowhere"
    where = ("--fifo", fifo, "--path", port, "--recording", recording)
    ran = answered(capsys, "--capture", *where)
    os.close(reader)
    assert (ran.status, ran.out) == (2, "")
    assert str(port) in ran.complaint
    assert not recording.exists()


def test_a_capture_is_recorded_in_a_file_of_its_own_if_nobody_says_where(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setenv("HOME", str(tmp_path))
    own = recording_of("", is_wanted=True)
    assert own is not None
    assert own.parent == tmp_path / FOLDER
    assert own.parent.is_dir()
    assert own.suffix == ".mcap"
    there = recording_of(str(tmp_path), is_wanted=True)
    assert there is not None
    assert there.parent == tmp_path
    assert recording_of("x/run", is_wanted=True) == Path("x/run.mcap")
    assert recording_of("x.mcap", is_wanted=True) == Path("x.mcap")
    assert recording_of("x.mcap", is_wanted=False) is None
    before = tmp_path / "run.mcap"
    before.write_bytes(b"of the capture before")
    after = recording_of(str(before), is_wanted=True)
    assert after is not None
    assert not after.exists()
    assert after.name.startswith("run-")


@pytest.mark.parametrize("way", ["the reader goes", "a polite kill"])
def test_a_capture_ends_well_and_its_recording_has_what_was_shown(
    way: str, bus: str, tmp_path: Path
) -> None:
    fifo, recording, shown = tmp_path / "fifo", tmp_path / "x.mcap", tmp_path / "x.pcapng"
    os.mkfifo(fifo)
    arguments = ("--fifo", fifo, "--path", bus, "--protocol", "mightyzap", "--recording", recording)
    with subprocess.Popen(
        [*CALLED, "--capture", *map(str, arguments)],
        stdout=subprocess.PIPE,
        stderr=subprocess.PIPE,
        text=True,
        env=environment(),
    ) as process:
        with fifo.open("rb", buffering=0) as pipe, shown.open("wb") as kept:
            while kept.tell() < FRAMES * (HEAD.size + 80):
                data = pipe.read(65536)
                assert data
                kept.write(data)
            if way != "the reader goes":
                process.send_signal(signal.SIGTERM)
                while data := pipe.read(65536):
                    kept.write(data)
        out, err = process.communicate(timeout=DEADLINE_S)
    assert (process.returncode, out, err) == (0, "", "")
    recorded = frames_of(recording)
    assert len(recorded) > FRAMES / 2
    if way == "a polite kill":  # else the last block is cut
        assert frames_of(shown) == recorded


@pytest.mark.skipif(shutil.which("tshark") is None, reason="needs tshark")
def test_tshark_captures_from_the_bus_and_it_is_recorded_at_the_same_time(
    bus: str, tmp_path: Path
) -> None:
    extcap = tmp_path / ".config/wireshark/extcap"
    newer = tmp_path / ".local/lib/wireshark/extcap"
    install(Places(tmp_path / "plugins", tmp_path / "profile", (extcap, newer)))
    shown, recording = tmp_path / "shown.pcapng", tmp_path / "recorded.mcap"
    told = {"path": bus, "protocol": "mightyzap", "recording": str(recording)}
    options = [a for k, v in told.items() for a in ("-o", f"extcap.servo_bus.{k}:{v}")]
    command = ["tshark", "-i", "servo-bus", *options, "-a", f"packets:{FRAMES}", "-w", str(shown)]
    own = environment(HOME=str(tmp_path))
    own.pop("XDG_CONFIG_HOME", None)
    ran = subprocess.run(
        command, env=own, capture_output=True, text=True, timeout=DEADLINE_S, check=False
    )
    assert ran.returncode == 0, ran.stderr
    live = frames_of(shown)
    assert len(live) >= FRAMES - 2  # of a bus that is joined somewhere, the first may be none
    assert frames_of(recording)[: len(live)] == live
