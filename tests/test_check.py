"""``sniffer check``: captures held to rules; what cannot be decided is no rule that holds."""

from __future__ import annotations

from functools import cache
from pathlib import Path
from typing import TYPE_CHECKING, Final
from xml.etree import ElementTree as ET

import pytest

import sniffer
from sniffer.diagnosis.causes import CAUSES
from sniffer.ground.model import Chunk, Clock, Severity, SnifferError
from sniffer.reports import rules as r
from sniffer.reports.judging import Decision, Judged
from sniffer.reports.rules import KINDS, rules_of
from tests.commands import Ran, log, talk, within
from tests.commands import sniffer as command
from tests.recordings import keep
from tests.recordings import talk as simulated
from tests.streams.mightyzap import packet

if TYPE_CHECKING:
    Capsys = pytest.CaptureFixture[str]

SAMPLES: Final = Path(__file__).parents[1] / "sample_captures"
CLEAN: Final = SAMPLES / "mightyzap_clean.log"
DAMAGED: Final = SAMPLES / "mightyzap_damaged.log"
NO_CLOCK: Final = SAMPLES / "lss_clean.bin"


def rule(**keys: object) -> str:
    """Return a rule as TOML."""

    def value(v: object) -> str:
        return f'"{v}"' if isinstance(v, str) else str(v).lower() if isinstance(v, bool) else str(v)

    lines = [f"{k} = {value(v)}" for k, v in keys.items()]
    return "\n".join(["[[rule]]", *lines, ""]).replace("'", '"')


def judged(capture: Path, text: str) -> list[Judged]:
    """Hold a capture to rules."""
    return list(sniffer.check(capture, rules_of(text)).verdicts)


def one(capture: Path, **keys: object) -> Judged:
    """Hold a capture to one rule."""
    (verdict,) = judged(capture, rule(**keys))
    return verdict


def checked(capsys: Capsys, folder: Path, text: str, *more: str | Path) -> Ran:
    """Run the command with rules."""
    path = folder / "rules.toml"
    path.write_text(text, encoding="utf-8")
    return within(capsys, "check", *more, "--rules", path)


P, U, F = Decision.PASSED, Decision.UNDECIDED, Decision.FAILED

