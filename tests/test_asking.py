"""What of a capture is asked for: rows and parts, as a user of the command line meets them."""

from __future__ import annotations

import json
import re
from collections import Counter
from pathlib import Path
from typing import TYPE_CHECKING, Any, Final

import pyarrow.parquet
import pytest

from tests.commands import two_buses, within
from tests.lists import each_in_turn

if TYPE_CHECKING:
    from collections.abc import Sequence

Capsys = pytest.CaptureFixture[str]

CAPTURE: Final = Path(__file__).parents[1] / "sample_captures" / "mightyzap_damaged.log"
BEGINS_NS: Final = 1795215306_000000000
"""A whole second; the first byte is a millisecond and a half behind it."""


def told(capsys: Capsys, *options: str | Path, file: Path = CAPTURE) -> list[dict[str, Any]]:
    """Return the JSON lines; that they are a selection is said in front, and left out here."""
    ran = within(capsys, "decode", file, "--format", "jsonl", *options)
    assert ran.status == 0, ran.err
    rows = [json.loads(line) for line in ran.out.splitlines()]
    return [row for row in rows if row["type"] != "selection"]


@pytest.fixture
def whole(capsys: Capsys) -> list[dict[str, Any]]:
    return told(capsys)


@pytest.mark.parametrize(
    ("options", "keys", "types"),
    [
        (["--servo", "3,1", "--op", "store_data"], ("servo_id", "op"), {"frame", "transaction"}),
        (["--kind", "request", "--servo", "1-3"], ("kind", "servo_id"), {"frame"}),
        (["--code", "no-response", "--code", "bad-checksum"], ("code",), {"anomaly"}),
    ],
)
def test_a_selection_is_the_rows_of_the_whole_that_it_names(
    options: list[str],
    keys: Sequence[str],
    types: set[str],
    whole: list[dict[str, Any]],
    capsys: Capsys,
) -> None:
    *rows, summary = told(capsys, *options)
    values = {key: {row[key] for row in rows} for key in keys}
    expected = [
        row
        for row in whole[:-1]
        if row["type"] in types and all(row[key] in values[key] for key in keys)
    ]
    assert rows == expected
    assert {row["type"] for row in rows} == types
    asked = summary.pop("selection")
    assert summary == whole[-1], "everything is still counted"
    shown = Counter(f"{row['type']}s".replace("anomalys", "anomalies") for row in rows)
    assert {name: n for name, n in asked["shown"].items() if n} == shown


def test_a_part_says_what_the_whole_says_of_that_time_and_accounts_for_its_bytes(
    whole: list[dict[str, Any]], capsys: Capsys
) -> None:
    *rows, summary = told(capsys, "--from", "2.003", "--to", "4.4444")
    low, high = summary["selection"]["from_ns"], summary["selection"]["to_ns"]
    timed = [row for row in whole[:-1] if "t_ns" in row and low <= row["t_ns"] <= high]
    assert [row for row in rows if "t_ns" in row] == timed
    assert [row for row in rows if row not in whole] == [], "no edge is seen in any of them"
    bytes_in = sum(row["length"] for row in rows if row["type"] in ("frame", "gap"))
    assert summary["bytes"] == bytes_in == summary["bytes_in_frames"] + summary["bytes_in_gaps"]
    assert summary["frames"] == sum(row["type"] == "frame" for row in rows) > 100


def test_a_part_of_parts_is_as_large_as_the_whole(
    whole: list[dict[str, Any]], capsys: Capsys
) -> None:
    first, second = (told(capsys, *cut)[:-1] for cut in (["--to", "3.1"], ["--from", "3.1"]))
    of = [Counter(json.dumps(row) for row in rows) for rows in (first, second, whole[:-1])]
    assert of[0] + of[1] == of[2]


@pytest.mark.parametrize(
    ("place", "at_ns"),
    [
        ("2", 2_000000000),
        ("2s", 2_000000000),
        ("2000ms", 2_000000000),
        ("22:55:08", None),
        ("22:55:08.5", None),
        ("2026-11-20T22:55:08.25Z", None),
    ],
)
def test_a_place_is_a_time_in_any_form(place: str, at_ns: int | None, capsys: Capsys) -> None:
    first, *_, summary = told(capsys, "--from", place, "--kind", "request")
    asked = summary["selection"]["from_ns"]
    assert 0 <= first["t_ns"] - asked < 50_000_000
    if at_ns is not None:
        assert abs(asked - BEGINS_NS - at_ns) < 2_000_000


