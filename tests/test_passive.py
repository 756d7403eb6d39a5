"""Nothing leaves the tap: what a recording asks of the kernel about its port, as strace saw it."""

from __future__ import annotations

import ast
import re
import shutil
import subprocess
import sys
from pathlib import Path
from typing import TYPE_CHECKING, Final, NamedTuple

import pytest

from tests.commands import talk
from tests.terminals import LINUX_ONLY, PATIENCE_S, Terminal
from tests.test_architecture import FILES, ROOT, file_named, imports, tree

if TYPE_CHECKING:
    from collections.abc import Sequence

RECORDER: Final = """
import select, sys, time
from sniffer.ports import PortOptions, open_port

port = open_port(sys.argv[1], PortOptions(115200))
heard = b""
end = time.monotonic() + 1
while time.monotonic() < end:
    if select.select([port.fileno()], [], [], 0.05)[0]:
        heard += port.unmark(port.read())[0]
    port.counters()
port.close()
assert bytes(range(256)) in heard, heard[:20]
"""

SPEAKER: Final = """
import os, sys, termios

port = os.open(sys.argv[1], os.O_RDWR | os.O_NOCTTY)
settings = termios.tcgetattr(port)
settings[0], settings[3] = termios.PARMRK, 0
termios.tcsetattr(port, termios.TCSAFLUSH, settings)
termios.tcflush(port, termios.TCIFLUSH)
termios.tcsendbreak(port, 0)
os.write(os.dup(port), b"hello")
"""
"""A program that does all a tap must not."""

RECORD: Final = (sys.executable, "-m", "sniffer", "record", "--quiet", "--protocol", "mightyzap")

COMMANDS: Final = {
    "port": (sys.executable, "-c", RECORDER),
    "duration": (*RECORD, "--duration", "1s", "-o", "{}/run.mcap"),
    "frames": (*RECORD, "--frames", "10", "-o", "{}/run.mcap", "-o", "{}/run.jsonl"),
}
"""What is watched; the port's name is added to it, and a folder is put in place of ``{}``."""

ASKS: Final = {
    "TCGETS": "is it a terminal",
    "TCGETS2": "settings",
    "TCSETS2": "settings, at once: without waiting for output, without a flush",
    "TIOCMGET": "which modem lines are up",
    "TIOCMBIC": "DTR and RTS down",
    "TIOCGEXCL": "is it reserved",
    "TIOCGSERIAL": "low latency?",
    "TIOCSSERIAL": "low latency, please",
    "TIOCGICOUNT": "the driver's counters",
    "FIONREAD": "how many bytes can be read",
}
"""All that may be asked of the port; TCSETSW, TCSETSF, TCSBRK, TCSBRKP, TIOCSBRK, TCFLSH, TCXONC,
TIOCSTI, TIOCMBIS and TIOCMSET are not among it."""

CALLS: Final = {"openat", "open", "read", "ioctl", "flock", "close", "fstat", "newfstatat", "fcntl"}
"""Calls that may be made on the port's descriptor; those that wait for it are not recorded."""

WAITS: Final = {"select", "pselect6", "poll", "ppoll", "epoll_ctl", "epoll_wait", "epoll_pwait"}

_CALL: Final = re.compile(r"^(?:\d+ +)?(\w+)\((.*)$")


class Call(NamedTuple):
    """One line of a trace."""

    name: str
    rest: str


class Watched(NamedTuple):
    """What a program did with a line: the calls that name it, and what came out of it."""

    calls: list[Call]
    answers: bytes

    @property
    def opens(self) -> list[str]:
        return [c.rest for c in self.calls if c.name in ("open", "openat", "openat2", "creat")]

    @property
    def made(self) -> list[Call]:
        """The calls on the port's descriptor, and those that pass it on."""
        return [call for call in self.calls if re.search(r"\d+<[^>]*/pts/\d+>", call.rest)]

    @property
    def requests(self) -> list[str]:
        """The ioctls in order; where drivers share a number, strace names them all."""
        found = (re.match(r"[^,]*, ([^,)]+)", c.rest) for c in self.made if c.name == "ioctl")
        names = (match[1].split(" or ") if match else ["?"] for match in found)
        return [next((n for n in several if n.startswith("T")), several[0]) for several in names]


def watch(command: Sequence[str], path: Path) -> Watched:
    """Run a command to its end, children too, while it is spoken to; ``path`` takes the trace."""
    strace = shutil.which("strace")
    if strace is None:
        pytest.skip("strace is not installed")
    # -y writes behind each descriptor what it is, so that copies of it are found too
    options = ("-f", "-y", "-s", "16", "-e", "trace=all", "-o", str(path))
    with Terminal() as line:
        process = subprocess.Popen(
            [strace, *options, *command, line.path],
            stdin=subprocess.DEVNULL,
            stdout=subprocess.DEVNULL,
            stderr=subprocess.PIPE,
            text=True,
        )
        try:
            _wait_for_tap(line, process)
            line.say((bytes(range(256)) + b"\xff\xff\xff\x01\x05\xf3\xff\x00" * 10 + talk(3)) * 3)
            _, complaints = process.communicate(timeout=PATIENCE_S)
        finally:
            process.kill()
            process.wait()
        assert process.returncode == 0, complaints
        lines = path.read_text(encoding="utf-8", errors="replace").splitlines()
        calls = [Call(*match.groups()) for match in map(_CALL.match, lines) if match]
        return Watched([call for call in calls if line.path in call.rest], line.answers())


