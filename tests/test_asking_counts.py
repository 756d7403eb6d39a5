"""Of a selection, what is selected is counted, written and compared, and it is said."""

from __future__ import annotations

import csv
import io
import json
import re
from pathlib import Path
from typing import TYPE_CHECKING, Any, Final

import pytest

from sniffer.inside.filters import filter_of
from tests.commands import two_buses, within
from tests.lists import each_in_turn
from tests.schemas import hold_to

if TYPE_CHECKING:
    from tests.commands import Ran

Capsys = pytest.CaptureFixture[str]

CAPTURES: Final = Path(__file__).parents[1] / "sample_captures"
CLEAN: Final = CAPTURES / "mightyzap_clean.log"
DAMAGED: Final = CAPTURES / "mightyzap_damaged.log"


def lines(ran: Ran) -> list[dict[str, Any]]:
    assert ran.status == 0, ran.err
    return [json.loads(line) for line in ran.out.splitlines()]


def figures(capsys: Capsys, capture: Path, *options: str) -> dict[str, Any]:
    """Return what ``stats`` tells of a capture, as the schema has it."""
    [told] = lines(within(capsys, "stats", capture, "--format", "json", *options))
    hold_to("stats", told)
    return told


@pytest.mark.parametrize("name", ["mightyzap_damaged.log", "wck_damaged.log"])
def test_what_is_counted_of_a_servo_is_what_the_whole_says_of_it(name: str, capsys: Capsys) -> None:
    whole = figures(capsys, CAPTURES / name)["buses"][0]
    for servo in whole["servos"][:2]:
        who = servo["servo_id"]
        told = figures(capsys, CAPTURES / name, "--servo", str(who))
        assert told["selection"]["where"] == f"servo_id = {who}"
        part = told["buses"][0]
        assert part["servos"] == [servo], "goals, errors and steps are judged by all that was said"
        assert part["seconds"] == whole["seconds"], "a rate is one over all the time"
        shares = {"bytes_share": 0}
        assert [c | shares for c in part["commands"] if c["servo_id"] == who] == [
            c | shares for c in whole["commands"] if c["servo_id"] == who
        ]
        counts = ("code", "count", "t_ns", "offsets", "rate_hz")
        assert [[a[k] for k in counts] for a in part["anomalies"]] == [
            [a[k] for k in counts] for a in whole["anomalies"] if a["servo_id"] == who
        ]


@each_in_turn(
    2,
    "where",
    [
        "servo_id = 3 AND op = 'store_data'",
        "outcome = 'no_response'",
        "kind = 'request' AND length > 9",
        "value > 20",
        "reason IS NOT NULL",
        "code = 'no-response'",
    ],
)
def test_the_frames_that_are_counted_and_written_are_those_of_the_table(
    where: str, tmp_path: Path, capsys: Capsys
) -> None:
    table = within(capsys, "decode", DAMAGED, "--where", where).out.split("\n\n")[0]
    shown = [line for line in table.splitlines()[1:] if " > " in line or " < " in line]
    bus = figures(capsys, DAMAGED, "--where", where)["buses"][0]
    assert bus["frames"] == len(shown)
    assert bus["bytes"] == bus["bytes_in_frames"] + bus["bytes_in_gaps"]
    log, raw = tmp_path / "x.log", tmp_path / "x.bin"
    ran = within(capsys, "convert", DAMAGED, log, raw, "--where", where)
    assert ran.status == 0, ran.err
    assert f"{log} has the selected frames only" in ran.err
    assert len(log.read_text().splitlines()) == len(shown)
    assert raw.stat().st_size == bus["bytes_in_frames"]


def test_the_first_line_says_that_it_is_a_selection(capsys: Capsys) -> None:
    ran = within(capsys, "stats", DAMAGED, "--servo", "3", "--op", "store_data")
    told = "selection, servo_id = 3 AND op = 'store_data': 7 of 1448 frames, 6 of 841 transactions"
    assert ran.out.splitlines()[0] == told
    for command in (["discover"], ["query", "SELECT 1"], ["stats", "--format", "csv"]):
        ran = within(capsys, *command, DAMAGED, "--servo", "3")
        assert "sniffer: selection, servo_id = 3: 408 of 1448 frames" in ran.err


