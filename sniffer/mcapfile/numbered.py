"""The files of one recording, ``run-0001.mcap`` and on: which are its own, and which are kept."""

from __future__ import annotations

import contextlib
import re
from typing import TYPE_CHECKING

from sniffer.ground.files import is_lost, numbered, writing
from sniffer.ground.model import OutputError

if TYPE_CHECKING:
    from pathlib import Path


class NumberedFiles:
    """Files that were begun, in order; ``keep`` is how many of them stay, None: all.

    A file is known by its place on the disk: what somebody puts under its name is not deleted.
    """

    def __init__(self, base: Path, keep: int | None = None) -> None:
        self._base = base
        self._keep = keep
        self._begun: list[tuple[Path, tuple[int, int]]] = []
        self._deleted: list[Path] = []

    def __len__(self) -> int:
        return len(self._begun)

    @property
    def kept(self) -> tuple[Path, ...]:
        """The files that are there, the latest last."""
        return tuple(path for path, _ in self._begun if path not in self._deleted)

    @property
    def deleted(self) -> tuple[Path, ...]:
        """The files that somebody has deleted while they were written."""
        return tuple(self._deleted)

    @property
    def latest(self) -> Path | None:
        """The file that was begun last."""
        return self._begun[-1][0] if self._begun else None

    @property
    def is_lost(self) -> bool:
        """Tell whether the latest file is no more under its name."""
        return bool(self._begun) and is_lost(*self._begun[-1])

    def of(self, number: int) -> Path:
        """Return the path with a number."""
        return numbered(self._base, number)

    def free(self, number: int) -> int:
        """Return the first number from ``number`` on under which nothing is there."""
        while self.of(number).exists():
            number += 1
        return number

    def refuse_others(self) -> None:
        """Refuse to mix with the files of another recording.

        Raises:
            OutputError: some are there, or the folder cannot be read.
        """
        stem, suffix = re.escape(self._base.stem), re.escape(self._base.suffix)
        name = re.compile(rf"{stem}-\d{{4,}}{suffix}")
        with writing(self._base):
            there = sorted(p for p in self._base.parent.iterdir() if name.fullmatch(p.name))
        if there:
            raise OutputError(f"{there[0]} is there already: choose another name")

    def began(self, path: Path) -> None:
        """Learn of a file that is there now."""
        status = path.stat()
        self._begun.append((path, (status.st_dev, status.st_ino)))

    def lost(self, path: Path) -> bool:
        """Learn that somebody deleted a file; tell whether that is news."""
        is_news = path not in self._deleted
        if is_news:
            self._deleted.append(path)
        return is_news

    def drop_oldest(self) -> None:
        """Delete files beyond those to keep, but not the latest; what cannot be deleted stays."""
        while self._keep is not None and len(self._begun) > max(1, self._keep):
            path, identity = self._begun.pop(0)
            with contextlib.suppress(OSError):
                if not is_lost(path, identity):
                    path.unlink()
