"""ServoNames of servos: told, recorded, handed on; laid over ids wherever a person reads."""

from __future__ import annotations

import json
from pathlib import Path
from typing import Final

import pytest

from sniffer.decoding.called import Named, ServoNames, name_facts, names_in, overlaid
from tests.commands import sniffer
from tests.recorder import Recorder, said_by, say_slowly
from tests.terminals import LINUX_ONLY, Terminal

DAMAGED: Final = "sample_captures/mightyzap_damaged.log"
CLEAN: Final = "sample_captures/mightyzap_clean.log"


def two_buses(folder: Path, *more: str) -> Path:
    """Return a recording of two buses that have the ids 1, 2 and 3 both."""
    arm, leg = folder / "arm.log", folder / "leg.log"
    for path, source in ((arm, DAMAGED), (leg, CLEAN)):
        path.write_bytes(Path(source).read_bytes())
    both = folder / "both.mcap"
    assert sniffer("merge", arm, leg, "-q", *more, "-o", both).status == 0
    return both


def recorded_names(path: Path) -> dict[str, str]:
    """Return what a recording says of names."""
    from mcap.records import Metadata

    from sniffer.mcapfile.given import open_recording
    from sniffer.mcapfile.records import Records

    out: dict[str, str] = {}
    with open_recording(path) as stream:
        for record in Records(stream):
            if isinstance(record, Metadata):
                out |= {k: v for k, v in record.metadata.items() if k.startswith("name.")}
    return out


def test_a_name_of_a_bus_is_that_of_no_other_bus_and_wins_over_one_of_all() -> None:
    names = ServoNames({3: "knee", ("arm", 3): "elbow"})
    assert names.of("arm", 3) == "elbow"
    assert names.of("arm.lss", 3) == "elbow"
    assert names.of("arm.left", 3) == "knee"
    assert names.of("leg", 3) == "knee"
    assert names.of("leg", 4) is None


@pytest.mark.parametrize(
    ("said", "shown"),
    [
        ("servo 3 never answers", "servo 3 left knee never answers"),
        ("servos 1, 3 and 30", "servos 1, 3 left knee and 30"),
        ("servos 3 and 3 more", "servos 3 left knee and 3 more"),
        ("servos 3, 3 and 33 others", "servos 3 left knee, 3 left knee and 33 others"),
        ("servo 3, and servo 5", "servo 3 left knee, and servo 5"),
        ("the servo's 3 answers, servo 303", "the servo's 3 answers, servo 303"),
        ("3 servos of 3", "3 servos of 3"),
    ],
)
def test_a_sentence_has_the_names_of_the_servos_that_it_speaks_of(said: str, shown: str) -> None:
    assert ServoNames({("arm", 3): "left knee"}).sentence("arm", said) == shown
    assert ServoNames({("arm", 3): "left knee"}).sentence("leg", said) == said


def test_names_are_read_back_as_they_were_written() -> None:
    told: dict[Named, str] = {3: "knee", ("arm.left", 3): "elbow", ("/dev/ttyUSB0", 12): "wrist 2"}
    assert names_in(name_facts(told)) == told
    assert names_in({"name.300": "x", "name.x": "x", "name..3": "x", "name.3": " x"}) == {}


def test_what_is_told_now_wins_over_what_was_recorded_of_a_bus() -> None:
    recorded: dict[Named, str] = {("arm", 3): "elbow", ("leg", 3): "knee", 5: "hip"}
    assert overlaid(recorded, {3: "toe"}) == {5: "hip", 3: "toe"}
    assert overlaid(recorded, {("leg", 3): "toe"}) == {
        ("arm", 3): "elbow",
        ("leg", 3): "toe",
        5: "hip",
    }


@pytest.mark.parametrize(
    "table", ['[names]\n1 = "hip"\n"arm:2" = "knee"\n', '[names]\n1 = "hip"\narm.2 = "knee"\n']
)
def test_a_file_of_names_may_name_those_of_a_bus(table: str, tmp_path: Path) -> None:
    (tmp_path / "names.toml").write_text(table)
    out = tmp_path / "run.mcap"
    told = ("--name", str(tmp_path / "names.toml"))
    assert sniffer("decode", CLEAN, "-q", *told, "-o", out).status == 0
    assert recorded_names(out) == {"name.1": "hip", "name.arm.2": "knee"}