def test_only_an_exchange_that_is_selected_is_a_retry_and_what_stands_before_it_counts(
    capsys: Capsys,
) -> None:
    whole = figures(capsys, DAMAGED)["buses"][0]["commands"]
    part = figures(capsys, DAMAGED, "--where", "outcome = 'no_response'")["buses"][0]["commands"]
    assert sum(c["missing"] for c in part) == sum(c["missing"] for c in whole)
    assert sum(c["retries"] for c in part) <= sum(c["retries"] for c in whole)


def test_the_tables_of_a_query_are_the_rows_of_the_json_lines(capsys: Capsys) -> None:
    where = ["--servo", "1,2", "--from", "1", "--to", "3"]
    rows = lines(within(capsys, "decode", DAMAGED, "--format", "jsonl", *where))[1:-1]
    for table in ("transactions", "anomalies"):
        sql = f"SELECT count(*) AS n FROM {table}"
        [told] = lines(within(capsys, "query", sql, DAMAGED, "--format", "json", *where))
        assert told["n"] == sum(
            row["type"] == table.replace("ies", "y").rstrip("s") for row in rows
        )


def test_bytes_of_what_is_selected_are_looked_into_and_no_others(capsys: Capsys) -> None:
    ran = within(capsys, "discover", CLEAN, "--servo", "2")
    assert "bytes of servo 2 that" in ran.out
    assert "servo 1" not in ran.out
    ran = within(capsys, "discover", CLEAN, "--op", "echo")
    told = "op = 'echo': no byte of a register is in the frames it selects"
    assert (ran.status, ran.complaint) == (2, told)


def test_a_table_has_the_selected_rows_and_one_that_can_have_none_is_told(
    tmp_path: Path, capsys: Capsys
) -> None:
    wide = tmp_path / "wide.csv"
    ran = within(
        capsys, "convert", DAMAGED, wide, "--wide", "--servo", "3", "--from", "1", "--to", "2"
    )
    assert ran.status == 0, ran.err
    head, *rows = csv.reader(io.StringIO(wide.read_text()))
    assert rows
    assert {name.partition(".")[0] for name in head[2:]} == {"3"}
    ran = within(capsys, "convert", DAMAGED, tmp_path / "x.csv", "--op", "store_data")
    assert f"{tmp_path / 'x.csv'} has no rows: samples have no op; ask for `value IS" in ran.err
    ran = within(capsys, "convert", DAMAGED, tmp_path / "z.csv", "--code", "no-response")
    assert 'samples have no code; `sniffer query "SELECT * FROM anomalies" FILE`' in ran.err
    told = ["--op", "store_data", "--where", "value IS NOT NULL"]
    ran = within(capsys, "convert", DAMAGED, tmp_path / "y.csv", *told)
    assert "has no rows" not in ran.err
    registers = {
        row["register"] for row in csv.DictReader((tmp_path / "y.csv").read_text().splitlines())
    }
    assert "moving_speed" in registers
    assert "present_position" not in registers