def test_a_place_is_where_something_was_found(whole: list[dict[str, Any]], capsys: Capsys) -> None:
    anomalies = [row for row in whole if row["type"] == "anomaly"]
    errors = [row for row in anomalies if row["severity"] == "error"]
    error = errors[0]
    silent = [row for row in anomalies if row["code"] == "no-response"]
    for place, row in (
        ("@first-error", error),
        (f"@{error['code']}", error),
        ("@error:5", errors[4]),
        ("@no-response:3", silent[2]),
        ("@anomaly:7", anomalies[6]),
        ("@byte:bus0:12175", next(r for r in whole if r.get("offset") == 12173)),
        ("@byte:12175", next(r for r in whole if r.get("offset") == 12173)),
    ):
        asked = told(capsys, "--from", place, "--around", "200ms")[-1]["selection"]
        middle = row["t_ns"]
        assert (asked["from_ns"], asked["to_ns"]) == (middle - 200_000_000, middle + 200_000_000)


@pytest.mark.parametrize(
    ("servo", "meant"),
    [
        ("0x02", "servo_id = 2"),
        ("1,0x03", "servo_id IN (1, 3)"),
        ("bus0:2", "bus = 'bus0' AND servo_id = 2"),
        ("bus0:2,arm:3", "((bus = 'bus0' AND servo_id = 2) OR (bus = 'arm' AND servo_id = 3))"),
    ],
)
def test_servos_are_named_as_manuals_write_ids_and_as_places_name_buses(
    servo: str, meant: str, capsys: Capsys
) -> None:
    ran = within(capsys, "decode", CAPTURE, "--servo", servo, "--format", "jsonl")
    assert json.loads(ran.out.splitlines()[-1])["selection"]["where"] == meant
    by_hand = within(capsys, "decode", CAPTURE, "--where", meant, "--format", "jsonl")
    assert by_hand.out == ran.out


@each_in_turn(
    2,
    ("options", "where", "servo"),
    [
        (["--servo", "3", "--from", "@first-error"], " where servo_id = 3", 3),
        (["--from", "@first-error:servo=2"], "", 2),
        (
            ["--servo", "2", "--op", "store_data", "--from", "@first-error"],
            " where servo_id = 2",
            2,
        ),
        (
            [
                *("--where", "kind = 'request' AND (length > 2 AND servo_id BETWEEN 2 AND 2)"),
                *("--from", "@error:1"),
            ],
            " where servo_id BETWEEN 2 AND 2",
            2,
        ),
        (["--op", "store_data", "--from", "@first-error"], "", None),
        (["--kind", "request", "--from", "@error:1:servo=3"], "", 3),
    ],
)
def test_the_first_error_is_that_of_what_is_selected(
    options: list[str],
    where: str,
    servo: int | None,
    whole: list[dict[str, Any]],
    capsys: Capsys,
) -> None:
    asked = told(capsys, *options, "--around", "200ms")[-1]["selection"]
    errors = [row for row in whole if row.get("severity") == "error"]
    one = next(row for row in errors if servo in (None, row["servo_id"]))
    middle = one["t_ns"]
    assert (asked["from_ns"], asked["to_ns"]) == (middle - 200_000_000, middle + 200_000_000)
    assert asked["part"] == f"0.2 s around {options[-1]}{where}"


