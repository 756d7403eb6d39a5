"""Files, standard input and bytes, opened so that their head can be looked at first.

A regular file is opened again for every pass; anything else (a pipe, standard input) is read once
and its head kept, so that nothing is read twice and nothing is read whole.
"""

from __future__ import annotations

import contextlib
import io
import math
import os
import re
import select
import stat
import sys
import time
import weakref
from pathlib import Path
from typing import TYPE_CHECKING, BinaryIO, Final, Protocol

from sniffer.ground.devices import is_port
from sniffer.ground.files import STDIN
from sniffer.ground.model import DamagedInputError, InputError
from sniffer.pcapfile.layout import PCAP_MAGICS, PCAPNG_MAGIC
from sniffer.sources.recognise import HEAD
from sniffer.sources.text import pauses

if TYPE_CHECKING:
    from collections.abc import Iterator

    from sniffer.ground.files import Stream

SPOOLED_AT_ONCE: Final = 1 << 20
"""Bytes that go to a temporary file at once."""

GATHER_S: Final = 0.2
"""How long a pipe must be silent for its beginning to be looked at, in seconds."""

GATHER_MOST_S: Final = 1.0
"""How long its beginning is gathered if it never is, in seconds."""

SILENT_S: Final = 0.1
"""From so long a silence on what has come of a pipe is handed on, in seconds."""


SHOWN: Final = 300
"""A longer path is shown by its beginning and its end."""


class Origin(Protocol):
    """Where bytes come from: ``head`` is what recognition may see."""

    name: str
    path: Path | None
    suffix: str  # of its name, with the dot
    head: bytes
    live: bool  # its bytes come when they come

    def open(self) -> contextlib.AbstractContextManager[Stream]:
        """Return the whole input, from its first byte on."""

    def close(self) -> None:
        """Release the input."""


class _Guarded:
    """A stream after its head: an error of the system becomes one of ours."""

    def __init__(self, head: bytes, rest: Stream, name: str) -> None:
        self._head = head
        self._rest = rest
        self._name = name
        self._read = 0

    def read(self, size: int, /) -> bytes:
        data, self._head = self._head, b""
        if not data:
            try:
                data = self._rest.read(size)
            except OSError as error:
                why = f"{self._name}: reading broke off after {self._read} bytes"
                raise DamagedInputError(f"{why} ({error.strerror})") from None
        self._read += len(data)
        return data

    def comes(self) -> bool:
        """Tell whether more comes soon, or the end."""
        return bool(self._head) or not pauses(self._rest)


class File:
    """A regular file, or bytes held in memory: it can be read any number of times."""

    live = False

    def __init__(self, path: Path | None, data: bytes = b"") -> None:
        self.path = path
        self.suffix = path.suffix if path else ""
        self.name = _shown(path) if path else "the given bytes"
        self._data = data
        with self._binary() as file:
            self.head = file.read(HEAD)

    def _binary(self) -> BinaryIO:
        if self.path is None:
            return io.BytesIO(self._data)
        with _explained(self.path):
            return self.path.open("rb", buffering=0)

    @contextlib.contextmanager
    def open(self) -> Iterator[Stream]:
        """Return the file from its first byte on."""
        with self._binary() as file:
            yield _Guarded(b"", file, self.name)

    def close(self) -> None:
        """Do nothing: the file is open only while it is read."""


class Pipe:
    """What can be read once: standard input, a named pipe."""

    live = True

    def __init__(self, stream: BinaryIO, name: str, *, owned: bool) -> None:
        self.path: Path | None = None
        self.suffix = ""
        self.name = name
        self._stream = stream
        self._owned = owned
        self._used = False
        self._read = b""
        whole = False
        # Whoever writes slowly is not waited for: what has come is looked at.
        until = math.inf
        while len(self._read) < HEAD and (not self._read or _more(stream, GATHER_S)):
            if time.monotonic() > until:
                break
            read = _Pipe(stream).read(HEAD - len(self._read))
            until = min(until, time.monotonic() + GATHER_MOST_S)
            if not read:
                whole = True
                break
            self._read += read
        # a line that has half come would look like nonsense
        whole = whole or self._read.startswith((*PCAP_MAGICS, PCAPNG_MAGIC))
        end = len(self._read) if whole else self._read.rfind(b"\n") + 1
        self.head = self._read[:end] or self._read

    @contextlib.contextmanager
    def open(self) -> Iterator[Stream]:
        """Return the stream with its head in front, once."""
        if self._used:
            raise InputError(f"{self.name} can be read only once")
        self._used = True
        try:
            yield _Guarded(self._read, _Pipe(self._stream), self.name)
        finally:
            self.close()

    def close(self) -> None:
        """Close a pipe that was opened here; standard input stays open."""
        if self._owned:
            self._stream.close()


class _BrokenOff:
    """A stream behind whose end it is said why there is no more."""

    def __init__(self, stream: Stream, why: DamagedInputError) -> None:
        self._stream, self._why = stream, why

    def read(self, size: int, /) -> bytes:
        """Return up to ``size`` bytes.

        Raises:
            DamagedInputError: there are no more.
        """
        if data := self._stream.read(size):
            return data
        raise self._why