@pytest.mark.parametrize(
    ("asked", "rows"),
    [
        (("--code", "damaged-response"), "anomalies"),
        (("--where", "reason = 'damaged'"), "gaps"),
    ],
)
def test_a_file_of_bytes_of_what_is_no_frame_says_that_it_has_none(
    asked: tuple[str, str],
    rows: str,
    tmp_path: Path,
    capsys: Capsys,
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    out = tmp_path / "x.hex"
    ran = within(capsys, "convert", DAMAGED, out, *asked)
    assert (ran.status, out.read_text()) == (0, "")
    told = f"{out} has no bytes: {rows} are no frames; `sniffer decode` shows theirs"
    assert told in ran.err
    monkeypatch.setenv("COLUMNS", "200")  # who is piped gets it whole, who has 80 columns does not
    shown = within(capsys, "decode", DAMAGED, *asked).out
    assert "FF FF FF" in shown


def test_a_recording_of_frames_alone_would_be_a_lie(tmp_path: Path, capsys: Capsys) -> None:
    ran = within(capsys, "convert", DAMAGED, tmp_path / "x.mcap", "--servo", "3")
    told = "a recording has every byte of its buses: frames alone go into a .log"
    assert (ran.status, ran.complaint) == (2, told)


def test_two_runs_are_compared_in_what_is_selected(capsys: Capsys) -> None:
    ran = within(capsys, "diff", CLEAN, DAMAGED, "--servo", "1", "--from", "1", "--to", "3")
    first, a, b = ran.out.splitlines()[:3]
    assert first == "of each what is selected: servo_id = 1; from second 1 to second 3"
    assert ": 2.0 s, 55 answers expected, 0 failed" in a
    assert ": 2.0 s" in b
    ran = within(capsys, "diff", CLEAN, DAMAGED, "--kind", "request")
    assert ran.out.splitlines()[1].endswith(": 8.0 s, 855 frames"), "no word of answers"
    ran = within(capsys, "diff", CLEAN, DAMAGED, "--code", "no-response")
    assert ran.out.splitlines()[1].endswith(": 8.0 s")
    for options, told in (
        (["--servo", "9"], "servo_id = 9: neither run has any of it"),
        (["--from", "12:00"], "two runs have no date in common: write seconds of each, as in 10"),
    ):
        ran = within(capsys, "diff", CLEAN, DAMAGED, *options)
        assert ran.status == 2
        assert told in ran.err


@pytest.fixture
def begun(monkeypatch: pytest.MonkeyPatch) -> list[dict[str, Any]]:
    """Note what the screen would be begun with."""
    calls: list[dict[str, Any]] = []
    monkeypatch.setattr(
        "sniffer.inside.session.look_inside", lambda *given, **more: calls.append(more)
    )
    return calls


def test_a_screen_begins_with_the_filter_that_is_asked_for(
    begun: list[dict[str, Any]], capsys: Capsys
) -> None:
    assert within(capsys, "open", DAMAGED, "--servo", "3", "--kind", "request").status == 0
    text = begun[0]["selection"].text
    assert text == "servo_id = 3 AND kind = 'request'"
    assert filter_of(text) is not None, "the filter line takes it as it is"


def test_lines_of_a_selection_are_no_capture_and_those_of_a_part_are_one(
    tmp_path: Path, capsys: Capsys
) -> None:
    some, part = tmp_path / "some.jsonl", tmp_path / "part.jsonl"
    assert within(capsys, "convert", DAMAGED, some, "--servo", "3").status == 0
    assert json.loads(some.read_text().splitlines()[0]) == {
        "type": "selection",
        "where": "servo_id = 3",
        "tables": ["frames", "transactions", "samples", "anomalies"],
    }
    ran = within(capsys, "decode", some)
    assert ran.status == 2
    assert "these lines are a selection (servo_id = 3)" in ran.err
    assert within(capsys, "decode", DAMAGED, "--to", "2", "-o", part, "--quiet").status == 0
    assert within(capsys, "decode", part).status == 0


@pytest.fixture(scope="module")
def parts(tmp_path_factory: pytest.TempPathFactory) -> list[Path]:
    """Cut a capture into two files, as a rotation would."""
    folder = tmp_path_factory.mktemp("parts")
    lines = DAMAGED.read_text().splitlines(keepends=True)
    out = [folder / "a.log", folder / "b.log"]
    for path, half in zip(out, (lines[: len(lines) // 2], lines[len(lines) // 2 :]), strict=True):
        path.write_text("".join(half))
    return out


def test_several_files_are_captures_of_their_own_or_together_one(
    parts: list[Path], tmp_path: Path, capsys: Capsys
) -> None:
    whole = figures(capsys, DAMAGED)["buses"]
    told = lines(within(capsys, "stats", *reversed(parts), "--together", "--format", "json"))
    assert [one["buses"] for one in told] == [whole], "in the order of their times"
    assert len(lines(within(capsys, "stats", *parts, "--format", "json"))) == 2
    [cause] = lines(within(capsys, "diagnose", *parts, "--together", "--format", "json"))
    [alone] = lines(within(capsys, "diagnose", DAMAGED, "--format", "json"))
    assert cause == alone
    rules = tmp_path / "rules.toml"
    rules.write_text(within(capsys, "check", "--example").out)
    for together, captures in (([], 2), (["--together"], 1)):
        ran = within(capsys, "check", *parts, "--rules", rules, *together)
        assert ran.status in (0, 1), ran.err
        heads = [line for line in ran.out.splitlines() if line and not line.startswith(" ")]
        assert len(heads) == captures


@pytest.mark.parametrize("form", ["text", "json", "csv"])
def test_figures_of_one_bus_have_no_rows_of_the_others(
    form: str, tmp_path: Path, capsys: Capsys
) -> None:
    capture = two_buses(tmp_path / "two.log", DAMAGED)
    told = within(capsys, "stats", capture, "--bus", "leg", "--format", form).out
    assert set(re.findall(r"\b(?:arm|leg)\b", told)) == {"leg"}
    every = within(capsys, "stats", capture, "--format", form).out
    assert set(re.findall(r"\b(?:arm|leg)\b", every)) == {"arm", "leg"}
