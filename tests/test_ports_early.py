"""What a port holds when it is opened: kept where it is known to be as it was on the line."""

from __future__ import annotations

import os
import re
import select
import subprocess
import sys
import threading
from contextlib import contextmanager
from pathlib import Path
from typing import TYPE_CHECKING, Final

import pytest

from sniffer.ground.model import InputError
from sniffer.ports import PortOptions, kernel, open_port, tty
from tests.commands import sniffer, talk, within
from tests.recorder import raw
from tests.terminals import (
    AT_115200,
    EVERY_BYTE,
    HEADERS,
    LINUX_ONLY,
    PATIENCE_S,
    Terminal,
    listen,
    refusal,
    wait,
)
from tests.transcripts import ROOT

if TYPE_CHECKING:
    from collections.abc import Iterator


RULES: Final = ROOT / "docs/60-servo-tap.rules"

HOLDER: Final = """
import os, sys
fd = os.open(sys.argv[1], os.O_RDWR | os.O_NOCTTY)
print("open", flush=True)
sys.stdin.read()
"""
"""A controller that has the port open and locks nothing."""


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
@pytest.mark.parametrize("meanwhile", [b"*1QD10\r", HEADERS])
def test_what_a_port_heard_before_its_settings_held_is_kept_without_a_hole_or_dropped_whole(
    line: Terminal, meanwhile: bytes, monkeypatch: pytest.MonkeyPatch
) -> None:
    slave = held_open(line, marks=False)
    line.say(b"#1QD\r")
    real = kernel.set_settings

    def late(fd: int, settings: kernel.LineSettings) -> None:
        line.say(meanwhile)
        wait(lambda: bool(select.select([fd], [], [], 0)[0]), "it did not come")
        real(fd, settings)

    monkeypatch.setattr(kernel, "set_settings", late)
    port = open_port(line.path, AT_115200)
    monkeypatch.undo()
    line.say(b"now")
    before = b"#1QD\r" + meanwhile
    kept = before if b"\xff" not in before else b""
    assert listen(port, len(kept) + 3)[0] == kept + b"now"
    assert int(port.facts()["dropped_at_open"]) >= len(before) - len(kept)
    port.close()
    os.close(slave)


@LINUX_ONLY
@pytest.mark.parametrize("before", [True, False])
def test_headers_that_a_plain_port_heard_just_beside_its_new_settings_are_kept(
    line: Terminal, before: bool, monkeypatch: pytest.MonkeyPatch
) -> None:
    slave = held_open(line, marks=False)
    line.say(b"#1QD\r")
    real, reads = tty._rest, list[bytes]()

    def rest(fd: int) -> bytes:
        if before == bool(reads):  # the first time behind what is read, the second time before it
            reads.append(real(fd))
            return reads[-1]
        came = real(fd) if before else b""
        line.say(HEADERS)
        wait(lambda: bool(select.select([fd], [], [], 0)[0]), "it did not come")
        reads.append(came or real(fd))
        return reads[-1]

    monkeypatch.setattr(tty, "_rest", rest)
    port = open_port(line.path, AT_115200)
    expected = b"#1QD\r" + HEADERS
    assert listen(port, len(expected)) == (expected, [])
    assert port.facts()["dropped_at_open"] == "0"
    assert len(reads) == 2
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


class Chatter:
    """A bus that talks all the time, and keeps what comes back to it."""

    PHRASE = b"servo"

    def __init__(self, line: Terminal) -> None:
        self.line = line
        self.back = b""
        self.said = 0
        self._stop = threading.Event()
        self._thread = threading.Thread(target=self._talk)

    def _talk(self) -> None:
        while not self._stop.is_set():
            self.line.say(self.PHRASE)
            self.said += 1
            self.back += self.line.answers()
            self._stop.wait(0.0005)

    def goes_on(self) -> None:
        """Wait until it has said some more."""
        enough = self.said + 20
        wait(lambda: self.said > enough, "the bus is silent")

    def __enter__(self) -> Chatter:
        self._thread.start()
        self.goes_on()
        return self

    def __exit__(self, *_: object) -> None:
        self._stop.set()
        self._thread.join()


def prepared(line: Terminal) -> None:
    """Do what the udev rule does when an adapter is plugged in."""
    words = re.search(r'PROGRAM=="(/bin/stty [^"]*)"', RULES.read_text(encoding="utf-8"))
    assert words
    subprocess.run(words[1].replace("$devnode", line.path).split(), check=True, timeout=PATIENCE_S)


