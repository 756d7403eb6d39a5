"""Everything that is known of a capture as arrow tables in memory, for SQL.

Frames and samples have the columns of the files (``tables.py``); transactions, gaps and anomalies
are beside them. Where a column has no value it is null, never -1.
"""

from __future__ import annotations

import difflib
from types import MappingProxyType
from typing import TYPE_CHECKING, Any, Final, NamedTuple

import numpy as np
import pyarrow as pa

from sniffer.anomalies.catalogue import CATALOGUE
from sniffer.anomalies.found import CODES, Anomalies
from sniffer.decoding.called import ServoNames
from sniffer.decoding.narrowing import selected
from sniffer.ground.codes import OUTCOMES
from sniffer.ground.distinct import distinct
from sniffer.ground.gaps import REASONS, Gaps
from sniffer.sinks.dictionaries import NAME, absent, always, constant, named, with_names
from sniffer.sinks.tables import FRAMES, SAMPLES, frames_table, samples_table

if TYPE_CHECKING:
    from collections.abc import Iterable, Mapping, Sequence

    from sniffer.ground.model import Batch, Chunk
    from sniffer.protocols.base import BusProtocol
    from sniffer.sinks.tables import Builder

TRANSACTIONS = pa.schema(
    [
        always("t_ns", pa.int64(), metadata={"about": "end of the last frame, ns"}),
        always("bus", NAME),
        pa.field("servo_id", pa.int16()),
        always("op", NAME),
        always("outcome", NAME),
        pa.field("response_time_ns", pa.int64()),
        pa.field("uncertainty_ns", pa.int64()),
        pa.field("request_offset", pa.int64()),
        pa.field("response_offset", pa.int64()),
        always("protocol", NAME),
    ]
)
"""Columns of the transactions table."""

GAPS = pa.schema(
    [
        always("t_ns", pa.int64()),
        always("bus", NAME),
        pa.field("servo_id", pa.int16(), metadata={"about": "whose frame it may have been"}),
        always("offset", pa.int64()),
        always("length", pa.int64()),
        always("reason", NAME),
        always("protocol", NAME),
    ]
)
"""Columns of the gaps table: bytes that no frame claims."""

ANOMALIES = pa.schema(
    [
        always("t_ns", pa.int64()),
        always("bus", NAME),
        pa.field("servo_id", pa.int16()),
        always("severity", NAME),
        always("group", NAME),
        always("code", NAME),
        always("detail", pa.string()),
        always("offset", pa.int64(), metadata={"about": "first byte of the evidence"}),
        always("length", pa.int64()),
        always("protocol", NAME),
    ]
)
"""Columns of the anomalies table."""


def transactions_table(bus: str, protocol: BusProtocol, batch: Batch) -> Any:
    """Return a batch's transactions as an arrow table with the columns of ``TRANSACTIONS``."""
    f, t = batch.frames, batch.transactions
    if batch.chosen is not None:
        t = t.take(batch.chosen("transactions"))
    if not len(t):
        return TRANSACTIONS.empty_table()
    is_asked, is_answered = t.request != -1, t.response >= 0
    frames, rows = batch.asking(np.where(is_asked, t.request, t.response))
    who = frames.servo_id[rows]
    last = np.where(is_answered, t.response, np.maximum(batch.rows_of(t.request), 0))
    who = np.where(who >= 0, who, f.servo_id[last]).astype(np.int16)
    ops, which, _ = distinct(frames.op[rows])
    unknown = t.response_time_ns < 0
    answered = f.start[np.maximum(t.response, 0)] + batch.base
    return pa.Table.from_arrays(
        [
            pa.array(f.t_end[last]),
            constant(bus, len(t)),
            absent(who, who < 0),
            named(which, [protocol.op_name(op) for op in ops.tolist()]),
            named(t.outcome, OUTCOMES),
            absent(t.response_time_ns, unknown),
            absent(t.uncertainty_ns, unknown | (t.uncertainty_ns < 0)),
            absent(frames.start[rows] + batch.base, ~is_asked),
            absent(answered, ~is_answered),
            constant(protocol.name, len(t)),
        ],
        schema=TRANSACTIONS,
    )


def gaps_table(bus: str, protocol: BusProtocol, batch: Batch) -> Any:
    """Return a batch's gaps as an arrow table with the columns of ``GAPS``."""
    gaps = Gaps.of(selected(batch).gaps)
    who = gaps.servo_id.astype(np.int16)
    return pa.Table.from_arrays(
        [
            pa.array(gaps.t_ns),
            constant(bus, len(gaps)),
            absent(who, who < 0),
            pa.array(gaps.start + batch.base),
            pa.array(gaps.length),
            named(gaps.kind, REASONS),
            constant(protocol.name, len(gaps)),
        ],
        schema=GAPS,
    )


