"""``sniffer.query``: SQL over the records of captures; what ``sniffer query`` calls.

DuckDB reads the arrow tables where they lie. It is given nothing else: no files, no network, no
extensions, no variables of the program, and its configuration is locked.
"""

from __future__ import annotations

import contextlib
import re
from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING, Any, Final

from sniffer.ground.model import InputError
from sniffer.ground.needs import need_duckdb, need_pyarrow
from sniffer.ground.wording import as_text
from sniffer.jobs.session import Ending
from sniffer.jobs.through import hear_part
from sniffer.selection.expression import BY_ALPHABET, GRADED
from sniffer.sources.several import name_of

if TYPE_CHECKING:
    from collections.abc import Iterator, Mapping, Sequence

    from sniffer.decoding.options import Options
    from sniffer.decoding.summary import Summary
    from sniffer.jobs.session import Patience
    from sniffer.jobs.telling import Teller
    from sniffer.selection.places import Window
    from sniffer.selection.selection import Selection

ROWS: Final = 10_000
"""Rows that are taken at once."""

_LOCKED: Final[Mapping[str, str | bool | int | float | list[str]]] = {
    "enable_external_access": False,
    "autoinstall_known_extensions": False,
    "autoload_known_extensions": False,
    "python_enable_replacements": False,
    "lock_configuration": True,
}
"""What keeps a query away from everything but the tables."""

_SHOW: Final = re.compile(r"\s*SHOW\b", re.IGNORECASE)
"""What asks which tables there are, and names none."""

_WORDS: Final = re.compile(r"\w+")

_BYTES: Final = re.compile(r"\bhex\b(?!\s*\()", re.IGNORECASE)
"""What asks for the column ``hex``; with a parenthesis it is DuckDB's function."""

_END: Final = re.compile(r";\s*(--[^\n]*)?\s*\Z")
"""Where a statement ends, with what is remarked behind."""

ZONED: Final = "TIMESTAMP WITH TIME ZONE"
"""The type of a column whose times have a zone."""

_NO_TABLE: Final = re.compile(r"Table with name (\S+) does not exist")

_BARE: Final = re.compile(r"(?<![\"'\w])(offset\b(?!\s*\d)|group\b(?!\s+by\b))(?![\"'])", re.I)
"""A column that SQL takes for a word of its own, as it is not in quotes."""


_GRADES: Final = re.compile(rf"\b{GRADED}\b\"?\s*(>|<(?!>))", re.IGNORECASE)
"""What compares severities by more and less, which SQL takes for words."""


@dataclass(frozen=True, slots=True)
class Answer:
    """What a query gives: the names of its columns, and its rows, once, as they are made.

    ``ending`` is the worst of the captures', ``summaries`` are their totals, one by one.
    """

    columns: tuple[str, ...]
    ending: Ending
    summaries: tuple[Summary, ...]
    _result: Any

    def __iter__(self) -> Iterator[tuple[Any, ...]]:
        with _told():
            while rows := self._result.fetchmany(ROWS):
                yield from rows


