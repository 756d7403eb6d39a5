"""CSV and Parquet hold what the decoder said, for whoever reads them with other tools."""

from __future__ import annotations

import json
import math
import re
from pathlib import Path
from typing import Any, Final

import numpy as np
import pandas as pd
import pyarrow as pa
import pyarrow.csv as pv
import pyarrow.parquet as pq
import pytest
from hypothesis import example, given
from hypothesis import strategies as st

import sniffer
from sniffer.decoding.fields import tidied, tidy
from sniffer.decoding.rows import FrameRow, SampleRow
from sniffer.ground.files import beside
from sniffer.sinks.tables import FRAMES, SAMPLES
from tests.commands import log, talk, within
from tests.lists import each_in_turn

Capsys = pytest.CaptureFixture[str]

CAPTURES: Final = Path(__file__).parents[1] / "sample_captures"
NAMES: Final = [f"{name}_damaged.log" for name in sniffer.PROTOCOLS]


def written(name: str, suffix: str, folder: Path, capsys: Capsys) -> Path:
    out = folder / f"x{suffix}"
    ran = within(capsys, "decode", CAPTURES / name, "-o", out, "--quiet")
    assert (ran.status, ran.out, ran.err) == (0, "", "")
    return out


def text(schema: Any) -> Any:
    """Return a schema as CSV has it: names are plain texts."""
    return pa.schema(
        [(f.name, pa.string() if pa.types.is_dictionary(f.type) else f.type) for f in schema]
    )


def from_csv(path: Path, schema: Any) -> Any:
    convert = pv.ConvertOptions(column_types=text(schema), quoted_strings_can_be_null=False)
    return pv.read_csv(path, convert_options=convert)


@pytest.mark.parametrize("name", NAMES)
def test_parquet_holds_the_samples_and_frames_of_the_api(
    name: str, tmp_path: Path, capsys: Capsys
) -> None:
    path = written(name, ".parquet", tmp_path, capsys)
    capture = sniffer.decode(CAPTURES / name)
    for file, schema, want in (
        (path, SAMPLES, capture.samples()),
        (beside(path), FRAMES, capture.frames()),
    ):
        got = pq.read_table(file)
        assert got.schema.names == schema.names
        assert len(got) == len(want) > 100
        assert got.cast(text(schema)) == want.cast(text(schema))


def test_parquet_says_which_columns_may_be_empty_and_where_numbers_lie(
    tmp_path: Path, capsys: Capsys
) -> None:
    path = written("rs30x_damaged.log", ".parquet", tmp_path, capsys)
    maybe = {"servo_id", "value", "uncertainty_ns", "address", "status"}
    for file in (path, beside(path)):
        parquet = pq.ParquetFile(file)
        table = parquet.read()
        assert {f.name for f in table.schema if f.nullable} == maybe & {*table.column_names}
        told = parquet.metadata.row_group(0)
        for place, field in enumerate(table.schema):
            figures = told.column(place).statistics
            if pa.types.is_dictionary(field.type):
                assert figures is None
            elif field.name in ("t_ns", "offset"):
                column = table.column(place).to_pylist()
                assert (figures.min, figures.max) == (min(column), max(column))


@each_in_turn(2, "name", NAMES)
def test_csv_holds_the_samples_and_frames_of_the_api(
    name: str, tmp_path: Path, capsys: Capsys
) -> None:
    path = written(name, ".csv", tmp_path, capsys)
    capture = sniffer.decode(CAPTURES / name)
    assert from_csv(path, SAMPLES).to_pylist() == capture.samples().cast(text(SAMPLES)).to_pylist()
    got = from_csv(beside(path), FRAMES)
    assert got.to_pylist() == capture.frames().cast(text(FRAMES)).to_pylist()


def test_the_tables_say_what_the_rows_say(tmp_path: Path, capsys: Capsys) -> None:
    path = written("rs30x_damaged.log", ".parquet", tmp_path, capsys)
    rows = list(sniffer.decode(CAPTURES / "rs30x_damaged.log"))
    samples = [r for r in rows if isinstance(r, SampleRow)]
    got = pq.read_table(path).to_pylist()
    for key in ("t_ns", "bus", "servo_id", "register", "quantity", "role", "raw", "unit", "scale"):
        assert [row[key] for row in got] == [getattr(r, key) for r in samples], key
    assert [row["value"] for row in got] == [r.value for r in samples]
    frames = [r for r in rows if isinstance(r, FrameRow)]
    got = pq.read_table(beside(path)).to_pylist()
    for key in ("t_ns", "t_start_ns", "bus", "offset", "length", "kind", "servo_id", "op"):
        assert [row[key] for row in got] == [getattr(r, key) for r in frames], key


