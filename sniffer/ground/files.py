"""Files: how they are read, and what the system refuses when one is written, in one clear line."""

from __future__ import annotations

import contextlib
import stat
from pathlib import Path
from typing import TYPE_CHECKING, BinaryIO, Final, Protocol, TextIO

from sniffer.ground.model import OutputError
from sniffer.ground.wording import Sentence

if TYPE_CHECKING:
    from collections.abc import Iterable, Iterator, Sequence

STDIN: Final = "-"
"""What is given in place of a file for what comes on standard input."""

TABLES: Final = frozenset({".csv", ".parquet"})
"""Suffixes of outputs that are two files."""


class Stream(Protocol):
    """The one method a reader needs of a binary file."""

    def read(self, size: int, /) -> bytes:
        """Return up to ``size`` bytes, none at the end."""


@contextlib.contextmanager
def writing(path: Path) -> Iterator[None]:
    """Turn the system's refusals while ``path`` is written into OutputError."""
    try:
        yield
    except FileNotFoundError as error:
        why = f"there is no folder {path.parent}: make it first"
        if path.parent.is_dir():  # a link that leads nowhere, a system's folder that takes no files
            why = f"cannot be written ({error.strerror})"
        raise OutputError(f"{path}: {why}") from None
    except IsADirectoryError:
        raise OutputError(f"{path} is a directory: give a file name") from None
    except PermissionError:
        raise OutputError(f"{path}: no permission to write it") from None
    except OSError as error:
        raise OutputError(f"{path}: cannot be written ({error.strerror or error})") from None


def beside(path: Path) -> Path:
    """Return the second file of a table: ``x.csv`` holds samples, ``x.frames.csv`` frames."""
    return path.with_suffix(f".frames{path.suffix}")


def files_of(path: Path, *, wide: bool = False) -> tuple[Path, ...]:
    """Return all files that an output writes; a ``wide`` table is one."""
    return (path, beside(path)) if path.suffix.lower() in TABLES and not wide else (path,)


def paths_of(outputs: str | Path | Sequence[str | Path]) -> list[Path]:
    """Return the files that are written, of one name or of several."""
    return [Path(outputs)] if isinstance(outputs, str | Path) else [*map(Path, outputs)]


def occupied(path: Path) -> bool:
    """Tell whether a file is there that holds something; a device or a pipe holds nothing."""
    try:
        status = path.stat()
    except OSError:  # whoever opens it tells why
        return False
    return stat.S_ISREG(status.st_mode) and status.st_size > 0


def refuse_occupied(files: Iterable[Path]) -> None:
    """Let nothing be replaced that somebody may want to keep.

    Raises:
        OutputError: one of the files is there and holds something.
    """
    for file in files:
        if occupied(file):
            told = "{file} is there already: choose another name, or {overwrite:True}"
            raise OutputError(Sentence(told, file=file))


def probe(path: Path) -> None:
    """Learn whether a file that is there may be written, before anything is emptied.

    Raises:
        OutputError: it may not.
    """
    if path.is_file():
        with writing(path):
            path.open("r+b").close()


def is_lost(path: Path, identity: tuple[int, int] | None = None) -> bool:
    """Tell whether a file that was being written is no more under its name."""
    try:
        status = path.stat()
    except OSError:
        return True
    return identity is not None and identity != (status.st_dev, status.st_ino)


def called(path: Path, apart: str) -> Path:
    """Return the name of one of several files: what tells it apart stands before the suffix."""
    return path.with_name(f"{path.stem}-{apart}{path.suffix}")


def numbered(path: Path, number: int) -> Path:
    """Return the name of a file of a row of them: ``run-0001.mcap``."""
    return called(path, f"{number:04d}")


def open_text(path: Path) -> TextIO:
    """Open a text file for writing, UTF-8."""
    with writing(path):
        return path.open("w", encoding="utf-8", newline="\n", buffering=1 << 18)


def open_binary(path: Path) -> BinaryIO:
    """Open a binary file for writing."""
    with writing(path):
        return path.open("wb", buffering=1 << 20)
