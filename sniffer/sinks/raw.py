"""The bytes themselves as files, as ``sources`` read them: log lines, plain hex, raw bytes.

They take chunks as they were read, all buses in their order; nothing has to be decoded for them.
What such a file has no room for is counted, and said when it is done.
"""

from __future__ import annotations

import re
from typing import TYPE_CHECKING, Final, Protocol

from sniffer.ground.coarse import FINE
from sniffer.ground.files import open_binary, writing
from sniffer.ground.model import NS, Chunk, Clock, Direction, MarkKind, OutputError
from sniffer.ground.wording import Sentence, and_, counted

if TYPE_CHECKING:
    from collections.abc import Callable, Iterable, Mapping
    from pathlib import Path

LINE_BYTES: Final = 1 << 18
"""Payload of a log line at most, in bytes: readers of dumps take lines of up to 1 MiB."""

ROW: Final = 16
"""Bytes in a line of plain hex, as ``xxd`` and ``hexdump`` have them."""

_UNFIT: Final = re.compile(r"[\s#()]")
_HEXLIKE: Final = re.compile(r"[0-9A-Fa-f]+")
_LABELS: Final = {Direction.TX: "TX", Direction.RX: "RX", Direction.UNKNOWN: ""}

_NANO: Final = 9
"""Decimal places of a time that is known to the nanosecond."""