CASES: Final[list[tuple[Path, dict[str, object], Decision, str]]] = [
    (CLEAN, {"what": "frames", "at_least": 1506}, P, "1506 frames on bus0"),
    (CLEAN, {"what": "frames", "above": 1506}, F, "1506 frames on bus0"),
    (CLEAN, {"what": "frames", "bus": "leg", "at_least": 1}, U, "there is no bus leg: bus0 is"),
    (CLEAN, {"what": "seconds", "at_least": 7, "below": 9}, P, "7.983 s of bus0"),
    (NO_CLOCK, {"what": "seconds", "at_least": 1}, U, "no clock"),
    (CLEAN, {"what": "bytes_in_frames", "at_least": 1}, P, "19001 of 19001 bytes"),
    (DAMAGED, {"what": "bytes_in_frames", "at_least": 0.999}, F, "18274 of 18442 bytes"),
    (DAMAGED, {"what": "bytes_in_frames", "at_least": 0.99}, P, "18274 of 18442 bytes"),
    (CLEAN, {"what": "anomalies"}, P, "no anomaly; wanted: none"),
    (DAMAGED, {"what": "anomalies", "codes": ["bad-checksum"]}, F, "2 anomalies (2 bad-checksum)"),
    (DAMAGED, {"what": "anomalies", "codes": ["bad-checksum"], "at_most": 2}, P, "2 anomalies"),
    (DAMAGED, {"what": "anomalies", "codes": ["bad-checksum"], "servos": [2]}, P, "no anomaly"),
    (DAMAGED, {"what": "anomalies", "codes": ["no-response"], "servos": [3]}, F, "1 anomaly (1 no"),
    (DAMAGED, {"what": "anomalies", "codes": ["noise"], "from": "error"}, P, "no anomaly"),
    (
        DAMAGED,
        {"what": "anomalies", "codes": ["noise"], "servos": [1]},
        F,
        "22 anomalies (22 noise",
    ),
    (CLEAN, {"what": "incidents"}, P, "no incident; wanted: none"),
    (DAMAGED, {"what": "incidents", "causes": ["brownout"]}, F, "1 incident (brownout: "),
    (DAMAGED, {"what": "incidents", "causes": ["brownout"], "servos": [2]}, P, "no incident"),
    (DAMAGED, {"what": "incidents", "causes": ["nv-wear"]}, P, "no incident"),
    (DAMAGED, {"what": "incidents", "confidence": 1}, P, "no incident"),
    (CLEAN, {"what": "value", "quantity": "voltage", "above": 11}, P, "voltage of servo "),
    (DAMAGED, {"what": "value", "quantity": "voltage", "above": 11}, F, "servo 1 is 6.9 V at 22:"),
    (DAMAGED, {"what": "value", "quantity": "voltage", "above": 11, "servos": [2, 3]}, P, "11.5 V"),
    (DAMAGED, {"what": "value", "quantity": "temperature", "below": 34}, F, "34 °C"),
    (
        CLEAN,
        {"what": "value", "quantity": "current", "below": 1},
        U,
        "no current was heard (force_limit, goal",
    ),
    (CLEAN, {"what": "value", "quantity": "voltage", "above": 1, "servos": [9]}, U, "id 9"),
    (CLEAN, {"what": "value", "quantity": "voltage", "above": 1, "servos": [1, 9]}, U, "servo 9"),
    (CLEAN, {"what": "answers_missing", "at_most": 0}, P, "0 of "),
    (DAMAGED, {"what": "answers_missing", "at_most": 0.02}, F, "6 of 212 answers of servo 1"),
    (DAMAGED, {"what": "answers_missing", "at_most": 0.03}, P, "6 of 212 answers of servo 1"),
    (DAMAGED, {"what": "answers_damaged", "at_most": 0.02}, F, "5 of 215 answers of servo 2"),
    (CLEAN, {"what": "goals_acknowledged"}, P, "goals acknowledged by servo"),
    (NO_CLOCK, {"what": "goals_acknowledged"}, U, "no goal was told"),
    (CLEAN, {"what": "response_time_ms", "below": 5}, P, "(between 0.00 and 1.2"),
    (CLEAN, {"what": "response_time_ms", "below": 1}, U, "(between 0.00 and 1.2"),
    (CLEAN, {"what": "response_time_ms", "above": 0.2, "below": 0.8}, U, "(between 0.00 and 1.2"),
    (DAMAGED, {"what": "response_time_ms", "below": 5}, F, "p99 of servo 2 is 12.71 ms"),
    (DAMAGED, {"what": "response_time_ms", "figure": "p50", "below": 5}, P, "p50 of servo"),
    (DAMAGED, {"what": "response_time_ms", "figure": "max", "below": 5}, F, "max of servo "),
    (NO_CLOCK, {"what": "response_time_ms", "below": 5}, U, "the input has no clock"),
    (CLEAN, {"what": "following_error", "below": 6}, P, "p99 of the following error of servo "),
    (CLEAN, {"what": "following_error", "figure": "max", "below": 3}, F, "max of the following"),
    (NO_CLOCK, {"what": "following_error", "below": 1000}, P, "°, "),
    (CLEAN, {"what": "lag_ms", "below": 100}, P, "servo 2 is behind its goals by "),
    (CLEAN, {"what": "lag_ms", "below": 88}, U, "servo 2 is behind its goals by "),
    (CLEAN, {"what": "lag_ms", "below": 50, "servos": [3]}, U, "servo 3 is behind its goals by "),
    (CLEAN, {"what": "lag_ms", "below": 40, "servos": [3]}, F, "servo 3 is behind its goals by "),
    (NO_CLOCK, {"what": "lag_ms", "below": 100}, U, "the input has no clock"),
    (CLEAN, {"what": "settle_ms", "figure": "max", "below": 1000}, P, "settles is"),
    (NO_CLOCK, {"what": "settle_ms", "below": 1000}, U, "the input has no clock"),
    (CLEAN, {"what": "first_motion_ms", "figure": "max", "below": 100}, P, " moves is "),
    (CLEAN, {"what": "first_motion_ms", "figure": "p50", "above": 100}, F, " goals of "),
    (NO_CLOCK, {"what": "first_motion_ms", "below": 1000}, U, "the input has no clock"),
    (CLEAN, {"what": "goals_not_reached"}, P, "0 goals of servo 1 not reached; wanted: none"),
    (NO_CLOCK, {"what": "goals_not_reached"}, U, "the input has no clock"),
]


@cache
def found_of(capture: Path) -> list[Judged]:
    """Hold a capture to all of its rules at once."""
    return judged(capture, "".join(rule(**keys) for one_, keys, _, _ in CASES if one_ == capture))


