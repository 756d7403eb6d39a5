"""``sniffer.register_delta``: the files of a data set as Delta tables, without a copy.

A Delta table is a log beside the files that says which of them count. So a reader sees the data set
as it was at one moment, whatever is decoded meanwhile. The files and their names stay as they are.
"""

from __future__ import annotations

import json
import time
import urllib.parse
from collections import Counter
from typing import TYPE_CHECKING, Any, Final, NamedTuple

from sniffer.fleet.rows import DAMAGED, OK
from sniffer.ground.model import InputError, OutputError
from sniffer.ground.needs import need_deltalake, need_pyarrow

if TYPE_CHECKING:
    from collections.abc import Mapping
    from pathlib import Path

    from sniffer.fleet.store import Store

PARTITIONS: Final = ["robot", "date"]


def register_delta(
    dataset: str | Path, *, storage_options: Mapping[str, str] | None = None
) -> dict[str, int]:
    """Make what a data set holds now the next version of its Delta tables, each in one commit.

    The tables are the folders ``samples``, ``frames``, ``transactions`` and ``anomalies``; one that
    has not changed gets no new version.

    Args:
        dataset: the folder of the data set, or a URI of an object store.
        storage_options: how deltalake gets at an object store, in its words.

    Returns:
        The version of each table.

    Raises:
        InputError: there is no data set.
        OutputError: a table cannot be written, or deltalake is not installed.
    """
    need_pyarrow()
    need_deltalake()
    from deltalake.exceptions import DeltaError
    from pyarrow import ArrowInvalid

    from sniffer.fleet.store import Store
    from sniffer.fleet.tables import TABLES

    store = Store.of(dataset)
    try:
        files = _files(store)
        return {
            table: _registered(store, table, files.get(table, {}), dict(storage_options or {}))
            for table in TABLES
        }
    except FileNotFoundError:
        raise InputError(f"{dataset} is no data set: `sniffer fleet` makes one") from None
    except (DeltaError, ArrowInvalid, OSError) as error:
        told = " ".join(str(error).split())
        raise OutputError(f"{dataset}: cannot be registered ({told})") from None


class _RegisteredFile(NamedTuple):
    """A file of a table: its size in bytes, when it was changed, and how many rows it has."""

    size: int
    mtime_ns: int
    rows: int


def _files(store: Store) -> dict[str, dict[str, _RegisteredFile]]:
    """Return the files of each table that captures have, by their paths below it.

    How many rows a file has the list of captures says, unless it has a part of a capture, or
    several: of these the file is asked.
    """
    import pyarrow.parquet as pq

    from sniffer.fleet.dataset import CAPTURES_FILE
    from sniffer.fleet.tables import TABLES

    with store.open(CAPTURES_FILE) as file:
        captures = pq.read_table(file, columns=["status", "files", *TABLES]).to_pylist()
    rows: dict[str, int | None] = {}
    for capture in captures:
        if capture["status"] not in (OK, DAMAGED):
            continue
        parts = Counter(path.partition("/")[0] for path in capture["files"])
        for path in capture["files"]:
            table = path.partition("/")[0]
            is_told = path not in rows and parts[table] == 1
            rows[path] = capture[table] if is_told else None

    def counted(path: str) -> int:
        told = rows[path]
        if told is None:
            with store.open(path) as file:
                told = int(pq.read_metadata(file).num_rows)
        return told

    out: dict[str, dict[str, _RegisteredFile]] = {}
    for table in TABLES:
        found = (f for f in store.files(table, deep=True) if f.path in rows)
        out[table] = {
            f.path.removeprefix(f"{table}/"): _RegisteredFile(f.size, f.mtime_ns, counted(f.path))
            for f in found
        }
    return out


def _registered(
    store: Store,
    table: str,
    files: Mapping[str, _RegisteredFile],
    storage_options: dict[str, str],
) -> int:
    """Bring one table up to its files; return its version."""
    import pyarrow as pa
    from deltalake import DeltaTable, Schema
    from deltalake.transaction import AddAction, RemoveAction

    place = f"{store.uri.rstrip('/')}/{table}"
    schema = Schema.from_arrow(_schema(table))
    delta = DeltaTable.create(
        place, schema, "ignore", PARTITIONS, storage_options=storage_options or None
    )
    known = pa.table(delta.get_add_actions(flatten=True))
    named = [urllib.parse.unquote(path) for path in known.column("path").to_pylist()]
    sizes = dict(zip(named, known.column("size_bytes").to_pylist(), strict=True))
    now_ms = time.time_ns() // 1_000_000
    actions: list[Any] = [
        RemoveAction(path, True, now_ms, sizes[path], _partition(path))
        for path in sizes.keys() - files.keys()
    ]
    for path, file in files.items():
        if path not in sizes:
            told = json.dumps({"numRecords": file.rows})
            at_ms = file.mtime_ns // 1_000_000
            actions.append(AddAction(path, file.size, _partition(path), at_ms, True, told))
    if actions:
        delta.create_write_transaction(actions, "append", schema, PARTITIONS)
        delta.update_incremental()
    return int(delta.version())


def _schema(table: str) -> Any:
    """Return the columns of a table as Delta has them."""
    import pyarrow as pa

    from sniffer.fleet.tables import columns_of
    from sniffer.sinks.relations import plain_schema

    mine = plain_schema(columns_of(table))
    return pa.schema([*mine, pa.field("robot", pa.string()), pa.field("date", pa.date32())])


def _partition(path: str) -> dict[str, str | None]:
    folders = (folder.partition("=") for folder in path.split("/")[:-1])
    return {name: urllib.parse.unquote(value) for name, _, value in folders}
