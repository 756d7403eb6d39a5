"""Names of servos in what programs read: JSON lines and tables."""

from __future__ import annotations

import csv
import json
import re
from typing import TYPE_CHECKING

import pytest
from pyarrow import parquet

from tests.commands import sniffer
from tests.recordings import messages
from tests.streams import mightyzap, rs30x
from tests.test_names import CLEAN, DAMAGED, two_buses
from tests.test_names_shown import LONG

if TYPE_CHECKING:
    from pathlib import Path

RS30X_ANSWER = rs30x.returned(2, 0x2A, b"\x10\x01")
RS30X_AT = 4 * len(rs30x.packet(2, 0x0F, 0x2A, 2, 0) + RS30X_ANSWER) - 2
MIGHTYZAP = mightyzap.packet(1, 0xF2, b"\x8c\x02") + mightyzap.packet(1, 0, b"\xff\x07")


@pytest.fixture(scope="module")
def both(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """Return a recording of two buses; servo 1 of arm and servo 2 of both have names."""
    told = ("--name", f"arm:1={LONG}", "--name", "2=wrist", "--name", "leg:2=ankle")
    return two_buses(tmp_path_factory.mktemp("names"), *told)


def test_records_have_a_name_behind_the_id_where_there_is_one_and_nothing_else_is_new(
    both: Path, tmp_path: Path
) -> None:
    known = {("arm", 1): LONG, ("arm", 2): "wrist", ("leg", 2): "ankle"}
    met = set()
    for line in sniffer("decode", both, "--format", "jsonl", "--to", "2").out.splitlines():
        record = json.loads(line)
        who = record.get("bus"), record.get("servo_id")
        named = known.get(who) if record["type"] != "gap" else None
        assert record.get("servo_name") == named
        if named is not None:
            keys = list(record)
            assert keys[keys.index("servo_id") + 1] == "servo_name"
            met.add((record["type"], *who))
    assert {kind for kind, *_ in met} == {"frame", "sample", "transaction", "anomaly"}
    assert {(bus, servo) for _, bus, servo in met} == set(known)
    name = 'a "b" \\ é'
    told, plain = tmp_path / "told.jsonl", sniffer("decode", DAMAGED, "--format", "jsonl").out
    assert sniffer("decode", DAMAGED, "-q", "--name", f"3={name}", "-o", told).status == 0
    lines = told.read_text(encoding="utf-8")
    assert lines.count(name_key := f',"servo_name":{json.dumps(name, ensure_ascii=False)}') > 1000
    assert lines.replace(name_key, "") == plain
    again = sniffer("decode", told, "--summary").out
    assert "1448 frames" in again


def test_tables_have_a_column_of_names_where_they_are_known(both: Path, tmp_path: Path) -> None:
    known = {("arm", "1"): LONG, ("arm", "2"): "wrist", ("leg", "2"): "ankle"}
    table, packed = tmp_path / "x.csv", tmp_path / "x.parquet"
    assert sniffer("convert", both, table, packed, "-q", "--to", "2").status == 0
    for path in (table, tmp_path / "x.frames.csv"):
        rows = list(csv.DictReader(path.read_text(encoding="utf-8").splitlines()))
        assert {(r["bus"], r["servo_id"]) for r in rows if r["servo_name"]} == set(known)
        assert all(r["servo_name"] == known.get((r["bus"], r["servo_id"]), "") for r in rows)
    samples = parquet.read_table(packed).to_pylist()
    assert [r["servo_name"] for r in samples] == [
        known.get((r["bus"], str(r["servo_id"]))) for r in samples
    ]
    plain = tmp_path / "plain.csv"
    assert sniffer("decode", CLEAN, "-q", "-o", plain).status == 0
    assert plain.read_text(encoding="utf-8").splitlines()[0].endswith(',"protocol"')
    assert sniffer("decode", CLEAN, "-q", "--name", "1==1+1", "-o", plain, "--force").status == 0
    assert '"\'=1+1"' in plain.read_text(encoding="utf-8"), "a spreadsheet runs no name"


def test_the_log_of_two_protocols_on_one_line_has_the_names_too(tmp_path: Path) -> None:
    capture, out = tmp_path / "two.bin", tmp_path / "two.mcap"
    torn = bytearray(b"".join(rs30x.packet(2, 0x0F, 0x2A, 2, 0) + RS30X_ANSWER for _ in range(9)))
    torn[RS30X_AT] ^= 1
    capture.write_bytes(MIGHTYZAP * 9 + torn + MIGHTYZAP * 9)
    told = ("--protocol", "mightyzap+rs30x", "--name", "2=elbow", "-q", "-o", out)
    assert sniffer("decode", capture, *told).status == 0
    log = [
        m.message for topic, rows in messages(out).items() if topic.endswith("/log") for m in rows
    ]
    assert any("servo 2 elbow" in line for line in log)
    assert not any(re.search(r"servo 2\b(?! elbow)", line) for line in log)
