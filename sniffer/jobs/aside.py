"""What stood where an output is written: kept until there is something in its place."""

from __future__ import annotations

import contextlib
import os
import stat
from typing import TYPE_CHECKING, Final

from sniffer.decoding.detect import UndecidedError
from sniffer.ground.files import occupied
from sniffer.ground.model import InputError, OutputError
from sniffer.ground.processes import is_gone

if TYPE_CHECKING:
    from collections.abc import Iterable, Iterator
    from pathlib import Path


OLD: Final = ".old"
"""What the name of a file ends in that was put away."""


class Aside:
    """Files that are about to be replaced, where nobody sees them."""

    def __init__(self) -> None:
        self._held: list[tuple[Path, Path]] = []
        self._new: list[Path] = []
        self.outputs = 0
        """How many files are written."""

    def take(self, files: Iterable[Path]) -> None:
        """Move the files that hold something out of the way; a link leads to where it did.

        Where a folder lets none be moved, one is written over as it stands.
        """
        files = [*files]
        self.outputs += len(files)
        self._new += [file for file in files if not file.exists()]
        for file in filter(occupied, files):
            path = file.resolve()
            held = path.with_name(f"{_hidden(path)}{os.getpid()}{OLD}")
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

    def drop(self) -> None:
        """Delete them: others stand in their place, which whoever might read them may read.

        So are those that runs left which were killed.
        """
        for path, held in self._held:
            with contextlib.suppress(OSError):
                path.chmod(stat.S_IMODE(held.stat().st_mode))
            held.unlink(missing_ok=True)
            with contextlib.suppress(OSError):
                for left in _left(path):
                    left.unlink()


def _hidden(path: Path) -> str:
    return f".{path.name[:200]}."


def _left(path: Path) -> list[Path]:
    """Return what stood in the place of a file, put away by processes that are gone."""
    begin = _hidden(path)
    away = [p for p in path.parent.iterdir() if p.name.startswith(begin) and p.suffix == OLD]
    numbers = {p: p.name[len(begin) : -len(OLD)] for p in away}
    return [p for p, number in numbers.items() if number.isdecimal() and is_gone(int(number))]


@contextlib.contextmanager
def kept_aside() -> Iterator[Aside]:
    """Give what keeps files; they are back where an input is refused, and gone else.

    So they are where the one output cannot be written to its end: of several nobody knows which,
    and the others are whole. What was decoded of one bus is not given up for them where another
    one's protocol is unknown.
    """
    aside = Aside()
    try:
        yield aside
    except UndecidedError as error:
        if not error.others:
            aside.restore()
        raise
    except InputError:
        aside.restore()
        raise
    except OutputError:
        if aside.outputs == 1:
            aside.restore()
        raise
    finally:
        aside.drop()