def test_a_profile_may_name_the_servos_of_a_bus(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    capture = Path(CLEAN).resolve()
    text = '[profile.robot]\nnames = { 1 = "hip", "arm:2" = "knee", leg = { 2 = "toe" } }\n'
    (tmp_path / "sniffer.toml").write_text(text)
    monkeypatch.chdir(tmp_path)
    done = sniffer("decode", capture, "-q", "--profile", "robot", "-o", "run.mcap")
    assert done.status == 0, done.err
    assert recorded_names(tmp_path / "run.mcap") == {
        "name.1": "hip",
        "name.arm.2": "knee",
        "name.leg.2": "toe",
    }


@pytest.mark.parametrize("told", [":3=knee", "arm:=knee", "arm:300=knee"])
def test_a_name_of_a_bus_that_cannot_be_is_refused_in_a_line(told: str) -> None:
    done = sniffer("decode", CLEAN, "--name", told)
    assert done.status == 2
    assert "write ID=NAME or BUS:ID=NAME" in done.complaint


def test_a_name_in_a_file_that_is_too_long_is_told_with_the_file(tmp_path: Path) -> None:
    long = "left_shoulder_pitch_actuator_of_the_upper_arm"
    names = tmp_path / "names.toml"
    names.write_text(f'[names]\n1 = "{long}"\n')
    done = sniffer("decode", CLEAN, "--name", names)
    assert done.status == 2
    assert "names.toml: " in done.complaint
    assert f"1='{long}'" in done.complaint
    assert "at most 32 signs" in done.complaint


def test_a_name_of_a_bus_that_is_not_there_is_told_in_a_line(tmp_path: Path) -> None:
    both = two_buses(tmp_path, "--name", "arm:1=elbow")
    done = sniffer("stats", both, "-q", "--name", "lge:1=knee")
    assert done.status == 0
    told = "names were told of lge, but no bus is called so: did you mean leg?"
    assert done.complaint == told


def test_names_that_a_recording_has_of_a_bus_that_was_left_out_say_nothing(tmp_path: Path) -> None:
    one = tmp_path / "one.mcap"
    assert sniffer("decode", CLEAN, "-q", "--name", "bus0:1=hip", "-o", one).status == 0
    again = tmp_path / "again.mcap"
    assert sniffer("convert", one, again, "-q", "--name", "leg:1=knee").err.count("leg") == 1
    assert sniffer("stats", again, "-q").err == ""


def test_merged_captures_keep_the_names_of_each(tmp_path: Path) -> None:
    arm, leg = tmp_path / "arm.mcap", tmp_path / "leg.mcap"
    assert sniffer("decode", DAMAGED, "-q", "--name", "1=elbow", "-o", arm).status == 0
    assert sniffer("decode", CLEAN, "-q", "--name", "bus0:1=knee", "-o", leg).status == 0
    both = tmp_path / "both.mcap"
    assert sniffer("merge", arm, leg, "-q", "-o", both).status == 0
    assert recorded_names(both) == {"name.arm.1": "elbow", "name.leg.1": "knee"}


def test_merged_captures_that_agree_on_names_say_them_once(tmp_path: Path) -> None:
    both = two_buses(tmp_path, "--name", "1=elbow")
    assert recorded_names(both) == {"name.1": "elbow"}


def test_a_cut_and_a_conversion_keep_names_and_a_capture_to_hand_on_has_none(
    tmp_path: Path,
) -> None:
    both = two_buses(tmp_path, "--name", "arm:1=elbow", "--name", "2=wrist")
    told = {"name.arm.1": "elbow", "name.2": "wrist"}
    part, again, nobodys = (tmp_path / f"{name}.mcap" for name in ("part", "again", "nobodys"))
    assert sniffer("cut", both, "--to", "2", "-q", "-o", part).status == 0
    assert sniffer("convert", both, "-q", "-o", again).status == 0
    assert sniffer("convert", both, "-q", "--anonymise", "-o", nobodys).status == 0
    assert recorded_names(part) == recorded_names(again) == told
    assert recorded_names(nobodys) == {}


def test_data_sets_of_names_of_a_bus_decode_with_them(tmp_path: Path) -> None:
    from sniffer.decoding.options import Options
    from sniffer.fleet.recipe import read_recipe, write_recipe

    options = Options(names={3: "knee", ("arm", 3): "elbow"})
    assert read_recipe(write_recipe(options, None, "auto"))[0].names == options.names
    assert json.loads(write_recipe(Options(names={3: "knee"}), None, "auto"))["names"] == [
        [3, "knee"]
    ]


@LINUX_ONLY
def test_a_recorder_shows_names_selects_by_them_and_keeps_them(tmp_path: Path) -> None:
    with Terminal() as one, Terminal() as two:
        ports = ("arm={}=mightyzap@57600", "leg={}=mightyzap@57600")
        told = ("--name", "arm:1=elbow", "--name", "1=knee", "--log", "--servo", "elbow")
        with Recorder(tmp_path, *ports, *told, lines=[one, two]) as run:
            for line in (one, two):
                say_slowly(line, said_by("mightyzap", 1, 0.4), 60)
            ran = run.stop()
    assert ran.status == 0
    assert recorded_names(tmp_path / "run.mcap") == {"name.arm.1": "elbow", "name.1": "knee"}
    lines = [line for line in ran.out.splitlines() if " load_data " in line]
    assert lines
    assert all(" arm " in line and "  1 elbow " in line for line in lines)
    shown = sniffer("stats", tmp_path / "run.mcap").out
    assert "1 elbow" in shown
    assert "1 knee" in shown


@pytest.mark.parametrize(
    ("models", "said"),
    [
        (["9=mightyzap-12lf", "8=mightyzap-12lf"], "servos 8 and 9"),
        (["9=mightyzap-12lf", "3=mightyzap-12lf"], "servo 9"),
        (["3=mightyzap-12lf"], ""),
        (["mightyzap-12lf"], ""),
    ],
)
def test_a_model_of_a_servo_that_is_not_there_is_told(models: list[str], said: str) -> None:
    told = [word for model in models for word in ("--model", model)]
    ran = sniffer("decode", DAMAGED, "--summary", *told)
    assert ran.status == 0
    assert ("a model was told" in ran.err) == bool(said)
    assert f"{said}, of which nothing is in it: one of 1, 2, 3, 254" in ran.err or not said
