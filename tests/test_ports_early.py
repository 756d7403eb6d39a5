"""What a port holds when it is opened: kept where it is known to be as it was on the line."""

from __future__ import annotations

import os
from pathlib import Path
from typing import TYPE_CHECKING

import pytest

from sniffer.sources.ports import open_port
from tests.commands import sniffer, talk
from tests.recorder import raw
from tests.terminals import AT_115200, EVERY_BYTE, HEADERS, LINUX_ONLY, Terminal, listen, wait

if TYPE_CHECKING:
    from collections.abc import Iterator


@pytest.fixture
def line() -> Iterator[Terminal]:
    with Terminal() as terminal:
        yield terminal


def held_open(line: Terminal, *, marks: bool) -> int:
    """Open a line as a program does that wants its bytes as they are."""
    import termios
    import tty

    slave = os.open(line.path, os.O_RDWR | os.O_NOCTTY)
    tty.setraw(slave)
    if marks:  # as a tap leaves it behind
        settings = termios.tcgetattr(slave)
        settings[0], settings[3] = termios.PARMRK | termios.INPCK, 0
        termios.tcsetattr(slave, termios.TCSANOW, settings)
    return slave


@LINUX_ONLY
@pytest.mark.parametrize("marks", [False, True])
def test_what_a_plain_port_heard_before_it_was_opened_is_kept(line: Terminal, marks: bool) -> None:
    slave = held_open(line, marks=marks)
    line.say(EVERY_BYTE + HEADERS)
    port = open_port(line.path, AT_115200)
    line.say(HEADERS)
    expected = EVERY_BYTE + HEADERS + HEADERS
    assert listen(port, len(expected)) == (expected, [])
    assert port.facts()["dropped_at_open"] == "0"
    port.close()
    os.close(slave)


@LINUX_ONLY
def test_what_was_said_just_before_a_recording_is_in_it(line: Terminal, tmp_path: Path) -> None:
    slave = held_open(line, marks=False)
    line.say(talk(20))
    ran = sniffer("record", f"{line.path}=mightyzap", "--frames", "60", "-o", tmp_path / "x.mcap")
    os.close(slave)
    assert ran.status == 0, ran.err
    assert raw(tmp_path / "x.mcap") == {"bus0": talk(20)}


@LINUX_ONLY
def test_a_terminal_that_a_shell_runs_in_is_left_alone(tmp_path: Path) -> None:
    import pty

    pid, master = pty.fork()
    if not pid:
        os.execvp("sleep", ["sleep", "60"])
    try:
        wait(lambda: Path(f"/proc/{pid}/comm").read_text() == "sleep\n", "it does not start")
        path = str(Path(f"/proc/{pid}/fd/0").readlink())
        ran = sniffer("record", path, "--duration", "1", "-o", tmp_path / "x.mcap")
        assert ran.status == 2
        assert ran.complaint.startswith(f"{path} is a terminal that somebody types in")
        assert not (tmp_path / "x.mcap").exists()
    finally:
        os.kill(pid, 9)
        os.waitpid(pid, 0)
        os.close(master)
