"""Shows a .rrd file, or what is decoded just now, in the Rerun viewer: a window, or a browser.

The viewer is the program that comes with the rerun package, run as a child that ends with the call.
Its usage statistics are switched off. Written for rerun-sdk 0.41.
"""

from __future__ import annotations

import atexit
import contextlib
import importlib.util
import os
import shutil
import signal
import socket
import subprocess
import sys
import threading
import time
import urllib.error
import urllib.request
import uuid
from pathlib import Path
from typing import TYPE_CHECKING, Any, Final, NoReturn

from sniffer.model import OutputError

if TYPE_CHECKING:
    from collections.abc import Callable, Iterator, Sequence

    from sniffer.model import Batch, Chunk
    from sniffer.protocols.base import BusProtocol

WEB_PORT: Final = 9090
DATA_PORT: Final = 9876
"""Rerun's own default ports; others are taken where these are in use."""

LOCAL: Final = ("--bind", "127.0.0.1")
"""The viewer, too, listens; by default to the whole network."""

PATIENCE_S: Final = 20.0
"""How long the server may take to answer; it takes half a second on an idle machine."""


def show(
    path: Path,
    *,
    web: bool = False,
    port: int | None = None,
    say: Callable[[str], None] | None = None,
) -> None:
    """Show a recording; return when the window is closed, or on Ctrl-C.

    Args:
        path: a .rrd file.
        web: serve it, and the viewer for the browser, on 127.0.0.1 until Ctrl-C.
        port: of the web page; see ``WEB_PORT``.
        say: is told the address to open, once it answers.

    Raises:
        OutputError: there is no display, or the viewer does not start.
    """
    if not web:
        need_display(path)
    with _signals():
        if web:
            _serve(path, port, say)
        else:
            _open(path)


def need_display(file: Path | str) -> None:
    """Raise OutputError, saying what to do instead, where no window can be opened."""
    if not has_display():
        raise OutputError(f"there is no display for the Rerun viewer: {_instead(file)}")


def _instead(file: Path | str) -> str:
    name = "FILE" if str(file) == "-" else file
    return (
        f"let a browser show it with `sniffer view {name} --web`, or write `sniffer view {name} "
        "-o x.rrd` and open that with `rerun x.rrd` where there is one"
    )


def has_display() -> bool:
    """Tell whether a window can be opened."""
    if sys.platform in ("win32", "darwin"):
        return True
    return bool(os.environ.get("DISPLAY") or os.environ.get("WAYLAND_DISPLAY"))


def _open(path: Path) -> None:
    # A viewer that is open already would take the file over and let this call return at once.
    with (
        _rerun(*LOCAL, "--port", "auto", str(path)) as viewer,
        contextlib.suppress(KeyboardInterrupt),
    ):
        if status := viewer.wait():
            raise OutputError(f"the Rerun viewer stopped with status {status}: {_instead('FILE')}")


def _serve(path: Path, port: int | None, say: Callable[[str], None] | None) -> None:
    web_port = _free_port(WEB_PORT) if port is None else port
    data_port = _free_port(DATA_PORT)
    page = f"http://127.0.0.1:{web_port}/"
    server = _rerun(
        *LOCAL,
        *("--serve-web", "--web-viewer-port", str(web_port), "--port", str(data_port)),
        *("--server-memory-limit", "75%"),  # the default drops what is old from large recordings
        str(path),
    )
    with server as process, contextlib.suppress(KeyboardInterrupt):
        if not _comes_up(process, lambda: _answers(page) and _listens(data_port)):
            raise OutputError(f"the Rerun server does not start on {page}: is the port in use?")
        if say is not None:
            data = f"rerun%2Bhttp%3A%2F%2F127.0.0.1%3A{data_port}%2Fproxy"
            say(f"open {page}?url={data}  (Ctrl-C stops)")
        process.wait()
        raise OutputError(f"the Rerun server stopped with status {process.returncode}")


