"""A recording that somebody names: opened, or refused in a sentence."""

from __future__ import annotations

from typing import TYPE_CHECKING

from sniffer.ground.files import STDIN
from sniffer.ground.model import InputError

if TYPE_CHECKING:
    from io import BufferedReader
    from pathlib import Path


def open_recording(path: Path) -> BufferedReader:
    """Open a file to read it; whether it is a recording is for the caller to find out.

    Raises:
        InputError: it is no file, is not there, or cannot be read.
    """
    refuse_no_file(path)
    try:
        return path.open("rb")
    except FileNotFoundError:
        raise InputError(f"{path}: there is no such file") from None
    except OSError as error:
        raise unreadable(path, error) from None


def refuse_no_file(path: Path) -> None:
    """Raise an InputError where standard input or a directory is given."""
    if str(path) == STDIN:
        raise InputError("this needs a file: save standard input first")
    if path.is_dir():
        raise InputError(f"{path} is a directory: give the recording in it")


def unreadable(path: Path, error: OSError) -> InputError:
    """Return what is said of a file that cannot be read."""
    return InputError(f"{path}: cannot be read ({error.strerror})")