@LINUX_ONLY
@pytest.mark.parametrize("by", ["the rule", "the doctor", "an opening before"])
def test_a_port_that_was_prepared_sends_nothing_back_when_it_is_opened_on_a_talking_bus(
    line: Terminal, by: str, capsys: pytest.CaptureFixture[str]
) -> None:
    if by == "the rule":
        prepared(line)
    elif by == "the doctor":
        assert within(capsys, "doctor", line.path, "--prepare").out == (
            f"{line.path}: prepared; its echo was on before\n"
        )
    else:
        open_port(line.path, AT_115200).close()
    with Chatter(line) as bus:
        for _ in range(5):
            port = open_port(line.path, AT_115200)
            assert port.facts()["echo_at_open"] == "off"
            bus.goes_on()
            assert bus.PHRASE in listen(port, 50)[0]
            port.close()
            bus.goes_on()
    assert bus.back == line.answers() == b""


@LINUX_ONLY
def test_a_port_that_nobody_prepared_sends_nothing_back_once_it_is_open_and_says_what_it_was(
    line: Terminal,
) -> None:
    with Chatter(line) as bus:  # nobody has it open: all of it waits there, and was echoed
        port = open_port(line.path, AT_115200)
        assert port.facts()["echo_at_open"] == "on"
        bus.goes_on()
        echoed = len(bus.back)  # what the kernel had sent back before the first call
        bus.goes_on()
        listen(port, 200)
        bus.goes_on()
        assert len(bus.back) == echoed
        port.close()


@LINUX_ONLY
def test_a_port_that_is_refused_after_all_echoes_as_before(
    line: Terminal, monkeypatch: pytest.MonkeyPatch
) -> None:
    import termios

    from sniffer.ports import kernel

    monkeypatch.setattr(kernel, "is_reserved", lambda fd: True)  # root is let in: we are not always
    with pytest.raises(InputError, match="is in use by"):
        open_port(line.path, AT_115200)
    assert line.settings()[3] & termios.ECHO


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


# --- a port that another program has open --------------------------------------------------------


@contextmanager
def held_by_another(line: Terminal) -> Iterator[str]:
    """Let another program have a line open; yield what it is called."""
    holder = subprocess.Popen(
        [sys.executable, "-c", HOLDER, line.path],
        stdin=subprocess.PIPE,
        stdout=subprocess.PIPE,
        text=True,
    )
    assert holder.stdout is not None
    try:
        assert holder.stdout.readline() == "open\n"
        comm = Path(f"/proc/{holder.pid}/comm").read_text(encoding="utf-8").strip()
        yield f"{comm} (process {holder.pid})"
    finally:
        holder.communicate("")


@LINUX_ONLY
def test_a_port_that_another_program_has_open_is_refused_and_left_as_it_is(
    line: Terminal, tmp_path: Path
) -> None:
    before = line.settings()
    with held_by_another(line) as who:
        told = refusal(line.path)
        assert told == (
            f"{line.path} is open in {who}, and not locked: to open it would change its settings "
            "under that program, and take bytes from it; end that first, or say `shared=True`"
        )
        for command in (["record", line.path, "-o", tmp_path / "x.mcap"], ["doctor", line.path]):
            ran = sniffer(*command)
            in_options = told.replace("`shared=True`", "--shared")
            assert (ran.status, ran.complaint) == (2, in_options)
        assert not (tmp_path / "x.mcap").exists()
        assert line.settings() == before
    open_port(line.path, AT_115200).close()


@LINUX_ONLY
def test_a_port_that_another_program_has_open_is_opened_where_that_is_asked_for(
    line: Terminal, tmp_path: Path
) -> None:
    with held_by_another(line) as who:
        port = open_port(line.path, PortOptions(115200, shared=True))
        assert port.facts()["also_open_in"] == who
        port.close()
        ran = sniffer(
            *("record", line.path, "--shared", "--duration", "200ms", "-o", tmp_path / "x.mcap")
        )
        assert ran.status == 0
        assert f"bus0: {line.path} is also open in {who}" in ran.err
        ran = sniffer("doctor", line.path, "--shared", "--duration", "0.2")
        assert ran.status == 1
        assert "bad   access    also open in" in ran.out


@LINUX_ONLY
def test_the_program_at_the_other_end_of_a_pseudo_terminal_is_no_rival(line: Terminal) -> None:
    slave = held_open(line, marks=False)  # this program has the master, too
    code = (
        "import sys; from sniffer.ports import PortOptions, open_port\n"
        "open_port(sys.argv[1], PortOptions(115200)).close()"
    )
    subprocess.run([sys.executable, "-c", code, line.path], check=True, timeout=PATIENCE_S)
    os.close(slave)
