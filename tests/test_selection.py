"""What ``--where`` selects: the same rows as SQL does, and mistakes told with their place."""

from __future__ import annotations

import functools
from dataclasses import replace
from pathlib import Path
from typing import Any, Final

import duckdb
import pyarrow as pa
import pytest
from hypothesis import example, given, settings
from hypothesis import strategies as st

import sniffer
from sniffer.decoding.called import Named, ServoNames
from sniffer.decoding.rows import Row, as_dict, rows
from sniffer.ground.model import InputError
from sniffer.ground.naming import worded
from sniffer.selection.columns import IS_TEXT, LENT, REALS, TABLES, VALUES
from sniffer.selection.expression import GRADED, HEADINGS
from sniffer.selection.selection import Selection
from sniffer.sinks.text import HEAD
from tests.commands import within

CAPTURES: Final = Path(__file__).parents[1] / "sample_captures"

NAMED: Final = {"frame": "frames", "gap": "gaps", "transaction": "transactions"} | {
    "sample": "samples",
    "anomaly": "anomalies",
}
"""The table that each kind of row is of."""


NAMES: Final[dict[Named, str]] = {1: "hip", 2: "left_knee", 16: "hip"}
"""What servos are called; others have no name."""

LINES: Final = 300
"""Lines of a capture: enough for something to be wrong, few enough for many examples."""


class Told:
    """A capture as rows, and as tables that were made from these rows, not from the columns."""

    def __init__(self, name: str) -> None:
        head = b"".join((CAPTURES / name).read_bytes().splitlines(keepends=True)[:LINES])
        capture = sniffer.decode(head)
        self.parts = capture.batches
        self.rows = list(capture)
        protocol = self.parts[0][1]
        tables: dict[str, list[dict[str, Any]]] = {table: [] for table in TABLES}
        more = {
            "frames": iter(capture.frames().to_pylist()),
            "samples": iter(capture.samples().to_pylist()),
        }
        ends = {row.offset: row.t_ns for row in self.rows if isinstance(row, sniffer.FrameRow)}
        for number, row in enumerate(self.rows):
            table = NAMED[row.type]
            told = as_dict(row) | {"protocol": protocol.name, "n": number}
            if table == "transactions":
                last = max(
                    x for x in (told["request_offset"], told["response_offset"]) if x is not None
                )
                told["t_ns"] = ends[last]
            if table == "anomalies":
                told["offset"], told["length"] = told["evidence"][0]
            if table == "gaps":
                told["servo_id"] = told["detail"].get("fields", {}).get("servo_id")
            told |= next(more[table]) if table in more else {}
            told["servo_name"] = NAMES.get(told["servo_id"])
            lent = LENT["gaps"] if table == "gaps" else ()
            tables[table].append({name: told[name] for name in (*TABLES[table], *lent, "n")})
        self.base = duckdb.connect()
        said = {(frame["bus"], frame["offset"]): frame for frame in tables["frames"]}
        memories = {register.name: register.memory for register in protocol.registers}
        for sample in tables["samples"]:
            lending = said[sample["bus"], sample["offset"]] | {
                "memory": memories[sample["register"]]
            }
            sample |= {name: lending[name] for name in LENT["samples"]}
        for table, found in tables.items():
            lent = LENT.get(table, ())
            types = [(name, _type(name)) for name in (*TABLES[table], *lent)]
            schema = pa.schema([*types, ("n", pa.int64())])
            self.base.register(table, pa.Table.from_pylist(found, schema))

    def by_sql(self, text: str, tables: tuple[str, ...]) -> list[Row]:
        """Return the rows that DuckDB selects."""
        asked = [f"SELECT n FROM {table} WHERE {text}" for table in tables]
        found = self.base.sql(" UNION ALL ".join(asked)).fetchall()
        return [self.rows[n] for (n,) in sorted(found)]

    def by_us(self, selection: Selection) -> list[Row]:
        """Return the rows that we select."""
        selection = selection.named(ServoNames(NAMES))
        return [
            row
            for bus, protocol, batch in self.parts
            for row in rows(
                replace(batch, chosen=selection.rows(bus, protocol, batch)), protocol, bus
            )
        ]


def _type(name: str) -> Any:
    return pa.string() if IS_TEXT[name] else pa.float64() if name in REALS else pa.int64()


told = functools.cache(Told)
DAMAGED: Final = ("mightyzap_damaged.log", "lss_damaged.log", "wck_damaged.log")

NUMBERS: Final = st.one_of(
    st.integers(-3, 40),
    st.sampled_from([2**31, 2**63, -(2**70), 1_000_000, 1732142106123456789]),
    st.integers(-10_000, 300_000).map(lambda n: f"{n / 100:.2f}"),
    st.sampled_from(["1e3", "2.5E-1", ".5", "7."]),
).map(str)
WORDS: Final = st.sampled_from(
    ["", "read", "store_data", "D", "QD", "position", "mm", "bus0", "it's", "wck", "%", "hip"]
)


def quoted(text: str) -> str:
    return "'" + text.replace("'", "''") + "'"


