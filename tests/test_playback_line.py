"""``sniffer replay --to PORT``: the line as it was, on pseudo-terminals."""

from __future__ import annotations

import os
import select
import signal
import subprocess
import time
from typing import TYPE_CHECKING, Any, Final

import pytest
from hypothesis import given
from hypothesis import strategies as st

from sniffer.ground.model import NS, Chunk, Clock, OutputError, SnifferError
from sniffer.jobs.playback import PlayedRole
from sniffer.playback.line import LinePlayer
from sniffer.selection.places import Window, names_port
from sniffer.simulation.play.outlet import FrameWriter
from tests.commands import COMMAND, damaged, environment, log, talk, within
from tests.lists import each_in_turn
from tests.playbacks import CLEAN, playing
from tests.simulations import DEADLINE_S, ear
from tests.terminals import LINUX_ONLY, heard

if TYPE_CHECKING:
    from collections.abc import Sequence
    from pathlib import Path

Capsys = pytest.CaptureFixture[str]
MS: Final = NS // 1000
LINE: Final = PlayedRole.LINE


# --- its moments -------------------------------------------------------------------------------


class Wall:
    """A clock that stands still while nobody sleeps or works, and who stops what goes by it."""

    asked = False
    step_ns = NS
    """It never sleeps longer: something may have come."""

    def __init__(self, late_ns: Sequence[int]) -> None:
        self.now_ns = 7 * NS
        self._late = list(late_ns)

    def now(self) -> int:
        return self.now_ns

    def sleep(self, ns: int, *others: int) -> None:
        """Sleep too long, as machines do."""
        del others
        self.now_ns += min(ns, self.step_ns) + (self._late.pop() if self._late else 0)


class Noted:
    """A port that notes when bytes came."""

    name, carries = "port", False

    def __init__(self, wall: Wall) -> None:
        self._wall = wall
        self.written: list[tuple[int, bytes]] = []

    def fileno(self) -> int:
        return -1

    def listened(self) -> bool:
        return True

    def write(self, data: bytes) -> int:
        self.written.append((self._wall.now_ns - 7 * NS, data))
        return len(data)

    def read(self) -> bytes:
        return b""

    def forget(self) -> int:
        return 0

    def drain(self) -> int:
        return 0

    def close(self) -> None:
        pass


def moments(at_ms: Sequence[int], late_ns: Sequence[int], speed: float) -> list[int]:
    """Return when the chunks of these times are written, from the first one on."""
    wall: Any = Wall(late_ns)
    port = Noted(wall)
    player = LinePlayer({"bus0": FrameWriter(port, lambda frame, offset: None)}, wall, wall.now)
    player.play((Chunk(b"x", 5 * NS + at * MS, Clock.FILE) for at in at_ms), speed)
    assert player.pacing.worst_ns <= max(late_ns, default=0)
    return [t for t, _ in port.written]


def test_where_the_clock_was_set_a_line_is_played_on_at_once() -> None:
    leap = 57 * 365 * 86_400_000
    assert moments([0, 250, leap + 300, leap + 400, 60, 160], [], 1.0) == [
        t * MS for t in (0, 250, 250, 350, 350, 450)
    ]


TIMES = st.lists(st.integers(0, 10_000), min_size=2, max_size=30).map(sorted)


@given(TIMES, st.lists(st.integers(0, 3 * MS), max_size=30), st.sampled_from([0.5, 1.0, 4.0]))
def test_nothing_is_early_and_what_is_late_delays_nothing_else(
    at_ms: list[int], late_ns: list[int], speed: float
) -> None:
    due = [int((at - at_ms[0]) * MS / speed) for at in at_ms]
    for written, planned in zip(moments(at_ms, late_ns, speed), due, strict=True):
        assert planned <= written <= planned + 3 * MS


def test_speed_0_waits_for_nothing() -> None:
    assert moments([0, 5000, 9000], [], 0) == [0, 0, 0]


# --- its bytes ---------------------------------------------------------------------------------


def two_buses(folder: Path) -> tuple[Path, dict[str, bytes]]:
    """Write a log of two buses, with noise and damage, a tenth of a second long."""
    said = {"arm": damaged(talk(2)), "leg": talk(3, seed=4)}
    lines = []
    for nth, (bus, data) in enumerate(said.items()):
        pieces = [data[at : at + 11] for at in range(0, len(data), 11)]
        for k, piece in enumerate(pieces):
            lines.append((k * 2 + nth, f"{bus} #{piece.hex().upper()}"))
    path = folder / "two.log"
    written = (f"(1700000000.{ms:03d}000) {text}\n" for ms, text in sorted(lines))
    path.write_text("".join(written))
    return path, said