@pytest.mark.parametrize(
    ("options", "complaint"),
    [
        (["--servo", "300"], "300 is not in the range"),
        (["--kind", "reqest"], "--kind: there is no 'reqest': did you mean request?"),
        (["--code", "no-respons"], "did you mean no-response?"),
        (["--where", "servo_di = 3"], "did you mean servo_id?"),
        (
            ["--where", "temperature > 33"],
            "temperature is a quantity: write quantity = 'temperature' AND value ...",
        ),
        (
            ["--where", "present_voltage < 9"],
            "is a register: write register = 'present_voltage' AND",
        ),
        (
            ["--where", "response_time_ns > 20ms"],
            "at '20ms' (character 20): this is no number: in ns it is 20000000",
        ),
        (["--where", "value > 20mm"], "at '20mm' (character 9): this is no number"),
        (["--servo", "3", "--where", "length >"], "--where, at its end: expected a column"),
        (
            ["--op", "read", "--code", "noise"],
            "op is of frames and transactions; code is of",
        ),
        (["--from", "@first-eror"], "did you mean first-error?"),
        (["--from", "first-error"], "no place in a capture: did you mean @first-error?"),
        (["--from", "@anomaly:700"], "@anomaly:700: the capture has 69 anomalies"),
        (["--from", "@byte:99999"], "no record of the capture has this byte"),
        (["--from", "@byte:arm:5"], "no record of bus arm has this byte"),
        (["--from", "@no-response:10"], "@no-response:10: the capture has 9 of them"),
        (["--from", "@no-response:x"], "write which of them is meant, as in @no-response:7"),
        (
            ["--from", "@no-response:9", "--servo", "3"],
            "@no-response:9: the capture has 1 of them where servo_id = 3",
        ),
        (
            ["--from", "@first-error:3"],
            "of servo 3 it is @first-error:servo=3; number 3 of them all is @error:3",
        ),
        (["--from", "@first-error:x"], "write @first-error, or of a servo @first-error:servo=3"),
        (["--from", "@noise:servo=arm"], "write the id of a servo, as in @noise:servo=3"),
        (["--from", "@byte:7:servo=3"], "'@byte:7' is one place, of whatever servo: leave"),
        (["--servo", "3..5"], "'3..5' is no servo id: write ids as 3,5 or 3-6"),
        (["--servo", "3-"], "'3-' is no servo id: write ids as 3,5 or 3-6"),
        (["--from", "25:00"], "is no place in a capture: write it like 10, 10min, 20:35:20.5"),
        (["--from", "2026-13-01"], "there is no such day or time"),
        (["--to", "1", "--from", "3"], "--to must lie behind --from"),
        (["--from", "90"], "nothing was said from second 90 to its end: "),
        (["--to", "-1h"], "nothing was said from its beginning to 3600 s before its end: "),
        (["--to", "-1h"], " has at least "),
        (["--around", "1s"], "--around goes with --from or --to"),
        (["--servo", "3", "-o", "x.mcap"], "a recording has every byte of its buses"),
    ],
    ids=str,
)
def test_what_cannot_be_asked_is_told_in_one_line(
    options: list[str], complaint: str, capsys: Capsys
) -> None:
    ran = within(capsys, "decode", CAPTURE, *options)
    assert (ran.status, ran.out) == (2, "")
    assert complaint in ran.err.splitlines()[-1]


def test_a_selection_that_shows_nothing_says_what_is_not_in_the_capture(capsys: Capsys) -> None:
    ran = within(capsys, "decode", CAPTURE, "--op", "stor_data", "--bus", "arm")
    last = " ".join(ran.out.split())
    assert "; op 'stor_data' is not in it: did you mean store_data?" in last
    assert last.endswith("; bus 'arm' is not in it: one of bus0")
    ran = within(capsys, "decode", CAPTURE, "--servo", "2,9")
    assert "is not in it" not in ran.out
    ran = within(capsys, "decode", CAPTURE, "--servo", "7,9")
    last = " ".join(ran.out.split())
    assert last.endswith(
        "; servo 7 is not in it: one of 1, 2, 3, 254; servo 9 is not in it: one of 1, 2, 3, 254"
    )
    for column, odd, meant in (
        ("quantity", "temprature", "temperature"),
        ("register", "present_positon", "present_position"),
        ("register", "torque_enable", "quantity = 'torque_enable'"),
        ("quantity", "present_voltage", "register = 'present_voltage'"),
        ("quantity", "force", "force_limit"),
    ):
        ran = within(capsys, "decode", CAPTURE, "--where", f"{column} = '{odd}'")
        last = " ".join(ran.out.split())
        assert last.endswith(f"; {column} '{odd}' is not in it: did you mean {meant}?")
    ran = within(capsys, "decode", CAPTURE, "--op", "execution", "--servo", "3")
    assert "is not in it" not in ran.out


def test_a_byte_of_any_bus_is_that_of_the_one_bus_which_has_it(
    tmp_path: Path, capsys: Capsys
) -> None:
    path = two_buses(tmp_path / "two.log", CAPTURE)
    ran = within(capsys, "decode", path, "--from", "@byte:18")
    assert (ran.status, ran.out) == (2, "")
    assert ran.err == (
        "sniffer: @byte:18: arm and leg have a byte 18: say of which bus, as in @byte:arm:18\n"
    )
    parts = [
        told(capsys, "--from", place, "--around", "9ms", file=path)[:-1]
        for place in ("@byte:12175", "@byte:arm:12175")
    ]
    assert parts[0] == parts[1] != []


def test_the_first_of_a_kind_is_the_first_in_time_of_all_buses(
    tmp_path: Path, capsys: Capsys
) -> None:
    lines = CAPTURE.read_text().replace(" bus0 ", " leg ").splitlines()
    later = [
        re.sub(r"^\((\d+)", lambda t: f"({int(t[1]) + 2}", line).replace(" leg ", " arm ")
        for line in lines
    ]
    path = tmp_path / "two.log"
    path.write_text("\n".join([lines[0].replace(" leg ", " arm "), *sorted([*lines, *later])]))
    anomalies = [row for row in told(capsys, file=path) if row["type"] == "anomaly"]
    for place, key, value, nth in (
        ("@first-error", "severity", "error", 0),
        ("@no-response:3", "code", "no-response", 2),
    ):
        times = sorted(row["t_ns"] for row in anomalies if row[key] == value)
        part = told(capsys, "--from", place, file=path)[-1]["selection"]
        assert part["from_ns"] == times[nth]


