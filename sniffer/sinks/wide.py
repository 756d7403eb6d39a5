"""A wide table: a row a frame that made values known (or a step of time), a column a quantity.

Which columns there are is known only when everything was heard. Until then values wait, packed, in
a temporary file; the table is made of them in pieces, so a long capture takes no memory.
"""

from __future__ import annotations

import contextlib
import tempfile
from typing import TYPE_CHECKING, Any, Final, NamedTuple

import numpy as np
import pyarrow as pa
import pyarrow.csv
import pyarrow.parquet

from sniffer.decoding.called import ServoNames
from sniffer.decoding.fields import tidied
from sniffer.decoding.sink import bus_of
from sniffer.ground.files import open_binary, writing
from sniffer.mcapfile.fields import state_field
from sniffer.sinks.spaced import Spaced
from sniffer.sinks.tables import harmless

if TYPE_CHECKING:
    from collections.abc import Sequence
    from pathlib import Path

    from sniffer.ground.model import F64, I64, Batch, Chunk
    from sniffer.protocols.base import BusProtocol

CELLS: Final = 1 << 22
"""Cells of the table that are laid out at a time: 32 MiB of numbers."""

_VALUE: Final = np.dtype([("row", "<i8"), ("column", "<i4"), ("value", "<f8")])
_ROW: Final = np.dtype([("t_ns", "<i8"), ("bus", "<i4")])


class _Column(NamedTuple):
    """What a column is of: servos with one id have several where buses call them otherwise."""

    servo_id: int
    quantity: str
    called: str | None


