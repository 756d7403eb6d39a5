"""Wide tables: a column for each quantity of a servo."""

from __future__ import annotations

import csv
from typing import TYPE_CHECKING

import pyarrow.parquet as pq
import pytest

import sniffer
from sniffer.decoding.fields import tidy
from sniffer.decoding.rows import SampleRow
from sniffer.mcapfile.fields import state_field
from tests.commands import log, talk, within
from tests.test_convert import CAPTURES, LOG, Capsys

if TYPE_CHECKING:
    from pathlib import Path


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
