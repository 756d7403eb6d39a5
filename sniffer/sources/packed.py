"""gzip and zstd around an input: unpacked as it is read, never as a whole."""

from __future__ import annotations

import contextlib
import zlib
from pathlib import Path
from typing import TYPE_CHECKING, Any, Final, NamedTuple

from sniffer.ground.model import DamagedInputError, InputError
from sniffer.sources.recognise import HEAD
from sniffer.sources.text import pauses

if TYPE_CHECKING:
    from collections.abc import Callable, Iterator

    from sniffer.ground.files import Stream
    from sniffer.sources.opening import Origin

READ: Final = 1 << 16
"""Packed bytes that are read at once."""

SMALL: Final = 1 << 26
"""Up to this size, in bytes, anything may be unpacked."""

RATIO_MOST: Final = 250
"""What is larger, and as many times as large as it was packed, is no capture: text logs of a bus
pack to a tenth or so, the times in them are never the same."""


class _Packing(NamedTuple):
    """A form of packing; ``step`` bytes of it unpack to 16 MiB at most."""

    magic: bytes
    suffixes: tuple[str, ...]
    step: int
    begin: Callable[[], Any]


def _gzip() -> Any:
    return zlib.decompressobj(wbits=31)


def _zstd() -> Any:
    import zstandard

    return zstandard.ZstdDecompressor(max_window_size=1 << 27).decompressobj()


_PACKINGS: Final = (
    _Packing(b"\x1f\x8b\x08", (".gz", ".gzip"), 1 << 14, _gzip),  # 1032 bytes a byte (zlib)
    _Packing(b"\x28\xb5\x2f\xfd", (".zst", ".zstd"), 1 << 9, _zstd),  # 128 KiB a block of 4 bytes
)


class _Unpacked:
    """What is packed in a stream, piece by piece."""

    def __init__(self, packed: Stream, packing: _Packing, name: str, *, is_head: bool) -> None:
        self._packed, self._packing, self._name = packed, packing, name
        self._is_head = is_head
        self._machine = packing.begin()
        self._waiting, self._out = b"", b""
        self._taken = self._given = 0

    @property
    def is_open(self) -> bool:
        """Whether more must follow."""
        return not self._machine.eof

    def read(self, size: int, /) -> bytes:
        """Return up to ``size`` bytes, none at the end.

        Raises:
            DamagedInputError: it is cut off, or not what it says it is.
        """
        while not self._out:
            if not self._waiting:
                self._waiting = self._packed.read(READ)
                if not self._waiting:
                    self._end()
                    return b""
            self._step()
        out, self._out = self._out[:size], self._out[size:]
        return out

    def put_back(self, head: bytes) -> None:
        """Have what was read to look at it be read again, and all that follows, to the end."""
        self._out, self._is_head = head + self._out, False

    def comes(self) -> bool:
        """Tell whether more comes soon, or the end."""
        return bool(self._out or self._waiting) or not pauses(self._packed)

    def _step(self) -> None:
        if self._machine.eof:  # a second member stands behind the first
            self._machine = self._packing.begin()
        step = self._waiting[: self._packing.step]
        self._waiting = self._waiting[len(step) :]
        try:
            self._out = self._machine.decompress(step)
        except Exception as error:  # zlib.error, ZstdError: each library has its own
            raise self._damaged(f"is damaged ({error})") from None
        if self._machine.eof:
            self._waiting = self._machine.unused_data + self._waiting
        self._taken += len(step)
        self._given += len(self._out)
        if self._given > max(SMALL, RATIO_MOST * self._taken):
            raise self._damaged(
                f"unpacks to more than {RATIO_MOST} times its size: no capture does"
            )

    def _end(self) -> None:
        if not self._machine.eof and not self._is_head and self._taken:
            raise self._damaged("is cut off")

    def _damaged(self, why: str) -> DamagedInputError:
        kind = self._packing.suffixes[0].removeprefix(".")
        return DamagedInputError(f"{self._name}: what is packed with {kind} {why}")


class Packed:
    """An input that is packed; it is read as what is in it."""

    def __init__(self, origin: Origin, packing: _Packing) -> None:
        self._origin, self._packing = origin, packing
        self.name, self.live = origin.name, origin.live
        self.path: Path | None = None
        inner = Path(origin.name)
        self.suffix = Path(inner.stem).suffix if inner.suffix in packing.suffixes else ""
        self._kept = contextlib.ExitStack()
        self._begun: _Unpacked | None = None
        head = _Unpacked(_Given(origin.head), packing, self.name, is_head=True)
        self.head = b""
        try:
            self._look(head)
            if not self.head and head.is_open:
                self._look_on()
        except DamagedInputError as error:
            if not self.head:
                self._kept.close()
                raise InputError(str(error)) from None
        if not self.head and head.is_open:
            self._kept.close()
            raise InputError(f"{self.name}: it is packed, and cut off before anything is in it")

    def _look(self, at: Stream) -> None:
        while len(self.head) < HEAD and (more := at.read(HEAD - len(self.head))):
            self.head += more

    def _look_on(self) -> None:
        """Read until anything is in it: zstd gives a block whole, and it may be longer than a head.

        What can be read once is kept as far as it was read.
        """
        if not self.live:
            with self._origin.open() as stream:
                self._look(_Unpacked(stream, self._packing, self.name, is_head=True))
            return
        stream = self._kept.enter_context(self._origin.open())
        self._begun = _Unpacked(stream, self._packing, self.name, is_head=True)
        self.head = self._begun.read(HEAD)
        self._begun.put_back(self.head)

    @contextlib.contextmanager
    def open(self) -> Iterator[Stream]:
        """Return what is in it, from its first byte on."""
        if self._begun is not None:
            with self._kept.pop_all():
                begun, self._begun = self._begun, None
                yield begun
            return
        with self._origin.open() as stream:
            yield _Unpacked(stream, self._packing, self.name, is_head=False)

    def close(self) -> None:
        """Release the input."""
        self._kept.close()
        self._origin.close()


class _Given:
    """Bytes that are there already, as a stream."""

    def __init__(self, data: bytes) -> None:
        self._data = data

    def read(self, size: int, /) -> bytes:
        out, self._data = self._data[:size], self._data[size:]
        return out


def unpacked(origin: Origin) -> Origin:
    """Return an input as it is to be read: unpacked, if it is packed."""
    for packing in _PACKINGS:
        if origin.head.startswith(packing.magic):
            return Packed(origin, packing)
    return origin
