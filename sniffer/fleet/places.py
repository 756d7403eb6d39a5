"""Where files of this machine are: each has one name, however it was given."""

from __future__ import annotations

import os
import urllib.parse
import urllib.request
from pathlib import Path

FILE = "file://"
"""What a URI of this machine begins with."""


def is_remote(given: str) -> bool:
    """Tell whether a name is one of an object store."""
    return "://" in given and not given.startswith(FILE)


def place_of(given: str | Path) -> str:
    """Return the whole path of a file or folder of this machine, without ``.`` and ``..``.

    What a capture is called tells it from others, so ``in``, ``./in`` and ``../here/in`` are one.
    Links stay in it as they were named: a folder that is a link may lead to another disk tomorrow.
    Only ``..`` behind a link is where the link leads, as it is for the system.

    >>> place_of("/captures/r07/../r08/./a.log")
    '/captures/r08/a.log'
    >>> place_of("file:///captures/a%20b.log")
    '/captures/a b.log'
    """
    told = str(given)
    if told.startswith(FILE):
        told = urllib.request.url2pathname(urllib.parse.urlsplit(told).path)
    path = Path(told).absolute()
    if ".." in path.parts:
        whole = Path(path.anchor)
        for part in path.parts[1:]:
            if part != "..":
                whole /= part
            else:
                whole = (whole.resolve() if whole.is_symlink() else whole).parent
        path = whole
    name = path.as_posix()
    return name[1:] if name.startswith("//") and os.name == "posix" else name


class Grounds:
    """The folder of a data set, and whether others lie in it, by whatever links they are named."""

    def __init__(self, root: str) -> None:
        self._root = os.path.realpath(root)
        self._known: dict[str, bool] = {}

    def is_at(self, path: str) -> bool:
        """Tell whether a path is the folder itself."""
        return os.path.realpath(path) == self._root

    def have(self, folder: str) -> bool:
        """Tell whether a folder is this one, or lies in it."""
        known = self._known.get(folder)
        if known is None:
            within = Path(os.path.realpath(folder)).is_relative_to(self._root)
            known = self._known[folder] = within
        return known

    def seen_from(self, folder: str) -> str | None:
        """Return what the folder is called for who walks another one, None if he does not come."""
        real = os.path.realpath(folder)
        if not Path(self._root).is_relative_to(real):
            return None
        return (Path(folder) / Path(self._root).relative_to(real)).as_posix()