@st.composite
def comparisons(draw: st.DrawFn, columns: list[str]) -> str:
    """Draw one comparison, in any form that there is."""
    name = draw(st.sampled_from(columns))
    word = draw(st.sampled_from([f'"{name}"', f'"{name.upper()}"']))
    negated = draw(st.sampled_from(["", "NOT "]))
    texts = st.sampled_from(VALUES[name]) if name in VALUES else WORDS
    value = texts.map(quoted) if IS_TEXT[name] else NUMBERS
    forms = ["compare", "turned", "null", "in", "like", "columns"]
    signs = ["=", "<>", "!=", "=="]
    if name != GRADED:
        forms, signs = [*forms, "between"], [*signs, "<", "<=", ">", ">="]
    form, sign = draw(st.sampled_from(forms)), draw(st.sampled_from(signs))
    match form:
        case "turned":
            return f"{draw(value)} {sign} {word}"
        case "null":
            return f"{word} IS {negated}NULL"
        case "in":
            listed = draw(st.lists(value, min_size=1, max_size=12))
            return f"{word} {negated}in ({', '.join(listed)})"
        case "between":
            return f"{word} {negated}BETWEEN {draw(value)} AND {draw(value)}"
        case "like" if IS_TEXT[name]:
            pattern = "".join(draw(st.lists(st.sampled_from("%_aeinorst-"), max_size=7)))
            return f"{word} {negated}LIKE '{pattern}'"
        case "columns" if not IS_TEXT[name]:
            others = [other for other in columns if not IS_TEXT[other]]
            return f'{word} {sign} "{draw(st.sampled_from(others))}"'
        case _:
            return f"{word} {sign} {draw(value)}"


def expressions(columns: list[str]) -> st.SearchStrategy[str]:
    leaf = comparisons(columns) | st.sampled_from(["TRUE", "false"])
    return st.recursive(
        leaf,
        lambda inner: st.one_of(
            st.builds("{} AND {}".format, inner, inner),
            st.builds("{} or {}".format, inner, inner),
            st.builds("({})".format, inner),
            st.builds("NOT ({})".format, inner),
            st.builds("not {}".format, leaf),
        ),
        max_leaves=6,
    )


ANY: Final = st.one_of(
    *(expressions(sorted(columns)) for columns in TABLES.values()),
    expressions(
        ["kind", "op", "address", "status", "memory", "register", "value", "role", "servo_id"]
    ),
    expressions(["reason", "servo_id", "servo_name", "length"]),
)


@settings(max_examples=150, deadline=None)
@given(name=st.sampled_from(DAMAGED), text=ANY)
@example(DAMAGED[0], "register = 'moving_speed' AND kind = 'request' AND op <> 'send_data'")
@example(DAMAGED[0], "value > 500 AND address BETWEEN 120 AND 140 AND status IS NULL")
@example(DAMAGED[0], "memory = 'non-volatile' AND kind = 'request'")
@example(DAMAGED[0], "servo_name = 'left_knee' AND value > 5")
@example(DAMAGED[0], "servo_name <> 'hip'")
@example(DAMAGED[0], "servo_name IS NULL OR NOT servo_name LIKE 'h%'")
@example(DAMAGED[0], "servo_id IS NOT NULL AND reason = 'damaged'")
def test_an_expression_selects_the_rows_that_sql_selects(name: str, text: str) -> None:
    selection = Selection.parse(text)
    capture = told(name)
    assert capture.by_us(selection) == capture.by_sql(text, selection.tables), text


@settings(max_examples=100, deadline=None)
@given(text=ANY)
@example("servo_id = 1 AND length BETWEEN 3 AND 9 AND (kind = 'request' AND servo_id < 9)")
@example("(servo_id = 1) AND (op = 'x') OR length > 3")
@example("(servo_id = 1 OR servo_id = 2) AND kind = 'request'")
@example("op = ' AND servo_id = 3 AND ' AND servo_id = 2")
def test_what_is_asked_of_another_table_is_true_of_all_that_is_selected(text: str) -> None:
    capture, selection = told(DAMAGED[0]), Selection.parse(text)
    for table in TABLES:
        about = selection.about(table)
        if about is None or table in selection.tables:
            assert about in (None, selection)
            continue
        assert table in about.tables
        for held in selection.tables:
            if held in about.tables:
                missed = f"({text}) AND NOT coalesce(({about.text}), FALSE)"
                sql = f"SELECT count(*) FROM {held} WHERE {missed}"
                assert capture.base.sql(sql).fetchall() == [(0,)]


def test_not_to_have_a_status_is_no_status_that_differs() -> None:
    capture = told("mightyzap_damaged.log")
    differ = capture.by_us(Selection.parse("NOT status = 99"))
    assert differ == capture.by_us(Selection.parse("status IS NOT NULL"))
    assert 0 < len(differ) < len(capture.by_us(Selection.parse("kind IS NOT NULL")))


