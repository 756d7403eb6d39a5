"""Zip archives that hold samples: read piece by piece, whatever they claim of themselves."""

from __future__ import annotations

import struct
import zipfile
import zlib
from typing import TYPE_CHECKING, Final, Self

from sniffer.ground.model import DamagedInputError, InputError

if TYPE_CHECKING:
    from collections.abc import Iterable, Iterator
    from pathlib import Path

PIECE_SIZE: Final = 1 << 20
"""Bytes of samples that are unpacked at once."""

TEXT_MOST: Final = 1 << 20
"""A description of a capture that is larger is none, in bytes."""

LISTED_MOST: Final = 1 << 20
"""Bytes of the list of what is in an archive: some 16 000 entries, each of 4 MiB in sigrok."""

SAME: Final = 1000
"""What packs better than this is all the same (deflate ends at 1032): nobody speaks in it ..."""

SAME_SIZE: Final = 512 << 20
"""... and if it unpacks to more than this, in bytes, it is not looked at for long: half a minute at
16 MHz."""

_END: Final = b"PK\x05\x06"
_END_SIZE: Final = 22
_COMMENT_MOST: Final = 0xFFFF
_BROKEN: Final = (
    zipfile.BadZipFile,  # a list, a header or a checksum that is none
    RuntimeError,  # encrypted; NotImplementedError: of a later version, packed as a patch
    ValueError,  # a name that is no UTF-8, an offset beyond 64 bits
    OSError,  # an entry that begins in front of the file; a disk that fails
    zlib.error,  # what is packed makes no sense
    EOFError,  # the file ends before the entry does
)
"""What Python's zipfile raises for archives that are damaged, or that it cannot read."""


class SampleArchive:
    """An archive of samples.

    Raises:
        DamagedInputError: it is cut off, or not what it says it is.
        InputError: it claims more than can be meant.
    """

    def __init__(self, path: Path, name: str) -> None:
        self._name = name
        self._size = path.stat().st_size
        try:
            with path.open("rb") as file:
                file.seek(max(self._size - _COMMENT_MOST - _END_SIZE, 0))
                tail = file.read()
            at = tail.rfind(_END)
            if at < 0 or len(tail) < at + _END_SIZE:
                raise DamagedInputError(f"{name}: the archive is cut off: its list is missing")
            if struct.unpack_from("<I", tail, at + 12)[0] > LISTED_MOST:
                raise InputError(f"{name}: the archive lists more entries than a capture has")
            self._zip = zipfile.ZipFile(path)
        except _BROKEN as error:
            raise self._damaged(error) from None

    @property
    def names(self) -> list[str]:
        """Names of what is in it."""
        return self._zip.namelist()

    def text(self, entry: str) -> str:
        """Return a small entry as text.

        Raises:
            InputError: it is not there, or not small.
            DamagedInputError: it is damaged.
        """
        try:
            info = self._zip.getinfo(entry)
        except KeyError:
            raise InputError(f"{self._name}: the archive has no {entry}") from None
        if info.file_size > TEXT_MOST:
            raise InputError(f"{self._name}: {entry} of the archive is too large to describe it")
        return b"".join(self.pieces([entry])).decode("utf-8", "replace")

    def expect(self, entries: Iterable[str]) -> None:
        """Look at what these entries claim to unpack to.

        Raises:
            InputError: it is so much, and so much the same, that nobody speaks in it.
        """
        size = sum(self._zip.getinfo(entry).file_size for entry in entries)
        if size > max(SAME_SIZE, SAME * self._size):
            raise InputError(
                f"{self._name}: it unpacks to {size >> 20} MiB, more than {SAME} times its size: "
                "nothing changes in it; export the part of the capture in which something does"
            )

    def pieces(self, entries: Iterable[str], whole: int = 1) -> Iterator[bytes]:
        """Yield what is in these entries, joined, in pieces of whole samples of ``whole`` bytes.

        Raises:
            DamagedInputError: an entry is damaged; what comes before it was yielded.
        """
        held = bytearray()  # entries may be small: they are handed on together
        size = PIECE_SIZE // whole * whole
        for entry in entries:
            try:
                info = self._zip.getinfo(entry)
                if info.compress_type not in (zipfile.ZIP_STORED, zipfile.ZIP_DEFLATED):
                    raise DamagedInputError(f"{self._name}: {entry} is packed in an unusual way")
                with self._zip.open(info) as file:
                    while data := file.read(size - len(held)):
                        held += data
                        if len(held) == size:
                            yield bytes(held)
                            held.clear()
            except (*_BROKEN, KeyError) as error:
                if end := len(held) // whole * whole:
                    yield bytes(held[:end])
                raise self._damaged(error) from None
        if end := len(held) // whole * whole:
            yield bytes(held[:end])

    def __enter__(self) -> Self:
        return self

    def __exit__(self, *_: object) -> None:
        self._zip.close()

    def _damaged(self, error: BaseException) -> DamagedInputError:
        return DamagedInputError(f"{self._name}: the archive is damaged ({error})")
