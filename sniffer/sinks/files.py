"""Opening output files: what the system refuses becomes one clear OutputError."""

from __future__ import annotations

import contextlib
from typing import TYPE_CHECKING, BinaryIO, Final, TextIO

from sniffer.model import OutputError

if TYPE_CHECKING:
    from collections.abc import Iterator
    from pathlib import Path

TABLES: Final = frozenset({".csv", ".parquet"})
"""Suffixes of outputs that are two files."""


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


def files_of(path: Path) -> tuple[Path, ...]:
    """Return all files that an output writes."""
    return (path, beside(path)) if path.suffix.lower() in TABLES else (path,)


def open_text(path: Path) -> TextIO:
    """Open a text file for writing, UTF-8."""
    with writing(path):
        return path.open("w", encoding="utf-8", newline="\n", buffering=1 << 18)


def open_binary(path: Path) -> BinaryIO:
    """Open a binary file for writing."""
    with writing(path):
        return path.open("wb", buffering=1 << 20)
