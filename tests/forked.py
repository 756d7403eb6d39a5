"""The command line in a process of its own that has its libraries loaded from the beginning.

Loading them, and taking them apart at the end, is most of what a short command costs, and tests run
a thousand of these. Here one process loads them once and forks for each command, which has memory,
streams, a folder, an environment, signals and an exit status of its own, as if a shell had begun
it. How it loads is what is not tested so: tests of that start ``python -m sniffer`` themselves, as
those of recording do.
"""

from __future__ import annotations

import atexit
import contextlib
import functools
import gc
import importlib
import io
import json
import os
import pkgutil
import select
import signal
import socket
import subprocess
import sys
import tempfile
import threading
import time
from pathlib import Path
from typing import TYPE_CHECKING, Final, TextIO, cast

import sniffer
from sniffer.cli import run

if TYPE_CHECKING:
    from collections.abc import Iterable, Mapping, Sequence

ROOT: Final = Path(__file__).parent.parent
PROGRAM: Final = "sniffer.__main__"
READY: Final = b"."
_AT_BEGIN: Final = ("PYTHON", "LC_", "LANG")

_STREAMS: Final = 3
_LATER: Final = ("pyarrow.parquet", "rerun.blueprint", "duckdb")
"""What the package loads where it is needed."""

_USUAL: Final = (("decode", "--format", "jsonl"), ("decode",), ("stats",), ("diagnose",))
"""What many commands do, for a capture."""

CLIENT: Final = """#!{python} -ISE
import _socket, array, json, os, sys
line = _socket.socket(_socket.AF_UNIX, _socket.SOCK_STREAM)
line.connect({address!r})
told = json.dumps([sys.argv[1:], os.getcwd(), dict(os.environ)]).encode()
fds = array.array("i", [0, 1, 2])
line.sendmsg([len(told).to_bytes(4, "big")], [(_socket.SOL_SOCKET, _socket.SCM_RIGHTS, fds)])
while told:
    told = told[line.send(told):]
line.recv(4)
status = int.from_bytes(line.recv(4), "big", signed=True)
if status < 0:
    os.kill(os.getpid(), -status)
os._exit(status)
"""
"""A program that passes its command line, folder, environment and streams on, and ends alike."""


def can_fork(env: Iterable[str] = ()) -> bool:
    """Tell whether a command does the same if it is forked, with such variables beside ours.

    Some are looked at when Python begins. And on other systems libraries have threads by then, or
    there is no fork.
    """
    return sys.platform == "linux" and not any(name.startswith(_AT_BEGIN) for name in env)


class Server:
    """The process that has everything loaded; it is gone when this one is."""

    def __init__(self) -> None:
        self._folder = tempfile.TemporaryDirectory(prefix="forked-")
        self.address = str(Path(self._folder.name) / "line")
        self._lifeline, theirs = socket.socketpair()
        self._process = subprocess.Popen(
            [sys.executable, "-m", "tests.forked", self.address, str(theirs.fileno())],
            cwd=ROOT,
            stdin=subprocess.DEVNULL,
            pass_fds=[theirs.fileno()],
        )
        theirs.close()
        atexit.register(self._end)
        if self._lifeline.recv(1) != READY:
            raise RuntimeError("the process that forks commands has not begun: see above")

    def _end(self) -> None:
        self._lifeline.close()
        self._process.wait()
        self._folder.cleanup()

    def start(
        self,
        arguments: Sequence[str],
        streams: tuple[int, int, int],
        env: Mapping[str, str],
        folder: Path | None = None,
    ) -> Process:
        """Start a command, in this folder if no other is said."""
        line = socket.socket(socket.AF_UNIX)
        line.connect(self.address)
        told = json.dumps([list(arguments), str(folder or Path.cwd()), dict(env)]).encode()
        socket.send_fds(line, [len(told).to_bytes(4, "big")], streams)
        line.sendall(told)
        return Process(line)

    def install(self, path: Path) -> None:
        """Write a program that is the command."""
        path.write_text(CLIENT.format(python=sys.executable, address=self.address), "ascii")
        path.chmod(0o755)


