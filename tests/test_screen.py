"""The screen of a recording: a terminal or a pipe that stands still stops nothing."""

from __future__ import annotations

import contextlib
import fcntl
import os
import pty
import re
import select
import signal
import struct
import subprocess
import sys
import termios
import textwrap
import threading
import time
from typing import TYPE_CHECKING, Final

import pytest

from sniffer.cli.screen import BOARD, LINE, LOG, Screen
from sniffer.protocols import PROTOCOLS
from sniffer.sinks.board import Board
from tests.commands import environment
from tests.terminals import PATIENCE_S
from tests.wires import feed, lines_of, status_of, wire

if TYPE_CHECKING:
    from collections.abc import Callable, Iterator, Mapping


class Terminal:
    """A terminal whose other side the test holds; it is read only when the test says so."""

    def __init__(self, columns: int = 80, lines: int = 24) -> None:
        self.master, self.slave = pty.openpty()
        self.resize(columns, lines)
        self.stream = open(os.dup(self.slave), "w", encoding="utf-8")  # noqa: PTH123, SIM115
        self.seen = b""

    def resize(self, columns: int, lines: int) -> None:
        size = struct.pack("HHHH", lines, columns, 0, 0)
        fcntl.ioctl(self.slave, termios.TIOCSWINSZ, size)

    def read(
        self, until: Callable[[bytes], bool] = lambda seen: False, wait_s: float = PATIENCE_S
    ) -> bytes:
        """Read until it is as wanted, or has been waited for long enough."""
        deadline = time.monotonic() + wait_s
        while not until(self.seen) and time.monotonic() < deadline:
            if select.select([self.master], [], [], 0.05)[0]:
                self.seen += os.read(self.master, 65536)
        return self.seen

    def close(self) -> None:
        self.stream.close()
        for fd in (self.master, self.slave):
            os.close(fd)


@pytest.fixture
def terminal() -> Iterator[Terminal]:
    one = Terminal()
    yield one
    one.close()


def picture(seen: bytes, columns: int = 80, lines: int = 24) -> list[str]:
    """Return what a terminal shows after these bytes: the few controls the screen uses."""
    rows, row, column = [""] * lines, 0, 0
    for control, number, letter, text in re.findall(
        r"(\x1b\[(\??[0-9;]*)([A-Za-z]))|([^\x1b])", seen.decode()
    ):
        if control:
            match letter:
                case "A":
                    row = max(row - int(number or 1), 0)
                case "K":
                    rows[row] = ""
                case "J":
                    rows[row] = rows[row][:column]
                    rows[row + 1 :] = [""] * (lines - row - 1)
                case _:
                    assert letter in "mhl", control
        elif text == "\r":
            column = 0
        elif text == "\n":
            row += 1
            if row == lines:
                rows, row = [*rows[1:], ""], lines - 1
        else:
            assert column < columns, "the terminal would wrap"
            rows[row] = rows[row].ljust(column)[:column] + text + rows[row][column + 1 :]
            column += 1
    return [one.rstrip() for one in rows]


def test_the_board_is_drawn_over_itself_and_gives_the_cursor_back(terminal: Terminal) -> None:
    w = wire("arm", "mightyzap")
    screen = Screen(BOARD, lambda: status_of(w.status()), stream=terminal.stream)
    feed(screen, w)
    terminal.read(until=lambda seen: seen.count(b"Ctrl-C stops") > 2)
    screen.say("arm: mightyzap (sure)\x1b[2J")
    terminal.read(until=lambda seen: b"(sure)" in seen and seen.endswith(b"\x1b[?2026l"))
    screen.close()
    seen = terminal.read(until=lambda seen: b"\x1b[?25h" in seen)
    assert screen.failure is None
    assert (screen.dropped, screen.is_stalled) == (0, False)
    assert seen.startswith(b"\x1b[?25l")
    assert seen.rstrip().endswith(b"\x1b[?25h")
    rows = picture(seen)
    assert sum("Ctrl-C stops" in one for one in rows) == 1
    assert sum("/dev/serial" in one or "by-id" in one for one in rows) <= 1
    assert not any("[2J" in one and "\\x1b" not in one for one in rows)
    batches = zip(w.groups, w.batches, strict=False)
    board = Board()
    for chunks, batch in batches:
        board.raw(w.name, chunks)
        board.write(w.name, PROTOCOLS[w.protocol], batch)
    expected = [one.rstrip() for one in lines_of(board, status_of(w.status()), 80, 24)]
    assert rows[24 - 1 - len(expected) : -1] == expected


def test_the_board_follows_the_size_of_the_terminal(terminal: Terminal) -> None:
    w = wire("legs", "rs30x", 12)
    with Screen(BOARD, lambda: status_of(w.status()), stream=terminal.stream) as screen:
        feed(screen, w)
        terminal.read(until=lambda seen: b"not shown" in seen or seen.count(b"Ctrl-C stops") > 1)
        terminal.resize(140, 40)
        terminal.read(until=lambda seen: b"answers/s" in seen)
        assert b"answers/s" in terminal.seen
        terminal.resize(50, 10)
        terminal.read(until=lambda seen: b"more servos" in seen)
    assert b"more servos" in terminal.seen


