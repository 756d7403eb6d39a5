"""The layout of a data set: where what is of a capture lies, and which captures are in it.

A capture is in the data set when its commit is, a file in ``_done``, which is written last. What is
told of all captures in ``captures.parquet`` is made of the commits.
"""

from __future__ import annotations

import contextlib
import io
import urllib.parse
from collections import Counter
from concurrent.futures import ThreadPoolExecutor
from dataclasses import asdict
from typing import TYPE_CHECKING, Any, Final, NamedTuple

import pyarrow as pa
import pyarrow.parquet as pq

from sniffer.fleet.rows import CRASHED, FAILED, CaptureRow

if TYPE_CHECKING:
    from collections.abc import Collection
    from pathlib import Path

    from sniffer.fleet.store import Store

DONE: Final = "_done"
"""The folder of the commits."""

CAPTURES_FILE: Final = "captures.parquet"

CAPTURES: Final = pa.schema(
    [
        pa.field("capture", pa.string(), metadata={"about": "its id in all tables"}),
        pa.field("path", pa.string()),
        pa.field("robot", pa.string()),
        pa.field("date", pa.string(), metadata={"about": "day in UTC"}),
        pa.field("date_from", pa.string(), metadata={"about": "stamp or mtime"}),
        pa.field("status", pa.string(), metadata={"about": "ok, damaged, failed, crashed"}),
        pa.field("error", pa.string()),
        pa.field("bytes", pa.int64(), metadata={"about": "of its file"}),
        pa.field("buses", pa.list_(pa.string())),
        pa.field("protocols", pa.list_(pa.string())),
        pa.field("t_first_ns", pa.int64()),
        pa.field("t_last_ns", pa.int64()),
        pa.field("frames", pa.int64()),
        pa.field("samples", pa.int64()),
        pa.field("transactions", pa.int64()),
        pa.field("anomalies", pa.int64()),
        pa.field("errors", pa.int64(), metadata={"about": "anomalies that are errors"}),
        pa.field("bytes_in_gaps", pa.int64()),
        pa.field("summary", pa.string(), metadata={"about": "JSON"}),
        pa.field("files", pa.list_(pa.string())),
        pa.field("sha256", pa.string()),
        pa.field("decoder", pa.string()),
        pa.field("seconds", pa.float64()),
        pa.field("fingerprint", pa.string()),
    ]
)
"""Columns of ``captures.parquet``: those of ``CaptureRow``."""

READERS: Final = 16
"""Commits that are read at once: an object store takes some 20 ms for each, nearly all waiting."""

ROUNDS: Final = 10
"""How often the list of captures is written again because another run has committed meanwhile."""


def table_path(
    table: str, robot: str, date: str, capture: str, decoder: str, stretch: int | None = None
) -> str:
    """Return where a capture's file of a table lies, below the root.

    ``robot`` is encoded as in a URL, as readers of such folders expect it. ``stretch`` is the
    number of the file where a capture has several, in the order of their names.
    """
    whose = urllib.parse.quote(robot, safe="")
    number = "" if stretch is None else f"-{stretch:05d}"
    return f"{table}/robot={whose}/date={date}/{capture}-{decoder}{number}.parquet"


def hive_folder(root: str) -> str | None:
    """Return the folder on a path that is called like those of tables, None where there is none.

    >>> hive_folder("/captures/robot=r07/dataset")
    'robot=r07'
    """
    return next((n for n in root.split("/") if n.startswith(("robot=", "date="))), None)


def commit_path(fingerprint: str) -> str:
    """Return where a capture's commit lies, below the root."""
    return f"{DONE}/{fingerprint}.json"


def commit(store: Store, row: CaptureRow, folder: Path | None = None) -> None:
    """Let a capture be in the data set; its files are there already.

    ``folder`` is what ``store.staging`` gave, None: nothing yet.

    Raises:
        OSError: it cannot be written.
    """
    store.put_bytes(commit_path(row.fingerprint), row.as_json().encode(), folder)


class CommittedCapture(NamedTuple):
    """What a run must know of a capture that is in the data set.

    ``was_read``: to its end, once; one that was not (no permission, it ended whoever decoded it)
    may be another time.
    """

    path: str
    status: str
    files: tuple[str, ...]
    was_read: bool