class Process:
    """A command that runs, as ``subprocess.Popen`` has it."""

    def __init__(self, line: socket.socket) -> None:
        self._line = line
        self.pid = int.from_bytes(line.recv(4), "big")
        self.returncode: int | None = None

    def poll(self) -> int | None:
        """Return its status if it has ended."""
        if self.returncode is None and select.select([self._line], [], [], 0)[0]:
            self.wait()
        return self.returncode

    def wait(self, timeout: float | None = None) -> int:
        """Return its status once it has ended.

        Raises:
            TimeoutError: it takes longer, in seconds.
        """
        if self.returncode is None:
            self._line.settimeout(timeout)
            told = self._line.recv(4)
            assert told, "who waits for the command is gone"
            self.returncode = int.from_bytes(told, "big", signed=True)
            self._line.close()
        return self.returncode

    def send_signal(self, number: int) -> None:
        """Send it a signal, unless it has ended."""
        if self.poll() is None:
            os.kill(self.pid, number)

    def kill(self) -> None:
        """Kill it, unless it has ended."""
        self.send_signal(signal.SIGKILL)


@functools.cache
def server() -> Server:
    """Return the one of this process."""
    return Server()


def _load() -> None:
    """Load what commands load: all of the package, and libraries that it waits with."""
    for module in pkgutil.walk_packages(sniffer.__path__, "sniffer."):
        if module.name != PROGRAM:
            importlib.import_module(module.name)
    for name in _LATER:
        importlib.import_module(name)
    _rehearse()
    assert threading.active_count() == 1, "a forked process would lack the other threads"
    gc.collect()
    gc.freeze()  # else each process had a copy of all that is loaded, by its first collection


def _rehearse() -> None:
    """Do once what many commands do: what is worked out once a process is not, then, by each."""
    nowhere = io.StringIO()
    with contextlib.redirect_stdout(nowhere), contextlib.redirect_stderr(nowhere):
        for capture in sorted(ROOT.glob("sample_captures/*_manual.*")):
            for command, *options in _USUAL:
                assert run([command, str(capture), *options]) == 0, nowhere.getvalue()


def _serve(address: str, lifeline: int) -> None:
    """Fork for each who calls, until nobody holds the other end of ``lifeline``.

    Each command returns from here: it goes on as if the interpreter had just begun.
    """
    _load()
    listening = socket.socket(socket.AF_UNIX)
    listening.bind(address)
    listening.listen(64)
    running = dict[int, tuple[int, socket.socket]]()
    """Who is told of each command's end, by what tells of it; to fork once more costs more."""
    os.write(lifeline, READY)
    while lifeline not in (ready := _ready(listening.fileno(), lifeline, *running)):
        for ended in running.keys() & ready:
            os.close(ended)
            _tell_status(*running.pop(ended))
        if listening.fileno() not in ready:
            continue
        line, _ = listening.accept()
        told, streams = _received(line)
        if not (pid := os.fork()):
            for descriptor in (*running, lifeline):
                os.close(descriptor)
            for _, other in (*running.values(), (0, line), (0, listening)):
                other.close()
            _become(told, streams)
            return
        running[os.pidfd_open(pid)] = pid, line
        _tell(line, pid)
        for stream in streams:  # a pipe ends when the command does, not later
            os.close(stream)
    os._exit(0)


def _ready(*descriptors: int) -> list[int]:
    return select.select(descriptors, [], [])[0]


def _received(line: socket.socket) -> tuple[bytes, Sequence[int]]:
    """Return command line, folder and environment as they are told, and the streams."""
    size, streams, _, _ = socket.recv_fds(line, 4, _STREAMS)
    told = b""
    while len(told) < int.from_bytes(size, "big") and (part := line.recv(1 << 20)):
        told += part
    return told, streams


def _become(told: bytes, streams: Sequence[int]) -> None:
    """Take them over."""
    arguments, folder, env = json.loads(told)
    for number, stream in enumerate(streams):
        os.dup2(stream, number)
        os.close(stream)
    os.chdir(folder)
    os.environ.clear()
    os.environ.update(env)
    time.tzset()
    sys.argv[1:] = arguments
    sys.stdin, sys.stdout = _text(0, "r"), _text(1, "w")
    sys.stderr = _text(2, "w", buffering=1, errors="backslashreplace")


def _tell_status(pid: int, line: socket.socket) -> None:
    with line:
        _tell(line, os.waitstatus_to_exitcode(os.waitpid(pid, 0)[1]))


def _tell(line: socket.socket, number: int) -> None:
    with contextlib.suppress(OSError):  # who has called is gone
        line.sendall(number.to_bytes(4, "big", signed=True))


def _text(stream: int, mode: str, buffering: int = -1, errors: str = "strict") -> TextIO:
    return cast("TextIO", open(stream, mode, buffering, "utf-8", errors, closefd=False))


if __name__ == "__main__":
    _serve(sys.argv[1], int(sys.argv[2]))
    program = importlib.import_module(PROGRAM)
    sys.modules["__main__"] = program  # which processes that it starts look for
    program.main()
