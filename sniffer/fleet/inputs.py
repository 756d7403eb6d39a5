"""Which captures are meant: files by name, those that a pattern matches, those in a folder."""

from __future__ import annotations

import glob
import os
import posixpath
import re
from dataclasses import dataclass, field
from pathlib import Path
from typing import TYPE_CHECKING, Final, NamedTuple

from sniffer.fleet.places import FILE, Grounds, is_remote, place_of
from sniffer.fleet.store import STAGING, Store
from sniffer.fleet.tables import TABLES
from sniffer.ground.model import InputError
from sniffer.ground.wording import Sentence

if TYPE_CHECKING:
    from collections.abc import Iterable, Iterator

SUFFIXES: Final = frozenset(
    {
        *(".mcap", ".pcap", ".pcapng", ".jsonl", ".log", ".txt", ".hex", ".csv"),
        *(".bin", ".dat", ".raw", ".vcd", ".sr", ".dsl"),
    }
)
"""What captures are called by the programs that write them (docs/formats.md). Other files of a
folder are no captures; what is named, or matched by a pattern, is."""

PACKED: Final = frozenset({".gz", ".gzip", ".zst", ".zstd"})

_PATTERN: Final = re.compile(r"[*?\[]")


class FoundCapture(NamedTuple):
    """A file that is a capture: where it lies, its size in bytes, when it was changed."""

    uri: str
    size: int
    mtime_ns: int


class FoundCaptures(NamedTuple):
    """The captures that are meant, each once, in order, and what is beside them.

    ``left_out`` are files of folders that are not called like captures, ``in_dataset`` are those
    of the data set itself, ``astray`` are links called like captures that lead nowhere: so many.
    ``in_others`` are those of other data sets, whose folders are ``others``.
    ``unread`` has a sentence for each folder within others that cannot be looked into.
    """

    captures: list[FoundCapture]
    left_out: int
    in_dataset: int
    astray: int
    unread: list[str]
    in_others: int = 0
    others: tuple[str, ...] = ()


def find_captures(inputs: Iterable[str | Path], dataset: Store) -> FoundCaptures:
    """Return the captures of files, patterns and folders; what lies in the data set is none.

    Raises:
        InputError: there is no such file, nothing matches a pattern, or only what is in the data
            set does.
        OSError: a folder that is named cannot be looked into.
    """
    inputs = list(inputs)
    found: dict[str, FoundCapture] = {}
    left_out = in_dataset = 0
    itself = ""
    missed = _Missed()
    others = _Others()
    grounds = Grounds(dataset.root)
    for given in map(str, inputs):
        if not given:
            told = "'' names no captures: name files, patterns or folders (`.` is this one)"
            raise InputError(f"{told}; a variable that is empty says nothing")
        if _is_dataset(given, dataset, grounds):  # as a shell's * has it
            itself = given
            continue
        if _is_in(given if is_remote(given) else place_of(given), dataset, grounds):
            raise InputError(Sentence(_WITHIN, given=given, root=dataset.uri))
        is_any = False
        own, unread, in_others = 0, len(missed.unread), others.files
        looked = _remote(given) if is_remote(given) else _local(given, grounds, missed)
        for capture, is_named in looked:
            if _is_in(capture.uri, dataset, grounds):
                own += 1
            elif others.takes(capture.uri):
                continue
            elif is_named or _is_called_so(capture.uri):
                found[capture.uri] = capture
                is_any = True
            else:
                left_out += 1
        in_dataset += own
        if not is_any and len(missed.unread) == unread:
            told = _OTHERS if others.files > in_others else _NONE
            raise InputError(Sentence(_WITHIN if own else told, given=given, root=dataset.uri))
    if itself and not found:
        raise InputError(Sentence(_ITSELF, given=itself))
    captures = [found[uri] for uri in sorted(found) if not others.takes_beside(uri)]
    if found and not captures:
        raise InputError(Sentence(_OTHERS, given=", ".join(map(str, inputs))))
    beside = (left_out, in_dataset, missed.astray, missed.unread)
    return FoundCaptures(captures, *beside, others.files, tuple(sorted(others.roots)))


_PARTS: Final = "|".join(TABLES)

_OF_DATASET: Final = re.compile(
    rf"(.*)/(?:(?:{_PARTS})/robot=[^/]*/date=[^/]*/[0-9a-f]{{16}}-[0-9a-f]{{8}}(?:-[0-9]{{5,}})?\.parquet"
    r"|_done/[0-9a-f]{24}\.json)",
    re.DOTALL,
)
"""Files that only a data set has (``dataset.table_path``, ``dataset.commit_path``), and where."""

_BESIDE: Final = re.compile(rf"/(?:(?:{_PARTS}|_done|{STAGING})/.*|captures\.parquet)", re.DOTALL)
"""What else lies in one; also captures may."""


@dataclass(slots=True)
class _Others:
    """Data sets among the inputs: of what they are made nothing is a capture."""

    files: int = 0
    roots: set[str] = field(default_factory=set)

    def takes(self, uri: str) -> bool:
        """Tell whether a file shows by its path that it is of a data set, and count it."""
        match = _OF_DATASET.fullmatch(uri)
        if match is None:
            return False
        self.files += 1
        self.roots.add(match[1])
        return True

    def takes_beside(self, uri: str) -> bool:
        """Tell whether a file is of a data set that another file has shown, and count it."""
        roots = (root for root in self.roots if uri.startswith(f"{root}/"))
        is_of = any(_BESIDE.fullmatch(uri, len(root)) for root in roots)
        self.files += is_of
        return is_of