def test_each_bus_has_its_port_and_every_byte_comes_damage_and_noise_too(tmp_path: Path) -> None:
    path, said = two_buses(tmp_path)
    with (
        playing(path, "mightyzap", LINE) as it,
        ear(it.names["arm"]) as arm,
        ear(it.names["leg"]) as leg,
    ):
        assert arm.listen(until=len(said["arm"])) == said["arm"]
        assert leg.listen(until=len(said["leg"])) == said["leg"]
        done = it.wait()
    assert [(bus, w.size, w.lost) for bus, w in done.ports.items()] == [
        (bus, len(data), 0) for bus, data in said.items()
    ]
    assert done.pacing is not None


def test_it_begins_when_the_port_is_opened_so_that_nothing_is_lost(tmp_path: Path) -> None:
    path = tmp_path / "x.log"
    path.write_text(log(talk(2)))
    with playing(path, "mightyzap", LINE, speed=0) as it:
        with ear(it.names["bus0"]) as listener:
            heard = listener.listen()
        assert heard == talk(2)
        assert it.wait().ports["bus0"].lost == 0


def test_an_input_without_times_is_played_at_the_pace_of_its_rate() -> None:
    took_ns = []
    for speed in (1.0, 0.1):
        with playing(CLEAN["lss"], "lss", LINE, window=Window(0, 0.05), speed=speed) as it:
            began_ns = time.time_ns()  # nothing is said before somebody listens
            with ear(it.names["bus0"]) as listener:
                heard = listener.listen()
            took_ns.append(listener.reads[-1][0] - began_ns)
            it.wait()
        assert CLEAN["lss"].read_bytes().startswith(heard)
        assert len(heard) > 400
    assert took_ns[0] > 40 * MS
    assert took_ns[1] > 400 * MS


def test_only_a_part_of_it_and_only_one_bus_are_played(tmp_path: Path) -> None:
    path, said = two_buses(tmp_path)
    part = {"window": Window("0.02", None), "buses": ("leg",)}
    with playing(path, "mightyzap", LINE, **part) as it, ear(it.names["leg"]) as leg:
        heard = leg.listen()
        assert list(it.names) == ["leg"]
    assert heard
    assert said["leg"].endswith(heard)
    assert heard != said["leg"]


def test_it_goes_on_from_its_beginning_until_it_is_stopped(tmp_path: Path) -> None:
    path = tmp_path / "x.log"
    path.write_text(log(talk(1)))
    with (
        playing(path, "mightyzap", LINE, loop=True, speed=50) as it,
        ear(it.names["bus0"]) as listener,
    ):
        heard = listener.listen(until=3 * len(talk(1)))
        assert heard.startswith(talk(1) * 3)
        it.end()


# --- where -------------------------------------------------------------------------------------


@pytest.mark.parametrize(
    "text", ["pty", "PTY", "/dev/pts/3", "./bus", "../bus", "COM3", "com12", "/x"]
)
def test_these_are_ports(text: str) -> None:
    assert names_port(text)


@pytest.mark.parametrize(
    "text", ["10", "20s", "20:35:20.5", "2026-01-31T20:35:20Z", "@first-error", "COM", "bus", ""]
)
def test_these_are_no_ports(text: str) -> None:
    assert not names_port(text)


@LINUX_ONLY
def test_a_pseudo_terminal_is_played_on_whatever_it_is_called(tmp_path: Path) -> None:
    path = tmp_path / "x.log"
    path.write_text(log(talk(1)))
    master, slave = os.openpty()
    try:
        link = tmp_path / "ttyUSB0"
        link.symlink_to(os.ttyname(slave))
        with playing(path, "mightyzap", LINE, to=(str(link),), speed=0) as it:
            it.wait()
        assert heard(master, len(talk(1))) == talk(1)
        assert not select.select([master], [], [], 0)[0], "and nothing more"
    finally:
        os.close(master)
        os.close(slave)


@LINUX_ONLY
@pytest.mark.parametrize("role", [PlayedRole.SERVOS, PlayedRole.CONTROLLER])
def test_a_port_whose_other_end_goes_away_ends_it_with_a_word(
    tmp_path: Path, role: PlayedRole
) -> None:
    path = tmp_path / "x.log"
    path.write_text(log(talk(20)))
    master, slave = os.openpty()
    name = os.ttyname(slave)
    with playing(path, "mightyzap", role, to=(name,)) as it:
        os.close(slave)
        os.close(master)
        with pytest.raises(OutputError, match=r"went away|cannot be (read|written)"):
            it.wait()