def anomalies_table(bus: str, protocol: BusProtocol, batch: Batch) -> Any:
    """Return a batch's anomalies as an arrow table with the columns of ``ANOMALIES``."""
    found = Anomalies.of(batch.anomalies)
    if batch.chosen is not None:
        found = found.take(batch.chosen("anomalies").nonzero()[0])
    known = [CATALOGUE[code] for code in CODES]
    who = found.servo_id.astype(np.int16)
    return pa.Table.from_arrays(
        [
            pa.array(found.t_ns),
            constant(bus, len(found)),
            absent(who, who < 0),
            named(found.code, [entry.severity.name.lower() for entry in known]),
            named(found.code, [entry.group for entry in known]),
            named(found.code, CODES),
            pa.array([detail for detail, _ in found.told()], pa.string()),
            pa.array(found.at),
            pa.array(found.length),
            constant(protocol.name, len(found)),
        ],
        schema=ANOMALIES,
    )


class _Relation(NamedTuple):
    """The columns of a table, and what makes it of a batch."""

    schema: Any
    build: Builder


RELATIONS: Final[Mapping[str, _Relation]] = MappingProxyType(
    {
        "frames": _Relation(FRAMES, frames_table),
        "transactions": _Relation(TRANSACTIONS, transactions_table),
        "samples": _Relation(SAMPLES, samples_table),
        "anomalies": _Relation(ANOMALIES, anomalies_table),
        "gaps": _Relation(GAPS, gaps_table),
    }
)
"""The tables that SQL may name."""


HEX = always("hex", pa.string())
"""The column of bytes, as the JSON lines have them."""

HAVING_BYTES: Final = ("frames", "gaps")
"""Tables whose rows are bytes of the stream."""


def plain_schema(schema: Any) -> Any:
    """Return a schema in types that every reader has: Spark and Delta lack some.

    Names are strings, for in dictionaries they differ from batch to batch; no number is unsigned.
    """
    plainer = {NAME: pa.string(), pa.uint8(): pa.int16()}
    return pa.schema([f.with_type(plainer.get(f.type, f.type)) for f in schema])


def no_relation(name: str) -> str:
    """Return what is said where somebody names a table that there is not."""
    near = difflib.get_close_matches(name, RELATIONS, 1)
    advice = f"did you mean {near[0]}?" if near else f"one of {', '.join(RELATIONS)}"
    return f"there is no table {name[:40]!r}: {advice}"


def _hex(table: Any, batch: Batch) -> Any:
    """Return the bytes of frames or gaps of a batch, by where they stand."""
    begin = (table["offset"].to_numpy() - batch.base).tolist()
    spans = zip(begin, table["length"].to_pylist(), strict=True)
    return pa.array([batch.data[at : at + n].hex() for at, n in spans], pa.string())


class RelationSink:
    """A sink that keeps the tables that are asked for, all their rows that are shown.

    ``file`` stands in a column of that name, in front of the others; None: there is no such column.
    ``has_bytes``: frames and gaps have their bytes, in hex, which take more room than all the rest.
    """

    def __init__(
        self, names: Iterable[str], file: str | None = None, *, has_bytes: bool = False
    ) -> None:
        self._parts: dict[str, list[Any]] = {name: [] for name in names}
        self._file = file
        self._has_bytes = has_bytes
        self._names = ServoNames()

    def call(self, names: ServoNames) -> None:
        """Take what servos are called."""
        self._names = names

    def raw(self, bus: str, chunks: Sequence[Chunk]) -> None:
        """Take nothing: tables hold what was decoded."""

    def write(self, bus: str, protocol: BusProtocol, batch: Batch) -> None:
        """Add the batch's rows."""
        for name, parts in self._parts.items():
            table = RELATIONS[name].build(bus, protocol, batch)
            if self._has_bytes and name in HAVING_BYTES:
                table = table.append_column(HEX, _hex(table, batch))
            if len(table):
                parts.append(table)

    def close(self) -> None:
        """Do nothing: tables are asked for afterwards."""

    def taken(self, name: str) -> list[Any]:
        """Return the parts of a table that came since it was asked last, and forget them."""
        parts, self._parts[name] = self._parts[name], []
        return parts

    def tables(self) -> dict[str, Any]:
        """Return the tables by name."""
        out = {}
        for name, parts in self._parts.items():
            schema = RELATIONS[name].schema
            if self._has_bytes and name in HAVING_BYTES:
                schema = schema.append(HEX)
            table = pa.concat_tables([schema.empty_table(), *parts])
            if self._names and "servo_id" in table.column_names:
                table = with_names(table, self._names)
            if self._file is not None:
                table = table.add_column(0, "file", constant(self._file, len(table)))
            out[name] = table.unify_dictionaries()
        return out