COMPLAINTS: Final = {
    "servo = 3": ", at 'servo = 3' (character 1): there is no such column: did you mean servo_id?",
    "servo_id = 3 AND opp = 'x'": (
        ", at \"opp = 'x'\" (character 18): there is no such column: did you mean op?"
    ),
    "verdict = 'ok'": (
        ", at \"verdict = 'ok'\" (character 1): there is no such column: what is shown as verdict "
        "is outcome"
    ),
    "eeprom = 1": (
        ", at 'eeprom = 1' (character 1): there is no such column: where a register stands is "
        "memory, 'volatile' or 'non-volatile'"
    ),
    "severity >= 'warn'": (
        ", at \"severity >= 'warn'\" (character 1): severity is a text, and 'error' stands before "
        "'warn' in the alphabet: write severity IN ('warn', 'error')"
    ),
    "servo_id =": ", at its end: expected a column, a number or a text",
    "servo_id = 3; drop": (
        ", at '; drop' (character 13): ';' is nothing that an expression can have"
    ),
    "code = 'no-respons'": (
        ", at \"'no-respons'\" (character 8): code is never that: did you mean no-response?"
    ),
    "value > 3 and outcome = 'ok'": (
        ": no table has all of its columns: value is of samples; outcome is of transactions"
    ),
    "op = read": ", at 'read' (character 6): a text stands in single quotes: 'read'",
    'op = "read"': (
        ", at '\"read\"' (character 6): a text stands in single quotes, a column in double ones"
    ),
    "servo_id = '3'": (
        ", at \"'3'\" (character 12): servo_id holds numbers: write a number without quotes"
    ),
    "offset > 3": (
        ", at 'offset > 3' (character 1): offset is a word of SQL: as a column write "
        '"offset", in double quotes'
    ),
    "status = NULL": (
        ", at 'NULL' (character 10): nothing is equal to NULL: write IS NULL or IS NOT NULL"
    ),
    "servo_id * 2 = 4": (
        ", at '* 2 = 4' (character 10): there is no arithmetic: compare columns with "
        "numbers, texts or each other"
    ),
    "op = 'read": ', at "\'read" (character 6): a quote that is opened here is not closed',
    "  ": " is empty: write it like servo_id = 3 AND op = 'read'",
    "("
    * 90: ", at '((((((((((((((((((((' (character 51): more than 50 parentheses inside each other",
}
"""What is said of an expression, behind the name of the option."""


@pytest.mark.parametrize("text", COMPLAINTS)
def test_a_mistake_is_told_with_its_place_and_what_may_be_meant(text: str) -> None:
    with pytest.raises(InputError) as told:
        Selection.parse(text)
    assert worded(told.value) == f"--where{COMPLAINTS[text]}"


@settings(max_examples=200, deadline=None)
@given(st.text(max_size=40) | st.text("()'\"=<>,.-+e19 servo_idANOTBwekin%", max_size=40))
def test_any_text_is_read_or_refused_in_one_line(text: str) -> None:
    try:
        Selection.parse(text)
    except InputError as error:
        told = worded(error)
    else:
        told = ""
    assert "\n" not in told


def test_shorthands_are_an_expression_that_can_be_written_out() -> None:
    selection = Selection.of("length > 7", servos=(3, 5), ops=("it's",), kinds=("request",))
    assert selection is not None
    written = "servo_id IN (3, 5) AND op = 'it''s' AND kind = 'request' AND (length > 7)"
    assert selection.text == written
    assert selection.tables == ("frames",)
    assert Selection.of() is None


@pytest.mark.parametrize("number", ["300", "-129", "32768", "70000", "4294967296", "-1", "2.5"])
@pytest.mark.parametrize("sign", ["=", "<>", "<", ">="])
def test_a_number_that_a_column_cannot_hold_is_compared_as_what_it_is(
    sign: str, number: str
) -> None:
    base = told("mightyzap_damaged.log")
    text = f"servo_id {sign} {number}"
    selection = Selection.parse(text)
    assert base.by_us(selection) == base.by_sql(text, selection.tables)


def test_all_headings_of_a_listing_lead_to_columns() -> None:
    shown = {name for name in HEAD if name.strip()}
    assert shown - {*IS_TEXT} <= {*HEADINGS}
    assert {column.split(",")[0] for column in HEADINGS.values()} <= {*IS_TEXT}


def test_what_was_written_to_wearing_memory_is_asked_for_by_one_word() -> None:
    selection = Selection.parse("memory = 'non-volatile' AND kind = 'request'")
    found = told("mightyzap_damaged.log").by_us(selection)
    assert {getattr(row, "register", None) for row in found} == {"feedback_return_mode"}


@pytest.mark.parametrize("option", ["--servo", "--op", "--kind", "--code", "--bus"])
def test_an_option_that_names_nothing_does_not_select_everything(
    option: str, capsys: pytest.CaptureFixture[str]
) -> None:
    """An empty variable of a script did."""
    for empty in ("", " , "):
        done = within(capsys, "decode", CAPTURES / "mightyzap_clean.log", option, empty)
        assert done.status == 2
        assert f"'{option}'" in done.err
        assert "it is empty: leave it out to take all of them" in done.err
