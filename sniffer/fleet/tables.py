"""The four tables of one capture, each a Parquet file that grows while the capture is decoded."""

from __future__ import annotations

from dataclasses import dataclass
from typing import TYPE_CHECKING, Any, Final, NamedTuple

import pyarrow as pa
import pyarrow.parquet as pq

from sniffer.sinks.dictionaries import NAME, always, constant
from sniffer.sinks.relations import RELATIONS
from sniffer.sinks.tables import MOST, parquet_writer

if TYPE_CHECKING:
    from collections.abc import Mapping, Sequence
    from pathlib import Path

    from sniffer.ground.model import Batch, Chunk
    from sniffer.protocols.base import BusProtocol
    from sniffer.sinks.pieces import WrittenElsewhere

TABLES: Final = ("samples", "frames", "transactions", "anomalies")
"""The tables of a data set, names of ``RELATIONS``."""

CAPTURE: Final = always("capture", NAME)
"""The first column of every table: the id of the capture that a row is of."""


def columns_of(table: str) -> Any:
    """Return the columns of a table of the data set."""
    return pa.schema([CAPTURE, *RELATIONS[table].schema])


class TableFile(NamedTuple):
    """A file of a capture's table; ``number`` is that of its stretch, None where it has all."""

    table: str
    number: int | None
    path: Path


class CaptureTables:
    """A sink that writes a capture's tables to ``folder``, a file each that has rows.

    The same records in the same order give the same bytes, however they come in batches. Those of
    a capture ``in_stretches`` are a file a stretch: so the processes that decode it together can
    write them, each its own.
    """

    def __init__(self, folder: Path, capture: str, *, in_stretches: bool = False) -> None:
        self.folder = folder
        self.files: list[TableFile] = []
        """The files that are finished; one without rows is none."""
        self._rows = dict.fromkeys(TABLES, 0)
        self._capture = capture
        self._number = 0 if in_stretches else None
        self._grown = self._begun()

    def raw(self, bus: str, chunks: Sequence[Chunk]) -> None:
        """Take nothing: tables hold what was decoded."""

    def write(self, bus: str, protocol: BusProtocol, batch: Batch) -> None:
        """Add the batch's rows."""
        _add(self._grown, bus, protocol, batch)

    def turn(self) -> None:
        """Finish the files of a stretch."""
        if self._number is not None:
            self.close()
            self._number += 1
            self._grown = self._begun()

    def pieces(self) -> CapturePieces:
        """Return how a stretch of a capture is written elsewhere."""
        return CapturePieces(self._capture)

    def join(self, piece: Path, told: WrittenElsewhere) -> None:
        """Take the files of a stretch that were written elsewhere."""
        del told
        self.turn()
        for table in TABLES:
            made = _piece(piece, table)
            if made.exists():
                path = made.replace(self._path(table))
                self._finished(table, path, pq.read_metadata(path).num_rows)

    def close(self) -> None:
        """Write what is left and the files' ends."""
        for table, grown in self._grown.items():
            grown.close()
            if grown.rows:
                self._finished(table, grown.path, grown.rows)

    def rows(self, table: str) -> int:
        """Return how many rows the finished files of a table have."""
        return self._rows[table]

    def _begun(self) -> dict[str, GrowingTable]:
        return {name: _grown(self._path(name), name, self._capture) for name in TABLES}

    def _path(self, table: str) -> Path:
        number = "" if self._number is None else f"-{self._number}"
        return self.folder / f"{table}{number}.parquet"

    def _finished(self, table: str, path: Path, rows: int) -> None:
        self.files.append(TableFile(table, self._number, path))
        self._rows[table] += rows


@dataclass(frozen=True, slots=True)
class CapturePieces:
    """Stretches of a capture as the files of its tables."""

    capture: str

    def open(self, path: Path) -> CapturePiece:
        """Return what writes one."""
        return CapturePiece(path, self.capture)


class CapturePiece:
    """Writes the tables of a stretch, a file each that has rows.

    What the machine refuses is raised as it is: it is not the capture's fault.
    """

    def __init__(self, path: Path, capture: str) -> None:
        self._grown = {name: _grown(_piece(path, name), name, capture) for name in TABLES}

    def raw(self, bus: str, chunks: Sequence[Chunk]) -> None:
        """Take nothing."""

    def write(self, bus: str, protocol: BusProtocol, batch: Batch) -> None:
        """Add the batch's rows."""
        _add(self._grown, bus, protocol, batch)

    def close(self) -> None:
        """Write what is left and the files' ends."""
        for grown in self._grown.values():
            grown.close()


def _add(grown: Mapping[str, GrowingTable], bus: str, protocol: BusProtocol, batch: Batch) -> None:
    for name, file in grown.items():
        file.add(RELATIONS[name].build(bus, protocol, batch))


def _piece(path: Path, table: str) -> Path:
    return path.with_name(f"{path.stem}.{table}{path.suffix}")


def _grown(path: Path, table: str, capture: str) -> GrowingTable:
    """Return the file of a capture's table."""
    return GrowingTable(path, columns_of(table), (capture,))


class GrowingTable:
    """One table's file; it is made when there are rows.

    ``same`` are the names that stand in the first columns, in every row; rows come without them.
    """

    def __init__(self, path: Path, schema: Any, same: Sequence[str] = ()) -> None:
        self.path = path
        self.rows = 0
        self._schema = schema
        self._same = same
        self._held: list[Any] = []
        self._waiting = 0
        self._writer: Any = None

    def add(self, rows: Any) -> None:
        """Take rows; whole row groups are written, so that these do not depend on batches."""
        if not len(rows):
            return
        self._held.append(rows)
        self._waiting += len(rows)
        self.rows += len(rows)
        while self._waiting >= MOST:
            self._write(MOST)

    def close(self) -> None:
        """Write what is left, and the end of the file."""
        try:
            if self._waiting:
                self._write(self._waiting)
        finally:
            if self._writer is not None:
                self._writer.close()
                self._file.close()

    def _write(self, count: int) -> None:
        if self._writer is None:
            self._file = self.path.open("wb")
            self._writer = parquet_writer(self._file, self._schema, count)
        held = self._held[0] if len(self._held) == 1 else pa.concat_tables(self._held)
        group = held.slice(0, count)
        self._held = [held.slice(count)] if count < len(held) else []
        self._waiting -= count
        if group.num_columns and group.column(0).num_chunks > 1:
            group = group.unify_dictionaries().combine_chunks()
        first = (constant(name, count) for name in self._same)
        columns = [*first, *group.columns]
        self._writer.write_table(pa.Table.from_arrays(columns, schema=self._schema))