def query(
    sql: str,
    sources: Sequence[str | Path | Sequence[str | Path]],
    options: Options | None = None,
    *,
    input_format: str = "auto",
    window: Window | None = None,
    selection: Selection | None = None,
    patience: Patience | None = None,
    tell: Teller | None = None,
) -> Answer:
    """Answer a question in SQL about captures, over tables of their records.

    The tables are ``frames``, ``transactions``, ``samples``, ``anomalies`` and ``gaps``; those that
    the query names are built, in memory. With several captures each has a column ``file``.

    Args:
        sql: one SELECT (or WITH, EXPLAIN, DESCRIBE ...) as DuckDB has it.
        sources: captures, each a path, ``"-"`` for standard input, or several of them that are
            one capture, read in the order of their times.
        options: how they are decoded; what a recording says of itself fills what is not said.
        input_format: ``"auto"`` or a name of ``sniffer.sources.SOURCES``.
        window: which part of each; all of it where None.
        selection: which records the tables have; all of them where None.
        patience: takes interruptions; what was read until then is asked.
        tell: takes what should be told; nothing is told without.

    Raises:
        InputError: an input cannot be read, or the query cannot be answered.
        OutputError: DuckDB is not installed.
        SnifferError: unknown protocol or model, or a number that cannot be.
    """
    need_duckdb()
    need_pyarrow()
    if isinstance(sources, str | Path) or not sources:
        raise InputError("name the captures of a query in a list, one at least")
    import duckdb
    import pyarrow as pa

    from sniffer.sinks.relations import RELATIONS, RelationSink

    with _told(sql):
        connection = duckdb.connect(":memory:", config=dict(_LOCKED))
        statements = connection.extract_statements(sql)
        kinds = {statement.type.name for statement in statements}
        if len(statements) != 1 or not kinds <= {"SELECT", "EXPLAIN"}:
            raise InputError("a query is one SELECT: nothing can be written, set or attached")
        try:
            named = {name.lower() for name in connection.get_table_names(sql)}
        except duckdb.BinderException:  # it looks for the columns of USING before there are tables
            named = set(_WORDS.findall(sql.lower()))
    if tell is not None and "anomalies" in named and _GRADES.search(sql):
        tell.warn(BY_ALPHABET)
    if _SHOW.match(sql):
        named |= RELATIONS.keys()
    if selection is not None and tell is not None:
        for name in (name for name in RELATIONS if name in named):
            if (why := selection.lacking_in(name)) is not None:
                tell.talk(f"the table {name} has no rows: {why}")
    endings = [Ending.DONE]
    heard, summaries = [], []
    for source in sources:
        sink = RelationSink(
            [name for name in RELATIONS if name in named],
            file=as_text(name_of(source)) if len(sources) > 1 else None,
            has_bytes=_BYTES.search(sql) is not None,
        )
        done = hear_part(
            source,
            sink,
            options,
            input_format=input_format,
            window=window,
            selection=selection,
            patience=patience,
            tell=tell,
        )
        endings.append(done.ending)
        summaries.append(done.summary)
        heard.append(sink.tables())
        if endings[-1] == Ending.INTERRUPTED:
            break
    with _told(sql):
        for name in heard[0]:
            # one capture may know names of servos, another not
            both = pa.concat_tables([each[name] for each in heard], promote_options="default")
            connection.register(name, both.unify_dictionaries())
        result = connection.execute(sql)
        columns = tuple(column[0] for column in result.description)
        types = [str(column[1]) for column in result.description]
        if any(ZONED in kind for kind in types):
            result = connection.execute(_without_zones(sql, types))
    worst = Ending.worst(endings)
    return Answer(columns, worst, tuple(summaries), result)


def _without_zones(sql: str, types: Sequence[str]) -> str:
    """Return a query whose times with a zone are told in UTC: for those Python needs a library."""
    own = [f"c{n}" for n in range(len(types))]
    told = []
    for column, kind in zip(own, types, strict=True):
        if kind == ZONED:
            told.append(f"make_timestamp(epoch_us({column}))")
        else:
            told.append(f"{column}::VARCHAR" if ZONED in kind else column)
    return f"SELECT {', '.join(told)} FROM ({_END.sub('', sql)}\n) AS told({', '.join(own)})"


@contextlib.contextmanager
def _told(sql: str = "") -> Iterator[None]:
    """Tell what DuckDB complains of in a line."""
    import duckdb

    try:
        yield
    except duckdb.Error as error:
        text = str(error).partition("\nLINE")[0]
        unknown = _NO_TABLE.search(text)
        if unknown is not None:
            from sniffer.sinks.relations import no_relation

            raise InputError(no_relation(unknown[1])) from None
        hint = ""
        if isinstance(error, duckdb.ParserException) and (bare := _BARE.search(sql)):
            hint = f'; {bare[0]} is a word of SQL: the column is written "{bare[0].lower()}"'
        raise InputError(f"the query: {' '.join(text.split())}{hint}") from None