@pytest.mark.parametrize(("capture", "keys", "verdict", "figure"), CASES)
def test_a_rule_passes_fails_or_cannot_be_decided_and_tells_its_figure(
    capture: Path, keys: dict[str, object], verdict: Decision, figure: str
) -> None:
    found = found_of(capture)[[k for c, k, _, _ in CASES if c == capture].index(keys)]
    assert (found.verdict, found.holds) == (verdict, verdict == P), found.figure
    assert figure in found.figure


def test_every_kind_of_rule_is_held_here() -> None:
    assert {str(keys["what"]) for _, keys, _, _ in CASES} == set(KINDS)


def test_a_rule_by_itself_is_judged_as_among_others() -> None:
    nth = next(n for n, case in enumerate(CASES) if case[0] == DAMAGED and case[2] == F)
    before = sum(case[0] == DAMAGED for case in CASES[:nth])
    alone = one(DAMAGED, **CASES[nth][1])
    among = found_of(DAMAGED)[before]
    assert (alone.verdict, alone.figure) == (among.verdict, among.figure)


def goals(*answers: bytes) -> list[Chunk]:
    """Return what is said where a servo is told a goal again and again, and how it answers."""
    ping, pong = packet(1, 0xF1, b""), packet(1, 0x00, b"")
    told = [ping, pong]
    for answer in answers:
        told += [packet(1, 0xF3, b"\x86\x00\x02"), answer]  # store_data, goal position
    told += [ping, pong]
    times = (10**18 + k * 20_000_000 for k in range(len(told)))
    return [Chunk(raw, t, Clock.SAMPLE) for raw, t in zip(told, times, strict=True) if raw]


GOOD, REFUSED = packet(1, 0, b""), packet(1, 8, b"")
"""Answers to a goal; bit 3 is a value out of range."""


@pytest.mark.parametrize(
    ("answers", "figure"),
    [
        ((GOOD, GOOD, GOOD), "3 of 3 goals acknowledged by servo 1; "),
        ((GOOD, GOOD, REFUSED), "2 of 3 goals acknowledged by servo 1, 1 refused; "),
        ((GOOD, GOOD, b""), "2 of 3 goals acknowledged by servo 1, 1 without acknowledgement; "),
    ],
)
def test_a_goal_is_acknowledged_where_its_servo_has_answered_and_taken_it(
    answers: tuple[bytes, ...], figure: str, tmp_path: Path
) -> None:
    capture = tmp_path / "x.mcap"
    keep(capture, [goals(*answers)])
    found = one(capture, what="goals_acknowledged")
    assert found.figure.startswith(figure)
    assert found.verdict == (P if "3 of 3" in figure else F)


def test_the_command_prints_each_rule_with_its_figure_and_tells_by_its_status(
    tmp_path: Path, capsys: Capsys
) -> None:
    text = rule(name="heard", what="frames", at_least=1) + rule(
        name="supply", what="value", quantity="voltage", above=11
    )
    good = checked(capsys, tmp_path, text, CLEAN)
    assert good.status == 0
    lines = good.out.splitlines()
    assert lines[0] == str(CLEAN)
    assert lines[1].startswith("  passed  heard: 1506 frames on bus0; wanted: at least 1")
    assert lines[-1] == "  2 rules: 2 passed"
    both = checked(capsys, tmp_path, text, CLEAN, DAMAGED)
    assert both.status == 1
    assert both.out.splitlines()[:4] == lines
    assert "  FAILED  supply: voltage of servo 1 is 6.9 V at 22:55:13.848 (byte " in both.out


@pytest.mark.parametrize("where", ["rule", "file"])
def test_what_cannot_be_decided_fails_unless_the_rules_let_it_pass(
    where: str, tmp_path: Path, capsys: Capsys
) -> None:
    keys: dict[str, object] = {"name": "prompt", "what": "response_time_ms", "below": 5}
    strict = checked(capsys, tmp_path, rule(**keys), NO_CLOCK)
    assert strict.status == 1
    assert "  UNDECIDED  prompt: the input has no clock, so no time is known" in strict.out
    text = (
        rule(**keys, undecided="pass") if where == "rule" else 'undecided = "pass"\n' + rule(**keys)
    )
    lenient = checked(capsys, tmp_path, text, NO_CLOCK)
    assert lenient.status == 0
    assert "  undecided  prompt: " in lenient.out


