"""``sniffer.read_batches``: one table of a capture, batch by batch, for readers of data frames."""

from __future__ import annotations

from typing import TYPE_CHECKING, Any, Final

from sniffer.decoding.pipeline import Options, Pipeline
from sniffer.ground.model import DamagedInputError, InputError
from sniffer.ground.needs import need_pyarrow
from sniffer.jobs.asked import Extract
from sniffer.jobs.order import merged
from sniffer.jobs.session import nothing_in, reads_on
from sniffer.jobs.telling import Teller
from sniffer.sources.several import open_capture

if TYPE_CHECKING:
    from collections.abc import Iterator, Sequence
    from pathlib import Path

    from sniffer.selection.places import Window
    from sniffer.selection.selection import Selection
    from sniffer.sinks.relations import RelationSink
    from sniffer.sources import Source

ROWS: Final = 1 << 16
"""Rows of a batch at most: what a pass of the decoder gives, some MB."""


def read_batches(
    source: str | Path | Sequence[str | Path],
    table: str,
    options: Options | None = None,
    *,
    input_format: str = "auto",
    window: Window | None = None,
    selection: Selection | None = None,
    rows: int = ROWS,
    tell: Teller | None = None,
) -> Any:
    """Return a table of a capture as a reader of Arrow record batches, decoded as they are asked.

    It is a ``pyarrow.RecordBatchReader``: an iterator with a ``schema``, and what DuckDB, polars
    and others take as it is. Names are plain strings. Memory does not grow with the capture. What
    of an input can be read comes before what is wrong with it is raised.

    Args:
        source: a path, or ``"-"`` for standard input; several are one capture, read in the order
            of their times.
        table: ``frames``, ``transactions``, ``samples``, ``anomalies`` or ``gaps``.
        options: how it is decoded; what a recording says of itself fills what is not said.
        input_format: ``"auto"`` or a name of ``sniffer.sources.SOURCES``.
        window: which part of it; all of it where None.
        selection: which rows; all of them where None.
        rows: how many a batch has at most.
        tell: takes what should be told; nothing is told without.

    Raises:
        InputError: there is no such table, the input cannot be read or is empty, its protocol
            cannot be told, or the window is empty.
        DamagedInputError: raised behind the last batch: the input breaks off. A recording that
            was not finished is none: it is read as far as it goes.
        OutputError: pyarrow is not installed.
        SnifferError: unknown protocol or model, or a number that cannot be.
    """
    need_pyarrow()
    import pyarrow as pa

    from sniffer.sinks.relations import RELATIONS, RelationSink, no_relation, plain_schema

    if table not in RELATIONS:
        raise InputError(no_relation(table))
    options = options or Options()
    options.check()
    if rows < 1:
        raise InputError(f"a batch has 1 row at least, not {rows}")
    asked = Extract.of(selection, window)
    again = asked is not None and asked.seeks
    opened = open_capture(source, input_format, again=again, wiring=options.wired)
    schema = plain_schema(RELATIONS[table].schema)
    sink = RelationSink([table])
    tell = tell or Teller(lambda line: None, quiet=True)

    def batches() -> Iterator[Any]:
        with opened:
            for made in _tables(opened, table, sink, options, asked, tell):
                yield from made.cast(schema).combine_chunks().to_batches(rows)

    return pa.RecordBatchReader.from_batches(schema, batches())


def _tables(
    opened: Source,
    table: str,
    sink: RelationSink,
    options: Options,
    asked: Extract | None,
    tell: Teller,
) -> Iterator[Any]:
    """Yield what each pass gives, where it gives something."""
    options = options.with_facts(opened.facts(), opened.tables)
    pipeline = Pipeline(options, [sink], on_detection=tell.found)
    part = None
    if asked is not None:
        pipeline.narrowing = asked.sought_in(opened, options).narrowing([pipeline.summary], tell)
        part = pipeline.narrowing.part
    damage: DamagedInputError | None = None
    try:
        for group in merged(opened, opened, options, tell):
            pipeline.feed(group)
            yield from sink.taken(table)
            if part is not None and part.is_over:
                break
    except DamagedInputError as error:
        damage = error
    pipeline.close()
    yield from sink.taken(table)
    pipeline.finish()
    if damage is not None:
        if not reads_on(opened, pipeline.summary):
            raise damage
        tell.warn(f"{damage}: read as far as it goes")
    elif not pipeline.summary.buses:
        raise InputError(nothing_in(opened.name, part, opened.notes))
