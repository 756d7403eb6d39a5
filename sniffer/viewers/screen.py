"""What ``sniffer record`` shows, in a thread of its own: a stalled terminal stops nothing.

The recorder hands records over and never waits: a full queue drops them and counts how many. The
thread is a daemon: even a write that never returns lets the program end.
"""

from __future__ import annotations

import atexit
import contextlib
import functools
import os
import sys
import threading
import time
from collections import deque
from dataclasses import replace
from typing import TYPE_CHECKING, Final, NamedTuple, Self, TextIO, cast

from sniffer.decoding.sink import written
from sniffer.ground.wording import one_line
from sniffer.sinks.intime import LIVE
from sniffer.sinks.text import TextSink
from sniffer.viewers.board.board import Board
from sniffer.viewers.board.controls import Controls
from sniffer.viewers.board.line import line, statistics
from sniffer.viewers.outlet import Outlet, StalledError
from sniffer.viewers.terminal import TerminalPicture

if TYPE_CHECKING:
    from collections.abc import Callable, Collection, Iterable, Sequence

    from sniffer.decoding.called import ServoNames
    from sniffer.decoding.sink import Part
    from sniffer.ground.model import Batch, Chunk
    from sniffer.protocols.base import BusProtocol
    from sniffer.selection.selection import Selection
    from sniffer.tap.status import Status

BOARD: Final = "board"
LOG: Final = "log"
LINE: Final = "line"
"""The live board on a terminal; a line a frame; a line a second."""

FRAME_S: Final = 0.2
"""Time between two pictures of the board."""

LINE_S: Final = 1.0
"""Time between two lines."""

NAP_S: Final = 0.05
"""Time between two looks at the queue: the recorder hands over as often."""

SHARE: Final = 2
"""The thread rests this many times as long as it has worked: it shares one interpreter lock with
the recorder."""

WORK_S: Final = 0.02
"""How long it works on the queue in one go."""

RECORDS: Final = 100_000
BYTES: Final = 4 << 20
ITEMS: Final = 10_000
"""What may wait: records in columns take some 100 bytes each, so 20 MB at most."""

SCREEN_END_S: Final = 1.0
"""How long the end of a recording waits for the screen."""


class _Queued(NamedTuple):
    """What waits to be shown, and how much it is."""

    shown: Callable[[], None]
    records: int = 0
    size: int = 0
    frames: int = 0


def usual_mode(stream: TextIO) -> str:
    """Return the board for a terminal that can move its cursor, else the line a second."""
    able = stream.isatty() and os.environ.get("TERM", "") not in ("", "dumb", "unknown")
    return BOARD if able or (os.name == "nt" and stream.isatty()) else LINE


