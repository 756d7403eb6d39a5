"""How long a recording keeps anybody waiting, timed: the tests hold it to no time.

A terminal that nobody reads, a viewer that takes nothing, an address that does not answer, a signal
under full load: each call is timed at its worst. ``python -m bench.waits``.
"""

from __future__ import annotations

import argparse
import contextlib
import os
import pty
import socket
import subprocess
import sys
import tempfile
import time
from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING, Final

from bench.lines import NAMES, Line, protocol_of, ticks, traffic
from sniffer.decoding.decoder import Decoder
from sniffer.decoding.pipeline import Options
from sniffer.ground.model import NS, Chunk, Clock
from sniffer.ports import PortOptions, open_port
from sniffer.protocols import PROTOCOLS
from sniffer.tap.events import Lost, Read
from sniffer.tap.reader import Anchor, Listener
from sniffer.tap.status import Status
from sniffer.viewers.companion.parcels import CONNECT
from sniffer.viewers.companion.parent import CLOSE_S, LiveView
from sniffer.viewers.screen import BOARD, LINE, LOG, Screen

if TYPE_CHECKING:
    from collections.abc import Callable, Iterator

BAUD: Final = 921600
PASS_S: Final = 0.05
"""The recorder hands over what a line says in so long."""

SHOWN_S: Final = 3.0
LINES: Final = 8
SPOKEN_S: Final = 2.0
WORDS: Final = 20
SETTLES_S: Final = 0.2
WAIT_S: Final = 30.0


@dataclass(frozen=True, slots=True)
class Wait:
    """What was waited for, for how long at worst, and how long that may be; in ms."""

    what: str
    worst: float
    allowed: float

    def __str__(self) -> str:
        """Say it in a line."""
        return f"{self.what}: {self.worst:.0f} ms at worst, {self.allowed:.0f} allowed"


class Watch:
    """Keeps the longest of what it times, in ms."""

    def __init__(self) -> None:
        self.worst = 0.0

    @contextlib.contextmanager
    def times(self) -> Iterator[None]:
        """Time what stands in its block."""
        began = time.monotonic()
        yield
        self.worst = max(self.worst, (time.monotonic() - began) * 1e3)


def _until(is_so: Callable[[], bool]) -> None:
    deadline = time.monotonic() + WAIT_S
    while not is_so():
        if time.monotonic() > deadline:
            raise RuntimeError("what is waited for does not happen")
        time.sleep(0.001)


def _passes(name: str) -> list[Chunk]:
    """Return what a full line says in some seconds, a chunk each pass of the recorder."""
    size = int(BAUD / 10 * PASS_S)
    data, now_ns = traffic(name, BAUD, SHOWN_S, 1), time.time_ns()
    starts = range(0, len(data) - size + 1, size)
    return [
        Chunk(data[at : at + size], now_ns + int(n * PASS_S * NS), Clock.READ, "bus0")
        for n, at in enumerate(starts)
    ]


def screens() -> list[Wait]:
    """Show on a terminal that nobody reads."""
    out = []
    for mode in (BOARD, LINE, LOG):
        calls, end = Watch(), Watch()
        master, slave = pty.openpty()
        with os.fdopen(slave, "w", encoding="utf-8") as stream:
            screen = Screen(
                mode, lambda: Status(0, 0, "x.mcap", 0, 0, ()), stream=stream, notes=stream
            )
            for name in NAMES:
                decoder = Decoder(name, baud=BAUD)
                for chunk in _passes(name):
                    batch = decoder.feed(chunk)
                    with calls.times():
                        screen.raw("bus0", [chunk])
                        screen.write("bus0", PROTOCOLS[name], batch)
                        screen.say("x" * 4000)
            with end.times():
                screen.close(0.5)
            os.close(master)  # lets go of who still writes
        what = f"a terminal that nobody reads (`{mode}`)"
        out += [Wait(f"{what}, a call", calls.worst, 50), Wait(f"{what}, its end", end.worst, 1000)]
    return out


