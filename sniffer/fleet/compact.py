"""``sniffer.compact_fleet``: the tables of a data set in few large files, a copy for readers.

A file of the copy is named by the files it is made of, whose names are those of bytes and decoder:
so equal names are equal rows, and what is there need not be looked into. The data set stays as it
is, file by file, for a capture can be replaced only where its rows are files of their own.
"""

from __future__ import annotations

import contextlib
import hashlib
import io
import re
import time
from dataclasses import dataclass
from typing import TYPE_CHECKING, Any, Final, NamedTuple

from sniffer.fleet.places import Grounds
from sniffer.fleet.progress import FleetProgress
from sniffer.fleet.rows import UndoneError
from sniffer.ground.model import InputError, OutputError
from sniffer.ground.needs import need_pyarrow
from sniffer.ground.wording import Sentence, counted

if TYPE_CHECKING:
    from collections.abc import Callable, Iterator, Mapping, Sequence
    from pathlib import Path

    from sniffer.fleet.store import Store

LARGE: Final = 512_000_000
"""Bytes of files that one file is made of, at most: larger ones cost readers more than they save,
who take a file or a row group as what one of their threads does."""

LAYOUT: Final = 1
"""The number of how files are put together; another one makes all of them anew."""

NAMED: Final = re.compile(r"[0-9a-f]{16}\.parquet")
"""What a file of a copy is called; nothing of a data set is, nor what others put beside."""

ROUNDS: Final = 5
"""How often it is begun anew because the data set, or the copy, was changed meanwhile."""


@dataclass(frozen=True, slots=True)
class CompactedFleet:
    """What a copy has: so many captures, in ``files`` files made of ``sources``.

    ``written`` of these were made now, from ``bytes`` of the data set; the others were there.
    """

    captures: int
    files: int
    sources: int
    written: int
    bytes: int
    seconds: float


class _Source(NamedTuple):
    """A file of the data set, and where it is in the order of a table: by time."""

    t_first_ns: int
    path: str
    size: int


class _Large(NamedTuple):
    """A file of the copy, and what it is made of."""

    path: str
    sources: tuple[_Source, ...]


def compact_fleet(
    dataset: str | Path,
    into: str | Path,
    *,
    progress: Callable[[FleetProgress], None] = lambda so_far: None,
) -> CompactedFleet:
    """Copy the tables of a data set into few large files, those of a day and robot together.

    What of the copy is as the data set has it is left, without being read; what is not any more is
    replaced. ``captures.parquet`` is written last.

    Args:
        dataset: the folder of the data set, or a URI of an object store.
        into: a folder of its own for the copy, or a URI.
        progress: is told how far it is, in files of the data set.

    Raises:
        InputError: there is no data set.
        OutputError: the copy cannot lie there, or pyarrow is missing.
        UndoneError: it could not be done now: no room, or a run is changing the data set.
    """
    began = time.monotonic()
    need_pyarrow()
    from sniffer.fleet.store import Store

    source, target = Store.of(dataset), Store.of(into)
    _check(source, target)
    work = _Copying(source, target, began, progress)
    work.listed()  # where there is none, nothing is begun
    try:
        target.probe()
        target.sweep()
    except OSError as error:
        told = "{root}: cannot be written ({why}): give {output} a folder that can be"
        raise OutputError(Sentence(told, root=into, why=error.strerror or error)) from None
    try:
        for _ in range(ROUNDS):
            done = work.round()
            if done is not None:
                return done
    finally:
        with contextlib.suppress(OSError):
            target.sweep()
    raise UndoneError(f"{target.uri}: it is changed by another run again and again")