@pytest.mark.parametrize("mode", [BOARD, LINE, LOG])
def test_a_terminal_that_nobody_reads_stops_nothing(terminal: Terminal, mode: str) -> None:
    stream, w = terminal.stream, wire("arm", "rs30x", 12)
    screen = Screen(mode, lambda: status_of(w.status()), stream=stream, notes=stream)
    deadline = time.monotonic() + (0.5 if mode == LINE else PATIENCE_S)
    while not screen.dropped and time.monotonic() < deadline:
        feed(screen, w)  # and it comes back
        screen.say("x" * 4000)
    assert screen.dropped or mode == LINE
    screen.close(0.5)
    assert screen.is_stalled or mode == LINE


def test_ctrl_s_and_ctrl_q_stop_the_picture_and_not_the_recording(terminal: Terminal) -> None:
    w = wire("arm", "mightyzap")
    with Screen(BOARD, lambda: status_of(w.status()), stream=terminal.stream) as screen:
        terminal.read(until=lambda seen: b"Ctrl-C stops" in seen)
        os.write(terminal.master, b"\x13")
        terminal.read(wait_s=0.5)
        before = len(terminal.seen)
        terminal.read(wait_s=0.5)
        assert len(terminal.seen) == before, "the terminal stands still"
        feed(screen, w)  # and it comes back
        os.write(terminal.master, b"\x11")
        terminal.read(until=lambda seen: b" mm" in seen[before:])
    assert b" mm" in terminal.seen[before:]
    assert not screen.is_stalled


def test_a_log_whose_reader_goes_away_falls_silent() -> None:
    w = wire("arm", "mightyzap")
    inside, outside = os.pipe()
    with open(outside, "w", encoding="utf-8") as stream:  # noqa: PTH123
        screen = Screen(LOG, lambda: status_of(w.status()), stream=stream)
        os.close(inside)
        feed(screen, w)
        screen.close()
        assert (screen.failure, screen.is_stalled) == (None, False)


def test_a_log_has_every_frame_and_statistics_go_beside_it() -> None:
    w = wire("arm", "mightyzap", seconds=2)
    (log, into), (notes, beside) = os.pipe(), os.pipe()
    texts: dict[int, bytes] = {}

    def read(fd: int) -> None:
        with open(fd, "rb") as file:
            texts[fd] = file.read()

    readers = [threading.Thread(target=read, args=(fd,)) for fd in (log, notes)]
    for reader in readers:
        reader.start()
    with (
        open(into, "w", encoding="utf-8") as stream,  # noqa: PTH123
        open(beside, "w", encoding="utf-8") as other,  # noqa: PTH123
    ):
        status = status_of(w.status())
        screen = Screen(LOG, lambda: status, stream=stream, notes=other, board=Board())
        feed(screen, w)
        screen.ask()
        screen.close(10)
    for reader in readers:
        reader.join(10)
    assert screen.dropped == 0
    frames = sum(len(b.frames) for b in w.batches[: len(w.groups)])
    table = texts[log].decode().partition("\n\n")[0].splitlines()
    assert sum(1 for one in table if re.match(r"\d\d:\d\d:\d\d\.\d+ +\S+ [<>] ", one)) == frames
    assert "/dev/serial/by-id/arm" in texts[notes].decode()


SCRIPT: Final = """
import sys
from sniffer.cli.outlet import write_within
from sniffer.cli.screen import Screen
from sniffer.decoder import Decoder
from sniffer.model import Chunk
from sniffer.status import BusStatus, Status
from tests.commands import talk

bus = BusStatus("arm", "/dev/ttyUSB0", 57600, "mightyzap", "listening", 0, 0, None)
status = Status(1.0, 10**18, "run.mcap", 0, 0, (bus,))
mode = sys.argv[1]
screen_stream = sys.stdout if mode == "log" else sys.stderr
screen = Screen(mode, lambda: status, stream=screen_stream)
decoder = Decoder("mightyzap")
batch = decoder.feed(Chunk(talk(400), 10**18))
for _ in range(100):
    screen.write("arm", decoder.protocol, batch)
    screen.say("x" * 2000)
{end}
"""

ENDS: Final[Mapping[str, str]] = {
    "closed": "screen.close(0.5); assert not write_within(screen_stream, 'x' * 2**20, 0.2)",
    "forgotten": "",
    "failed": "raise SystemExit(3)",
}


@pytest.mark.parametrize("end", ENDS)
@pytest.mark.parametrize(("kind", "mode"), [("terminal", BOARD), ("pipe", LOG), ("pipe", LINE)])
def test_a_program_ends_whose_output_nobody_takes(kind: str, mode: str, end: str) -> None:
    script = textwrap.dedent(SCRIPT.format(end=ENDS[end]))
    with contextlib.ExitStack() as stack:
        if kind == "terminal":
            terminal = Terminal()
            stack.callback(terminal.close)
            out: int = terminal.slave
        else:
            inside, out = os.pipe()
            stack.callback(os.close, inside)
            stack.callback(os.close, out)
        done = subprocess.Popen(
            [sys.executable, "-c", script, mode],
            stdin=subprocess.DEVNULL,
            stdout=out,
            stderr=out,
            env=environment(TERM="xterm"),
        )
        try:
            assert done.wait(30) == (3 if end == "failed" else 0)
        finally:
            if done.poll() is None:
                done.send_signal(signal.SIGKILL)
                done.wait(10)