def viewers() -> list[Wait]:
    """Show where somebody answers the connection and takes nothing."""
    calls, end = Watch(), Watch()
    with socket.create_server(("127.0.0.1", 0)) as server:
        url = f"127.0.0.1:{server.getsockname()[1]}"
        live = LiveView(
            CONNECT,
            options=Options(protocol="mightyzap"),
            name="bench",
            url=url,
            say=lambda _: None,
        )
        chunks = _passes("mightyzap")
        for _ in range(10):
            for chunk in chunks:
                with calls.times():
                    live.raw("bus0", [chunk])
                    live.keep_up()
        with end.times():
            live.close()
    what = "a viewer that takes nothing"
    allowed = CLOSE_S * 1e3 + 500
    return [Wait(f"{what}, a call", calls.worst, 50), Wait(f"{what}, its end", end.worst, allowed)]


def addresses() -> list[Wait]:
    """Listen to a line while an address that went away does not answer."""
    heard, end = Watch(), Watch()
    options = PortOptions(BAUD)
    with socket.socket() as server:
        server.bind(("127.0.0.1", 0))
        server.listen(0)
        host, number = server.getsockname()
        line = Line(b"", BAUD)
        ports = [open_port(f"socket://{host}:{number}", options)]
        ports += [open_port(line.port.name, options)]
        far, _ = server.accept()
        # another one who is not let in: the server's queue is full
        with socket.create_connection((host, number)):
            listener = Listener(ports, [options] * 2, Anchor.take())
            listener.start()
            far.close()
            _until(lambda: any(isinstance(e, Lost) for e in listener.drain()))
            time.sleep(SETTLES_S)
            for _ in range(WORDS):
                with heard.times():
                    line.port.write(b"hello")
                    _until(lambda: any(isinstance(e, Read) for e in listener.drain()))
                time.sleep(PASS_S)
            with end.times():
                listener.stop()
        line.port.close()
    what = "an address that does not answer"
    return [
        Wait(f"{what}, what another port says", heard.worst, 100),
        Wait(f"{what}, the end", end.worst, 500),
    ]


def signals() -> list[Wait]:
    """End a recorder with a signal while its lines speak as fast as they can."""
    end = Watch()
    lines = [Line(traffic(protocol_of(n), BAUD, SPOKEN_S, n), BAUD) for n in range(LINES)]
    with tempfile.TemporaryDirectory() as folder:
        path = Path(folder) / "run.mcap"
        ports = [f"b{n}={it.port.name}={protocol_of(n)}@{BAUD}" for n, it in enumerate(lines)]
        command = [sys.executable, "-m", "sniffer", "record", *ports, "--quiet", "-o", str(path)]
        process = subprocess.Popen(command, stdin=subprocess.DEVNULL)
        try:
            _until(path.exists)
            time.sleep(SETTLES_S)
            for elapsed, _ in ticks(SPOKEN_S):
                for line in lines:
                    line.say(elapsed)
            with end.times():
                process.terminate()
                status = process.wait(WAIT_S)
        finally:
            process.kill()
            process.wait()
            for line in lines:
                line.port.close()
    if status:
        raise RuntimeError(f"the recorder ended with status {status}")
    return [Wait(f"{LINES} lines at {BAUD}, SIGTERM until its end", end.worst, 2000)]


PARTS: Final = (screens, viewers, addresses, signals)


def measure(say: Callable[[str], object]) -> list[Wait]:
    """Return all of them."""
    out: list[Wait] = []
    for part in PARTS:
        for it in part():
            say(str(it))
            out.append(it)
    return out


def complaints(waits: list[Wait]) -> list[str]:
    """Return what lasted too long."""
    return [str(it) for it in waits if it.worst > it.allowed]


def main() -> None:
    """Measure once; end with status 1 where something lasts too long."""
    argparse.ArgumentParser(description=__doc__).parse_args()
    found = measure(lambda line: sys.stderr.write(f"{line}\n"))
    raise SystemExit(bool(complaints(found)))


if __name__ == "__main__":
    main()