class Spooled(File):
    """An input that is no file, written to a temporary one; it is waited for to its end.

    Of what is packed and breaks off there is what came before; that it did is said behind that.

    Raises:
        InputError: there is no room for it.
    """

    def __init__(self, origin: Origin) -> None:
        import tempfile  # with all that packs and unpacks files: few inputs need it

        self._damage: DamagedInputError | None = None
        self._file = tempfile.NamedTemporaryFile(prefix="sniffer-", suffix=".mcap")  # noqa: SIM115
        try:
            with origin.open() as stream, self._noting_damage():
                while data := stream.read(SPOOLED_AT_ONCE):
                    self._file.write(data)
            self._file.flush()
        except OSError as error:
            self._file.close()
            folder = tempfile.gettempdir()
            why = f"{origin.name}: cannot be kept in {folder} ({error.strerror})"
            raise InputError(f"{why}: save it and give its name") from None
        except BaseException:
            self._file.close()
            raise
        super().__init__(Path(self._file.name))
        self.name = origin.name
        weakref.finalize(self, self._file.close)  # who only looks at it does not close it

    @contextlib.contextmanager
    def _noting_damage(self) -> Iterator[None]:
        try:
            yield
        except DamagedInputError as error:
            self._damage = error

    @contextlib.contextmanager
    def open(self) -> Iterator[Stream]:
        """Return it from its first byte on."""
        with super().open() as stream:
            yield stream if self._damage is None else _BrokenOff(stream, self._damage)

    def close(self) -> None:
        """Remove the temporary file."""
        self._file.close()


class _Pipe:
    """Bytes of a pipe as they come: a read takes what is there and waits only for the first."""

    def __init__(self, stream: BinaryIO) -> None:
        self._stream = stream
        self._take = getattr(stream, "read1", stream.read)

    def read(self, size: int, /) -> bytes:
        """Return up to ``size`` bytes, none at the end."""
        return bytes(self._take(size) or b"")

    def comes(self) -> bool:
        """Tell whether more comes soon, or the end."""
        return _more(self._stream, SILENT_S)


def _more(stream: BinaryIO, seconds: float) -> bool:
    """Tell whether more comes in that time, or the end; where that cannot be told, it does."""
    try:
        return bool(select.select([stream.fileno()], [], [], seconds)[0])
    except (OSError, ValueError):  # no file at all, or a system that selects sockets only
        return True


def find(path: str | Path | bytes | bytearray | memoryview) -> Origin:
    """Return where the bytes of ``path`` come from; InputError says why they cannot be had.

    ``"-"`` is standard input; bytes are a file's content themselves.
    """
    if isinstance(path, bytes | bytearray | memoryview):
        return File(None, bytes(path))
    if not isinstance(path, str | os.PathLike):
        raise InputError(f"a path or the bytes of a file are needed, not {type(path).__name__}")
    if str(path) == STDIN:
        if sys.stdin is None or sys.stdin.closed:
            raise InputError("standard input is closed: give a file name")
        return Pipe(sys.stdin.buffer, "standard input", owned=False)
    path = Path(path)
    with _explained(path):
        status = path.stat()
        mode = status.st_mode
        if stat.S_ISDIR(mode):
            raise InputError(f"{_shown(path)} is a directory: give the file in it")
        if is_port(path, status):
            raise InputError(
                f"{_shown(path)} is a port: `sniffer record {_shown(path)}` listens to it"
            )
        if stat.S_ISREG(mode):
            return File(path)
        return Pipe(path.open("rb", buffering=0), _shown(path), owned=True)


def _shown(path: Path) -> str:
    """Return the path so that it fits in a message of one line."""
    text = str(path)
    text = text if len(text) <= SHOWN else f"{text[: SHOWN // 2]}…{text[-SHOWN // 2 :]}"
    return text if text.isprintable() else ascii(text)


def _not_here(path: Path) -> str:
    """Return what is said of a path at which there is nothing: it may be an address."""
    shown = _shown(path)
    if (scheme := re.match(r"(\w{2,}):/", shown)) is None:
        return f"{shown}: there is no such file"
    address = shown.replace(":/", "://", 1)  # of two strokes a path keeps one
    if scheme[1].lower() in ("socket", "rfc2217"):
        return f"{address} is a port: `sniffer record {address}` listens to it"
    return f"{address} is no file of this machine: fetch it first"


@contextlib.contextmanager
def _explained(path: Path) -> Iterator[None]:
    """Turn what the system says about ``path`` into an InputError."""
    try:
        yield
    except FileNotFoundError:
        raise InputError(_not_here(path)) from None
    except PermissionError:
        raise InputError(f"{_shown(path)}: no permission to read it") from None
    except (OSError, ValueError) as error:
        why = error.strerror if isinstance(error, OSError) else error
        raise InputError(f"{_shown(path)}: cannot be read ({why})") from None
