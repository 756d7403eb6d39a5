"""``sniffer open`` on a terminal: what it draws there, and that it leaves it as it was."""

from __future__ import annotations

import os
import pty
import select
import signal
import subprocess
import termios
import time
from typing import TYPE_CHECKING

import pytest

from tests.commands import COMMAND, environment
from tests.terminals import LINUX_ONLY, PATIENCE_S
from tests.terminals import Terminal as Port
from tests.test_open_screen import CLEAN, ROOT

if TYPE_CHECKING:
    from collections.abc import Callable
    from pathlib import Path


class Shell:
    """A command on a terminal of its own, 80 columns wide; what it warns of may go to a file."""

    def __init__(self, *arguments: str | Path, cwd: Path, warnings: int | None = None) -> None:
        self.master, slave = pty.openpty()
        termios.tcsetwinsize(slave, (24, 80))
        self.before = termios.tcgetattr(slave)
        self._slave = slave
        self.process = subprocess.Popen(
            [*COMMAND, *map(str, arguments)],
            stdin=slave,
            stdout=slave,
            stderr=slave if warnings is None else warnings,
            cwd=cwd,
            env=environment(TERM="xterm-256color", PYTHONPATH=str(ROOT)),
            start_new_session=True,
        )
        self.seen = b""

    def read(self, until: Callable[[bytes], bool]) -> None:
        end = time.monotonic() + PATIENCE_S
        while not until(self.seen):
            assert time.monotonic() < end, self.seen[-2000:]
            if select.select([self.master], [], [], 0.02)[0]:
                self.seen += os.read(self.master, 1 << 16)

    def ended(self) -> int:
        self.read(lambda seen: self.process.poll() is not None)
        return self.process.wait()

    def is_restored(self) -> bool:
        left = self.seen.rfind(b"\x1b[?1049l") > self.seen.rfind(b"\x1b[?1049h")
        return left and termios.tcgetattr(self._slave)[:4] == self.before[:4]

    def close(self) -> None:
        if self.process.poll() is None:
            self.process.kill()
        self.process.wait()
        os.close(self.master)
        os.close(self._slave)


@LINUX_ONLY
@pytest.mark.parametrize("end", ["ctrl-c", "SIGTERM"])
def test_a_terminal_is_as_it_was_however_it_ends(end: str, tmp_path: Path) -> None:
    shell = Shell("open", CLEAN, cwd=tmp_path)
    try:
        shell.read(lambda seen: b"echo" in seen and b"FF FF" in seen)
        if end == "SIGTERM":
            shell.process.send_signal(signal.SIGTERM)
        else:
            os.write(shell.master, b"\x03")
        assert shell.ended() == 0
        assert shell.is_restored()
        assert b"Traceback" not in shell.seen
        assert not [*tmp_path.iterdir()]
    finally:
        shell.close()


@LINUX_ONLY
@pytest.mark.parametrize("begun", ["", "(17952"])
def test_a_log_that_has_no_line_yet_is_waited_for(begun: str, tmp_path: Path) -> None:
    growing = tmp_path / "growing.log"
    growing.write_text(begun)
    shell = Shell("open", growing.name, "--follow", "--protocol", "mightyzap", cwd=tmp_path)
    try:
        shell.read(lambda seen: b"growing.log: waiting for its first line" in seen)
        with growing.open("a") as log:
            log.write(CLEAN.read_text().removeprefix(begun))
        shell.read(lambda seen: b"load_data" in seen and b"FF FF" in seen)
        os.write(shell.master, b"q")
        assert shell.ended() == 0
        assert b"no frame" not in shell.seen
    finally:
        shell.close()


@LINUX_ONLY
def test_the_screen_is_on_the_terminal_where_warnings_go_to_a_file(tmp_path: Path) -> None:
    with (tmp_path / "warnings.txt").open("w") as warnings:
        shell = Shell("open", CLEAN, cwd=tmp_path, warnings=warnings.fileno())
    try:
        shell.read(lambda seen: b"echo" in seen and b"FF FF" in seen)
        os.write(shell.master, b"q")
        assert shell.ended() == 0
        assert shell.is_restored()
        assert (tmp_path / "warnings.txt").read_bytes() == b""
    finally:
        shell.close()


@LINUX_ONLY
def test_a_port_is_recorded_beside_and_shown(tmp_path: Path) -> None:
    with Port() as port:
        shell = Shell("open", f"{port.path}=mightyzap@57600", "-o", "run.mcap", cwd=tmp_path)
        try:
            port.wait_for_tap()
            for _ in range(20):
                port.say(bytes.fromhex("ffffff0102f10c ffffff010200fc".replace("0c", "0b")))
                time.sleep(0.02)
            shell.read(lambda seen: b"run.mcap" in seen and b"echo" in seen)
            os.write(shell.master, b"q")
            assert shell.ended() == 0
            assert shell.is_restored()
            assert b"recorded in run.mcap" in shell.seen
            assert (tmp_path / "run.mcap").stat().st_size > 1000
        finally:
            shell.close()


@LINUX_ONLY
def test_what_cannot_be_read_is_told_in_a_line_on_the_terminal(tmp_path: Path) -> None:
    (tmp_path / "noise.bin").write_bytes(bytes(range(7, 200, 13)) * 40)
    shell = Shell("open", "noise.bin", cwd=tmp_path)
    try:
        assert shell.ended() == 2
        shell.read(lambda seen: b"--protocol" in seen)
        assert b"Traceback" not in shell.seen
    finally:
        shell.close()
