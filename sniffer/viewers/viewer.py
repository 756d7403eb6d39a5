"""The Rerun viewer: shows a .rrd file, or takes what is decoded just now; a window, or a browser.

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
import urllib.parse
import urllib.request
from pathlib import Path
from typing import TYPE_CHECKING, Any, Final, NoReturn

from sniffer.ground.model import OutputError

if TYPE_CHECKING:
    from collections.abc import Callable, Iterator, Sequence

    import rerun as rr

    from sniffer.decoding.called import ServoNames
    from sniffer.ground.model import Batch, Chunk
    from sniffer.protocols.base import BusProtocol

WEB_PORT: Final = 9090
DATA_PORT: Final = 9876
"""Rerun's own default ports; others are taken where these are in use."""

LOCAL: Final = ("--bind", "127.0.0.1")
"""The viewer, too, listens; by default to the whole network."""

SCHEMES: Final = ("rerun", "rerun+http", "rerun+https")
"""Of the addresses that the viewer takes data at; http and https stand for the latter two."""

ANSWER_S: Final = 20.0
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
    with stoppable():
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
    # the default limit drops what is old from large recordings
    with (
        contextlib.suppress(KeyboardInterrupt),
        server("--server-memory-limit", "75%", str(path), port=port) as (process, page, _),
    ):
        if say is not None:
            say(f"open {page}  (Ctrl-C stops)")
        process.wait()
        raise OutputError(f"the Rerun server stopped with status {process.returncode}")


@contextlib.contextmanager
def server(
    *arguments: str, port: int | None = None, own_group: bool = True
) -> Iterator[tuple[subprocess.Popen[bytes], str, str]]:
    """Serve data, and the viewer for the browser, on 127.0.0.1.

    Yields the process, the page to open, and the address that takes data.

    Raises:
        OutputError: it does not start.
    """
    web_port = _free_port(WEB_PORT) if port is None else port
    data_port = _free_port(DATA_PORT)
    page, data = f"http://127.0.0.1:{web_port}/", _proxy(data_port)
    ports = ("--serve-web", "--web-viewer-port", str(web_port), "--port", str(data_port))
    with _rerun(*LOCAL, *ports, *arguments, own_group=own_group) as process:
        if not _comes_up(process, lambda: _answers(page) and listens("127.0.0.1", data_port)):
            raise OutputError(f"the Rerun server does not start on {page}: is the port in use?")
        yield process, f"{page}?url={urllib.parse.quote(data, safe='')}", data


@contextlib.contextmanager
def window(
    *arguments: str, own_group: bool = True
) -> Iterator[tuple[subprocess.Popen[bytes], str]]:
    """Open an empty window; yields its process, and the address that takes data.

    Raises:
        OutputError: it does not start.
    """
    port = _free_port(DATA_PORT)
    live = ("--port", str(port), "--expect-data-soon")
    with _rerun(*LOCAL, *live, *arguments, own_group=own_group) as process:
        if not _comes_up(process, lambda: listens("127.0.0.1", port)):
            raise OutputError(
                "the Rerun viewer does not start: has this machine a graphics driver?"
            )
        yield process, _proxy(port)


def stream(name: str, address: str) -> rr.RecordingStream:
    """Return a recording that is sent to a viewer as it grows."""
    import rerun as rr

    from sniffer.sinks.rerun.layout import application_id

    recording = rr.RecordingStream(application_id(name))
    recording.connect_grpc(address)
    recording.send_recording_name(name)
    return recording


def data_address(url: str) -> tuple[str, str, int]:
    """Return the address of a viewer elsewhere as the SDK wants it, its host and its port.

    Raises:
        OutputError: it is none.
    """
    text = url if "://" in url else f"rerun+http://{url}"
    try:
        parts = urllib.parse.urlsplit(text)
        host, port = parts.hostname, parts.port or DATA_PORT
    except ValueError:  # a port that is no number, half an IPv6 address
        parts, host, port = urllib.parse.urlsplit(""), None, 0
    scheme = {"http": "rerun+http", "https": "rerun+https"}.get(parts.scheme, parts.scheme)
    extra = parts.query or parts.fragment or parts.username
    # what else a host may hold is the resolver's business, but a space is a slip of the keyboard
    is_host = host and not any(c.isspace() for c in url)
    if scheme not in SCHEMES or not is_host or extra or parts.path not in ("", "/", "/proxy"):
        raise OutputError(
            f"{url!r} is no address of a Rerun viewer: it looks like rerun+http://HOST:PORT/proxy"
        )
    named = f"[{host}]" if ":" in str(host) else host
    return f"{scheme}://{named}:{port}/proxy", str(host), port