class CaptureList:
    """Which captures are in a data set, by fingerprint: its list, and the commits that it lacks.

    What was not decoded may have been tried again since the list was written: of these the commit
    counts. Others never change under their fingerprint.

    Raises:
        OSError: the data set cannot be read.
    """

    def __init__(self, store: Store) -> None:
        self._store = store
        found = committed(store)
        table = self._read(["fingerprint", "path", "status", "files"])
        self.listed = set(table.column("fingerprint").to_pylist())
        """The captures that the list has, whether or not they are in the data set."""
        self.known: dict[str, CommittedCapture] = {}
        """The captures that are in the data set."""
        listed = (table.column(name).to_pylist() for name in table.column_names)
        for fingerprint, path, status, files in zip(*listed, strict=True):
            if fingerprint in found and status not in (FAILED, CRASHED):
                self.known[fingerprint] = CommittedCapture(path, status, tuple(files), True)
        for row in read_commits(store, found - self.known.keys()):
            told = (row.path, row.status, row.files, bool(row.sha256))
            self.known[row.fingerprint] = CommittedCapture(*told)

    def _read(self, columns: list[str] | None = None) -> Any:
        """Return the list as it was written last; one that is damaged is written anew.

        Raises:
            OSError: the disk or the store does not give it.
        """
        unread = contextlib.suppress(FileNotFoundError, pa.ArrowInvalid, KeyError, UnicodeError)
        try:
            with unread, self._store.open(CAPTURES_FILE) as file:
                return pq.read_table(file, columns=columns).select(columns or CAPTURES.names)
        except OSError as error:
            # arrow says of what a file holds what it says of disks, but without a number
            if error.errno is not None or not self._store.is_local:
                raise
        told = [CAPTURES.field(name) for name in columns or CAPTURES.names]
        return pa.schema(told).empty_table()

    def write(self) -> None:
        """Write the list anew, of all commits that are there.

        Raises:
            OSError: it cannot be written; the one before is there.
        """
        before = self._read()
        rows: dict[str, CaptureRow] = {}
        for _ in range(ROUNDS):
            found = committed(self._store)
            kept = _kept(before, found)
            names = set(kept.column("fingerprint").to_pylist())
            missing = found - names - rows.keys()
            rows |= {row.fingerprint: row for row in read_commits(self._store, missing)}
            mine = [asdict(row) for name, row in rows.items() if name in found]
            whole = pa.concat_tables([kept, pa.Table.from_pylist(mine, CAPTURES)])
            whole = whole.sort_by([("path", "ascending"), ("fingerprint", "ascending")])
            file = io.BytesIO()
            pq.write_table(whole.combine_chunks(), file, compression="zstd")
            self._store.put_bytes(CAPTURES_FILE, file.getvalue())
            if committed(self._store) == found:
                return


def _kept(listed: Any, found: Collection[str]) -> Any:
    """Return the rows of a list that no commit may have changed since."""
    final = [
        fingerprint in found and status not in (FAILED, CRASHED)
        for fingerprint, status in zip(
            listed.column("fingerprint").to_pylist(),
            listed.column("status").to_pylist(),
            strict=True,
        )
    ]
    return listed.filter(pa.array(final, pa.bool_())).cast(CAPTURES)


def committed(store: Store) -> set[str]:
    """Return the fingerprints of the captures that are in a data set.

    Raises:
        OSError: it cannot be read.
    """
    names = store.names(DONE)
    return {name.removesuffix(".json") for name in names if name.endswith(".json")}


def read_commits(store: Store, fingerprints: Collection[str]) -> list[CaptureRow]:
    """Return the rows of commits; one that is gone meanwhile, or is none, is left out.

    Raises:
        OSError: the data set cannot be read.
    """

    def read(fingerprint: str) -> CaptureRow | None:
        with contextlib.suppress(FileNotFoundError, ValueError):
            return CaptureRow.from_json(store.get_text(commit_path(fingerprint)))
        return None

    if not fingerprints:
        return []
    with ThreadPoolExecutor(min(READERS, len(fingerprints))) as pool:
        return [row for row in pool.map(read, sorted(fingerprints)) if row is not None]


class Withdrawal:
    """Takes captures out of a data set: their files, unless they are of another one, too.

    The commit goes last: as long as it is there, the next run knows what is left to be done.
    ``known`` are the captures of the data set by fingerprint; what is withdrawn is no more in it.
    """

    def __init__(self, store: Store, known: dict[str, CommittedCapture]) -> None:
        self._store = store
        self._known = known
        self._uses = Counter(file for capture in known.values() for file in capture.files)
        self._by_path: dict[str, list[str]] = {}
        for fingerprint, capture in known.items():
            self._by_path.setdefault(capture.path, []).append(fingerprint)

    def replace(self, row: CaptureRow) -> None:
        """Take out what was there of a capture's file before; the row has been committed.

        Raises:
            OSError: a file cannot be removed.
        """
        self._uses.update(row.files)
        self.outdate(row.path, row.fingerprint)

    def outdate(self, path: str, fingerprint: str) -> None:
        """Take out what is known of a capture's file under other fingerprints than this one.

        Raises:
            OSError: a file cannot be removed.
        """
        for other in self._by_path.get(path, ()):
            if other != fingerprint and other in self._known:
                self.take(other)

    def take(self, fingerprint: str) -> None:
        """Take out one capture.

        Raises:
            OSError: a file cannot be removed.
        """
        capture = self._known.pop(fingerprint)
        self._uses.subtract(capture.files)
        for file in capture.files:
            if not self._uses[file]:
                self._store.delete(file)
        self._store.delete(commit_path(fingerprint))