def _check(source: Store, target: Store) -> None:
    from sniffer.fleet.dataset import DONE, hive_folder

    within = target.root == source.root
    if source.is_local and target.is_local:
        within = Grounds(source.root).have(target.root)
    elif not within:
        within = target.root.startswith(f"{source.root}/")
    told = ""
    if within:
        told = "{root} lies in the data set"
    elif target.names(DONE):
        told = "{root} is a data set"
    elif hive_folder(target.root) is not None:
        told = "{root}: readers of tables would take its path for a column"
    if told:
        raise OutputError(Sentence(told + ": give {output} a folder of its own", root=target.uri))


class _Copying:
    """The copying, from one store to another."""

    def __init__(
        self,
        source: Store,
        target: Store,
        began: float,
        progress: Callable[[FleetProgress], None],
    ) -> None:
        self._source = source
        self._target = target
        self._began = began
        self._progress = progress
        self._written = 0
        self._bytes = 0

    def round(self) -> CompactedFleet | None:
        """Bring the copy to what the data set is now; None: one of them was changed meanwhile.

        Raises:
            InputError: there is no data set.
            UndoneError: files that the list of captures names are not there, or one cannot be
                written.
        """
        from sniffer.fleet.dataset import CAPTURES_FILE

        listed = self.listed()
        files = self._planned(listed)
        try:
            if not self._copy(files):
                return None
            data = _as_parquet(_relisted(listed, files))
            self._target.put_bytes(CAPTURES_FILE, data)
            wanted = {file.path for file in files}
            for path in self._there() - wanted:
                self._target.delete(path)
            # another run may have gone by an older list, and taken away what is named now
            if wanted - self._there() or self._target.get_bytes(CAPTURES_FILE) != data:
                return None
        except OSError as error:
            why = error.strerror or error
            raise UndoneError(
                f"{self._target.uri}: cannot be written ({why})", error.errno or 0
            ) from error
        return CompactedFleet(
            captures=len(listed),
            files=len(files),
            sources=sum(len(file.sources) for file in files),
            written=self._written,
            bytes=self._bytes,
            seconds=time.monotonic() - self._began,
        )

    def listed(self) -> Any:
        """Return the list of the captures of the data set.

        Raises:
            InputError: there is none.
        """
        import pyarrow as pa
        import pyarrow.parquet as pq

        from sniffer.fleet.dataset import CAPTURES_FILE

        try:
            with self._source.open(CAPTURES_FILE) as file:
                return pq.read_table(file)
        except FileNotFoundError:
            told = f"{self._source.uri} is no data set: `sniffer fleet` makes one"
            raise InputError(told) from None
        except (OSError, pa.ArrowInvalid) as error:
            raise InputError(f"{self._source.uri}: cannot be read ({error})") from None

    def _planned(self, listed: Any) -> list[_Large]:
        """Return the files that the copy is to have.

        Those of one decoder are together, for they have the same columns. In a day they are in the
        order of their times, so what is added later seldom changes a file that is full.
        """
        from sniffer.fleet.tables import TABLES

        sizes = {f.path: f.size for table in TABLES for f in self._source.files(table, deep=True)}
        told: dict[str, tuple[str, int]] = {}
        columns = ("files", "decoder", "t_first_ns")
        for files, decoder, t_ns in zip(*(listed[c].to_pylist() for c in columns), strict=True):
            for path in files:
                told.setdefault(path, (decoder, t_ns or 0))  # equal captures have one
        if gone := sorted(told.keys() - sizes.keys()):
            raise UndoneError(
                f"{self._source.uri}: {counted(len(gone), 'file')} of captures are not there "
                f"({gone[0]}): a run is replacing them, or was ended there; try again behind one"
            )
        groups: dict[tuple[str, str], list[_Source]] = {}
        for path, (decoder, t_ns) in told.items():
            folder = path.rpartition("/")[0]
            groups.setdefault((folder, decoder), []).append(_Source(t_ns, path, sizes[path]))
        return [
            _Large(f"{folder}/{_name(part)}", part)
            for (folder, _), sources in sorted(groups.items())
            for part in _parts(sorted(sources))
        ]

    def _copy(self, files: Sequence[_Large]) -> bool:
        """Write what is not there yet; tell whether all of the data set that it takes was there."""
        there = self._there()
        missing = [file for file in files if file.path not in there]
        of = sum(len(file.sources) for file in missing)
        of_bytes = sum(s.size for file in missing for s in file.sources)
        stale: dict[str, list[str]] = {}
        for path in there - {file.path for file in files}:
            stale.setdefault(path.rpartition("/")[0], []).append(path)
        done = done_bytes = 0
        with self._target.staging() as folder:
            for large in missing:
                try:
                    for source in _joined(self._source, large, folder / "large"):
                        done += 1
                        done_bytes += source.size
                        took = time.monotonic() - self._began
                        self._progress(FleetProgress(done, of, done_bytes, of_bytes, took))
                except _GoneError:
                    return False
                self._target.put(large.path, folder / "large")
                self._target.empty(folder)
                self._written += 1
                self._bytes += sum(source.size for source in large.sources)
                # rows are not there twice for longer than it takes
                for path in stale.pop(large.path.rpartition("/")[0], ()):
                    self._target.delete(path)
        return True

    def _there(self) -> set[str]:
        """Return the files of tables that the copy has."""
        from sniffer.fleet.tables import TABLES

        found = (f.path for table in TABLES for f in self._target.files(table, deep=True))
        return {path for path in found if NAMED.fullmatch(path.rpartition("/")[2])}