def _proxy(port: int) -> str:
    return f"rerun+http://127.0.0.1:{port}/proxy"


class LiveSink:
    """A viewer's window that shows what is written to it, following the newest time.

    ``close`` leaves the window to be looked at: it returns when it is closed, or on Ctrl-C.

    Raises:
        OutputError: there is no display, or the viewer does not start.
    """

    def __init__(self, name: str, *, window_s: float = 20.0) -> None:
        need_display("FILE")
        from sniffer.sinks.rerun.sink import RerunSink

        with contextlib.ExitStack() as stack:
            stack.enter_context(stoppable())
            self._viewer, address = stack.enter_context(window())
            self._recording = stream(name, address)
            self._sink = RerunSink(recording=self._recording, window_s=window_s)
            self._stack = stack.pop_all()
        atexit.register(self._stack.close)

    def raw(self, bus: str, chunks: Sequence[Chunk]) -> None:
        """Take chunks; Rerun has no use for them."""

    def call(self, names: ServoNames) -> None:
        """Take what servos are called."""
        self._sink.call(names)

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
    deadline = time.monotonic() + ANSWER_S
    while process.poll() is None and time.monotonic() < deadline:
        if is_up():
            return True
        time.sleep(0.05)
    return False


@contextlib.contextmanager
def _rerun(*arguments: str, own_group: bool = True) -> Iterator[subprocess.Popen[bytes]]:
    """Run the viewer's program, out of reach of the terminal's Ctrl-C, and end it.

    Args:
        arguments: of the program.
        own_group: in a process group of its own; else in that of the caller, who must have one
            that no terminal speaks to.
    """
    environment = {k: v for k, v in os.environ.items() if k != "FORCE_RERUN_ANALYTICS"}
    # CI: no usage statistics, no banner about them, no file in the user's home to say so.
    environment |= {"CI": "1", "RUST_LOG": os.environ.get("RUST_LOG", "error")}
    process = subprocess.Popen(
        [executable(), *arguments],
        env=environment,
        stdin=subprocess.DEVNULL,
        start_new_session=own_group,
    )
    try:
        yield process
    finally:
        _end(process, own_group=own_group)


def _end(process: subprocess.Popen[bytes], *, own_group: bool) -> None:
    if process.poll() is not None:
        return
    for number in (signal.SIGTERM, signal.SIGTERM if sys.platform == "win32" else signal.SIGKILL):
        with contextlib.suppress(ProcessLookupError):
            if sys.platform == "win32":
                process.terminate()
            elif not own_group:
                process.send_signal(number)
            else:
                os.killpg(process.pid, number)
        with contextlib.suppress(subprocess.TimeoutExpired):
            process.wait(3)
            return


def executable() -> str:
    """Return the viewer's program: the one in the package, else a ``rerun`` nearby.

    Raises:
        OutputError: there is none.
    """
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
def stoppable() -> Iterator[None]:
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


def listens(host: str, port: int, timeout_s: float = 1.0) -> bool:
    """Tell whether somebody takes connections there."""
    try:
        socket.create_connection((host, port), timeout_s).close()
    except (OSError, UnicodeError):  # the latter: a name that no resolver takes
        return False
    return True


def _answers(page: str) -> bool:
    # Not through a proxy, which environments often name for all addresses.
    opener = urllib.request.build_opener(urllib.request.ProxyHandler({}))
    try:
        with opener.open(page, timeout=1) as answer:
            return bool(answer.status == 200)
    except (urllib.error.URLError, OSError):
        return False
