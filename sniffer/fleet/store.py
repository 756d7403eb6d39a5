"""Where a data set lies: a folder or an object store, in which files appear whole or not at all.

Written is first beside, into a folder of this process: on a disk a finished file is renamed to its
place, which is one step for whoever looks; to an object store it is sent with one PUT. What a
killed process leaves beside is swept away by the next run.
"""

from __future__ import annotations

import contextlib
import errno
import os
import platform
import shutil
import tempfile
import time
from pathlib import Path
from typing import TYPE_CHECKING, Any, Final, NamedTuple

import pyarrow as pa
import pyarrow.fs as pafs

from sniffer.fleet.objects import ObjectPlace, find_objects, send_object
from sniffer.fleet.places import is_remote, place_of
from sniffer.ground.model import InputError
from sniffer.ground.processes import is_gone

if TYPE_CHECKING:
    from collections.abc import Iterator

STAGING: Final = "_staging"
"""The folder of what is not finished, beside the tables."""

SWEPT_MOST: Final = 100
"""So often at most other runs sweep a folder away before it is used: then it cannot be made."""

STALE_S: Final = 86_400
"""What another machine left unfinished is swept away after this time, in seconds: decoding one
capture takes minutes."""

SENT_AT_ONCE: Final = 1 << 20
"""Bytes of a file that are handed to an object store at once."""


class StoredFile(NamedTuple):
    """A file of a store: its path below the root, its size in bytes, when it was changed."""

    path: str
    size: int
    mtime_ns: int


