"""Tables for pandas, polars, DuckDB: samples in ``x.parquet``, frames in ``x.frames.parquet``.

The same for ``.csv``. Columns are built from the batch's arrays; names come from dictionaries, so
that no Python object stands for a row.
"""

from __future__ import annotations

import inspect
from collections.abc import Callable, Mapping, Sequence
from concurrent.futures import Future, ThreadPoolExecutor
from dataclasses import dataclass
from types import MappingProxyType
from typing import TYPE_CHECKING, Any, Final

import numpy as np
import pyarrow as pa
import pyarrow.csv
import pyarrow.ipc
import pyarrow.parquet

from sniffer.decoding.called import ServoNames
from sniffer.decoding.fields import tidied
from sniffer.ground.codes import KINDS, PARTS, PROVENANCES, ROLES
from sniffer.ground.distinct import distinct
from sniffer.ground.files import beside, open_binary, writing
from sniffer.ground.model import Batch, Chunk, OutputError
from sniffer.protocols.base import BusProtocol
from sniffer.sinks.dictionaries import (
    CALLED,
    NAME,
    RegisterNames,
    absent,
    always,
    constant,
    named,
    with_names,
)

if TYPE_CHECKING:
    from pathlib import Path

    from sniffer.sinks.pieces import WrittenElsewhere

FORMULA: Final = ("=", "+", "-", "@", "\t", "\r")
"""What a text begins with that spreadsheets take for a formula (OWASP, CSV injection)."""

SAMPLES = pa.schema(
    [
        always("t_ns", pa.int64(), metadata={"about": "end of the frame, ns"}),
        always("bus", NAME),
        pa.field("servo_id", pa.int16()),
        always("register", NAME),
        always("quantity", NAME),
        always("role", NAME),
        always("raw", pa.int64(), metadata={"about": "as on the wire"}),
        pa.field("value", pa.float64(), metadata={"about": "in `unit`; null: none stated"}),
        always("unit", NAME),
        always("scale", NAME, metadata={"about": "observed, profile or assumed"}),
        always("part", NAME),
        always("offset", pa.int64(), metadata={"about": "first byte of the frame"}),
        always("protocol", NAME),
    ]
)
"""Columns of the samples table."""

FRAMES = pa.schema(
    [
        always("t_ns", pa.int64()),
        always("t_start_ns", pa.int64()),
        pa.field("uncertainty_ns", pa.int64()),
        always("bus", NAME),
        always("offset", pa.int64()),
        always("length", pa.int32()),
        always("kind", NAME),
        pa.field("servo_id", pa.int16()),
        always("op", NAME),
        pa.field("address", pa.int32()),
        always("data_length", pa.int32()),
        pa.field("status", pa.int16()),
        always("flags", pa.uint8()),
        always("protocol", NAME),
    ]
)
"""Columns of the frames table."""


def samples_table(bus: str, protocol: BusProtocol, batch: Batch) -> Any:
    """Return a batch's samples as an arrow table with the columns of ``SAMPLES``."""
    v = batch.samples
    name, quantity, unit = RegisterNames.of(protocol.registers).columns(v.register)
    return pa.Table.from_arrays(
        [
            pa.array(v.t_ns),
            constant(bus, len(v)),
            absent(v.servo_id, v.servo_id < 0),
            name,
            quantity,
            named(v.role, ROLES),
            pa.array(v.raw),
            absent(tidied(v.value), np.isnan(v.value)),
            unit,
            named(v.provenance, PROVENANCES),
            named(v.part, PARTS),
            pa.array(batch.frames.start[v.row] + batch.base),
            constant(protocol.name, len(v)),
        ],
        schema=SAMPLES,
    )


def frames_table(bus: str, protocol: BusProtocol, batch: Batch) -> Any:
    """Return a batch's frames as an arrow table with the columns of ``FRAMES``."""
    f = batch.frames if batch.chosen is None else batch.frames.take(batch.chosen("frames"))
    ops, which, _ = distinct(f.op)
    return pa.Table.from_arrays(
        [
            pa.array(f.t_end),
            pa.array(f.t_start),
            absent(f.uncertainty, f.uncertainty < 0),
            constant(bus, len(f)),
            pa.array(f.start + batch.base),
            pa.array(f.length.astype(np.int32)),
            named(f.kind, KINDS),
            absent(f.servo_id, f.servo_id < 0),
            named(which, [protocol.op_name(op) for op in ops.tolist()]),
            absent(f.address, f.address < 0),
            pa.array(f.data_length.astype(np.int32)),
            absent(f.status, f.status < 0),
            pa.array(f.flags),
            constant(protocol.name, len(f)),
        ],
        schema=FRAMES,
    )


