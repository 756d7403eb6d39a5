"""The board in a shell: jobs that are stopped, go on, or were never in front."""

from __future__ import annotations

import contextlib
import os
import pty
import select
import signal
import sys
import time
from pathlib import Path
from typing import TYPE_CHECKING, Final

from tests.commands import environment
from tests.terminals import PATIENCE_S

if TYPE_CHECKING:
    from collections.abc import Callable

CONTROLLED: Final = """
import os, signal, time
from sniffer.viewers.leaving import leaving
from sniffer.viewers.screen import Screen
from sniffer.tap.status import Status

status = Status(1.0, 10**18, "run.mcap", 0, 0, ())
with Screen("board", lambda: status, stream=open("/dev/tty", "w")) as screen, leaving(screen):
    screen.say("said before")
    while not os.path.exists({stop!r}):
        time.sleep(0.05)
"""


class Shell:
    """A shell with a terminal of its own, in which jobs are stopped and go on."""

    def __init__(self, script: str, term: str = "xterm") -> None:
        self.process, self.master = pty.fork()
        if not self.process:
            os.execvpe("sh", ["sh", "-c", script], environment(TERM=term))
        self.seen = b""

    def read(self, until: Callable[[bytes], bool]) -> bytes:
        deadline = time.monotonic() + PATIENCE_S
        while not until(self.seen) and time.monotonic() < deadline:
            if select.select([self.master], [], [], 0.05)[0]:
                try:
                    self.seen += os.read(self.master, 65536)
                except OSError:  # it has ended
                    break
        assert until(self.seen), self.seen[-3000:]
        return self.seen

    def __enter__(self) -> Shell:
        return self

    def __exit__(self, *_: object) -> None:
        with contextlib.suppress(ProcessLookupError):
            os.kill(self.process, signal.SIGKILL)
        os.waitpid(self.process, 0)
        os.close(self.master)


def controlled(tmp_path: Path) -> str:
    """Return the command of a program with a board, until there is a file ``stop``."""
    (tmp_path / "board.py").write_text(CONTROLLED.format(stop=str(tmp_path / "stop")))
    root = Path(__file__).parent.parent
    return f"PYTHONPATH={root} {sys.executable} {tmp_path / 'board.py'}"


def test_ctrl_z_gives_the_terminal_back_and_the_board_returns_with_fg(tmp_path: Path) -> None:
    script = f"set -m; {controlled(tmp_path)}; echo HALF''WAY; fg; echo OV''ER"
    with Shell(script) as shell:
        shell.read(lambda seen: b"Ctrl-C stops" in seen.partition(b"said before")[2])
        os.write(shell.master, b"\x1a")
        stopped = shell.read(lambda seen: b"HALFWAY" in seen)
        assert stopped.rfind(b"\x1b[?1049l") > stopped.rfind(b"\x1b[?1049h")
        shell.read(lambda seen: b"Ctrl-C stops" in seen.partition(b"HALFWAY")[2])
        (tmp_path / "stop").touch()
        seen = shell.read(lambda seen: b"OVER" in seen)
    assert seen.rfind(b"\x1b[?1049l") > seen.rfind(b"\x1b[?1049h")
    assert b"Traceback" not in seen


def test_a_board_in_the_background_leaves_the_terminal_to_the_shell(tmp_path: Path) -> None:
    script = f"set -m; {controlled(tmp_path)} & sleep 3; touch {tmp_path / 'stop'}; wait; echo OVER"
    with Shell(script) as shell:
        seen = shell.read(lambda seen: b"OVER" in seen)
    assert b"sniffer: said before" in seen
    assert b"Ctrl-C stops" not in seen
    assert b"\x1b[?1049h" not in seen


def test_a_program_that_is_broken_off_by_its_key_gives_the_terminal_back(tmp_path: Path) -> None:
    with Shell(f"ulimit -c 0; set -m; {controlled(tmp_path)}; echo STATUS=$?") as shell:
        shell.read(lambda seen: b"Ctrl-C stops" in seen.partition(b"said before")[2])
        os.write(shell.master, b"\x1c")
        seen = shell.read(lambda seen: b"STATUS=131" in seen)
    assert seen.rfind(b"\x1b[?1049l") > seen.rfind(b"\x1b[?1049h")


def test_a_terminal_without_a_second_screen_has_at_the_end_what_was_said(tmp_path: Path) -> None:
    with Shell(f"set -m; {controlled(tmp_path)}; echo OV''ER", term="vt100") as shell:
        shell.read(lambda seen: seen.count(b"Ctrl-C stops") > 2)
        (tmp_path / "stop").touch()
        seen = shell.read(lambda seen: b"OVER" in seen)
    last = seen.rpartition(b"\x1b[2J")[2]
    assert b"said before" in last
    assert b"Ctrl-C stops" in last