@given(st.lists(st.one_of(st.floats(), st.integers(-(10**6), 10**6).map(lambda n: n * 0.1))))
@example([252 * 0.1, -608 * 0.1, math.nan, 5e15 + 1, 2.0**53 - 1, 0.0078125])
def test_many_values_are_tidied_as_one_is(values: list[float]) -> None:
    many = tidied(np.array(values, np.float64)).tolist()
    for one, found in zip(map(tidy, values), many, strict=True):
        if one is None:
            assert math.isnan(found)
        elif math.isfinite(one):
            assert found == pytest.approx(one, abs=1.1e-6, rel=0)
    exact = [
        n * scale for n in range(-3000, 3000) for scale in (0.1, 0.15, 0.01, 300 / 1023, 269 / 254)
    ]
    assert tidied(np.array(exact)).tolist() == [tidy(value) for value in exact]


@pytest.mark.parametrize("options", [(), ("--wide",)])
def test_no_value_in_a_table_has_rounding_dust(
    options: tuple[str, ...], tmp_path: Path, capsys: Capsys
) -> None:
    path = tmp_path / "values.csv"
    within(capsys, "convert", CAPTURES / "rs30x_damaged.log", path, *options)
    assert not re.search(r"\.\d{7}", path.read_text(encoding="utf-8"))


def test_a_value_is_selected_by_the_number_that_is_shown(capsys: Capsys) -> None:
    path = CAPTURES / "rs30x_damaged.log"
    shown = [
        r for r in sniffer.decode(path) if isinstance(r, SampleRow) and r.quantity == "position"
    ]
    dusty = [r for r in shown if r.value not in (None, r.raw * 0.1)]
    assert dusty
    wanted = dusty[0].value
    where = f"quantity = 'position' AND value = {wanted}"
    told = within(capsys, "decode", path, "--where", where, "--format", "jsonl").out
    found = [r for r in map(json.loads, told.splitlines()) if r["type"] == "sample"]
    assert len(found) == sum(r.value == wanted for r in shown)


def test_pandas_reads_both_alike(tmp_path: Path, capsys: Capsys) -> None:
    one = pd.read_parquet(written("wck_damaged.log", ".parquet", tmp_path, capsys))
    other = pd.read_csv(
        written("wck_damaged.log", ".csv", tmp_path, capsys), keep_default_na=False, na_values=[""]
    )
    assert list(one.columns) == list(other.columns) == SAMPLES.names
    positions = one[one.quantity == "position"].groupby("servo_id").value.mean()
    again = other[other.quantity == "position"].groupby("servo_id").value.mean()
    assert positions.to_dict() == pytest.approx(again.to_dict())
    assert set(positions.index) == {0, 1, 2, 3}


def test_the_suffix_may_be_in_capitals(tmp_path: Path, capsys: Capsys) -> None:
    path = written("wck_damaged.log", ".CSV", tmp_path, capsys)
    assert path.read_bytes().startswith(b'"t_ns","bus"')
    assert beside(path).name == "x.frames.CSV"
    assert len(from_csv(path, SAMPLES)) > 100


def test_two_buses_share_a_table(tmp_path: Path, capsys: Capsys) -> None:
    lines = log(talk(5)).splitlines()
    source, out = tmp_path / "two.log", tmp_path / "x.parquet"
    source.write_text("\n".join([*lines, *(x.replace("bus0", "elbow") for x in lines)]))
    assert within(capsys, "decode", source, "-o", out, "--quiet").status == 0
    buses = pq.read_table(beside(out))["bus"].to_pylist()
    assert {bus: buses.count(bus) for bus in buses} == {"bus0": 35, "elbow": 35}


def test_a_capture_without_a_frame_gives_tables_without_a_row(
    tmp_path: Path, capsys: Capsys
) -> None:
    source = tmp_path / "noise.bin"
    source.write_bytes(bytes(100))
    for suffix, read in ((".parquet", pq.read_table), (".csv", pv.read_csv)):
        out = tmp_path / f"x{suffix}"
        ran = within(capsys, "decode", source, "--protocol", "wck", "-o", out, "--quiet")
        assert ran.status == 0
        assert (len(read(out)), read(out).column_names) == (0, SAMPLES.names)
        assert (len(read(beside(out))), read(beside(out)).column_names) == (0, FRAMES.names)