Builder = Callable[[str, BusProtocol, Batch], Any]


ZSTD: Final[Mapping[str, Any]] = MappingProxyType({"compression": "zstd", "compression_level": 1})

FEW: Final = 1 << 14
"""Rows up to which a file is packed by Snappy: so few zstd sets up for longer than it packs, 40 us
for each of some 60 pages."""

MOST: Final = 1 << 18
"""Rows of a row group: some 20 MB in memory. DuckDB gives a thread no less than 122,880."""

_PAGES: Final[Mapping[str, int]] = MappingProxyType(
    # later pyarrow begins a page every 20,000 rows unless told otherwise, and zstd anew with it
    {"max_rows_per_page": MOST}
    if "max_rows_per_page" in inspect.signature(pyarrow.parquet.ParquetWriter).parameters
    else {}
)


def parquet_writer(file: Any, schema: Any, rows: int = MOST) -> Any:
    """Return what writes tables with these columns to a Parquet file, a row group each.

    ``rows`` is how many the first one has.
    """
    names = [f.name for f in schema if f.type == NAME]
    # Offsets and times grow by small steps: their differences pack to nothing.
    steps = [f.name for f in schema if f.type in (pa.int32(), pa.int64())]
    return pyarrow.parquet.ParquetWriter(
        file,
        schema,
        **({"compression": "snappy"} if rows <= FEW else ZSTD),
        use_dictionary=names,
        column_encoding=dict.fromkeys(steps, "DELTA_BINARY_PACKED"),
        # The least and greatest name of a group would take a third of the time, and tell nobody
        # anything: each stands in nearly every group.
        write_statistics=[f.name for f in schema if f.type != NAME],
        **_PAGES,
    )


class _Table:
    """One growing file; rows are gathered into groups before they are written."""

    def __init__(self, path: Path, schema: Any, build: Builder) -> None:
        self._path = path
        self._build = build
        self._parts: list[Any] = []
        self._rows = 0
        self._is_text = path.suffix.lower() == ".csv"
        self._schema = _plain(schema) if self._is_text else schema
        self._file = open_binary(path)
        self._writer: Any = None
        # The writer packs outside the interpreter's lock: decoding goes on meanwhile.
        self._packer = ThreadPoolExecutor(1, thread_name_prefix="tables")
        self._packing: Future[None] | None = None

    def write(self, bus: str, protocol: BusProtocol, batch: Batch) -> None:
        self.take(self._build(bus, protocol, batch))

    def widen(self, column: Any, build: Builder) -> None:
        """Have another column behind the others, before there is a row."""
        schema = pa.schema([column])
        self._schema = self._schema.append((_plain(schema) if self._is_text else schema)[0])
        self._build = build

    def take(self, table: Any) -> None:
        self._parts.append(_in_text(table, self._schema) if table.schema != self._schema else table)
        self._rows += len(table)
        if self._rows >= MOST:
            self._flush()

    def _flush(self) -> None:
        """Hand the rows over; one group at most is under way, and its failure is told here."""
        self._wait()
        self._begin()
        if self._parts:
            self._packing = self._packer.submit(self._pack, self._parts)
        self._parts, self._rows = [], 0

    def _begin(self) -> None:
        """Write the head of the file, once it is known which columns there are."""
        if self._writer is None:
            writer = pyarrow.csv.CSVWriter if self._is_text else parquet_writer
            with writing(self._path):
                self._writer = writer(self._file, self._schema)

    def _wait(self) -> None:
        if self._packing is not None:
            packing, self._packing = self._packing, None
            with writing(self._path):
                packing.result()

    def _pack(self, parts: list[Any]) -> None:
        self._writer.write_table(pa.concat_tables(parts).unify_dictionaries())

    def close(self) -> None:
        with writing(self._path), self._file, self._packer:
            try:
                self._flush()
                self._wait()
            finally:
                if self._writer is not None:
                    self._writer.close()


def _in_text(table: Any, schema: Any) -> Any:
    """Return a table as a .csv has it: names as texts, none of which a spreadsheet would run."""
    for i, field in enumerate(table.schema):
        if field.type == NAME:
            column = table.column(i).combine_chunks()
            for part in column.chunks if isinstance(column, pa.ChunkedArray) else [column]:
                names = part.dictionary.to_pylist()
                safe = [harmless(name) for name in names]
                if safe != names:
                    told = pa.DictionaryArray.from_arrays(part.indices, pa.array(safe))
                    table = table.set_column(i, field, told)
    return table.cast(schema)