class WideSink:
    """Writes a wide table, ``.csv`` or ``.parquet`` by the path's suffix.

    Columns: ``t_ns``, ``bus``, then ``<servo>.<quantity>_<unit>``, the servo by its name where it
    has one, and by both where several ids have that one. A cell is blank where the frame
    says nothing of it, or, with ``hold``, has the last value of its bus. With ``every_ns`` a bus
    has a row each such step of time instead, with what was said last in it.
    """

    def __init__(self, path: Path, *, hold: bool = False, every_ns: int | None = None) -> None:
        self._path = path
        self._hold = hold
        self._every_ns = every_ns
        self._spaced: dict[int, Spaced] = {}
        self._file = open_binary(path)
        self._columns: dict[_Column, int] = {}
        self._placed: dict[_Column, tuple[str, int]] = {}
        self._names = ServoNames()
        self._buses: dict[str, int] = {}
        self._n = 0
        self._rows = tempfile.TemporaryFile()  # noqa: SIM115 - closed by close
        self._values = tempfile.TemporaryFile()  # noqa: SIM115

    def raw(self, bus: str, chunks: Sequence[Chunk]) -> None:
        """Take nothing: tables hold what was decoded."""

    def call(self, names: ServoNames) -> None:
        """Take what servos are called."""
        self._names = names

    def write(self, bus: str, protocol: BusProtocol, batch: Batch) -> None:
        """Keep the batch's values until it is known which columns there are."""
        v = batch.samples
        names = [state_field(register) for register in protocol.registers]
        told = np.array([name is not None for name in names])
        v = v.take(~np.isnan(v.value) & told[v.register] & (v.servo_id >= 0))
        if not len(v):
            return
        v = v.take(np.argsort(v.row, kind="stable"))
        place = self._buses.setdefault(bus_of(bus, protocol, batch), len(self._buses))
        keys, key_of = np.unique(
            v.servo_id.astype(np.int64) << 32 | v.register, return_inverse=True
        )
        known = []
        for key in keys.tolist():
            name = names[key & 0xFFFFFFFF]
            assert name is not None, "only quantities are kept"
            titled = _Column(key >> 32, name, self._names.of(bus, key >> 32))
            known.append(self._columns.setdefault(titled, len(self._columns)))
            # as tables of registers have it: the order in which all was heard is that of batches
            place_of = (protocol.name, key & 0xFFFFFFFF)
            self._placed[titled] = min(self._placed.get(titled, place_of), place_of)
        column: I64 = np.array(known, np.int64)[key_of]
        value = tidied(v.value)
        if self._every_ns is None:
            _, first, which = np.unique(v.row, return_index=True, return_inverse=True)
            self._keep(place, v.t_ns[first], which, column, value)
        else:
            spaced = self._spaced.setdefault(place, Spaced(self._every_ns))
            self._keep(place, *spaced.take(v.t_ns, column, value))

    def _keep(self, place: int, t_ns: I64, row: I64, column: I64, value: F64) -> None:
        """Put rows of one bus away: their times, and of each value its row, column and itself."""
        rows = np.empty(len(t_ns), _ROW)
        rows["t_ns"] = t_ns
        rows["bus"] = place
        values = np.empty(len(value), _VALUE)
        values["row"] = row + self._n
        values["column"] = column
        values["value"] = value
        self._n += len(rows)
        with writing(self._path):
            self._rows.write(rows.tobytes())
            self._values.write(values.tobytes())

    def close(self) -> None:
        """Make the table."""
        with writing(self._path), self._file, self._rows, self._values:
            for place, spaced in self._spaced.items():
                self._keep(place, *spaced.rest())
            order = sorted(
                self._columns, key=lambda c: (c.servo_id, self._placed[c], c.called or "")
            )
            kind = pa.dictionary(pa.int32(), pa.string())
            is_csv = self._path.suffix.lower() == ".csv"
            names = [harmless(title) if is_csv else title for title in _titles(order)]
            schema = pa.schema(
                [
                    pa.field("t_ns", pa.int64()),
                    pa.field("bus", pa.string() if is_csv else kind),
                    *(pa.field(name, pa.float64()) for name in names),
                ]
            )
            at = np.empty(len(order), np.int64)
            at[[self._columns[c] for c in order]] = np.arange(len(order))
            if is_csv:
                writer = pyarrow.csv.CSVWriter(self._file, schema)
            else:
                writer = pyarrow.parquet.ParquetWriter(self._file, schema, compression="zstd")
            with contextlib.closing(writer):
                self._write_all(writer, schema, at)

    def _write_all(self, writer: Any, schema: Any, place: I64) -> None:
        self._rows.seek(0)
        self._values.seek(0)
        width = max(len(place), 1)
        step = max(CELLS // width, 1)
        last = np.full((len(self._buses), width), np.nan)
        names = [harmless(b) if self._path.suffix.lower() == ".csv" else b for b in self._buses]
        buses = pa.array(names, pa.string())
        waiting = np.empty(0, _VALUE)
        for begin in range(0, self._n, step):
            n = min(step, self._n - begin)
            rows = np.frombuffer(self._rows.read(n * _ROW.itemsize), _ROW)
            cells = np.full((n, width), np.nan)
            while True:
                stop = int(np.searchsorted(waiting["row"], begin + n))
                now, waiting = waiting[:stop], waiting[stop:]
                cells[now["row"] - begin, place[now["column"]]] = now["value"]
                if len(waiting):
                    break
                waiting = np.frombuffer(self._values.read(_VALUE.itemsize << 18), _VALUE)
                if not len(waiting):
                    break
            if self._hold:
                held(cells, rows["bus"], last)
            bus = pa.DictionaryArray.from_arrays(pa.array(rows["bus"]), buses)
            columns = [
                pa.array(np.ascontiguousarray(rows["t_ns"])),
                bus.cast(schema.field("bus").type),
                *(pa.array(cells[:, k], mask=np.isnan(cells[:, k])) for k in range(len(place))),
            ]
            writer.write_table(pa.Table.from_arrays(columns, schema=schema))


def _titles(columns: Sequence[_Column]) -> list[str]:
    """Return a title for each column; no two servos share one."""
    ids: dict[str, set[int]] = {}
    for c in columns:
        ids.setdefault(str(c.servo_id) if c.called is None else c.called, set()).add(c.servo_id)
    out = []
    for c in columns:
        who = str(c.servo_id) if c.called is None else c.called
        if c.called is not None and (len(ids[who]) > 1 or who.isdecimal()):
            who = f"{c.servo_id} {c.called}"
        out.append(f"{who}.{c.quantity}")
    return out


def held(cells: F64, bus: I64, last: F64) -> None:
    """Fill each blank with the value before it in its column, on its bus; ``last`` is carried."""
    for k in range(len(last)):
        mine = np.flatnonzero(bus == k)
        if not len(mine):
            continue
        block = np.vstack([last[k], cells[mine]])
        known = np.where(np.isnan(block), 0, np.arange(len(block))[:, None])
        filled = np.take_along_axis(block, np.maximum.accumulate(known, axis=0), axis=0)
        cells[mine] = filled[1:]
        last[k] = filled[-1]