_PLACES: Final = {NS // 10**places: places for places in range(FINE)}


def _places(chunk: Chunk) -> int:
    """Return to how many decimal places a chunk's time is known, as far as digits can say it."""
    for mark in chunk.marks:
        if mark.kind == MarkKind.COARSE and chunk.t_ns is not None and not chunk.t_ns % mark.count:
            return _PLACES.get(mark.count, _NANO)
    return _NANO


def _besides(chunk: Chunk, *, is_coarse_said: bool) -> int:
    """Return how many marks are left out: how coarse a time is may be said by its digits.

    That a capture ends there the end of the file says, too.
    """
    said = {MarkKind.ENDED, MarkKind.COARSE} if is_coarse_said else {MarkKind.ENDED}
    return sum(mark.kind not in said for mark in chunk.marks)


class RawFile(Protocol):
    """A file of bytes."""

    def take(self, chunks: Iterable[Chunk]) -> None:
        """Write chunks, those of several buses in the order of the call."""
        ...

    def close(self) -> None:
        """Finish the file."""
        ...

    def lost(self) -> str:
        """Return in a sentence what it has no room for; empty: nothing."""
        ...


class _Left:
    """What a form of file has no room for, counted."""

    def __init__(self, path: Path, form: str) -> None:
        self._head = f"{path}: {form}"
        self._what: dict[str, int] = {}

    def count(self, what: str, n: int = 1) -> None:
        """Count what is left out, or just say it where ``n`` is 0."""
        self._what[what] = self._what.get(what, 0) + n

    def told(self) -> str:
        """Return it in a sentence."""
        words = [counted(n, what) if n else what for what, n in self._what.items()]
        return f"{self._head} have no room for {and_(words)}" if words else ""


class LogFile:
    """Lines as ``candump -L`` writes them: ``(1732142106.123456789) bus0 RX#FAAF``.

    Read back they are the same chunks: times to the nanosecond, buses, wires, bytes. A time that is
    known to few decimal places is written with these.
    """

    def __init__(self, path: Path) -> None:
        self._path = path
        self._file = open_binary(path)
        self._names: dict[str, str] = {}
        self._left = _Left(path, "log lines")

    def take(self, chunks: Iterable[Chunk]) -> None:
        """Write a line for each chunk that has bytes.

        Raises:
            OutputError: a time is before 1970, or the file cannot be written.
        """
        lines: list[str] = []
        for chunk in chunks:
            if chunk.marks and (lost := _besides(chunk, is_coarse_said=_places(chunk) < _NANO)):
                self._left.count("tap mark", lost)
            if chunk.clock in (Clock.READ, Clock.SAMPLE):
                self._left.count("who stamped the times (they are read as a log's)", 0)
            lines += (
                self._line(chunk, chunk.data[at : at + LINE_BYTES])
                for at in range(0, len(chunk.data), LINE_BYTES)
            )
        with writing(self._path):
            self._file.write("".join(lines).encode())

    def _line(self, chunk: Chunk, data: bytes) -> str:
        t_ns = None if chunk.clock == Clock.NONE else chunk.t_ns
        time = ""
        if t_ns is not None:
            if t_ns < 0:
                told = "{file}: log lines have no times before 1970: say {anonymise:True}"
                raise OutputError(Sentence(told, file=self._path))
            places = _places(chunk) if chunk.marks else _NANO
            fraction = f".{t_ns % NS:09}"[: places + 1] if places else ""
            time = f"({t_ns // NS}{fraction}) "
        name = self._name(chunk.bus, timed=bool(time))
        return f"{time}{name} {_LABELS[chunk.direction]}#{data.hex().upper()}\n"

    def _name(self, bus: str, *, timed: bool) -> str:
        """Return a bus's name as a line can have it: no two buses get one name."""
        if bus not in self._names:
            name = _UNFIT.sub("_", bus) or "_"
            if not timed and _HEXLIKE.fullmatch(name):
                name = f"bus_{name}"  # else the line would begin like a list of bytes
            while name in self._names.values():
                name += "_"
            if name != bus:
                self._left.count(f"the name {bus[:40]!r} (there it is {name[:40]})", 0)
            self._names[bus] = name
        return self._names[bus]

    def close(self) -> None:
        """Finish the file."""
        with writing(self._path):
            self._file.close()

    def lost(self) -> str:
        """Return in a sentence what was left out."""
        return self._left.told()


class _Bytes:
    """One bus as bytes, without their times."""

    def __init__(self, path: Path, form: str) -> None:
        self._path = path
        self._file = open_binary(path)
        self._bus: str | None = None
        self._left = _Left(path, form)

    def take(self, chunks: Iterable[Chunk]) -> None:
        """Write the bytes.

        Raises:
            OutputError: there are several buses, or the file cannot be written.
        """
        parts = []
        for chunk in chunks:
            if chunk.marks and (lost := _besides(chunk, is_coarse_said=True)):
                self._left.count("tap mark", lost)
            if not chunk.data:
                continue
            if self._bus is None:
                self._bus = chunk.bus
            elif self._bus != chunk.bus:
                raise OutputError(
                    f"{self._path}: there are several buses ({self._bus}, {chunk.bus}), and it "
                    "holds the bytes of one: a .log holds them all"
                )
            if chunk.t_ns is not None and chunk.clock != Clock.NONE:
                self._left.count("times", 0)
            if chunk.direction != Direction.UNKNOWN:
                self._left.count("which wire it was", 0)
            parts.append(chunk.data)
        with writing(self._path):
            self._file.write(self._form(b"".join(parts)))

    def _form(self, data: bytes) -> bytes:
        return data

    def _end(self) -> bytes:
        return b""

    def close(self) -> None:
        """Finish the file."""
        with writing(self._path), self._file:
            self._file.write(self._end())

    def lost(self) -> str:
        """Return in a sentence what was left out."""
        return self._left.told()


class BinFile(_Bytes):
    """Raw bytes, as on the wire."""

    def __init__(self, path: Path) -> None:
        super().__init__(path, "raw bytes")


class HexFile(_Bytes):
    """Plain hex, 16 bytes a line."""

    def __init__(self, path: Path) -> None:
        super().__init__(path, "bytes in hex")
        self._rest = b""

    def _form(self, data: bytes) -> bytes:
        data = self._rest + data
        whole = len(data) - len(data) % ROW
        self._rest = data[whole:]
        rows = (data[at : at + ROW].hex(" ").upper() for at in range(0, whole, ROW))
        return "".join(f"{row}\n" for row in rows).encode()

    def _end(self) -> bytes:
        return f"{self._rest.hex(' ').upper()}\n".encode() if self._rest else b""


RAW_FILES: Final[Mapping[str, Callable[[Path], RawFile]]] = {
    ".log": LogFile,
    ".bin": BinFile,
    ".hex": HexFile,
}
"""Makers of files of bytes, by suffix."""