class _GoneError(Exception):
    """A file of the data set was replaced while it was to be read."""


def _joined(store: Store, large: _Large, path: Path) -> Iterator[_Source]:
    """Write the rows of files to one, and yield each that was read."""
    from sniffer.fleet.tables import GrowingTable

    grown: GrowingTable | None = None
    try:
        for source in large.sources:
            for rows in _row_groups(store, source.path):
                grown = grown or GrowingTable(path, rows.schema)
                grown.add(rows)
            yield source
    finally:
        if grown is not None:
            grown.close()


def _row_groups(store: Store, path: str) -> Iterator[Any]:
    """Yield the rows of a file of the data set, as many at a time as were written together.

    Raises:
        InputError: it cannot be read.
    """
    import pyarrow as pa
    import pyarrow.parquet as pq

    try:
        with store.open(path) as file, pq.ParquetFile(file) as parquet:
            for nth in range(parquet.num_row_groups):
                yield parquet.read_row_group(nth)
    except FileNotFoundError as error:
        raise _GoneError from error
    except (OSError, pa.ArrowInvalid) as error:
        told = " ".join(str(error).split())
        raise InputError(f"{store.uri}/{path}: cannot be read ({told})") from None


def _parts(sources: Sequence[_Source]) -> Iterator[tuple[_Source, ...]]:
    """Cut the files of a day where they would make a file that is too large."""
    held: list[_Source] = []
    size = 0
    for source in sources:
        if held and size + source.size > LARGE:
            yield tuple(held)
            held, size = [], 0
        held.append(source)
        size += source.size
    yield tuple(held)


def _name(sources: Sequence[_Source]) -> str:
    told = "\n".join([str(LAYOUT), *(source.path for source in sources)])
    return f"{hashlib.sha256(told.encode()).hexdigest()[:16]}.parquet"


def _relisted(listed: Any, files: Sequence[_Large]) -> Any:
    """Return the list of captures with the files of the copy."""
    import pyarrow as pa

    where: Mapping[str, str] = {s.path: file.path for file in files for s in file.sources}
    named = [list(dict.fromkeys(where[f] for f in own)) for own in listed["files"].to_pylist()]
    at = listed.schema.get_field_index("files")
    return listed.set_column(at, listed.schema.field(at), pa.array(named, pa.list_(pa.string())))


def _as_parquet(table: Any) -> bytes:
    import pyarrow.parquet as pq

    file = io.BytesIO()
    pq.write_table(table.combine_chunks(), file, compression="zstd")
    return file.getvalue()
