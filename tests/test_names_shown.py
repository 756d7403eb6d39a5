"""Names of servos where people read: figures, causes, reports; and selections by name."""

from __future__ import annotations

import csv
import io
import json
from typing import TYPE_CHECKING

import pytest

from tests.commands import sniffer
from tests.lists import each_in_turn, in_turn
from tests.schemas import hold_to
from tests.test_names import CLEAN, DAMAGED, two_buses
from tests.test_rerun import read

if TYPE_CHECKING:
    from pathlib import Path

LONG = "left_shoulder_pitch_"


@pytest.fixture(scope="module")
def both(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """Return a recording of two buses; servo 1 of arm and servo 2 of both have names."""
    told = ("--name", f"arm:1={LONG}", "--name", "2=wrist", "--name", "leg:2=ankle")
    return two_buses(tmp_path_factory.mktemp("names"), *told)


def of_bus(text: str, bus: str) -> str:
    """Return what is printed of a bus."""
    buses = {"arm": "", "leg": ""}
    now = ""
    for line in text.splitlines(keepends=True):
        now = next((name for name in buses if line.startswith(f"{name}: ")), now)
        if now:
            buses[now] += line
    return buses[bus]


@pytest.mark.parametrize("command", [("stats",), ("decode", "--summary")])
def test_tables_have_the_names_that_a_recording_has_each_bus_its_own(
    command: tuple[str, ...], both: Path
) -> None:
    shown = sniffer(*command, both).out
    assert f"  1 {LONG}  " in of_bus(shown, "arm")
    assert "  2 wrist  " in of_bus(shown, "arm")
    assert "  2 ankle  " in of_bus(shown, "leg")
    assert LONG not in of_bus(shown, "leg")
    assert "wrist" not in of_bus(shown, "leg")


def test_a_name_told_now_stands_in_place_of_the_one_that_was_recorded(both: Path) -> None:
    shown = sniffer("stats", both, "--name", "2=hand").out
    assert "2 hand" in of_bus(shown, "arm")
    assert "2 hand" in of_bus(shown, "leg")


@in_turn(2)
@pytest.mark.parametrize("columns", ["80", "140"])
def test_no_name_is_cut_in_a_narrow_terminal(columns: str, both: Path) -> None:
    for command in (("stats",), ("decode", "--summary"), ("diagnose",)):
        shown = sniffer(*command, both, env={"COLUMNS": columns}).out
        assert "…" not in shown
        assert max(map(len, shown.splitlines())) <= int(columns)


def test_a_table_without_room_for_names_has_ids_and_breaks_no_word(both: Path) -> None:
    narrow = of_bus(sniffer("stats", both, env={"COLUMNS": "80"}).out, "arm")
    assert f"\n  servos: 1 {LONG}, 2 wrist\n" in narrow
    traffic = narrow.split(" traffic, ")[1].split("\n\n")[0].splitlines()[2:]
    assert {line.split()[0] for line in traffic} == {"1", "2", "3", "254"}
    assert {"load_data", "symmetric_store"} <= {line.split()[1] for line in traffic}
    assert f"\n 1 {LONG} " in narrow.split(" following error ")[1]
    summary = of_bus(sniffer("decode", both, "--summary", env={"COLUMNS": "80"}).out, "arm")
    assert f"\n  servos: 1 {LONG}, 2 wrist\n" in summary
    assert " load_data 202/193,\n" in summary, "no command is broken"
    wide = of_bus(sniffer("stats", both, env={"COLUMNS": "140"}).out, "arm")
    assert "servos: 1" not in wide
    assert f"\n  1 {LONG} " in wide.split(" traffic, ")[1]


def test_figures_for_programs_have_a_name_beside_the_id_where_there_is_one(both: Path) -> None:
    figures = json.loads(sniffer("stats", both, "--format", "json").out)
    hold_to("stats", figures)
    for bus in figures["buses"]:
        known = {"arm": {1: LONG, 2: "wrist"}, "leg": {2: "ankle"}}[bus["bus"]]
        for key in ("commands", "servos", "anomalies"):
            for row in bus[key]:
                assert row.get("servo_name") == known.get(row["servo_id"])
                assert row["servo_id"] != 3 or "servo_name" not in row
    told = list(csv.DictReader(io.StringIO(sniffer("stats", both, "--format", "csv").out)))
    assert {(r["bus"], r["servo_id"], r["servo_name"]) for r in told if r["servo_name"]} == {
        ("arm", "1", LONG),
        ("arm", "2", "wrist"),
        ("leg", "2", "ankle"),
    }


@pytest.mark.parametrize("form", ["json", "csv", "text"])
def test_without_names_figures_are_what_they_were(form: str) -> None:
    shown = sniffer("stats", CLEAN, "--format", form).out
    assert "servo_name" not in shown


@in_turn(2)
@pytest.mark.parametrize("columns", ["140", "200", None])
def test_wide_lines_have_names_and_stay_aligned(columns: str | None, both: Path) -> None:
    env = None if columns is None else {"COLUMNS": columns}
    shown = sniffer("decode", both, "--from", "2", "--to", "3", "--where", "servo_id < 3", env=env)
    head, *lines = [line for line in shown.out.splitlines() if line.startswith(("time", "2"))]
    at = head.index("command")
    for bus, who in (("arm", f"1 {LONG}"), ("arm", "2 wrist"), ("leg", "1"), ("leg", "2 ankle")):
        there = [line for line in lines if line[16:19] == bus and line[22 : at - 2].strip() == who]
        assert there, (bus, who)
        assert all(line[at - 2] in "<>!" and line[at - 1] == " " for line in there)
    assert {line[16:19] for line in lines} == {"arm", "leg"}


def test_narrow_lines_keep_their_room_for_values(both: Path) -> None:
    asked = ("decode", both, "--from", "2", "--to", "3")
    named = sniffer(*asked, env={"COLUMNS": "80"}).out
    assert not any("wrist" in line for line in named.splitlines() if line.startswith("22:"))


def test_causes_and_what_was_found_name_the_servos(both: Path) -> None:
    shown = " ".join(sniffer("diagnose", both).out.split())
    assert f"brownout of servo 1 {LONG} on arm (99 %)" in shown
    assert f"the supply breaks down (servo 1 {LONG})" in shown
    assert f"supply of servo 1 {LONG} sags to 6.9 V" in shown
    assert "duplicate-id of servo 2 wrist" in shown
    assert "servo 1 sags" not in shown


def test_what_programs_read_of_a_diagnosis_has_names_beside_ids_and_no_others(both: Path) -> None:
    told = json.loads(sniffer("diagnose", both, "--format", "json").out)
    hold_to("diagnosis", told)
    findings = [(i["bus"], f) for i in told["incidents"] for f in i["findings"]]
    known = {("arm", 1): LONG, ("arm", 2): "wrist", ("leg", 2): "ankle"}
    assert {("arm", 1), ("arm", 2)} <= {(bus, f["servo_id"]) for bus, f in findings}
    for bus, finding in findings:
        assert finding.pop("servo_name", None) == known.get((bus, finding["servo_id"]))
    assert LONG not in json.dumps(told)
    assert any("servo 1" in incident["story"] for incident in told["incidents"])


def test_how_causes_were_weighed_names_the_servos() -> None:
    shown = sniffer("diagnose", DAMAGED, "--name", "1=elbow", "--why", "1").out
    assert "servo 1 elbow" in shown.splitlines()[0]


def test_what_no_cause_explains_is_told_with_names_of_its_bus(tmp_path: Path) -> None:
    from sniffer.decoding.called import ServoNames
    from sniffer.diagnosis.rest import Rest, Unexplained

    parts = (
        Unexplained("arm", "a", 2, (1,), "2 x a (servo 1) on arm"),
        Unexplained("leg", "b", 3, (1, 2), "3 x b (servos 1, 2)"),
    )
    rest = Rest(", ".join(part.words for part in parts), parts=parts)
    names = ServoNames({("arm", 1): "elbow", ("leg", 2): "knee"})
    assert rest.named(names).told == "2 x a (servo 1 elbow) on arm, 3 x b (servos 1, 2 knee)"
    assert rest.named(ServoNames()) is rest


@each_in_turn(2, "suffix", [".html", ".md"])
def test_reports_name_the_servos_of_each_bus(suffix: str, both: Path, tmp_path: Path) -> None:
    page = tmp_path / f"run{suffix}"
    assert sniffer("report", both, "-q", "-o", page).status == 0
    text = page.read_text(encoding="utf-8").replace("\\_", "_")
    assert f"(servo 1 {LONG})" in text
    assert f"arm servo 1 {LONG}" in text
    assert "leg servo 2 ankle" in text
    assert f"load_data, servo 1 {LONG}" in text
    assert f"leg servo 1 {LONG}" not in text


def test_pictures_call_servos_by_the_names_of_their_bus_and_so_do_their_logs(
    both: Path, tmp_path: Path
) -> None:
    plots = tmp_path / "x.rrd"
    assert sniffer("view", both, "-q", "-o", plots).status == 0
    rows, static = read(plots)
    assert f"/arm/servo/1_{LONG}/present_position" in rows
    assert "/leg/servo/1/present_position" in rows
    assert static["/leg/servo/2_ankle/present_position"]["SeriesLines:names"] == ["ankle (2)"]
    logs = " ".join(str(row) for row in rows["/arm/anomalies"])
    assert f"no-response: servo 1 {LONG} did not answer" in logs
    assert f"(servo 1 {LONG})" in str(rows["/arm/incidents"])


def test_a_place_that_is_explained_names_the_servo(both: Path) -> None:
    drawn = sniffer("explain", f"{both}@no-response").out
    assert f"servo 1 {LONG} did not answer" in drawn
    assert f"request: load_data, servo 1 {LONG}" in drawn


@in_turn(2)
@pytest.mark.parametrize(
    ("who", "where"),
    [
        ("wrist", "servo_id = 2 AND bus NOT IN ('leg')"),
        ("ankle", "bus = 'leg' AND servo_id = 2"),
        (f"{LONG},3", "((servo_id = 3) OR (bus = 'arm' AND servo_id = 1))"),
        ("3,1-2", "servo_id IN (3, 1, 2)"),
    ],
)
def test_a_servo_is_selected_by_its_name(who: str, where: str, both: Path) -> None:
    by_name = sniffer("decode", both, "--servo", who)
    assert by_name.status == 0
    assert f"selection, {where}: " in by_name.out
    lines = sniffer("decode", both, "--where", where).out
    assert by_name.out == lines


def test_every_command_that_selects_takes_a_name(both: Path, tmp_path: Path) -> None:
    for command in (
        ("decode", "--format", "jsonl"),
        ("stats",),
        ("replay", "--speed", "0"),
        ("discover",),
        ("convert", tmp_path / "x.csv"),
        ("view", "-o", tmp_path / "x.rrd"),
        ("query", "--format", "csv"),
    ):
        name, *rest = command
        what = ["SELECT DISTINCT bus, servo_id FROM frames"] if name == "query" else []
        files = [*what, both, *rest] if name != "convert" else [both, *rest]
        done = sniffer(name, *files, "--servo", "ankle")
        assert done.status == 0, (name, done.err)
        if name == "query":
            assert done.out == "bus,servo_id\nleg,2\n"
        if name == "decode":
            lines = [json.loads(line) for line in done.out.splitlines()]
            who = {(x["bus"], x["servo_id"]) for x in lines if x["type"] == "frame"}
            assert who == {("leg", 2)}


@pytest.mark.parametrize(
    ("who", "told"),
    [
        ("ancle", "no servo is called 'ancle': did you mean ankle?"),
        ("foo", f"no servo is called 'foo': one of {LONG}, wrist, ankle"),
    ],
)
def test_a_name_that_nobody_has_is_answered_with_the_nearest(
    who: str, told: str, both: Path
) -> None:
    done = sniffer("stats", both, "--servo", who)
    assert done.status == 2
    assert done.complaint == f"--servo: {told}"


def test_a_name_where_no_servo_has_one_is_no_id(tmp_path: Path) -> None:
    done = sniffer("stats", CLEAN, "--servo", "knee")
    assert done.status == 2
    assert "'knee' is no servo id: write ids as 3,5 or 3-6 (no names are known)" in done.err


def test_queries_have_a_column_of_names_where_a_capture_has_some(both: Path) -> None:
    asked = "SELECT DISTINCT bus, servo_id, servo_name FROM {} WHERE servo_id < 3 ORDER BY ALL"
    for table in ("frames", "transactions", "samples", "anomalies"):
        told = sniffer("query", asked.format(table), both, "--format", "csv").out.splitlines()
        rows = set(told[1:])
        assert {f"arm,1,{LONG}", "arm,2,wrist"} <= rows
        assert table == "anomalies" or {"leg,1,", "leg,2,ankle"} <= rows
    plain = sniffer("query", "DESCRIBE frames", CLEAN, "--format", "csv").out
    assert "servo_name" not in plain


def test_a_query_over_a_capture_with_names_and_one_without_has_the_column(both: Path) -> None:
    asked = "SELECT file, count(*) AS n FROM frames WHERE servo_name IS NOT NULL GROUP BY ALL"
    for files in ((both, CLEAN), (CLEAN, both)):
        told = sniffer("query", asked, *files, "--format", "csv").out.splitlines()
        assert len(told) == 2
        assert both.name in told[1]


def test_verdicts_on_rules_name_the_servo_that_decided(both: Path, tmp_path: Path) -> None:
    rules = tmp_path / "rules.toml"
    value = '[[rule]]\nwhat = "value"\nquantity = "voltage"\nabove = 11\n'
    rules.write_text(
        f'{value}\n[[rule]]\nwhat = "incidents"\n{value}servos = [2, 9]\nbus = "leg"\n'
    )
    told = sniffer("check", both, "--rules", rules).out
    assert f"voltage of arm servo 1 {LONG} is 6.9 V" in told
    assert f"(servo 1 {LONG})" in told
    assert "voltage of leg servo 2 ankle" in told
    assert "heard of servo 9" in told


@in_turn(2)
@pytest.mark.parametrize(
    ("rule", "told"),
    [
        (f'servos = ["{LONG}"]', f"voltage of arm servo 1 {LONG} is 6.9 V"),
        ('servos = ["wrist"]\nbus = "arm"', "voltage of arm servo 2 wrist is 11.6 V"),
        ('servos = ["ankle"]', "voltage of leg servo 2 ankle is"),
        ('servos = ["arm:1"]', f"voltage of arm servo 1 {LONG} is 6.9 V"),
        ('servos = ["ancle"]', "rule 'x': servos: no servo is called 'ancle': did you mean ankle?"),
        ('servos = ["ankle"]\nbus = "arm"', "rule 'x': no servo of arm is called 'ankle'"),
        (f'servos = ["{LONG}", "ankle"]', "rule 'x': its servos are those of arm and leg: write"),
    ],
)
def test_rules_of_a_check_may_name_servos(rule: str, told: str, both: Path, tmp_path: Path) -> None:
    rules = tmp_path / "rules.toml"
    value = 'name = "x"\nwhat = "value"\nquantity = "voltage"\nabove = 11'
    rules.write_text(f"[[rule]]\n{value}\n{rule}\n")
    done = sniffer("check", both, "--rules", rules)
    assert told in done.out + done.err
    assert done.status == (2 if told.startswith("rule") else 1 if "6.9" in told else 0)


def test_differences_of_two_runs_name_the_servos(tmp_path: Path) -> None:
    without = tmp_path / "without.log"
    assert sniffer("convert", CLEAN, without, "-q", "--where", "servo_id <> 3").status == 0
    asked = ("diff", CLEAN, without, "--name", "3=elbow")
    told = sniffer(*asked)
    assert told.status == 1
    assert "bus0 servo 3 elbow: it is asked in A only" in told.out
    found = json.loads(sniffer(*asked, "--format", "json").out)
    hold_to("diff", found)
    for one in found["differences"]:
        assert one.get("servo_name") == ("elbow" if one["servo_id"] == 3 else None)


def test_names_that_only_the_second_run_has_are_told_of_the_bus_it_is_compared_with(
    tmp_path: Path,
) -> None:
    log, b = tmp_path / "without.log", tmp_path / "b.mcap"
    assert sniffer("convert", CLEAN, log, "-q", "--where", "servo_id <> 3").status == 0
    log.write_text(log.read_text().replace("bus0", "left"))
    told = ("--name", "left:3=elbow", "--protocol", "mightyzap")
    assert sniffer("convert", log, b, "-q", *told).status == 0
    assert "bus0 servo 3 elbow: it is asked in A only" in sniffer("diff", CLEAN, b).out
    assert "left servo 3 elbow: it is asked in B only" in sniffer("diff", b, CLEAN).out


def test_each_run_of_a_picture_of_two_has_its_own_names(tmp_path: Path) -> None:
    arm = tmp_path / "arm.mcap"
    assert sniffer("decode", DAMAGED, "-q", "--name", "1=elbow", "-o", arm).status == 0
    plots = tmp_path / "x.rrd"
    assert sniffer("diff", arm, CLEAN, "-q", "-o", plots).status == 1
    static = read(plots)[1]
    names = {name for told in static.values() for name in told.get("SeriesLines:names", ())}
    assert {"elbow (1) A", "servo 1 B"} <= names


def test_two_runs_are_compared_for_a_servo_by_its_name(tmp_path: Path) -> None:
    done = sniffer("diff", CLEAN, CLEAN, "--name", "2=wrist", "--servo", "wrist")
    assert done.status == 0, done.err


def test_a_drawing_names_the_servo_as_it_is_told_now(both: Path) -> None:
    told = ("--name", "0=left_knee", "--name", "arm:1=hand")
    assert ", servo 0 left_knee\n" in sniffer("explain", "FFFFFF0002F10C", *told).out
    drawn = sniffer("explain", f"{both}@first-error:servo=1", *told).out
    assert "servo 1 hand" in drawn
    assert LONG not in drawn


def test_a_place_may_be_that_of_a_servo_by_its_name(both: Path) -> None:
    by_name, by_id = (sniffer("explain", f"{both}@first-error:servo={who}") for who in (LONG, "1"))
    assert by_name == by_id
    assert "servo 1 " in by_name.out
    wrist = sniffer("decode", both, "--format", "jsonl", "--from", "@no-response:servo=wrist")
    where = sniffer(
        "decode", both, "--format", "jsonl", "--from", "@no-response", "--servo", "wrist"
    )
    begins = [
        json.loads(ran.out.splitlines()[-1])["selection"]["from_ns"] for ran in (wrist, where)
    ]
    assert begins[0] == begins[1]
    wrong = sniffer("decode", both, "--from", "@first-error:servo=wirst")
    assert (wrong.status, wrong.out) == (2, "")
    assert "@first-error:servo=wirst: no servo is called 'wirst': did you mean wrist?" in wrong.err


def test_registers_have_ids_where_names_have_no_room_and_no_name_is_cut() -> None:
    told = ("state", DAMAGED, "--name", "1=left_knee", "--name", "2=right_knee")
    narrow = sniffer(*told, env={"COLUMNS": "80"}).out
    assert narrow.splitlines()[1] == "servos: 1 left_knee, 2 right_knee"
    assert " model_number                  1, 2, 3 12 " in narrow
    wide = sniffer(*told, env={"COLUMNS": "140"}).out
    assert "servos: " not in wide
    assert "model_number                   1 left_knee, 2 right_knee, 3  12 " in wide
