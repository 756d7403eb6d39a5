"""``sniffer query``: questions in SQL about captures."""

from __future__ import annotations

import csv
import itertools
import json
import math
import os
import sys
from collections.abc import Iterator
from typing import Any, Final

import click

from sniffer.cli.options import (
    captures_in,
    decoding,
    examples,
    with_files,
    with_format,
    with_quiet,
    with_together,
)
from sniffer.cli.selecting import say_selected, with_part, with_rows
from sniffer.cli.signals import patient
from sniffer.cli.statuses import status_of
from sniffer.decoding.options import Options
from sniffer.ground.wording import plain
from sniffer.jobs.query import Answer
from sniffer.jobs.query import query as ask
from sniffer.jobs.telling import Teller
from sniffer.selection.places import Window
from sniffer.selection.selection import Selection

EXPLAINED: Final = ("explain_key", "explain_value")
"""The columns of an answer to EXPLAIN."""

LOOK: Final = 1000
"""Rows by which the width of columns is judged; a longer value behind them is printed as it is."""


@click.command(
    short_help="Ask captures in SQL.",
    epilog=examples(
        'sniffer query "SELECT code, count(*) FROM anomalies GROUP BY ALL" run.mcap',
        'sniffer query "SELECT op, max(response_time_ns) FROM transactions GROUP BY op" run.mcap',
        'sniffer query "SELECT count(*) FROM gaps" --together run-001.mcap run-002.mcap',
        'sniffer query "DESCRIBE samples" run.mcap',
    ),
)
@click.argument("sql", metavar="SQL")
@with_files
@with_together
@with_part
@with_rows
@decoding
@with_format("text", "json", "csv", about="What is printed: json is a line a row.")
@with_quiet
def query(
    sql: str,
    files: tuple[str, ...],
    options: Options,
    input_format: str,
    output_format: str,
    together: bool,
    window: Window | None,
    selection: Selection | None,
    tell: Teller,
) -> int:
    """Answer one SELECT over the records of FILE, in DuckDB's SQL.

    The tables are frames, transactions, samples, anomalies and gaps; `DESCRIBE samples` lists the
    columns of one, `SHOW ALL TABLES` those of all. With several files each has a column `file`;
    with --together they are one. A query sees the tables and nothing else: no files, no network.
    It needs DuckDB: pip install 'servo-sniffer[query]'.

    Exit status: 0 done; 2 a mistake of yours; 3 an input breaks off (what could be read is asked).
    """
    if os.path.isfile(sql):  # noqa: PTH113 - Path's refuses what is too long for a name
        raise click.UsageError(f"{sql!r} is a file: the SQL comes first, then the files")
    with patient() as patience:
        answer = ask(
            sql,
            captures_in(files, together=together),
            options,
            input_format=input_format,
            window=window,
            selection=selection,
            patience=patience,
            tell=tell,
        )
    for summary in answer.summaries:
        say_selected(summary, tell)
    if output_format == "csv":
        table = csv.writer(sys.stdout, lineterminator="\n")
        table.writerow(answer.columns)
        table.writerows(answer)
    elif output_format == "json":
        for row in answer:
            told = zip(answer.columns, map(_jsonable, row), strict=True)
            click.echo(json.dumps(dict(told), default=str))
    else:
        for line in _lines(answer):
            click.echo(line)
    return status_of(answer.ending, is_lost=False)


def _jsonable(value: Any) -> Any:
    """Return a value as JSON can have it: what is no number is null."""
    return None if isinstance(value, float) and not math.isfinite(value) else value


def _lines(answer: Answer) -> Iterator[str]:
    """Yield a table for people, numbers right, texts left, nothing cut."""
    rows = iter(answer)
    if answer.columns == EXPLAINED:  # a drawing, line by line
        yield from (line for _, drawn in rows for line in str(drawn).splitlines())
        return
    head = [[_shown(value) for value in row] for row in itertools.islice(rows, LOOK)]
    widths = [max(map(len, column)) for column in zip(answer.columns, *head, strict=True)]
    right = [all(_is_number(cell) for cell in column) for column in zip(*head, strict=True)] or [
        False
    ] * len(widths)

    def line(cells: list[str]) -> str:
        told = zip(cells, widths, right, strict=True)
        placed = [c.rjust(width) if is_right else c.ljust(width) for c, width, is_right in told]
        return "  ".join(placed).rstrip()

    yield line([plain(name) for name in answer.columns])
    for cells in itertools.chain(head, ([_shown(value) for value in row] for row in rows)):
        yield line(cells)


def _shown(value: Any) -> str:
    if value is None:
        return ""
    return f"{value:.12g}" if isinstance(value, float) else plain(str(value))


def _is_number(cell: str) -> bool:
    try:
        float(cell or "0")
    except ValueError:
        return False
    return True
