"""Wide tables: a column for each quantity of a servo."""

from __future__ import annotations

import csv
from typing import TYPE_CHECKING

import numpy as np
import pyarrow.parquet as pq
import pytest

import sniffer
from sniffer.decoding.fields import tidy
from sniffer.decoding.rows import SampleRow
from sniffer.mcapfile.fields import state_field
from sniffer.sinks.spaced import Spaced
from tests.commands import log, talk, within
from tests.lists import in_turn
from tests.test_convert import CAPTURES, LOG, Capsys

if TYPE_CHECKING:
    from pathlib import Path

    from sniffer.ground.model import F64, I64


def rows_of(path: Path) -> list[dict[str, float | str | None]]:
    """Return a wide table's rows, whatever its suffix."""
    if path.suffix == ".parquet":
        return [
            {name: tidy(v) if isinstance(v, float) else v for name, v in row.items()}
            for row in pq.read_table(path).to_pylist()
        ]
    with path.open(newline="") as file:
        return [
            {name: text if name == "bus" else _number(name, text) for name, text in row.items()}
            for row in csv.DictReader(file)
        ]


def _number(name: str, text: str) -> float | None:
    if not text:
        return None
    return int(text) if name == "t_ns" else tidy(float(text))


def expected(source: Path, *, hold: bool) -> list[dict[str, float | str | None]]:
    """Return the rows of a wide table, made of the samples one by one."""
    capture = sniffer.decode(source)
    fields = {
        (protocol.name, r.name, r.unit): state_field(r)
        for _, protocol, _ in capture.batches
        for r in protocol.registers
    }
    protocols = {bus: protocol.name for bus, protocol, _ in capture.batches}
    rows: dict[tuple[str, int], dict[str, float | str | None]] = {}
    for s in capture:
        if isinstance(s, SampleRow) and s.value is not None and s.servo_id is not None:
            field = fields[protocols[s.bus], s.register, s.unit]
            if field is not None:
                row = rows.setdefault((s.bus, s.offset), {"t_ns": s.t_ns, "bus": s.bus})
                row[f"{s.servo_id}.{field}"] = s.value
    names = {name for row in rows.values() for name in row}
    last: dict[tuple[str, str], float | str | None] = {}
    out = []
    for (bus, _), row in rows.items():
        if hold:
            last |= {(bus, name): value for name, value in row.items()}
            row = {name: last.get((bus, name)) for name in names}
        out.append(dict.fromkeys(names) | row)
    return out


@in_turn(2)
@pytest.mark.parametrize("hold", [False, True])
@pytest.mark.parametrize(
    ("name", "suffix"), [("mightyzap_damaged.log", ".csv"), ("lss_damaged.log", ".parquet")]
)
def test_a_wide_table_has_a_column_for_each_quantity_of_a_servo(
    name: str, suffix: str, hold: bool, tmp_path: Path, capsys: Capsys
) -> None:
    out = tmp_path / f"x{suffix}"
    ran = within(capsys, "convert", CAPTURES / name, out, "--wide", *(["--hold"] if hold else []))
    assert ran.status == 0
    assert [p.name for p in tmp_path.iterdir()] == [out.name]
    want = expected(CAPTURES / name, hold=hold)
    assert len(want) > 100
    assert rows_of(out) == want


def test_a_wide_table_of_two_buses_holds_the_values_of_each(tmp_path: Path, capsys: Capsys) -> None:
    source = tmp_path / "two.log"
    lines = log(talk(6)).splitlines(keepends=True)
    other = [line.replace("bus0", "arm") for line in log(talk(6, seed=2)).splitlines(keepends=True)]
    source.write_text("".join(line for pair in zip(lines, other, strict=False) for line in pair))
    assert within(capsys, "convert", source, tmp_path / "x.csv", "--wide", "--hold").status == 0
    want = expected(source, hold=True)
    assert {row["bus"] for row in want} == {"bus0", "arm"}
    for bus in ("bus0", "arm"):
        got = [row for row in rows_of(tmp_path / "x.csv") if row["bus"] == bus]
        assert got == [row for row in want if row["bus"] == bus]