@LINUX_ONLY
@pytest.mark.parametrize("role", ["line", "servos", "controller"])
def test_what_is_no_pseudo_terminal_is_refused_whatever_it_is_called(
    tmp_path: Path, capsys: Capsys, role: str
) -> None:
    path = tmp_path / "x.log"
    path.write_text(log(talk(1)))
    (tmp_path / "pts").mkdir()
    link = tmp_path / "pts" / "3"
    link.symlink_to("/dev/null")
    ran = within(capsys, "replay", path, "--to", link, "--as", role)
    assert ran.status == 2
    assert ran.complaint == (
        f"{link} is no pseudo-terminal: what is played there is sent on a bus, and servos may "
        "move; --yes-transmit if that is meant"
    )
    ran = within(capsys, "replay", path, "--to", link, "--as", role, "--yes-transmit")
    assert ran.status == 2
    assert ran.complaint == f"{link} is no serial port: name one, as /dev/ttyUSB0"


@LINUX_ONLY
def test_a_port_that_is_refused_replaces_no_file(tmp_path: Path, capsys: Capsys) -> None:
    path, keep = tmp_path / "x.log", tmp_path / "keep.log"
    path.write_text(log(talk(1)))
    keep.write_text("mine")
    arguments = ("replay", path, "--to", "/dev/null", "--as", "controller", "-o")
    assert within(capsys, *arguments, keep, "--force").status == 2
    assert keep.read_text() == "mine"
    assert within(capsys, *arguments, tmp_path / "new.log").status == 2
    assert not (tmp_path / "new.log").exists()


REFUSED: Final = {
    "no port": (("--as", "servos"), "--as goes with a port to play on"),
    "rerun": (("--to", "pty", "--rerun"), "--to PORT plays, --rerun shows"),
    "output": (("--to", "pty", "-o", "x.bin"), "--to PORT plays, -o shows or writes"),
    "rows": (("--to", "pty", "--servo", "3"), "rows are not chosen"),
    "two places": (("--to", "3", "--to", "4"), "a part ends at one place"),
    "no place": (("--to", "bus"), "is no place in a capture"),
    "tap": (("--to", "pty", "--no-tap"), "it needs --as servos"),
    "tap link": (
        ("--to", "pty", "--as", "servos", "--no-tap", "--tap-link", "x"),
        "--tap-link needs the tap",
    ),
    "echo": (("--to", "pty", "--echo"), "--echo is for who speaks to --as servos"),
    "loop": (("--to", "pty", "--as", "servos", "--loop"), "leave --as out"),
    "speed": (("--to", "pty", "--as", "servos", "--speed", "2"), "--speed is for"),
    "ports": (("--to", "pty", "--to", "pty"), "it has the bus bus0: say --to once"),
    "links": (("--to", "pty", "--link", "a", "--link", "b"), "say --link once"),
    "named link": (("--to", "./x", "--link", "a"), "--link is for a new one"),
    "bus": (("--to", "pty", "--bus", "arm"), "there is no bus arm, only bus0"),
}


@pytest.mark.parametrize("case", REFUSED)
def test_what_does_not_go_together_is_refused_with_what_to_do(
    tmp_path: Path, capsys: Capsys, monkeypatch: pytest.MonkeyPatch, case: str
) -> None:
    monkeypatch.chdir(tmp_path)
    (tmp_path / "x.log").write_text(log(talk(1)))
    options, complaint = REFUSED[case]
    ran = within(capsys, "replay", "x.log", *options)
    assert ran.status == 2
    assert complaint in ran.err.splitlines()[-1]


def test_two_protocols_on_one_wire_have_no_servos_to_be_played() -> None:
    with (
        pytest.raises(SnifferError, match="two protocols share the wire"),
        playing(CLEAN["mightyzap"], "mightyzap+rs30x", PlayedRole.SERVOS) as it,
    ):
        it.wait()


# --- as a user runs it -------------------------------------------------------------------------


@each_in_turn(2, "number", [signal.SIGINT, signal.SIGTERM], ids=["ctrl-c", "kill"])
def test_whoever_ends_it_leaves_no_link_behind(tmp_path: Path, number: int) -> None:
    path, link = tmp_path / "x.log", tmp_path / "bus"
    path.write_text(log(talk(40)))
    process = subprocess.Popen(
        [*COMMAND, "replay", path.name, "--to", "3600s", "--to", "pty", "--link", link.name],
        cwd=tmp_path,
        env=environment(),
        stdout=subprocess.PIPE,
        stderr=subprocess.PIPE,
        text=True,
    )
    try:
        assert process.stdout is not None
        name = process.stdout.readline().strip()
        assert link.resolve().as_posix() == name
        if number == signal.SIGINT:  # in the midst of it; the other one while it waits
            with ear(name) as listener:
                assert listener.listen(until=50)
                process.send_signal(number)
                _, err = process.communicate(timeout=DEADLINE_S)
        else:
            process.send_signal(number)
            _, err = process.communicate(timeout=DEADLINE_S)
    finally:
        process.kill()
        process.wait()
    assert process.returncode == 0, err
    assert not link.is_symlink()
    assert "Traceback" not in err
    assert "bytes written" in err
