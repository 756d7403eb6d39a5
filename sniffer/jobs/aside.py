"""What stood where an output is written: kept until there is something in its place."""

from __future__ import annotations

import contextlib
import os
import shutil
from typing import TYPE_CHECKING, Self

from sniffer.decoding.detect import UndecidedError
from sniffer.ground.files import occupied
from sniffer.ground.model import InputError, OutputError

if TYPE_CHECKING:
    from collections.abc import Iterable
    from pathlib import Path
    from types import TracebackType


class Aside:
    """Holds files that are replaced; they are back where an input was refused, and gone else.

    So they are where the one output could not be written to its end. What was decoded of one bus is
    not given up for them where another one's protocol is unknown.
    """

    def __init__(self) -> None:
        self._held: list[tuple[Path, Path]] = []
        self._new: list[Path] = []
        self._count = 0

    def take(self, files: Iterable[Path]) -> None:
        """Move the files that hold something out of the way; a link leads to where it did.

        Where a folder lets none be moved, one is written over as it stands.
        """
        files = [*files]
        self._count += len(files)
        self._new += [file for file in files if not file.exists()]
        for file in filter(occupied, files):
            path = file.resolve()
            held = path.with_name(f".{path.name[:200]}.{os.getpid()}.old")
            with contextlib.suppress(OSError):
                path.rename(held)
                self._held.append((path, held))

    def restore(self) -> None:
        """Put all back, over what was begun in their place; what was begun with it is no more."""
        for path, held in self._held:
            held.replace(path)
        for path in self._new if self._held else ():
            path.unlink(missing_ok=True)
        self._held.clear()

    def __enter__(self) -> Self:
        return self

    def __exit__(
        self,
        kind: type[BaseException] | None,
        error: BaseException | None,
        trace: TracebackType | None,
    ) -> None:
        is_refused = isinstance(error, InputError) and not _is_in_part(error)
        # of several, who knows which; the others are whole
        if is_refused or (isinstance(error, OutputError) and self._count == 1):
            self.restore()
        for path, held in self._held:
            with contextlib.suppress(OSError):
                shutil.copymode(held, path)
            held.unlink(missing_ok=True)


def _is_in_part(error: InputError) -> bool:
    return isinstance(error, UndecidedError) and error.others
