"""The process that shows a recording while it is made: in Rerun, or (``serving.py``) in Foxglove.

Started as ``python -m sniffer.viewers.companion.child`` by ``parent.py`` beside this file, which
sends it the raw bytes through a pipe. It decodes them with the same core as the recorder does, and
owns the viewer. It is free to be slow or to hang: a viewer that takes no data holds it up, then the
pipe is full and the recorder leaves out what it would have sent. The end of the pipe, by whatever
end of the recorder, ends the show: a window stays open until somebody closes it, and this process
with it; a server for the browser is stopped.
"""

from __future__ import annotations

import contextlib
import os
import select
import subprocess
import sys
import time
from typing import TYPE_CHECKING, Final, NoReturn

from sniffer.decoding.detect import UndecidedError
from sniffer.decoding.pipeline import Pipeline
from sniffer.decoding.rates import Rate
from sniffer.ground.model import OutputError
from sniffer.sinks.rerun.entities import LogLine
from sniffer.viewers import viewer
from sniffer.viewers.companion.parcels import (
    CONNECT,
    DONE,
    GONE,
    READY,
    SAY,
    WEB,
    WINDOW,
    IncidentWord,
    Parcel,
    Setup,
    Unpacker,
)

if TYPE_CHECKING:
    from collections.abc import Callable, Iterable, Iterator

    from sniffer.ground.model import Chunk

    Tell = Callable[[str, str], None]

PIPE: Final = 0
"""The chunks come on standard input."""

READ: Final = 1 << 20
"""Bytes taken from the pipe in one go: what a delay heaped up there is decoded in one pass."""

PACE_S: Final = 0.1
WEB_PACE_S: Final = 0.25
"""How often the pipe is emptied, in seconds: a viewer's work goes by messages more than by numbers,
and a browser takes in only so many between two pictures."""

NICE: Final = 10
"""Drawing may wait; reading the ports and writing the file may not."""

WINDOW_MEMORY: Final = ("--memory-limit", "1GB", "--server-memory-limit", "25MB")
"""The viewer then drops what is oldest. Sent ten at a time a number takes it 200 to 300 bytes: four
servos polled for six values at 100 Hz fill this in half an hour. The second limit is for viewers
that connect to this one, and not for what is on its way."""

SERVER_MEMORY: Final = ("--server-memory-limit", "256MB")
"""What a browser is sent that is opened late, or once more: some minutes of the same."""

LOOK_S: Final = 0.25
"""How often it is looked whether the viewer is still there, in seconds."""

FLUSH_S: Final = 1.0
"""How long one wait for the viewer lasts before it is looked whether there still is one."""

ARRIVAL_S: Final = 3.0
"""How long a viewer elsewhere may take to answer."""

END_S: Final = 2.0
"""How long a viewer whose connection is gone may take to end: its status says more."""

PARTING_S: Final = 10.0
"""How long a viewer may hang after the recorder has gone."""


class GoneError(Exception):
    """There is nothing more to be shown to; the text says why."""