def test_an_input_that_breaks_off_is_judged_as_far_as_it_goes_and_told(
    tmp_path: Path, capsys: Capsys
) -> None:
    capture, xml = tmp_path / "x.log", tmp_path / "x.xml"
    capture.write_text(log(talk(40)) + "(1700000009.5) bus0 #GG\n" * 3, encoding="ascii")
    text = rule(what="frames", at_least=100)
    ran = checked(capsys, tmp_path, text, capture, "--junit", xml)
    assert ran.status == 3
    assert "1 rule: 1 passed" in ran.out
    (suite,) = ET.parse(xml).getroot()
    assert suite.get("errors") == "1"
    error = suite.find("testcase/error")
    assert error is not None
    assert "line" in (error.get("message") or "")


def test_a_total_that_a_part_is_too_short_for_says_that_it_is_of_a_part(
    tmp_path: Path, capsys: Capsys
) -> None:
    text = rule(what="frames", at_least=500) + rule(what="seconds", above=5)
    text += rule(what="frames", at_most=10) + rule(what="bytes_in_frames", at_least=1)
    part = ("--from", "1", "--to", "2")
    told = checked(capsys, tmp_path, text, DAMAGED, *part).out.splitlines()[1:5]
    said = "; a part of the capture alone was judged, from second 1 to second 2"
    assert [line.endswith(said) for line in told] == [True, True, False, False]
    assert all("FAILED" in line for line in told[:3])
    assert "part" not in checked(capsys, tmp_path, text, DAMAGED).out


def test_a_capture_that_cannot_be_read_does_not_keep_the_others_from_being_judged(
    tmp_path: Path, capsys: Capsys
) -> None:
    noise, xml = tmp_path / "noise.bin", tmp_path / "x.xml"
    noise.write_bytes(bytes(range(7, 200)) * 9)
    ran = checked(capsys, tmp_path, rule(what="frames", at_least=1), noise, CLEAN, "--junit", xml)
    assert ran.status == 2
    assert f"{CLEAN}\n  passed  " in ran.out
    assert [s.get("errors") for s in ET.parse(xml).getroot()] == ["1", "0"]


def test_the_example_is_a_file_of_rules_that_a_sound_capture_keeps(
    tmp_path: Path, capsys: Capsys
) -> None:
    example = within(capsys, "check", "--example")
    assert (example.status, example.err) == (0, "")
    assert checked(capsys, tmp_path, example.out, CLEAN).status == 0
    broken = checked(capsys, tmp_path, example.out, DAMAGED)
    assert broken.status == 1
    assert broken.out.count("  FAILED  ") >= 5
    told = {line.split('"')[1] for line in example.out.splitlines() if line.startswith("what = ")}
    assert told >= {r.INCIDENTS, r.ANOMALIES, r.RESPONSE_TIME, r.VALUE, r.GOALS, r.MISSING}


MISTAKES: Final = [
    ("", "there is no rule in it: each begins with a line [[rule]]"),
    ("rule = 3", "each rule begins with a line [[rule]]"),
    ("[[rules]]", "there is no key 'rules': did you mean rule?"),
    ("[[rule]\n", "Expected"),
    ('undecided = "maybe"\n[[rule]]', "no undecided 'maybe': one of fail, pass"),
    ("[[rule]]", "rule 1: it does not say what it is about: what = one of incidents,"),
    (
        rule(what="frames"),
        "rule 1: it asks for nothing: write one of below, at_most, above, at_least",
    ),
    (rule(what="frame", at_least=1), "rule 1: no what 'frame': did you mean frames?"),
    (rule(what="weather"), "rule 1: no what 'weather': one of incidents, anomalies,"),
    (rule(what="frames", atleast=1), "rule 1: there is no key 'atleast': did you mean at_least?"),
    (
        rule(name="x", what="frames", at_least=1, codes=["noise"]),
        "rule 'x': there is no key 'codes' where what is frames: one of name, what",
    ),
    (
        rule(what="frames", at_least="many"),
        "rule 1: at_least is a number to reckon with, not 'many'",
    ),
    (rule(what="frames", at_least=True), "rule 1: at_least is a number to reckon with, not True"),
    ('[[rule]]\nwhat = "frames"\nbelow = nan', "rule 1: below is a number to reckon with, not nan"),
    (rule(what="bytes_in_frames", at_least=99.9), "rule 1: at_least is a share of 0..1, not 99.9"),
    (
        rule(what="incidents", causes=["brown-out"]),
        "rule 1: no cause 'brown-out': did you mean brownout?",
    ),
    (
        rule(what="anomalies", codes=["bad-checksums"]),
        "rule 1: no code 'bad-checksums': did you mean bad-checksum?",
    ),
    (rule(what="anomalies", codes="noise"), "rule 1: codes is a list of texts"),
    ('[[rule]]\nwhat = "anomalies"\nfrom = "warning"', "no from 'warning': did you mean warn?"),
    (rule(what="response_time_ms", figure="p95", below=1), "no figure 'p95': did you mean p99?"),
    (rule(what="value", above=1), "it does not say which value: quantity = "),
    (rule(what="value", quantity=3, above=1), "quantity is a text, not 3"),
    (rule(what="frames", servos=[1], at_least=1), "frames is not told of servos: leave servos out"),
    (rule(what="answers_missing", servos=[256], at_most=0), "servos is a list of ids of 0..255"),
    (rule(what="answers_missing", servos=1, at_most=0), "servos is a list of ids of 0..255"),
    (rule(what="frames", at_least=1, undecided="skip"), "no undecided 'skip': one of fail, pass"),
]