class LiveSink:
    """A viewer's window that shows what is written to it, following the newest time.

    ``close`` leaves the window to be looked at: it returns when it is closed, or on Ctrl-C.

    Raises:
        OutputError: there is no display, or the viewer does not start.
    """

    def __init__(self, name: str, *, window_s: float = 20.0) -> None:
        need_display("FILE")
        import rerun as rr

        from sniffer.sinks.rerun import RerunSink

        port = _free_port(DATA_PORT)
        with contextlib.ExitStack() as stack:
            stack.enter_context(_signals())
            arguments = (*LOCAL, "--port", str(port), "--expect-data-soon")
            self._viewer = stack.enter_context(_rerun(*arguments))
            if not _comes_up(self._viewer, lambda: _listens(port)):
                raise OutputError(f"the Rerun viewer does not start: {_instead('FILE')}")
            self._recording = rr.RecordingStream(f"sniffer {name} {uuid.uuid4().hex[:6]}")
            self._recording.connect_grpc(f"rerun+http://127.0.0.1:{port}/proxy")
            self._sink = RerunSink(recording=self._recording, window_s=window_s)
            self._stack = stack.pop_all()
        atexit.register(self._stack.close)

    def raw(self, bus: str, chunks: Sequence[Chunk]) -> None:
        """Take chunks; Rerun has no use for them."""

    def write(self, bus: str, protocol: BusProtocol, batch: Batch) -> None:
        """Show what one pass decided; nothing once the window has been closed."""
        if self._viewer.poll() is None:
            self._sink.write(bus, protocol, batch)

    def close(self) -> None:
        """Wait until the window is closed; while an exception passes, close it."""
        leaves = sys.exc_info()[0] is not None
        with self._stack, contextlib.suppress(KeyboardInterrupt):
            if self._viewer.poll() is None:
                self._sink.close()
            self._recording.disconnect()
            if not leaves:
                self._viewer.wait()
        atexit.unregister(self._stack.close)


def live_sink(name: str) -> LiveSink:
    """Open a window that shows what is written to the sink."""
    return LiveSink(name)


def _comes_up(process: subprocess.Popen[bytes], is_up: Callable[[], bool]) -> bool:
    deadline = time.monotonic() + PATIENCE_S
    while process.poll() is None and time.monotonic() < deadline:
        if is_up():
            return True
        time.sleep(0.05)
    return False


@contextlib.contextmanager
def _rerun(*arguments: str) -> Iterator[subprocess.Popen[bytes]]:
    """Run the viewer's program in a process group of its own, and end all of it."""
    environment = {k: v for k, v in os.environ.items() if k != "FORCE_RERUN_ANALYTICS"}
    # CI: no usage statistics, no banner about them, no file in the user's home to say so.
    environment |= {"CI": "1", "RUST_LOG": os.environ.get("RUST_LOG", "error")}
    process = subprocess.Popen(
        [_executable(), *arguments],
        env=environment,
        stdin=subprocess.DEVNULL,
        start_new_session=True,
    )
    try:
        yield process
    finally:
        _end(process)


def _end(process: subprocess.Popen[bytes]) -> None:
    if process.poll() is not None:
        return
    for number in (signal.SIGTERM, signal.SIGTERM if sys.platform == "win32" else signal.SIGKILL):
        with contextlib.suppress(ProcessLookupError):
            if sys.platform == "win32":
                process.terminate()
            else:
                os.killpg(process.pid, number)
        with contextlib.suppress(subprocess.TimeoutExpired):
            process.wait(3)
            return


def _executable() -> str:
    """Return the viewer's program: the one in the package, else a ``rerun`` nearby."""
    package = importlib.util.find_spec("rerun_cli")
    folders = [Path(p) for p in (package.submodule_search_locations or ())] if package else []
    suffix = ".exe" if sys.platform == "win32" else ""
    names = [f / "Rerun.app/Contents/MacOS/Rerun" for f in folders if sys.platform == "darwin"]
    names += [folder / f"rerun{suffix}" for folder in folders]
    names.append(Path(sys.executable).with_name(f"rerun{suffix}"))
    for name in names:
        if name.is_file():
            return str(name)
    found = shutil.which("rerun")
    if found is None:
        raise OutputError("the Rerun viewer is not installed: `pip install rerun-sdk`")
    return found


@contextlib.contextmanager
def _signals() -> Iterator[None]:
    """Let a request to stop end the child too, as Ctrl-C does."""

    def stop(number: int, frame: Any) -> NoReturn:
        raise SystemExit(128 + number)

    if threading.current_thread() is not threading.main_thread():
        yield
        return
    names = ("SIGTERM", "SIGHUP")
    before = {s: signal.signal(s, stop) for n in names if (s := getattr(signal, n, None))}
    try:
        yield
    finally:
        for number, handler in before.items():
            signal.signal(number, handler)


def _free_port(wanted: int) -> int:
    """Return the wanted port, or another where that is taken."""
    for port in (wanted, 0):
        with socket.socket() as probe, contextlib.suppress(OSError):
            if sys.platform != "win32":  # there it would take a port that is in use
                probe.setsockopt(socket.SOL_SOCKET, socket.SO_REUSEADDR, 1)
            probe.bind(("127.0.0.1", port))
            return int(probe.getsockname()[1])
    raise OutputError("no port is free on 127.0.0.1")


def _listens(port: int) -> bool:
    with socket.socket() as probe:
        return probe.connect_ex(("127.0.0.1", port)) == 0


def _answers(page: str) -> bool:
    # Not through a proxy, which environments often name for all addresses.
    opener = urllib.request.build_opener(urllib.request.ProxyHandler({}))
    try:
        with opener.open(page, timeout=1) as answer:
            return bool(answer.status == 200)
    except (urllib.error.URLError, OSError):
        return False