class Store:
    """Files below one root, ``uri``: a folder, or ``s3://bucket/folder`` and the like."""

    def __init__(self, uri: str, place: ObjectPlace) -> None:
        self.uri = uri
        self.root = place.path
        self._place = place
        self._system = place.system
        self.is_local = isinstance(place.system, pafs.LocalFileSystem)

    @classmethod
    def of(cls, uri: str | Path) -> Store:
        """Return the store of a folder or of a URI; nothing is looked at yet.

        Raises:
            InputError: nobody knows such a URI.
        """
        told = str(uri)
        if not is_remote(told):
            return cls(told, ObjectPlace(pafs.LocalFileSystem(), place_of(told), 0))
        told = told.rstrip("/")
        try:
            place = find_objects(told)
        except (pa.ArrowInvalid, pa.ArrowNotImplementedError, OSError) as error:
            # no such URI; a file system that this build of arrow lacks; a bucket that is not found
            raise InputError(f"{told}: no place for files ({error})") from None
        return cls(told, place)

    def _at(self, path: str) -> str:
        return f"{self.root}/{path}" if path else self.root

    def put(self, path: str, file: Path) -> None:
        """Let a finished file of this machine appear at ``path``; on a disk it moves there.

        Raises:
            OSError: it cannot be; nothing is there then, or what was.
        """
        if self.is_local:
            target = Path(self.root, path)
            try:
                file.replace(target)
            except FileNotFoundError:  # the first one of its folder
                target.parent.mkdir(parents=True, exist_ok=True)
                file.replace(target)
            return
        send_object(self._place._replace(path=self._at(path)), file)

    def put_bytes(self, path: str, data: bytes, folder: Path | None = None) -> None:
        """Let a small file appear at ``path``; ``folder`` is what ``staging`` gave, None: not yet.

        Raises:
            OSError: as ``put``.
        """
        if folder is None:
            with self.staging() as own:
                self.put_bytes(path, data, own)
            return
        file = folder / "bytes"
        file.write_bytes(data)
        self.put(path, file)

    def exists(self, path: str) -> bool:
        """Tell whether there is a file at ``path``."""
        return bool(self._system.get_file_info(self._at(path)).type == pafs.FileType.File)

    def itself(self) -> StoredFile | None:
        """Return the file that the root is, None where it is none."""
        told = self._system.get_file_info(self.root)
        if told.type != pafs.FileType.File:
            return None
        return StoredFile("", told.size, told.mtime_ns or 0)

    def files(self, folder: str = "", *, deep: bool = False) -> list[StoredFile]:
        """Return the files of a folder, ``deep``: of those in it, too; none where it is not there.

        Raises:
            OSError: it cannot be looked into.
        """
        chosen = pafs.FileSelector(self._at(folder), recursive=deep, allow_not_found=True)
        found = (i for i in self._system.get_file_info(chosen) if i.type == pafs.FileType.File)
        cut = len(self.root) + 1
        return sorted(StoredFile(i.path[cut:], i.size, i.mtime_ns or 0) for i in found)

    def names(self, folder: str) -> list[str]:
        """Return the names of the files of a folder; none: it is not there.

        Raises:
            OSError: it cannot be looked into.
        """
        if not self.is_local:
            return [file.path.rpartition("/")[2] for file in self.files(folder)]
        try:
            with os.scandir(Path(self.root, folder)) as entries:  # asks nothing of each file
                return sorted(entry.name for entry in entries)
        except FileNotFoundError:
            return []

    def get_bytes(self, path: str) -> bytes:
        """Return what a file holds.

        Raises:
            OSError: it cannot be read.
        """
        with self._system.open_input_file(self._at(path)) as file:
            return bytes(file.read())

    def get_text(self, path: str) -> str:
        """Return what a file of text holds, UTF-8.

        Raises:
            OSError: it cannot be read.
        """
        return self.get_bytes(path).decode("utf-8")

    def open(self, path: str) -> Any:
        """Return a file of arrow that can be read here and there.

        Raises:
            OSError: it cannot be read.
        """
        return self._system.open_input_file(self._at(path))

    def fetch(self, path: str, folder: Path) -> Path:
        """Return a file of this machine with what is at ``path``, at the root where that is empty.

        It is a copy in ``folder`` unless it is here anyhow.

        Raises:
            OSError: it cannot be read.
        """
        if self.is_local:
            return Path(self.root, path)
        at = self._at(path)
        copy = folder / at.rpartition("/")[2]
        with self._system.open_input_stream(at) as source, copy.open("wb") as out:
            shutil.copyfileobj(source, out, SENT_AT_ONCE)
        return copy

    def delete(self, path: str) -> None:
        """Remove a file; where it is gone already, nothing is done."""
        with contextlib.suppress(FileNotFoundError):
            self._system.delete_file(self._at(path))

    @contextlib.contextmanager
    def staging(self) -> Iterator[Path]:
        """Give a folder of this process for what is to be put; it is gone afterwards.

        It lies on the disk of the store, where that has one.
        """
        at = self._own_folder()
        try:
            yield at
        finally:
            shutil.rmtree(at, ignore_errors=True)

    def empty(self, folder: Path) -> None:
        """Remove what is in a folder that ``staging`` gave: it can be used again."""
        for entry in list(os.scandir(folder)):
            if entry.is_dir(follow_symlinks=False):
                shutil.rmtree(entry.path, ignore_errors=True)
            else:
                Path(entry.path).unlink(missing_ok=True)

    def _own_folder(self) -> Path:
        name = f"{platform.node()}-{os.getpid()}-"
        if not self.is_local:
            return Path(tempfile.mkdtemp(prefix=name))
        parent, tries = Path(self.root, STAGING), 0
        while True:
            tries += 1
            try:
                parent.mkdir(parents=True, exist_ok=True)
                return Path(tempfile.mkdtemp(prefix=name, dir=parent))
            except (FileExistsError, FileNotFoundError):
                # Another run swept it away while it was empty: right before it was used, or between
                # two looks of mkdir, which finds it there and then no folder.
                if tries == SWEPT_MOST:
                    raise

    def probe(self) -> None:
        """Learn whether a disk may be written to, or a bucket is there.

        Whether it takes objects the first PUT tells.

        Raises:
            OSError: it may not, or is not there.
        """
        if self.is_local:
            with self.staging():
                return
        bucket = self.root.partition("/")[0]
        told = None
        with contextlib.suppress(OSError):  # not all who may write may ask
            told = self._system.get_file_info(bucket).type
        if told == pafs.FileType.NotFound:
            raise FileNotFoundError(errno.ENOENT, f"there is no bucket {bucket}")

    def sweep(self) -> None:
        """Remove what processes that are gone have left unfinished."""
        if not self.is_local:
            return
        parent = Path(self.root, STAGING)
        with contextlib.suppress(FileNotFoundError):
            for folder in list(parent.iterdir()):
                if _is_left(folder):
                    shutil.rmtree(folder, ignore_errors=True)
        with contextlib.suppress(OSError):  # another run has something in it
            parent.rmdir()


def _is_left(folder: Path) -> bool:
    """Tell whether nobody works in a folder any more: its process is gone, or it is old."""
    node, _, rest = folder.name.rpartition("-")[0].rpartition("-")
    if node == platform.node() and rest.isdecimal() and os.name == "posix":
        return is_gone(int(rest))
    with contextlib.suppress(OSError):
        return time.time() - folder.stat().st_mtime > STALE_S
    return False
