"""The four tables of one capture, each a Parquet file that grows while the capture is decoded."""

from __future__ import annotations

from dataclasses import dataclass
from typing import TYPE_CHECKING, Any, Final

import numpy as np
import pyarrow as pa
import pyarrow.ipc

from sniffer.sinks.relations import RELATIONS
from sniffer.sinks.tables import parquet_writer

if TYPE_CHECKING:
    from collections.abc import Sequence
    from pathlib import Path

    from sniffer.ground.model import Batch, Chunk
    from sniffer.protocols.base import BusProtocol
    from sniffer.sinks.pieces import WrittenElsewhere

TABLES: Final = ("samples", "frames", "transactions", "anomalies")
"""The tables of a data set, names of ``RELATIONS``."""

ROWS: Final = 1 << 18
"""Rows of a row group: some 20 MB in memory; DuckDB gives a thread no less than 122,880."""

CAPTURE: Final = pa.field("capture", pa.dictionary(pa.int32(), pa.string()))
"""The first column of every table: the id of the capture that a row is of."""


def columns_of(table: str) -> Any:
    """Return the columns of a table of the data set."""
    return pa.schema([CAPTURE, *RELATIONS[table].schema])


class CaptureTables:
    """A sink that writes a capture's tables to ``folder``, a file each that has rows.

    The same records in the same order give the same bytes, however they come in batches.
    """

    def __init__(self, folder: Path, capture: str) -> None:
        self.folder = folder
        self._grown = {name: _GrowingFile(folder / f"{name}.parquet", name, capture)
                       for name in TABLES}  # fmt: skip

    def raw(self, bus: str, chunks: Sequence[Chunk]) -> None:
        """Take nothing: tables hold what was decoded."""

    def write(self, bus: str, protocol: BusProtocol, batch: Batch) -> None:
        """Add the batch's rows."""
        for name, grown in self._grown.items():
            grown.add(RELATIONS[name].build(bus, protocol, batch))

    def pieces(self) -> CapturePieces:
        """Return how a part of a capture is written elsewhere."""
        return CapturePieces()

    def join(self, piece: Path, told: WrittenElsewhere) -> None:
        """Add the rows that were written elsewhere."""
        del told
        for name, grown in self._grown.items():
            with pa.memory_map(str(_piece(piece, name))) as file:
                for rows in pa.ipc.open_stream(file):
                    grown.add(pa.Table.from_batches([rows]))

    def close(self) -> None:
        """Write what is left and the files' ends."""
        for grown in self._grown.values():
            grown.close()

    def rows(self, table: str) -> int:
        """Return how many rows a table has."""
        return self._grown[table].rows

    def files(self) -> dict[str, Path]:
        """Return the files by the names of their tables; a table without rows has none."""
        return {name: grown.path for name, grown in self._grown.items() if grown.rows}


@dataclass(frozen=True, slots=True)
class CapturePieces:
    """Parts of a capture as rows that are ready to be packed into its tables."""

    def open(self, path: Path) -> CapturePiece:
        """Return what writes one."""
        return CapturePiece(path)


class CapturePiece:
    """Writes the rows of a part as Arrow streams, one a table, batch by batch.

    What the machine refuses is raised as it is: it is not the capture's fault.
    """

    def __init__(self, path: Path) -> None:
        packed = pa.ipc.IpcWriteOptions(compression="lz4", use_threads=False)
        self._writers = {
            name: pa.ipc.new_stream(_piece(path, name), RELATIONS[name].schema, options=packed)
            for name in TABLES
        }

    def raw(self, bus: str, chunks: Sequence[Chunk]) -> None:
        """Take nothing."""

    def write(self, bus: str, protocol: BusProtocol, batch: Batch) -> None:
        """Add the batch's rows."""
        for name, writer in self._writers.items():
            rows = RELATIONS[name].build(bus, protocol, batch)
            if len(rows):
                writer.write_table(rows)

    def close(self) -> None:
        """Write the files' ends."""
        for writer in self._writers.values():
            writer.close()


def _piece(path: Path, table: str) -> Path:
    return path.with_name(f"{path.stem}.{table}{path.suffix}")


class _GrowingFile:
    """One table's file; it is made when there are rows."""

    def __init__(self, path: Path, table: str, capture: str) -> None:
        self.path = path
        self.rows = 0
        self._schema = columns_of(table)
        self._capture = capture
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
        while self._waiting >= ROWS:
            self._write(ROWS)

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
            self._writer = parquet_writer(self._file, self._schema)
        held = pa.concat_tables(self._held)
        group = held.slice(0, count)
        self._held = [held.slice(count)]
        self._waiting -= count
        named = pa.DictionaryArray.from_arrays(
            pa.array(np.zeros(count, np.int32)), pa.array([self._capture])
        )
        whole = group.add_column(0, CAPTURE, named).unify_dictionaries()
        self._writer.write_table(whole.combine_chunks())