def test_a_wide_table_larger_than_a_piece_is_the_same(
    tmp_path: Path, capsys: Capsys, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr("sniffer.sinks.wide.CELLS", 200)
    assert within(capsys, "convert", LOG, tmp_path / "x.csv", "--wide", "--hold").status == 0
    assert rows_of(tmp_path / "x.csv") == expected(LOG, hold=True)


STEP_NS = 20_000_000


def on_a_grid(source: Path, *, hold: bool) -> dict[tuple[str, int], dict[str, float]]:
    """Return what each row of a grid has, made of the values one by one."""
    plain = expected(source, hold=False)
    out: dict[tuple[str, int], dict[str, float]] = {}
    for bus in {str(row["bus"]) for row in plain}:
        mine = [row for row in plain if row["bus"] == bus]
        last: dict[str, float] = {}
        slots: dict[int, dict[str, float]] = {}
        for row in mine:
            said = {k: float(v) for k, v in row.items() if isinstance(v, float | int)}
            at = -(-int(said.pop("t_ns")) // STEP_NS) * STEP_NS
            slots[at] = slots.get(at, {}) | said
        for at in range(min(slots), max(slots) + 1, STEP_NS):
            last = (last if hold else {}) | slots.get(at, {})
            out[bus, at] = last
    return out


@in_turn(2)
@pytest.mark.parametrize("hold", [False, True])
@pytest.mark.parametrize(
    ("name", "suffix"), [("mightyzap_damaged.log", ".csv"), ("wck_damaged.log", ".parquet")]
)
def test_a_wide_table_at_50_hz_has_what_was_said_last_in_each_step(
    name: str, suffix: str, hold: bool, tmp_path: Path, capsys: Capsys
) -> None:
    out = tmp_path / f"x{suffix}"
    how = ["--wide", "--every", "20ms", *(["--hold"] if hold else [])]
    ran = within(capsys, "convert", CAPTURES / name, out, *how)
    assert ran.status == 0, ran.err
    rows = rows_of(out)
    got = {
        (str(row["bus"]), int(row["t_ns"] or 0)): {
            k: v for k, v in row.items() if k not in ("bus", "t_ns") and v is not None
        }
        for row in rows
    }
    assert len(got) == len(rows) > 200
    assert got == on_a_grid(CAPTURES / name, hold=hold)


def spaced_rows(
    times: I64, columns: I64, values: F64, cuts: list[int]
) -> list[tuple[int, dict[int, float]]]:
    """Return the rows of values that come in pieces, each its ms and what it has of each column."""
    spaced, out = Spaced(STEP_NS), []
    pieces = [np.split(part, cuts) for part in (times, columns, values)]
    made = [spaced.take(*piece) for piece in zip(*pieces, strict=True) if len(piece[0])]
    for t_ns, row, column, value in [*made, spaced.rest()]:
        told: list[dict[int, float]] = [{} for _ in t_ns]
        for nth, which, said in zip(row, column, value, strict=True):
            told[nth][int(which)] = float(said)
        out += list(zip((t_ns // 1_000_000).tolist(), told, strict=True))
    return out


def test_rows_a_step_apart_do_not_depend_on_how_the_values_come() -> None:
    times = np.array([3, 17, 21, 65, 65, 141]) * 1_000_000
    columns = np.array([0, 0, 1, 0, 1, 1])
    values = np.arange(6.0)
    want: list[tuple[int, dict[int, float]]] = [
        (20, {0: 1.0}), (40, {1: 2.0}), (60, {}), (80, {0: 3.0, 1: 4.0}),
        (100, {}), (120, {}), (140, {}), (160, {1: 5.0}),
    ]  # fmt: skip
    for cuts in ([], [1], [2, 3], [1, 2, 3, 4, 5], [4]):
        assert spaced_rows(times, columns, values, cuts) == want, cuts


def test_rows_go_on_where_the_clock_was_set_back() -> None:
    times = np.array([9_003, 9_017, 9_065, 5_001, 5_030, 3_999]) * 1_000_000
    columns, values = np.array([0, 0, 1, 0, 1, 0]), np.arange(6.0)
    want: list[tuple[int, dict[int, float]]] = [
        (9_020, {0: 1.0}), (9_040, {}), (9_060, {}), (9_080, {1: 2.0}),
        (5_020, {0: 3.0}), (5_040, {1: 4.0}), (4_000, {0: 5.0}),
    ]  # fmt: skip
    for cuts in ([], [3], [5], [1, 2, 3, 4, 5], [2, 4]):
        assert spaced_rows(times, columns, values, cuts) == want, cuts


def test_a_clock_that_leaps_by_years_makes_no_endless_table(tmp_path: Path, capsys: Capsys) -> None:
    source = tmp_path / "leap.log"
    lines = log(talk(6)).splitlines(keepends=True)
    late = [line.replace("(1", "(3", 1) for line in lines]
    source.write_text("".join(lines + late))
    how = ("--wide", "--every", "20ms")
    ran = within(capsys, "convert", source, tmp_path / "x.csv", *how)
    assert ran.status == 2
    assert "the clock leaps by 2e+09 s; take a part with --from and --to" in ran.err


@pytest.mark.parametrize("given", ["20", "0.1ms", "often"])
def test_a_step_that_is_none_or_goes_without_a_wide_table_is_refused(
    given: str, tmp_path: Path, capsys: Capsys
) -> None:
    ran = within(capsys, "convert", LOG, tmp_path / "x.csv", "--every", given)
    assert ran.status == 2
    why = "write a time of 1 ms or more, such as 1s or 100ms"
    assert ("--every goes with --wide" if given == "20" else why) in ran.err


@pytest.mark.parametrize(
    ("given", "told"), [("50Hz", "20ms"), ("50 hz", "20ms"), ("3 Hz", "333.333333ms")]
)
def test_a_rate_is_told_as_the_step_that_it_is(
    given: str, told: str, tmp_path: Path, capsys: Capsys
) -> None:
    out = tmp_path / "x.csv"
    ran = within(capsys, "convert", LOG, out, "--wide", "--every", given)
    assert ran.status == 2
    assert f"{given!r}: write a time of 1 ms or more, here {told}" in ran.err
    assert within(capsys, "convert", LOG, out, "--wide", "--every", told).status == 0


@pytest.mark.parametrize(
    ("names", "titles"),
    [
        (["bus0:1=elbow", "arm:1=knee"], {"elbow", "knee"}),
        (["1=knee"], {"knee"}),
        (["1=knee", "2=knee"], {"1 knee", "2 knee"}),
        (["1=2"], {"1 2", "2"}),
        (["bus0:1==evil"], {"'=evil", "1"}),
    ],
)
def test_columns_have_the_names_of_servos_and_no_two_share_one(
    names: list[str], titles: set[str], tmp_path: Path, capsys: Capsys
) -> None:
    path, out = tmp_path / "x.log", tmp_path / "x.csv"
    left = log(talk(4)).splitlines()
    path.write_text("\n".join(sorted(left + [line.replace("bus0", "arm") for line in left])))
    options = [word for name in names for word in ("--name", name)]
    assert within(capsys, "convert", path, out, "--wide", *options).status == 0
    with out.open(newline="") as file:
        head = next(csv.reader(file))
    assert len(set(head)) == len(head)
    assert {title.rpartition(".")[0] for title in head[2:]} >= titles
    assert not any(title.startswith("1.") for title in head if "1" not in titles)
