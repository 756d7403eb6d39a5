"""``sniffer state``: what registers held, by the samples of the capture."""

from __future__ import annotations

import itertools
import json
from collections import Counter
from pathlib import Path
from typing import Any

import pytest

import sniffer
from sniffer.ground.registers import schema_path
from tests.commands import within
from tests.golden import captures
from tests.lists import in_turn
from tests.schemas import hold_to
from tests.streams.mightyzap import packet

SAMPLES = Path(__file__).parents[1] / "sample_captures"
CLEAN = SAMPLES / "mightyzap_clean.log"
Capsys = pytest.CaptureFixture[str]


def told(capsys: Capsys, *arguments: str | Path) -> list[dict[str, Any]]:
    ran = within(capsys, "state", *arguments, "--format", "jsonl")
    assert ran.status == 0, ran.err
    records = [json.loads(line) for line in ran.out.splitlines()]
    for record in records:
        hold_to("state", record)
    return records


@in_turn(3)
@pytest.mark.parametrize("capture", captures(), ids=lambda p: p.name)
def test_what_registers_held_is_what_the_samples_say(capture: Path, capsys: Capsys) -> None:
    pytest.importorskip("pyarrow", reason="samples as a table are the oracle")
    decoded = sniffer.decode(capture)
    kinds = {(row["bus"], row["offset"]): row["kind"] for row in decoded.frames().to_pylist()}
    said: dict[tuple[str, int, str], list[int]] = {}
    written: Counter[tuple[str, int, str]] = Counter()
    for row in decoded.samples().to_pylist():
        if not row["part"]:
            who = -1 if row["servo_id"] is None else row["servo_id"]
            of = row["bus"], who, row["register"]
            said.setdefault(of, []).append(row["raw"])
            written[of] += kinds[row["bus"], row["offset"]] == "request"
    found = told(capsys, capture)
    assert {(r["bus"], r["servo_id"], r["register"]) for r in found} == said.keys()
    for r in found:
        of = r["bus"], r["servo_id"], r["register"]
        raws = said[of]
        changes = sum(a != b for a, b in itertools.pairwise(raws))
        assert (r["count"], r["changes"]) == (len(raws), changes)
        assert (r["reads"], r["writes"]) == (len(raws) - written[of], written[of])
        assert (r["first"]["raw"], r["last"]["raw"]) == (raws[0], raws[-1])


def asked(servo: int, at_s: float, delay: int) -> list[str]:
    """Return lines of a log in which a servo's return delay is read."""
    lines = (packet(servo, 0xF2, b"\x05\x01"), packet(servo, 0, bytes([delay])))
    return [f"({at_s + 0.003 * k:.6f}) arm #{data.hex()}" for k, data in enumerate(lines)]


def test_a_setting_that_one_servo_has_otherwise_is_a_line_of_its_own(
    tmp_path: Path, capsys: Capsys
) -> None:
    log = tmp_path / "run.log"
    lines = [
        line for servo in range(1, 5) for line in asked(servo, servo, 250 if servo == 3 else 10)
    ]
    log.write_text("\n".join(lines) + "\n", encoding="ascii")
    ran = within(capsys, "state", log, "--protocol", "mightyzap", "--name", "3=left_hip")
    assert ran.status == 0
    rows = [line.split() for line in ran.out.splitlines() if line.strip()]
    where = rows.index(["settings"])
    delays = rows[where + 2 :]
    assert delays[0][1:4] == ["1,", "2,", "4"]
    assert delays[1][:2] == ["3", "left_hip"]


def test_no_word_is_broken_where_a_terminal_has_room_for_all(
    monkeypatch: pytest.MonkeyPatch, capsys: Capsys
) -> None:
    monkeypatch.setenv("COLUMNS", "80")
    ran = within(capsys, "state", SAMPLES / "lss_clean.bin")
    assert ran.status == 0
    assert max(map(len, ran.out.splitlines())) <= 80
    words = set(ran.out.split())
    assert {"-45.8", "deg", "deg/s", "magenta", "12345671"} <= words


def test_a_part_tells_what_was_said_in_it(capsys: Capsys) -> None:
    whole, part = (told(capsys, CLEAN, *more) for more in ((), ("--to", "2", "--servo", "1")))
    assert {r["servo_id"] for r in part} == {1}
    first = {(r["servo_id"], r["register"]): r for r in whole}
    for r in part:
        of_all = first[1, r["register"]]
        assert r["first"] == of_all["first"]
        assert r["count"] < of_all["count"] or r["last"] == of_all["last"]