@pytest.mark.parametrize(("text", "why"), MISTAKES)
def test_a_mistake_in_the_rules_is_told_in_one_line(
    text: str, why: str, tmp_path: Path, capsys: Capsys
) -> None:
    ran = checked(capsys, tmp_path, text, CLEAN)
    assert (ran.status, ran.out) == (2, "")
    assert ran.complaint.startswith(f"{tmp_path}/rules.toml: ")
    assert why in ran.complaint


def test_rules_that_cannot_be_read_are_told_in_one_line(tmp_path: Path, capsys: Capsys) -> None:
    none = within(capsys, "check", CLEAN, "--rules", tmp_path / "no.toml")
    assert (none.status, none.complaint) == (
        2,
        f"{tmp_path}/no.toml: cannot be read (No such file or directory)",
    )
    (tmp_path / "x.toml").write_bytes(b"\xff\xfe")
    odd = within(capsys, "check", CLEAN, "--rules", tmp_path / "x.toml")
    assert (odd.status, odd.complaint) == (2, f"{tmp_path}/x.toml: rules are text in UTF-8")
    folder = within(capsys, "check", CLEAN, "--rules", tmp_path)
    assert folder.complaint == f"{tmp_path} is a directory: give the file in it"
    missing = within(capsys, "check", CLEAN)
    assert missing.status == 2
    assert "--rules" in missing.complaint


@pytest.mark.parametrize("cause", CAUSES)
def test_every_cause_can_be_named_in_a_rule(cause: str) -> None:
    (found,) = rules_of(rule(what="incidents", causes=[cause]))
    assert found.named == (cause,)
    assert found.least == Severity.NOTE


def test_a_file_that_is_not_there_is_told_before_anything_is_judged(
    tmp_path: Path, capsys: Capsys
) -> None:
    text = rule(what="frames", at_least=1)
    ran = checked(capsys, tmp_path, text, CLEAN, tmp_path / "no.log")
    assert (ran.status, ran.out) == (2, "")
    assert ran.complaint == f"{tmp_path}/no.log: there is no such file"


def test_standard_input_is_checked_as_a_file_is(tmp_path: Path) -> None:
    rules = tmp_path / "rules.toml"
    rules.write_text(rule(what="incidents", causes=["brownout"]), encoding="utf-8")
    piped = command("check", "-", "--rules", rules, data=DAMAGED.read_bytes())
    whole = command("check", DAMAGED, "--rules", rules)
    assert piped.status == whole.status == 1
    assert piped.out.splitlines()[1:] == whole.out.splitlines()[1:]


def test_rules_of_several_buses_name_the_bus(tmp_path: Path) -> None:
    capture = tmp_path / "two.mcap"
    keep(capture, [simulated("mightyzap", 1.0), simulated("wck", 1.0, bus="leg")])
    found = one(capture, what="frames", bus="leg", at_least=10**6)
    assert found.verdict == F
    assert " frames on leg; " in found.figure
    both = one(capture, what="answers_missing", at_most=0)
    assert " of bus0 servo " in both.figure or " of leg servo " in both.figure


def test_a_rule_is_not_changed_by_what_is_said_of_it_again() -> None:
    with pytest.raises(SnifferError, match="rules: rule 2: no what"):
        rules_of(rule(what="frames", at_least=1) + rule(what="framez", at_least=1))