def test_a_time_of_day_needs_a_clock(capsys: Capsys) -> None:
    hex_dump = CAPTURE.with_name("mightyzap_manual.hex")
    ran = within(capsys, "decode", hex_dump, "--from", "22:55")
    assert ran.status == 2
    assert "the input has no clock" in ran.err
    assert told(capsys, "--from", "0.02", file=hex_dump)[-1]["bytes"] < 340


@each_in_turn(2, "protocol", ["lss", "mightyzap", "rs30x", "wck"])
def test_what_is_looked_for_is_found_without_a_clock_too(
    protocol: str, tmp_path: Path, capsys: Capsys
) -> None:
    raw = tmp_path / "raw.bin"
    capture = CAPTURE.with_name(f"{protocol}_damaged.log")
    assert within(capsys, "convert", capture, raw, "-q").status == 0
    every = [row for row in told(capsys, file=raw) if row["type"] in ("frame", "gap")]
    part = told(capsys, "--from", "@byte:1000", "--to", "@byte:1100", file=raw)
    assert [row for row in part if row["type"] in ("frame", "gap")] == [
        row for row in every if row["offset"] + row["length"] > 1000 and row["offset"] <= 1100
    ]
    first = next(row for row in told(capsys, file=raw) if row["type"] == "anomaly")
    found = told(capsys, "--from", "@anomaly:1", "--to", "@anomaly:1", file=raw)
    assert first in found


def test_tables_have_the_selected_rows_only(tmp_path: Path, capsys: Capsys) -> None:
    path = tmp_path / "x.parquet"
    asked = ("--where", "servo_id = 3 AND t_ns > 0", "--quiet", "-o", path)
    assert within(capsys, "decode", CAPTURE, *asked).status == 0
    for file in (path, path.with_name("x.frames.parquet")):
        table = pyarrow.parquet.read_table(file)
        assert len(table) > 100
        assert set(table.column("servo_id").to_pylist()) == {3}


def test_only_what_is_shown_fails_a_build(capsys: Capsys) -> None:
    asked = ("decode", CAPTURE, "--quiet", "--fail-on", "note")
    assert within(capsys, *asked).status == 1
    assert within(capsys, *asked, "--servo", "77").status == 0
    assert within(capsys, *asked, "--code", "no-response").status == 1


def test_a_line_that_is_there_for_a_value_says_that_value_and_no_other(
    whole: list[dict[str, Any]], capsys: Capsys
) -> None:
    low = [r for r in whole if r["type"] == "sample" and r["quantity"] == "voltage"]
    low = [row for row in low if row["value"] < 10]
    ran = within(capsys, "decode", CAPTURE, "--where", "quantity = 'voltage' AND value < 10")
    lines = ran.out.splitlines()[1 : 1 + len(low)]
    assert all(
        f"load_data voltage {row['value']:.4g} V " in re.sub(" +", " ", line) + " "
        for row, line in zip(low, lines, strict=True)
    )
    assert not any("position" in line for line in lines)
    goals = within(
        capsys, "decode", CAPTURE, "--servo", "3", "--where", "quantity = 'goal_position'"
    ).out
    shared = [line for line in goals.splitlines() if "symmetric_store" in line]
    assert shared
    assert all(" 3: " in line and " 2: " not in line for line in shared)


def test_figures_of_anomalies_alone_do_not_tell_of_no_bytes(capsys: Capsys) -> None:
    said = within(capsys, "stats", CAPTURE, "--code", "no-response").out
    assert "bytes" not in said
    assert "load" not in said
    assert said.count("no-response") == 1 + 3


def test_a_part_that_has_an_anomaly_and_not_a_byte_is_told_as_it_is(
    tmp_path: Path, capsys: Capsys
) -> None:
    """The clock went back: when the first error was found, nothing was said."""
    path = tmp_path / "back.log"
    path.write_text("(5.404) bus0 #FFFFFF0205F386360346\n(2.881) bus0 #FFFFFF0204003303C3\n")
    ran = within(
        capsys,
        "decode",
        path,
        "--from",
        "@first-error",
        "--around",
        "1s",
        "--protocol",
        "mightyzap",
    )
    assert ran.status == 0, ran.err
