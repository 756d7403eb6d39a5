"""The board on a terminal: drawn over itself on the terminal's other screen, as pagers do.

A terminal that is made narrower wraps anew what stands on its first screen, and pushes what has no
room any more into its history, where nothing can take it away. The other screen has neither: every
line there is written at a place of its own. What is said goes to the first screen at once, between
two pictures, so it outlives the program; its latest lines stand above the board too.
"""

from __future__ import annotations

import contextlib
import io
import threading
from collections import deque
from typing import TYPE_CHECKING, Any, Final, Self, TextIO, cast

from rich.console import Console
from rich.text import Text

from sniffer.sinks.consoles import console_for
from sniffer.tap.status import Status
from sniffer.viewers.board.board import Board
from sniffer.viewers.keyboard import Keyboard

if TYPE_CHECKING:
    from collections.abc import Iterator

    from sniffer.viewers.outlet import Outlet

ENTER: Final = "\x1b[?1049h\x1b[?25l\x1b[?7l\x1b[2J"
"""To the other screen, without a cursor; nothing wraps there (xterm's control sequences)."""

LEAVE: Final = "\x1b[?2026l\x1b[H\x1b[2J\x1b[?1049l\x1b[?7h\x1b[?25h"
"""Back to the first one, as it was. The other one is wiped before: tmux wraps it anew where the
width has changed meanwhile, and keeps in the history what has no room then."""

WIPE: Final = "\x1b[?2026l\x1b[H\x1b[2J\x1b[?7h\x1b[?25h"
"""The same where there is no other screen."""

BEGIN, END = "\x1b[?2026h", "\x1b[?2026l"
"""A picture begins and ends, which terminals that know it show at once."""

REMEMBERED: Final = 8
"""Lines said lately: as many as a tall terminal has room for above the board."""

HELD: Final = 1000
"""Lines said that wait for the end where there is no other screen."""

LEAVE_S: Final = 0.2
"""How long whoever stops the program waits for a picture that is being written."""


class TerminalPicture:
    """The board on a terminal; entered with ``with``, left as the terminal was found.

    One thread draws. ``left`` may be called from another one, within a signal handler.
    """

    def __init__(self, out: Outlet, *, color: bool | None = None) -> None:
        self._out = out
        self._colours: Any = console_for(cast("TextIO", out), color=color).color_system
        self._has_other = _has_other_screen(out.fileno())
        self._is_there = False
        self._shown: tuple[Board, Status] | None = None
        self._latest: deque[str] = deque(maxlen=REMEMBERED)
        self._held: deque[str] = deque(maxlen=HELD)
        self._writing = threading.Lock()
        self.keyboard = Keyboard(out.fileno())
        # What rich loads when it first draws is loaded here, before anything is recorded.
        self._text(Board(), Status(0.0, 0, "…×", 0, 0, ()), 80, 24)
        self._wrapped("…", 80)

    def __enter__(self) -> Self:
        return self

    def __exit__(self, *_: object) -> None:
        """Give the first screen back, with the last picture on it."""
        self.keyboard.close()
        with contextlib.suppress(OSError), self._writing:
            self._out.forget()
            self._out.let_go()
            self._write(self._leave())
            if self._held:
                self._write("\n".join(self._held) + "\n")
            if self._shown is not None:
                board, status = self._shown
                board.controls = None  # nobody presses keys any more
                self._write(self._text(board, status, *self._out.size()) + "\n")

    def draw(self, board: Board, status: Status) -> None:
        """Draw the board as it is now; nothing in the background: the terminal is the shell's."""
        if not self._out.is_ours():
            self.keyboard.forget()  # whoever has the terminal now has it as they want it
            self._shown = None
            return
        columns, lines = self._out.size()
        told = self._told(columns, lines // 4)
        rows = [*told, *self._text(board, status, columns, lines - len(told)).split("\n")]
        # A line is erased before it is written: behind its last cell the cursor stands on it.
        drawn = "".join(f"\x1b[{nth};1H\x1b[2K{row}" for nth, row in enumerate(rows, 1))
        rest = f"\x1b[{len(rows) + 1};1H\x1b[J" if len(rows) < lines else ""
        with self._writing:
            enter = "" if self._is_there else ENTER
            self._is_there = True
            self.keyboard.take()
            self._write(f"{enter}{BEGIN}{drawn}{rest}{END}")
        self._shown = board, status

    def say(self, text: str) -> None:
        """Show lines above the board, and leave them on the first screen."""
        lines = text.split("\n")
        self._latest.extend(lines)
        with self._writing:
            if self._is_there and not self._has_other:
                self._held.extend(lines)
            else:
                self._write(f"{self._leave()}{text}\n")

    @contextlib.contextmanager
    def left(self) -> Iterator[None]:
        """Give the first screen back meanwhile: the program is about to stand still, or to end.

        It waits a moment for a picture that is being written, and never for the terminal.
        """
        is_mine = self._writing.acquire(timeout=LEAVE_S)
        try:
            self.keyboard.give_back()
            self._out.try_write(self._leave())
            yield
        finally:
            if is_mine:
                self._writing.release()

    def _leave(self) -> str:
        was_there, self._is_there = self._is_there, False
        return (LEAVE if self._has_other else WIPE) if was_there else ""

    def _write(self, text: str) -> None:
        self._out.write(text)
        self._out.flush()

    def _told(self, columns: int, room: int) -> list[str]:
        """Return what was said last, as much of it as there is room for."""
        out: list[str] = []
        for said in reversed(self._latest):
            lines = self._wrapped(said, columns)
            if len(out) + len(lines) > room:
                return out or lines[:room]
            out = [*lines, *out]
        return out

    def _wrapped(self, text: str, columns: int) -> list[str]:
        console = Console(file=io.StringIO(), width=columns, legacy_windows=False)
        return [line.plain for line in Text(text).wrap(console, columns)]

    def _text(self, board: Board, status: Status, columns: int, lines: int) -> str:
        file = io.StringIO()
        console = Console(
            file=file,
            width=columns,
            height=lines,
            force_terminal=True,
            color_system=self._colours,
            legacy_windows=False,
        )
        console.print(board.render(status, columns, lines), end="")
        return file.getvalue().rstrip("\n")


def _has_other_screen(fd: int) -> bool:
    """Tell whether the terminal has a second screen, as all have but consoles and old ones."""
    try:
        import curses  # Windows has none, and terminals that have it

        curses.setupterm(fd=fd)
        return bool(curses.tigetstr("smcup"))
    except (ImportError, OSError):
        return True
    except curses.error:  # nothing is known of this kind of terminal
        return True