def test_a_capture_without_times_tells_the_byte(capsys: Capsys) -> None:
    ran = within(capsys, "state", SAMPLES / "lss_clean.bin")
    assert ran.status == 0
    assert "last at byte" in ran.out
    assert "last at s" not in ran.out


def test_a_capture_in_which_no_register_was_said_tells_so(tmp_path: Path, capsys: Capsys) -> None:
    dump = tmp_path / "echo.hex"
    dump.write_text("FF FF FF 00 02 F1 0C\n" * 9, encoding="ascii")
    ran = within(capsys, "state", dump, "--protocol", "mightyzap")
    assert ran.status == 0
    assert ran.out.startswith("no register was read or written, as far")
    ran = within(capsys, "state", dump, "--protocol", "mightyzap", "--servo", "3")
    assert ran.out.startswith("no register was read or written in what is asked for")


def test_a_capture_in_the_place_of_a_model_is_told_which_command_reads_it(capsys: Capsys) -> None:
    ran = within(capsys, "registers", CLEAN)
    assert (ran.status, ran.out) == (2, "")
    assert ran.complaint.endswith("`sniffer state` tells what registers held in a capture")


def test_a_register_with_a_long_name_leaves_room_for_what_it_held(
    tmp_path: Path, capsys: pytest.CaptureFixture[str], monkeypatch: pytest.MonkeyPatch
) -> None:
    """Whose it was, and what it held first and last, were left out at 80 columns."""
    table = tmp_path / "long.toml"
    known = schema_path("registers/mightyzap-l12.toml").read_text(encoding="utf-8")
    known = known.replace('model = "mightyzap-l12"', 'model = "long"', 1)
    long = "present_voltage_of_the_supply_as_the_servo_itself_measures_it"
    table.write_text(known.replace('name = "present_voltage"', f'name = "{long}"'))
    monkeypatch.setenv("COLUMNS", "80")
    asked = ("--registers", table, "--model", "long")
    out = within(capsys, "state", CLEAN, *asked).out
    measured = out.partition(" measured")[2].splitlines()
    assert measured[1].split()[:4] == ["register", "servos", "first", "last"]
    assert any("12.1 V" in line for line in measured)
    assert max(map(len, measured)) <= 80
    folded = [line[1:22].strip() for line in measured if line.startswith(" ")]
    assert long in "".join(folded)


def test_a_setting_that_changed_more_often_at_one_servo_is_a_line_of_its_own(
    tmp_path: Path, capsys: Capsys
) -> None:
    """Servo 1 was switched off and on twice, servo 2 once on; together they had four changes."""
    log = tmp_path / "a.log"
    sets = [(1, 1), (2, 1), (1, 0), (1, 1), (1, 0), (1, 1)]
    frames = [packet(servo, 0xF3, bytes([0x80, value])) for servo, value in sets]
    log.write_text("".join(f"({k}.0) bus0 #{f.hex()}\n" for k, f in enumerate(frames)))
    out = within(capsys, "state", log, "--protocol", "mightyzap").out
    rows = [line.split() for line in out.splitlines() if "0+" in line]
    assert rows[0][:4] == ["force_on", "1", "on", "(1)"]
    assert [row[-3:-1] for row in rows] == [["0+5", "4"], ["0+1", "0"]]


def test_a_selection_of_frames_alone_is_told_how_it_has_values(capsys: Capsys) -> None:
    """What they state was said not to be there."""
    why = "samples have no kind; ask for `value IS NOT NULL`, too, to have what these frames state"
    select = ["--kind", "response", "--servo", "2"]
    assert why in within(capsys, "state", CLEAN, *select).err
    assert told(capsys, CLEAN, *select, "--where", "value IS NOT NULL")
    assert why not in within(capsys, "state", CLEAN, "--servo", "9").err
    pytest.importorskip("duckdb")
    for table, is_told in (("samples", True), ("frames", False)):
        asked = within(capsys, "query", f"SELECT count(*) FROM {table}", CLEAN, *select)
        assert (f"the table {table} has no rows: {why}" in asked.err) == is_told