def _wait_for_tap(line: Terminal, process: subprocess.Popen[str]) -> None:
    try:
        line.wait_for_tap()
    except AssertionError:
        process.kill()
        complaints = process.communicate()[1]
        if "ptrace" in complaints.lower():
            pytest.skip("strace may not trace here")
        raise AssertionError(complaints) from None


@pytest.fixture(scope="module", params=COMMANDS)
def tap(request: pytest.FixtureRequest, tmp_path_factory: pytest.TempPathFactory) -> Watched:
    folder = tmp_path_factory.mktemp("strace")
    command = [word.replace("{}", str(folder)) for word in COMMANDS[request.param]]
    return watch(command, folder / "trace")


@LINUX_ONLY
def test_nothing_comes_out_of_a_line_that_is_listened_to(tap: Watched) -> None:
    assert tap.answers == b""


@LINUX_ONLY
def test_the_port_is_opened_for_reading_only(tap: Watched) -> None:
    assert tap.opens
    for flags in tap.opens:
        assert "O_RDONLY" in flags
        assert "O_NOCTTY" in flags
        assert not re.search("O_RDWR|O_WRONLY|O_TRUNC", flags)


@LINUX_ONLY
def test_nothing_is_written_to_the_port(tap: Watched) -> None:
    made = {call.name for call in tap.made}
    assert "read" in made
    assert made <= CALLS | WAITS


@LINUX_ONLY
def test_the_port_is_asked_and_told_only_what_sends_nothing(tap: Watched) -> None:
    assert {"TCSETS2", "TCGETS2", "TIOCMBIC"} <= {*tap.requests} <= {*ASKS}


@LINUX_ONLY
def test_the_echo_is_switched_off_before_anything_else_is_done(tap: Watched) -> None:
    """To ask what is set reaches no adapter; the next call sets the same without the echo."""
    opened = next(n for n, call in enumerate(tap.calls) if call.name in ("open", "openat"))
    asked, quiet, after = tap.calls[opened + 1 : opened + 4]
    assert [asked.name, quiet.name, after.name] == ["ioctl", "ioctl", "flock"]
    assert tap.requests[:2] == ["TCGETS2", "TCSETS2"]
    before, set_to = (re.search(r"c_lflag=([A-Z|]*)", call.rest) for call in (asked, quiet))
    assert before, asked
    assert set_to, quiet
    assert {*before[1].split("|")} - {*set_to[1].split("|")} == {"ECHO"}


@LINUX_ONLY
def test_the_modem_lines_are_lowered_before_anything_else_is_set(tap: Watched) -> None:
    settings = [n for n, request in enumerate(tap.requests) if request == "TCSETS2"]
    assert settings[0] < tap.requests.index("TIOCMBIC") < settings[1]
    assert any("TIOCM_DTR|TIOCM_RTS" in call.rest for call in tap.made)


@LINUX_ONLY
def test_a_program_that_speaks_would_be_seen(tmp_path: Path) -> None:
    seen = watch((sys.executable, "-c", SPEAKER), tmp_path / "trace")
    assert seen.answers == b"hello"
    assert any("O_RDWR" in flags for flags in seen.opens)
    assert "write" in {call.name for call in seen.made} - CALLS
    assert {"TCFLSH", "TCSBRK", "TCSETSF"} <= {*seen.requests} - {*ASKS}


# --- where the package may speak -----------------------------------------------------------------

SPEAKS: Final = "simulation/play/ports.py"
"""The only file that opens terminals for writing."""

PLAYS: Final = {"simulation/play", "playback"}
"""Folders that use it ..."""

PLAYERS: Final = {
    "jobs/playback.py",
    "jobs/like.py",
    "cli/simulate.py",
    "cli/playback.py",
}
"""... and the files that use these: what the commands ``simulate`` and ``replay --to`` run."""

DOOR: Final = "__init__.py"
"""Hands names on when somebody asks for them."""

MOUTHS: Final = {"O_RDWR", "openpty", "forkpty", "tcsendbreak", "tcflush", "TIOCSTI"}


def text_of(file: Path) -> str:
    return (ROOT / file).read_text(encoding="utf-8")


def names_in(file: Path) -> set[str]:
    """Return every name and attribute that a file uses."""
    if not any(mouth in text_of(file) for mouth in MOUTHS):
        return set()
    nodes = list(ast.walk(tree(file)))
    attributes = {node.attr for node in nodes if isinstance(node, ast.Attribute)}
    imported = {n.name for node in nodes if isinstance(node, ast.ImportFrom) for n in node.names}
    return attributes | imported | {node.id for node in nodes if isinstance(node, ast.Name)}


def test_one_file_opens_terminals_for_writing_and_no_other_can() -> None:
    assert {"O_RDWR", "openpty"} <= names_in(Path(SPEAKS))
    for file in FILES:
        if file.as_posix() != SPEAKS:
            assert not MOUTHS & names_in(file), file


def test_only_what_plays_reaches_that_file() -> None:
    for file in FILES:
        if file.parent.as_posix() in PLAYS or file.as_posix() in {*PLAYERS, DOOR}:
            continue
        if not re.search(r"\b(simulation|playback)\b", text_of(file)):
            continue
        reached = {there for m in imports(file) if (there := file_named(m)) is not None}
        assert not {f for f in reached if f.parent.as_posix() in PLAYS}, file
