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
from rich.cells import cell_len

from sniffer.protocols import PROTOCOLS
from sniffer.viewers.board.board import Board
from sniffer.viewers.screen import BOARD, LINE, LOG, Screen
from tests.commands import environment
from tests.lists import each_in_turn, in_turn
from tests.terminals import PATIENCE_S
from tests.wires import feed, lines_of, status_of, wire

END: Final = b"\x1b[?2026l"
"""Of a picture."""

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


def end(screen: Screen, terminal: Terminal) -> None:
    """Close a screen while its terminal is read, however long both take."""
    closing = threading.Thread(target=screen.close, args=(PATIENCE_S,))
    closing.start()
    terminal.read(until=lambda seen: not closing.is_alive())
    closing.join()


@pytest.fixture
def terminal() -> Iterator[Terminal]:
    one = Terminal()
    yield one
    one.close()


class Screens:
    """What a terminal shows after these bytes: the few controls the screen uses.

    ``first`` has all lines ever written to the first screen, ``other`` those of the second one.
    """

    def __init__(self, seen: bytes, columns: int = 80, lines: int = 24) -> None:
        self.first: list[str] = [""]
        self.other: list[str] | None = None
        rows, row, column = self.first, 0, 0
        for control, number, letter, text in re.findall(
            r"(\x1b\[(\??[0-9;]*)([A-Za-z]))|([^\x1b])", seen.decode()
        ):
            if control:
                match number + letter:
                    case "?1049h":
                        assert self.other is None, "it is there already"
                        before, rows = (row, column), [""] * lines
                        self.other, row, column = rows, 0, 0
                    case "?1049l":
                        assert self.other is not None, "it is not there"
                        self.other, rows, (row, column) = None, self.first, before
                    case "2J":
                        rows[:] = [""] * len(rows)
                    case "J":
                        rows[row:] = [rows[row][:column], *[""] * (len(rows) - row - 1)]
                    case "2K":
                        rows[row] = ""
                    case _ if letter == "H":
                        row, column = (int(n) - 1 for n in (number or "1;1").split(";"))
                        assert (row, column) < (lines, columns), "it is below the terminal"
                    case _:
                        assert letter in "mhl", control
            elif text == "\r":
                column = 0
            elif text == "\n":
                row += 1
                assert self.other is None or row < lines, "it would scroll"
                rows.extend([""] * (row + 1 - len(rows)))
            else:
                assert column < columns or self.other is None, "the terminal would wrap"
                rows[row] = rows[row].ljust(column)[:column] + text + rows[row][column + 1 :]
                column += 1
        self.first = [one.rstrip() for one in self.first]


def test_the_board_is_drawn_over_itself_and_gives_the_terminal_back(terminal: Terminal) -> None:
    w = wire("arm", "mightyzap")
    screen = Screen(BOARD, lambda: status_of(w.status()), stream=terminal.stream)
    feed(screen, w)
    terminal.read(until=lambda seen: seen.count(b"Ctrl-C stops") > 2)
    screen.say("arm: mightyzap (sure)\x1b[2J")
    terminal.read(until=lambda seen: seen.count(b"(sure)") > 1 and seen.endswith(END))
    shown = Screens(terminal.seen)
    assert shown.other is not None
    assert shown.other[0].startswith("sniffer: arm: mightyzap (sure)"), "it stands above the board"
    assert sum("Ctrl-C stops" in one for one in shown.other) == 1
    end(screen, terminal)
    seen = terminal.read(until=lambda seen: seen.endswith(b"\x1b[?25h"), wait_s=1)
    assert screen.failure is None
    assert not screen.is_stalled
    assert seen.count(b"\x1b[?25l") == seen.count(b"\x1b[?25h") == 2, "said in between, and the end"
    assert seen.rfind(b"\x1b[?7h") > seen.rfind(b"\x1b[?7l")
    shown = Screens(seen)
    assert shown.other is None
    batches = zip(w.groups, w.batches, strict=False)
    board = Board()
    for chunks, batch in batches:
        board.raw(w.name, chunks)
        board.write(w.name, PROTOCOLS[w.protocol], batch)
    expected = [one.rstrip() for one in lines_of(board, status_of(w.status()), 80, 24)]
    said = "sniffer: arm: mightyzap (sure)\\x1b[2J"
    assert shown.first == [said, *expected, ""]


@each_in_turn(4, ("columns", "lines"), [(60, 24), (40, 10), (140, 12), (20, 5)])
def test_a_terminal_that_changes_its_size_keeps_nothing_of_the_pictures_before(
    terminal: Terminal, columns: int, lines: int
) -> None:
    w = wire("legs", "rs30x", 12)
    terminal.resize(120, 30)
    with Screen(BOARD, lambda: status_of(w.status()), stream=terminal.stream) as screen:
        feed(screen, w)
        terminal.read(until=lambda seen: seen.count(b"Ctrl-C stops") > 1)
        terminal.resize(columns, lines)
        terminal.read(until=lambda seen: seen.endswith(END), wait_s=0.5)
        before = len(terminal.seen)
        drawn = terminal.read(until=lambda seen: seen.count(b"\x1b[?2026h", before) > 2)[before:]
        begin = drawn.index(b"\x1b[?2026h")
        end = drawn.rindex(END) + len(END)
        Screens(b"\x1b[?1049h" + drawn[begin:end], columns, lines)  # asserts that all of it fits
        screen.say("a warning")
    seen = terminal.read(until=lambda seen: seen.endswith(b"\x1b[?25h"), wait_s=1)
    # all that went to the first screen: nothing of a picture of another size is among it
    first = b"".join(re.split(rb"\x1b\[\?1049h.*?\x1b\[\?1049l", seen, flags=re.DOTALL))
    shown = Screens(first, columns, lines).first
    assert shown[0] == "sniffer: a warning"
    assert len(shown) <= lines + 2
    assert all(cell_len(one) <= columns for one in shown[1:])


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
    while time.monotonic() < deadline:
        feed(screen, w)  # and it comes back
        screen.say("x" * 4000)
        if screen.dropped and not select.select([], [terminal.slave], [], 0.01)[1]:
            break
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
        end(screen, terminal)
    assert b" mm" in terminal.seen[before:]
    assert not screen.is_stalled


def test_a_terminal_that_was_stopped_is_let_go_on_and_given_back_at_the_end(
    terminal: Terminal,
) -> None:
    w = wire("arm", "mightyzap")
    screen = Screen(BOARD, lambda: status_of(w.status()), stream=terminal.stream)
    terminal.read(until=lambda seen: b"Ctrl-C stops" in seen)
    os.write(terminal.master, b"\x13")
    terminal.read(wait_s=0.5)
    screen.close(0.5)
    seen = terminal.read(until=lambda seen: b"\x1b[?1049l" in seen)
    assert Screens(seen).other is None
    assert b"\x1b[?25h" in seen


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
    assert (
        sum(1 for one in table if re.match(r"\d\d:\d\d:\d\d\.\d+ +(\S+ +)?\S+ [<>] ", one))
        == frames
    )
    assert "/dev/serial/by-id/arm" in texts[notes].decode()


SCRIPT: Final = """
import sys
from sniffer.viewers.outlet import write_within
from sniffer.viewers.screen import Screen
from sniffer.decoding.decoder import Decoder
from sniffer.ground.model import Chunk
from sniffer.tap.status import BusStatus, Status
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


@in_turn(2)
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
            assert done.wait(PATIENCE_S) == (3 if end == "failed" else 0)
        finally:
            if done.poll() is None:
                done.send_signal(signal.SIGKILL)
                done.wait(10)