@dataclass(slots=True)
class _Missed:
    """What a walk through folders could not get at."""

    astray: int = 0
    unread: list[str] = field(default_factory=list)

    def folder(self, path: str, error: OSError) -> None:
        """Note a folder that cannot be looked into."""
        self.unread.append(f"{path}: cannot be looked into ({error.strerror or error})")


_NONE: Final = "{given}: there are no captures: name files, folders or patterns"

_OTHERS: Final = "{given}: there are no captures, only what a data set is made of"

_ITSELF: Final = "{given}: this is the data set itself: give {dataset} a folder of its own"

_WITHIN: Final = "{given}: this lies in the data set {root}: give {dataset} a folder of its own"


def _is_dataset(given: str, dataset: Store, grounds: Grounds) -> bool:
    if dataset.is_local:
        return not is_remote(given) and grounds.is_at(place_of(given))
    return given.rstrip("/") == dataset.uri


def _is_in(uri: str, dataset: Store, grounds: Grounds) -> bool:
    """Tell whether a file lies in the data set."""
    if dataset.is_local:
        return not is_remote(uri) and grounds.have(posixpath.dirname(uri))
    return uri.startswith(f"{dataset.uri}/")


def _local(given: str, grounds: Grounds, missed: _Missed) -> Iterator[tuple[FoundCapture, bool]]:
    """Yield files of this machine, and whether each was meant by its name or a pattern."""
    path = Path(place_of(given) if given.startswith(FILE) else given)
    if path.is_dir():
        yield from _walked(path, grounds, missed)
    elif path.is_file():
        yield _file(path), True
    elif path.exists():
        raise InputError(f"{given} is no file: a data set is made of captures that stay")
    elif not _PATTERN.search(given):
        raise InputError(f"{given}: there is no such file")
    else:
        for name in glob.glob(str(path), recursive=True):  # noqa: PTH207 - absolute ones, too
            matched = Path(name)
            if matched.is_file():
                yield _file(matched), True
            elif "**" not in given and matched.is_dir() and not grounds.have(place_of(matched)):
                try:  # files in it are matched by ** themselves
                    yield from _walked(matched, grounds, missed)
                except OSError as error:
                    missed.folder(name, error)


def _walked(path: Path, grounds: Grounds, missed: _Missed) -> Iterator[tuple[FoundCapture, bool]]:
    """Yield files of a folder, which nobody has named.

    Raises:
        OSError: it cannot be looked into.
    """
    folder = place_of(path)
    with os.scandir(folder) as entries:
        for capture in _inside(entries, grounds.seen_from(folder), missed):
            yield capture, False


def _inside(
    entries: Iterable[os.DirEntry[str]], dataset: str | None, missed: _Missed
) -> Iterator[FoundCapture]:
    """Yield the files of a folder, and of those in it, that are not hidden, nor in the data set."""
    for entry in entries:
        if entry.name.startswith("."):
            continue
        path = entry.path.replace(os.sep, "/")  # of many files, objects for paths take longest
        try:
            if entry.is_dir(follow_symlinks=False):
                if path != dataset:
                    with os.scandir(path) as deeper:
                        yield from _inside(deeper, dataset, missed)
            elif entry.is_file():
                told = entry.stat()
                yield FoundCapture(path, told.st_size, told.st_mtime_ns)
            elif entry.is_symlink() and not os.path.lexists(os.path.realpath(path)):
                missed.astray += _is_called_so(path)
        except FileNotFoundError:
            continue  # it was there a moment ago
        except OSError as error:
            if entry.is_symlink():  # it leads to itself, or where nobody may look
                missed.astray += _is_called_so(path)
            else:
                missed.folder(path, error)


def _file(path: Path) -> FoundCapture:
    told = path.stat()
    return FoundCapture(place_of(path), told.st_size, told.st_mtime_ns)


def _remote(given: str) -> Iterator[tuple[FoundCapture, bool]]:
    """Yield files of an object store, and whether each was meant by its name or a pattern."""
    fixed = _PATTERN.split(given)[0]
    base = given if fixed == given else fixed.rpartition("/")[0]
    store = Store.of(base)
    if fixed == given and (alone := store.itself()) is not None:
        yield FoundCapture(given, alone.size, alone.mtime_ns), True
        return
    pattern = glob_pattern(given)
    matches = re.compile(pattern)
    lies_in = re.compile(f"{pattern}/.*")  # a folder matches
    for file in store.files(deep=True):
        uri = f"{base.rstrip('/')}/{file.path}"
        is_named = fixed != given and matches.fullmatch(uri) is not None
        if is_named or fixed == given or lies_in.fullmatch(uri):
            yield FoundCapture(uri, file.size, file.mtime_ns), is_named


def glob_pattern(pattern: str) -> str:
    """Return a pattern of names as a regular expression: ``**`` crosses folders, ``*`` does not.

    As ``glob.translate``, which Python has from 3.13 on.

    >>> import re
    >>> re.fullmatch(glob_pattern("s3://a/**/*.log"), "s3://a/b/c/d.log") is not None
    True
    >>> re.fullmatch(glob_pattern("s3://a/*.log"), "s3://a/b/d.log") is not None
    False
    """
    out = []
    for part in re.split(r"(\*\*/|\*\*|\*|\?|\[[^\]]+\])", pattern):
        told = {"**/": "(?:.*/)?", "**": ".*", "*": "[^/]*", "?": "[^/]"}.get(part)
        if told is None:
            told = part if part.startswith("[") and part.endswith("]") else re.escape(part)
        out.append(told)
    return "".join(out)


def _is_called_so(uri: str) -> bool:
    name, suffix = posixpath.splitext(uri.lower())
    return (posixpath.splitext(name)[1] if suffix in PACKED else suffix) in SUFFIXES