class Screen:
    """A sink that shows; none of its calls waits, but ``close``, and that not for ever.

    Args:
        mode: ``BOARD``, ``LOG`` or ``LINE``.
        status: returns how the recording is going; it is called from the thread.
        stream: where to; the board and lines belong on standard error, the log on standard output.
        board: what the board and the lines show; ``LOG`` needs it for statistics alone.
        notes: where ``say`` and statistics go: ``stream``, but for a log standard error.
        selection: which records a log shows; of a board it is the filter that it begins with.
        color: whether a log or a board has colours; None: on a terminal.
        buses: what a log will have lines of.
    """

    def __init__(
        self,
        mode: str,
        status: Callable[[], Status],
        *,
        stream: TextIO,
        board: Board | None = None,
        notes: TextIO | None = None,
        selection: Selection | None = None,
        color: bool | None = None,
        buses: Iterable[str] = (),
    ) -> None:
        self.dropped = 0
        """Frames that were left out: nobody took what was written in time."""
        self.failure: Exception | None = None
        """What ended the screen although it should not have; the recording goes on without it."""
        self._ended: OSError | None = None
        self._mode = mode
        self._status = status
        self._board = board if board is not None or mode == LOG else Board()
        self._out = Outlet(stream)
        other = sys.stderr if notes is None and mode == LOG else notes
        self._notes = self._out if other is None else Outlet(other)
        self._log: TextSink | None = None
        if mode == LOG:
            out = cast("TextIO", self._out)
            self._log = TextSink(out, color=color, waits=LIVE, buses=buses)
        self._selection = selection
        if self._log is not None and selection is not None:
            self._log.narrow({"where": selection.text, "tables": list(selection.tables)})
        self._picture = TerminalPicture(self._out, color=color) if mode == BOARD else None
        self._still: tuple[Board, Status] | None = None
        """The board as it stood when the picture was held."""
        if self._picture is not None and self._board is not None:
            self._board.controls = Controls()
            self._board.watch(selection)
        self._queue: deque[_Queued] = deque()
        self._lock = threading.Lock()
        self._records = self._bytes = 0
        self._sayings: deque[str] = deque(maxlen=100)
        self._asked = self._silent = self._closed = False
        self._stop = threading.Event()
        self._thread = threading.Thread(target=self._run, name="screen", daemon=True)
        atexit.register(self.close)
        self._thread.start()

    def raw(self, bus: str, chunks: Sequence[Chunk]) -> None:
        """Hand chunks over; the log has no use for them."""
        if self._board is not None:
            size = sum(len(chunk.data) for chunk in chunks)
            heard = functools.partial(self._board.raw, bus, tuple(chunks))
            self._put(_Queued(heard, len(chunks), size))

    def call(self, names: ServoNames) -> None:
        """Have it show servos by name."""
        for sink in (self._board, self._log):
            if sink is not None:
                sink.call(names)

    def write(self, bus: str, protocol: BusProtocol, batch: Batch) -> None:
        """Hand a batch over."""
        self.write_together(bus, [(protocol, batch)])

    def write_together(self, bus: str, parts: Sequence[Part]) -> None:
        """Hand over what several protocols said in one pass."""
        records = frames = 0
        for _, b in parts:
            records += len(b.frames) + len(b.values) + len(b.gaps) + len(b.anomalies)
            frames += len(b.frames)
        told = functools.partial(self._tell, bus, parts)
        self._put(_Queued(told, records, len(parts[0][1].data), frames))

    def passed(self, until_ns: int | None, open_buses: Collection[str]) -> None:
        """Hand on that a pass is over; the board has no use for it."""
        if self._log is not None:
            self._put(_Queued(functools.partial(self._log.passed, until_ns, open_buses)))

    def say(self, message: str) -> None:
        """Show a line for the user, above the board where there is one."""
        self._sayings.append(f"sniffer: {one_line(message)}")

    def ask(self) -> None:
        """Have statistics written soon; also from within a signal handler."""
        self._asked = True

    def close(self, timeout_s: float = SCREEN_END_S) -> None:
        """Show what waits and end; what nobody takes within the time is left out.

        Where a terminal stands still afterwards, ``is_stalled`` tells, and whoever prints to it
        waits until somebody lets it go on: see ``write_within``.
        """
        if self._closed:
            return
        self._closed = True
        atexit.unregister(self.close)
        deadline = time.monotonic() + timeout_s
        self._out.deadline = self._notes.deadline = deadline
        self._stop.set()
        self._thread.join(timeout_s + 0.2)
        with self._lock:
            if not self._silent:
                self._forget()
        if self._thread.is_alive() and self._picture is not None:
            self._picture.keyboard.give_back()
        if not self._thread.is_alive():
            for out in {self._out, self._notes}:
                out.close()

    def __enter__(self) -> Self:
        return self

    def __exit__(self, *_: object) -> None:
        self.close()

    def left(self) -> contextlib.AbstractContextManager[None]:
        """Give the terminal back meanwhile; also from within a signal handler."""
        return contextlib.nullcontext() if self._picture is None else self._picture.left()

    @property
    def is_stalled(self) -> bool:
        """Tell whether nobody took what was written before the screen was closed."""
        return self._thread.is_alive() or isinstance(self._ended, StalledError)

    def _put(self, item: _Queued) -> None:
        with self._lock:
            if self._silent:
                return
            full = self._records + item.records > RECORDS or self._bytes + item.size > BYTES
            if self._queue and (full or len(self._queue) >= ITEMS):
                self.dropped += item.frames
                return
            self._records += item.records
            self._bytes += item.size
            self._queue.append(item)

    def _forget(self) -> None:
        """Leave out what waits, and what will come; the lock is held."""
        self._silent = True
        self.dropped += sum(item.frames for item in self._queue)
        self._queue.clear()

    # From here on everything runs in the thread.

    def _run(self) -> None:
        try:
            with self._picture or contextlib.nullcontext():
                self._show()
                self._end()
        except OSError as error:
            self._ended = error
            if not isinstance(error, StalledError):
                with self._lock:  # the reader is gone: nobody misses what waits
                    self._queue.clear()
                    self._silent = True
        except Exception as error:
            self.failure = error
        with self._lock:
            self._forget()

    def _show(self) -> None:
        every = FRAME_S if self._mode == BOARD else LINE_S
        due = time.monotonic() + (every if self._mode == LINE else 0)
        while not self._stop.is_set():
            began = time.thread_time()
            self._take(until=time.monotonic() + WORK_S)
            self._speak()
            now = time.monotonic()
            if self._press() or now >= due:
                self._refresh()
                due = max(due + every, now + every / 2)
            self._stop.wait(max(NAP_S, SHARE * (time.thread_time() - began)))

    def _end(self) -> None:
        """Show what still waits, as far as time allows."""
        self._take(until=self._out.deadline or 0.0)
        self._speak()
        if self._log is not None:
            self._log.close()
        self._still = None
        self._refresh()

    def _take(self, until: float) -> None:
        """Work on the queue."""
        while time.monotonic() < until:
            with self._lock:
                if not self._queue:
                    break
                item = self._queue.popleft()
                self._records -= item.records
                self._bytes -= item.size
            item.shown()
            if self._log is not None:
                self._out.flush()

    def _tell(self, bus: str, parts: Sequence[Part]) -> None:
        """Show what one pass decided."""
        if self._board is not None:
            written(self._board, bus=bus, parts=parts)
        if self._log is not None:
            written(self._log, bus=bus, parts=self._selected(bus, parts))

    def _selected(self, bus: str, parts: Sequence[Part]) -> Sequence[Part]:
        """Return what a log is given: which rows of it are shown, too."""
        selection = self._selection
        if selection is None:
            return parts
        return [(p, replace(b, chosen=selection.rows(bus, p, b))) for p, b in parts]

    def _refresh(self) -> None:
        """Draw the board or write the line; nothing in a log."""
        if self._board is None or self._mode == LOG:
            return
        self._board.left_out = self.dropped
        if self._picture is not None:
            self._picture.draw(*(self._still or (self._board, self._status())))
        else:
            self._out.write(line(self._status(), self._board) + "\n")
            self._out.flush()

    def _press(self) -> bool:
        """Do what keys say; tell whether there were any."""
        keys = [] if self._picture is None else self._picture.keyboard.read()
        if self._board is None or self._board.controls is None:
            return False
        controls = self._board.controls
        for key in keys:
            controls.press(key, self._board)
        if not controls.held:
            self._still = None
        elif self._still is None:
            self._still = self._board.still(), self._status()
        return bool(keys)

    def _speak(self) -> None:
        """Write what was said, and the statistics somebody asked for."""
        told = []
        while self._sayings:
            told.append(self._sayings.popleft())
        if self._asked:
            self._asked = False
            if self._board is not None:
                self._board.left_out = self.dropped
                told.append(statistics(self._status(), self._board))
        if told and self._picture is not None:
            self._picture.say("\n".join(told))
            self._refresh()
        elif told:
            self._notes.write("\n".join(told) + "\n")
            try:
                self._notes.flush()
            except BrokenPipeError:
                if self._notes is self._out:
                    raise