class Watcher:
    """Decodes what comes through the pipe and sends it to the viewer."""

    def __init__(self, setup: Setup, unpacker: Unpacker, tell: Tell) -> None:
        self._setup, self._unpacker, self._tell = setup, unpacker, tell
        self._viewer: subprocess.Popen[bytes] | None = None
        self._hung_up: float | None = None
        self._has_shown = False

    def run(self) -> None:
        """Show all that comes; return when the recording has ended and nobody looks any more.

        Raises:
            GoneError: the viewer went away.
            OutputError: there is none.
        """
        with self._target() as address:
            self._open(address)
            self._flush()
            self._tell(READY, "")
            self._show(self._unpacker.parcels())
            for data in self._pieces():
                self._unpacker.feed(data)
                self._show(self._unpacker.parcels())
            with contextlib.suppress(UndecidedError):
                self._pipeline.close()
            self._flush()
            self._tell(DONE, "")
            self._leave()

    def _open(self, address: str) -> None:
        """Make what decodes, and sends it there."""
        from sniffer.sinks.rerun.sink import RerunSink

        self._recording = viewer.stream(self._setup.name, address)
        self._sink = RerunSink(
            recording=self._recording,
            window_s=self._setup.window_s,
        )
        self._pipeline = Pipeline(self._setup.options, [self._sink], live=True)

    def _incident(self, bus: str, word: IncidentWord) -> None:
        """Show what has become of an incident."""
        self._sink.incident(bus, word.servo_ids, LogLine(word.t_ns, word.severity, word.text))

    def _leave(self) -> None:
        """End the connection; wait for a window until somebody closes it."""
        self._recording.disconnect()  # a viewer calls a line that only breaks off an error
        if self._viewer is not None and self._setup.mode == WINDOW and self._has_shown:
            self._viewer.wait()

    @contextlib.contextmanager
    def _target(self) -> Iterator[str]:
        """Yield where to send the data, with a viewer there."""
        setup = self._setup
        if setup.mode == CONNECT:
            _, host, port = viewer.data_address(setup.address)
            if not _within(ARRIVAL_S, lambda: viewer.listens(host, port)):
                raise GoneError(f"no Rerun viewer answers at {setup.address}")
            yield setup.address
        elif setup.mode == WINDOW:
            with viewer.window(*WINDOW_MEMORY, *setup.arguments, own_group=False) as opened:
                self._viewer, address = opened
                yield address
        else:
            with viewer.server(*SERVER_MEMORY, *setup.arguments, own_group=False) as served:
                self._viewer, page, address = served
                self._tell(SAY, f"Rerun shows the recording at {page}")
                yield address

    def _pieces(self) -> Iterator[bytes]:
        """Yield what the pipe holds, until the recorder closes it or is no more."""
        pace = WEB_PACE_S if self._setup.mode == WEB else PACE_S
        due = time.monotonic()
        while True:
            self._look()
            if select.select([PIPE], [], [], LOOK_S)[0]:
                while time.monotonic() < due and not _is_closed(PIPE):
                    time.sleep(0.02)
                due = time.monotonic() + pace
                data = os.read(PIPE, READ)
                if not data:
                    return
                yield data
            else:
                self._flush()  # a viewer that is none may take its time to show it

    def _show(self, parcels: Iterable[Parcel]) -> None:
        """Decode all parcels, those of a bus in one pass, and wait until the viewer has them.

        That a bus fell silent, the recorder tells by a mark. Time alone says nothing here: bytes
        of a while ago may be on their way still.
        """
        waiting: dict[str, list[Chunk]] = {}
        for bus, missing, chunks, words, baud in parcels:
            if baud:
                latency_ns = self._setup.options.latencies.get(bus, 0)
                self._pipeline.tune(bus, Rate(baud, 0, latency_ns))
            for word in words:
                self._incident(bus, word)
            self._has_shown |= bool(chunks)
            if missing and chunks:
                self._decode(waiting)
                self._pipeline.skip(bus, missing, chunks[0])
                chunks = chunks[1:]
            if chunks:
                waiting.setdefault(bus, []).extend(chunks)
        self._decode(waiting)
        self._flush()

    def _decode(self, waiting: dict[str, list[Chunk]]) -> None:
        for bus, chunks in waiting.items():
            self._pipeline.decode(bus, chunks)
        waiting.clear()

    def _flush(self) -> None:
        """Wait until the viewer has taken what was sent.

        Without that the SDK would keep up to 100 MB for a viewer that hangs.
        """
        while True:
            try:
                self._recording.flush(timeout_sec=FLUSH_S)
            except RuntimeError as error:
                is_gone = "timed out" not in str(error)
                self._look(END_S if is_gone else 0.0)
                if is_gone:
                    raise GoneError(self._lost()) from error
            else:
                return
            if self._is_deserted():
                raise GoneError("the Rerun viewer takes no data")

    def _lost(self) -> str:
        if self._has_shown or self._setup.mode != CONNECT:
            return "the Rerun viewer has gone"
        return f"what answers at {self._setup.address} is no Rerun viewer"

    def _look(self, patience_s: float = 0.0) -> None:
        """Raise GoneError once our own viewer has ended, for which there is some patience."""
        if self._viewer is None:
            return
        try:
            status = self._viewer.wait(patience_s)
        except subprocess.TimeoutExpired:
            return
        if status == 0 and self._setup.mode == WINDOW:
            raise GoneError("the Rerun window was closed")
        raise GoneError(f"the Rerun viewer stopped with status {status}")

    def _is_deserted(self) -> bool:
        """Tell whether the recorder has gone for so long that nobody waits for what it left."""
        if not _is_closed(PIPE):
            return False
        if self._hung_up is None:
            self._hung_up = time.monotonic()
        return time.monotonic() - self._hung_up > PARTING_S


def _is_closed(pipe: int) -> bool:
    """Tell whether nobody writes any more; what is left in the pipe does not hide it."""
    look = select.poll()
    look.register(pipe, 0)
    return any(event & select.POLLHUP for _, event in look.poll(0))


def _within(seconds: float, is_so: Callable[[], bool]) -> bool:
    deadline = time.monotonic() + seconds
    while not is_so():
        if time.monotonic() > deadline:
            return False
        time.sleep(0.2)
    return True


def _first(unpacker: Unpacker) -> Setup | None:
    """Return the setup; None where the recorder ends before it has sent it."""
    while data := os.read(PIPE, READ):
        unpacker.feed(data)
        if (setup := unpacker.setup()) is not None:
            return setup
    return None


def main(watcher: type[Watcher] = Watcher) -> NoReturn:
    """Show what comes on standard input; tell on standard output how it goes."""
    # What the SDK or the viewer print must not be taken for what we tell.
    told, nowhere = os.dup(1), os.open(os.devnull, os.O_WRONLY)
    os.dup2(nowhere, 1)

    def tell(what: str, text: str) -> None:
        line = f"{what} {' '.join(text.split())}\n"
        with contextlib.suppress(OSError):  # the recorder has gone
            os.write(told, line.encode())

    if sys.platform != "win32":
        os.nice(NICE)
    try:
        unpacker = Unpacker()
        with viewer.stoppable():
            setup = _first(unpacker)
            if setup is not None:
                watcher(setup, unpacker, tell).run()
    except (GoneError, OutputError) as error:
        tell(GONE, str(error))
    except Exception as error:
        tell(GONE, f"what shows it live failed: {type(error).__name__}: {error}")
    finally:
        # Not the usual way: the SDK would wait there for a viewer that hangs.
        os._exit(0)


if __name__ == "__main__":
    main()
