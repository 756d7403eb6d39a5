"""A name that stays the same for a port that has another one each time: a symbolic link."""

from __future__ import annotations

import contextlib
import os
from typing import TYPE_CHECKING

from sniffer.ground.files import writing
from sniffer.ground.model import OutputError

if TYPE_CHECKING:
    from collections.abc import Iterator
    from pathlib import Path


@contextlib.contextmanager
def linked(path: Path | None, target: str) -> Iterator[None]:
    """Let ``path`` lead to ``target`` as long as this lasts; None: nothing is linked.

    A link that leads nowhere, as a simulation that was killed leaves it, is replaced.

    Raises:
        OutputError: something else is there already, or it cannot be made.
    """
    if path is None:
        yield
        return
    _check(path, target)
    made = path.with_name(f".{path.name}.{os.getpid()}")
    with writing(path):
        with contextlib.suppress(FileNotFoundError):
            made.unlink()
        made.symlink_to(target)
        made.replace(path)
    try:
        yield
    finally:
        with contextlib.suppress(OSError):  # gone, or somebody else's by now
            if path.readlink().as_posix() == target:
                path.unlink()


def _check(path: Path, target: str) -> None:
    if path.is_symlink():
        leads = path.resolve()
        if path.exists() and leads.as_posix() != target:
            raise OutputError(f"{path} leads to {leads}, which is there: remove it or name another")
    elif path.exists():
        raise OutputError(f"{path} is there already: remove it or name another")