def harmless(name: str) -> str:
    """Return a text that no spreadsheet takes for a formula."""
    return f"'{name}" if name.startswith(FORMULA) else name


def _plain(schema: Any) -> Any:
    """Return the columns of a .csv: names are texts there, and none is said never to be missing."""
    texts = ((f.name, pa.string() if f.type == NAME else f.type) for f in schema)
    return pa.schema([pa.field(*one) for one in texts])


def _naming(build: Builder, names: ServoNames) -> Builder:
    """Return what makes a table that has names of servos."""
    return lambda bus, protocol, batch: with_names(build(bus, protocol, batch), names)


class TableSink:
    """Samples and frames side by side, ``.parquet`` or ``.csv`` by the path's suffix."""

    def __init__(self, path: Path) -> None:
        self._path = path
        self._samples = _Table(path, SAMPLES, samples_table)
        try:
            self._frames = _Table(beside(path), FRAMES, frames_table)
        except OutputError:
            self._samples.close()
            raise

    def call(self, names: ServoNames) -> None:
        """Take what servos are called: where names are known, a column has them."""
        if names:
            self._samples.widen(CALLED, _naming(samples_table, names))
            self._frames.widen(CALLED, _naming(frames_table, names))

    def raw(self, bus: str, chunks: Sequence[Chunk]) -> None:
        """Take nothing: tables hold what was decoded."""

    def write(self, bus: str, protocol: BusProtocol, batch: Batch) -> None:
        """Add the batch's rows."""
        if len(batch.frames):
            self._samples.write(bus, protocol, batch)
            self._frames.write(bus, protocol, batch)

    def pieces(self) -> TablePieces:
        """Return how a part of a capture is written elsewhere."""
        return TablePieces()

    def advice(self) -> str:
        """Return what packs a huge capture by all processes: a file in one piece does not."""
        if self._path.suffix.lower() == ".csv":
            return ""
        told = f"{self._path} is packed by one process, whoever decodes: "
        return told + "`sniffer fleet CAPTURE -o FOLDER` has each of them pack files of its own"

    def join(self, piece: Path, told: WrittenElsewhere) -> None:
        """Add the rows that were written elsewhere."""
        del told
        for path, table in ((piece, self._samples), (beside(piece), self._frames)):
            with pyarrow.memory_map(str(path)) as file:
                for rows in pa.ipc.open_stream(file):
                    table.take(pa.Table.from_batches([rows]))

    def close(self) -> None:
        """Write what is left and the files' ends."""
        try:
            self._samples.close()
        finally:
            self._frames.close()


@dataclass(frozen=True, slots=True)
class TablePieces:
    """Parts of a capture as rows that are ready to be packed into whatever file it is."""

    def open(self, path: Path) -> TablePiece:
        """Return what writes one."""
        return TablePiece(path)


class TablePiece:
    """Writes the rows of a part as two Arrow streams, names and all."""

    def __init__(self, path: Path) -> None:
        self._names = ServoNames()
        self._tables = [
            (file, open_binary(file), build, schema)
            for file, build, schema in (
                (path, samples_table, SAMPLES),
                (beside(path), frames_table, FRAMES),
            )
        ]
        self._writers: list[Any] = []

    def call(self, names: ServoNames) -> None:
        """Take what servos are called."""
        self._names = names

    def _begun(self) -> list[Any]:
        """Return the streams; which columns they have is known when they are asked for first."""
        if not self._writers:
            packed = pa.ipc.IpcWriteOptions(compression="lz4", emit_dictionary_deltas=False)
            self._writers = [
                pa.ipc.new_stream(
                    stream, schema.append(CALLED) if self._names else schema, options=packed
                )
                for _, stream, _, schema in self._tables
            ]
        return self._writers

    def raw(self, bus: str, chunks: Sequence[Chunk]) -> None:
        """Take nothing."""

    def write(self, bus: str, protocol: BusProtocol, batch: Batch) -> None:
        """Add the batch's rows."""
        if len(batch.frames):
            for writer, (path, _, build, _) in zip(self._begun(), self._tables, strict=True):
                with writing(path):
                    rows = build(bus, protocol, batch)
                    writer.write_table(with_names(rows, self._names) if self._names else rows)

    def close(self) -> None:
        """Write the files' ends."""
        for writer, (path, stream, _, _) in zip(self._begun(), self._tables, strict=True):
            with writing(path), stream:
                writer.close()
