"""``sniffer diagnose``: what it prints, and when it refuses."""

from __future__ import annotations

import json
import re
from typing import TYPE_CHECKING, Any

import pytest

from bench.diagnosis.catalogue import scenarios
from sniffer.simulation.buses import simulate
from sniffer.simulation.faults import read_fault
from sniffer.simulation.render import candump, frame_reads
from tests.commands import Ran, within
from tests.commands import sniffer as command
from tests.conversations import Conversation, robot
from tests.golden import CAPTURES, captures
from tests.lists import each_in_turn
from tests.schemas import hold_to

if TYPE_CHECKING:
    from pathlib import Path


def log(path: Path, protocol: str, *faults: str, seconds: float = 12.0, seed: int = 5) -> Path:
    struck = [read_fault(fault) for fault in faults]
    frames = simulate(protocol, seed=seed, faults=struck, duration_s=seconds)
    path.write_text(candump(frame_reads(frames)), encoding="ascii")
    return path


def said(path: Path, talk: Conversation) -> Path:
    lines = (f"({(c.t_ns or 0) / 1e9:.6f}) bus0 #{c.data.hex()}\n" for c in talk.chunks)
    path.write_text("".join(lines), encoding="ascii")
    return path


class Asked:
    """The command, within this process."""

    def __init__(self, capsys: pytest.CaptureFixture[str]) -> None:
        self._capsys = capsys

    def says(self, *arguments: str | Path) -> Ran:
        return within(self._capsys, "diagnose", *arguments)

    def told(self, *arguments: str | Path) -> dict[str, Any]:
        done = self.says(*arguments, "--format", "json")
        assert done.status == 0, done.err
        found: dict[str, Any] = json.loads(done.out)
        return found


@pytest.fixture
def diagnose(capsys: pytest.CaptureFixture[str]) -> Asked:
    return Asked(capsys)


@each_in_turn(3, "capture", captures(), ids=lambda p: p.name)
def test_what_is_said_of_a_sample_capture_is_as_the_schema_has_it(
    diagnose: Asked, capture: Path
) -> None:
    found = diagnose.told(capture)
    hold_to("diagnosis", found)
    assert found["judged"]
    if "clean" in capture.name:
        assert found["incidents"] == []
    if "damaged" in capture.name:
        assert found["incidents"]


def test_a_servo_that_dies_is_named_with_the_moment_and_what_to_do(
    diagnose: Asked, tmp_path: Path
) -> None:
    found = diagnose.told(log(tmp_path / "a.log", "mightyzap", "dead:2@5s"))
    (incident,) = found["incidents"]
    assert (incident["causes"][0]["cause"], incident["servo_ids"]) == ("servo-dead", [2])
    assert incident["first_t_ns"] == pytest.approx(5e9, abs=0.5e9)
    assert incident["next"]
    assert incident["evidence"]


def test_sound_traffic_is_called_sound_and_on_what_it_was_judged(
    diagnose: Asked, tmp_path: Path
) -> None:
    done = diagnose.says(log(tmp_path / "a.log", "rs30x", seconds=4))
    assert re.search(r"nothing is wrong, judged on bus0: \d+ rs30x frames of 3\s+servos", done.out)


def test_several_incidents_are_told_in_short_before_each_is_told_at_length(
    diagnose: Asked, tmp_path: Path
) -> None:
    one, two = (
        log(tmp_path / f"{n}.log", "mightyzap", "dead:2@5s", *more)
        for n, more in enumerate(((), ("absent:3",)))
    )
    assert "incidents: " not in diagnose.says(one).out, "one is told at length alone"
    whole = diagnose.told(two)["incidents"]
    each = [
        f"{i['id']} {i['causes'][0]['cause']} of servo {i['servo_ids'][0]} "
        f"({i['causes'][0]['confidence']:.0%})".replace("%)", " %)")
        for i in whole
    ]
    assert len(each) > 1
    first = diagnose.says(two).out.splitlines()[0]
    assert first == f"{len(each)} incidents: {', '.join(each)}"


def test_what_is_to_be_mended_stands_before_what_is_only_worth_knowing(
    diagnose: Asked, tmp_path: Path
) -> None:
    """A line that is full from the beginning is a note; the servo that dies later comes first."""
    talk = Conversation("rs30x")
    while talk.now_s < 10:
        for servo in (1, 2):
            talk.say(talk.tongue.ask(servo))
            talk.rest(0.12)
            if servo == 1 or talk.now_s < 7:
                talk.say(talk.tongue.answer(servo, 0.5))
            talk.rest(0.05 if servo == 1 or talk.now_s < 7 else 6)
    path = said(tmp_path / "full.log", talk)
    told = diagnose.told(path, "--baud", "115200")["incidents"]
    assert [i["causes"][0]["cause"] for i in told] == ["bus-saturated", "servo-dead"]
    head, _, story, *rest = diagnose.says(path, "--baud", "115200").out.splitlines()
    assert re.search(r"^2 incidents: 2 servo-dead of servo 2 .*, 1 bus-saturated", head)
    assert story.startswith("2  ")
    assert any(line.startswith("1  ") for line in rest)


def test_what_was_found_is_said_once_and_what_the_cause_is_known_by_first(
    diagnose: Asked, tmp_path: Path
) -> None:
    talk = robot(
        "mightyzap", 12, instead=lambda talk, n, servo: servo == 2 and n > 200 and _in_vain(talk)
    )
    path = said(tmp_path / "dead.log", talk)
    (incident,) = diagnose.told(path)["incidents"]
    words = " ".join(diagnose.says(path).out.split())
    for finding in incident["findings"][:6]:
        assert words.count(finding["what"]) == 1
    assert "silent-since" in {f["code"] for f in incident["findings"]}
    assert words.index("servo 2 answered until") < words.index("x no-response of servo 2")
    assert "it answered and never again; requests without an answer" in words
    assert "servo 2 answered until" in incident["causes"][0]["why"]


def _in_vain(talk: Conversation) -> bool:
    talk.ask_in_vain(2)
    return True


def few_lost(path: Path) -> Path:
    """Write a log in which servos 1 and 3 lose one answer each."""

    def lost(talk: Conversation, cycle: int, servo: int) -> bool:
        if (cycle, servo) not in {(90, 1), (240, 3)}:
            return False
        talk.ask_in_vain(servo)
        return True

    return said(path, robot("mightyzap", 8, instead=lost))


def test_a_few_lost_answers_have_no_cause_and_are_not_nothing(
    diagnose: Asked, tmp_path: Path
) -> None:
    done = diagnose.says(few_lost(tmp_path / "a.log"))
    assert "nothing is wrong" not in done.out
    assert re.search(r"no cause can be told of 2 x no-response \(servos 1, 3\)", done.out)
    words = " ".join(done.out.split())
    assert "next: 2 of 960 answers are lost, too few to tell why: record for longer" in words
    assert "@no-response` draws the first of them." in words


def test_what_an_incident_of_one_servo_explains_of_it_is_still_said_of_others(
    diagnose: Asked, tmp_path: Path
) -> None:
    def dies(talk: Conversation, cycle: int, servo: int) -> bool:
        if not (servo == 2 and cycle >= 200) and (cycle, servo) not in {(90, 1), (240, 3)}:
            return False
        talk.ask_in_vain(servo)
        return True

    log = said(tmp_path / "a.log", robot("mightyzap", 8, instead=dies))
    words = diagnose.says(log).out
    assert re.search(r"servo 2 answered until", words)
    assert "no cause can be told of 2 x no-response (servos 1, 3)\n" in words
    (drawn,) = re.findall(r"a\.log@(\d+)` draws the first of them", words)
    assert "no-response" in command("explain", f"{log}@{drawn}").out
    told = diagnose.told(log)
    assert told["unexplained"] == [
        {"bus": "bus0", "code": "no-response", "count": 2, "servo_ids": [1, 3]}
    ]


@pytest.mark.parametrize("protocol", ["mightyzap", "rs30x", "wck"])
def test_of_bytes_without_a_single_frame_nobody_says_that_nothing_is_wrong(
    protocol: str, diagnose: Asked, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    """What lies before a first frame that never comes is no beginning of a capture."""
    capture, rules = tmp_path / "a.bin", tmp_path / "rules.toml"
    capture.write_bytes(bytes.fromhex("C1 51") * 250)
    words = " ".join(diagnose.says(capture, "--protocol", protocol).out.split())
    assert words.startswith("no cause can be told of 500 bytes, none of them in a frame next: ")
    rules.write_text('[[rule]]\nname = "sound"\nwhat = "incidents"\nat_most = 0\n')
    checked = within(capsys, "check", capture, "--protocol", protocol, "--rules", rules)
    assert checked.status == 1
    assert "UNDECIDED  sound: not one frame was read" in checked.out


def test_where_what_no_cause_explains_is_drawn_can_be_copied(
    diagnose: Asked, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.chdir(tmp_path)
    for name, as_typed in (("a.log", "a.log@no-response"), ("a b.log", "'a b.log@no-response'")):
        few_lost(tmp_path / name)
        words = " ".join(diagnose.says(name).out.split())
        assert f"`sniffer explain {as_typed}` draws the first of them." in words


def test_what_no_cause_explains_in_a_part_is_drawn_in_the_part(diagnose: Asked) -> None:
    capture = CAPTURES / "mightyzap_damaged.log"
    words = " ".join(diagnose.says(capture, "--from", "7.9").out.split())
    (place,) = re.findall(r"mightyzap_damaged\.log@(\d+)` draws the first of them", words)
    assert int(place) > 18_000
    drawn = command("explain", f"{capture}@{place}")
    assert "22:55:13.9" in drawn.out


def test_of_several_files_each_is_named_where_it_is_told_of(
    diagnose: Asked, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.chdir(tmp_path)
    names = ("a.log", "b.log")
    for name in names:
        few_lost(tmp_path / name)
    words = " ".join(diagnose.says(*names).out.split())
    assert all(f"`sniffer explain {name}@no-response`" in words for name in names)


def test_a_sound_capture_names_no_next_act(diagnose: Asked, tmp_path: Path) -> None:
    assert "next:" not in diagnose.says(said(tmp_path / "a.log", robot("mightyzap", 4))).out


def test_a_servo_that_was_asked_before_it_was_there_lost_no_answer(
    diagnose: Asked, tmp_path: Path
) -> None:
    def comes_late(talk: Conversation, cycle: int, servo: int) -> bool:
        if servo != 3 or cycle > 100:
            return False
        if cycle % 25 == 0:
            talk.ask_in_vain(3)
        return True

    done = diagnose.says(said(tmp_path / "a.log", robot("mightyzap", 8, instead=comes_late)))
    assert "nothing is wrong" in done.out


def test_a_report_on_a_few_lost_answers_is_not_that_of_a_sound_capture(
    capsys: pytest.CaptureFixture[str], tmp_path: Path
) -> None:
    capture, page = few_lost(tmp_path / "a.log"), tmp_path / "a.html"
    assert within(capsys, "report", capture, "-o", page).status == 0
    assert 'class="verdict warn"' in page.read_text(encoding="utf-8")
    assert "No cause can be told of 2 x no-response (servos 1, 3)." in page.read_text("utf-8")


def test_who_looks_for_servos_finds_nothing_wrong(diagnose: Asked, tmp_path: Path) -> None:
    talk = Conversation("mightyzap")
    for servo in range(1, 40):
        if servo < 4:
            talk.read(servo, 0.5)
        else:
            talk.ask_in_vain(servo)
    assert "nothing is wrong, judged on" in diagnose.says(said(tmp_path / "a.log", talk)).out


def test_the_weighing_of_an_incident_is_shown_with_every_number(
    diagnose: Asked, tmp_path: Path
) -> None:
    path = log(tmp_path / "a.log", "mightyzap", "dead:2@5s")
    done = diagnose.says(path, "--why", "1")
    assert "silent-since" in done.out
    rows = re.findall(r"^ *([+-]\d+\.\d) ", done.out, re.MULTILINE)
    assert len(rows) > 2


def test_an_incident_that_there_is_not_is_refused_with_those_that_there_are(
    diagnose: Asked, tmp_path: Path
) -> None:
    path = log(tmp_path / "a.log", "mightyzap", "dead:2@5s")
    done = diagnose.says(path, "--why", "9")
    assert done.status == 2
    assert "there is no incident 9: 1 to 1" in done.err


def test_only_a_part_is_judged_where_one_is_asked_for(diagnose: Asked, tmp_path: Path) -> None:
    path = log(tmp_path / "a.log", "mightyzap", "dead:2@5s")
    assert diagnose.told(path, "--to", "4")["incidents"] == []
    late = diagnose.told(path, "--from", "6")["incidents"]
    assert [i["causes"][0]["cause"] for i in late] == ["servo-absent"]


def test_a_part_that_ends_before_it_begins_is_refused(diagnose: Asked) -> None:
    done = diagnose.says(CAPTURES / "wck_clean.log", "--from", "3", "--to", "2")
    assert done.status == 2
    assert "--to must lie behind --from" in done.err


def test_a_capture_at_a_wrong_rate_is_told_as_that_and_not_as_an_unknown_protocol(
    diagnose: Asked, tmp_path: Path
) -> None:
    scenario = next(s for s in scenarios() if s.name == "wrong-baud-double-mightyzap")
    path = tmp_path / "a.log"
    lines = [f"({h.t_end_ns / 1e9:.6f}) bus0 #{h.wire.hex()}\n" for h in scenario.make(0) if h.wire]
    path.write_text("".join(lines), encoding="ascii")
    (incident,) = diagnose.told(path)["incidents"]
    assert incident["causes"][0]["cause"] == "wrong-baud"


def test_causes_that_are_nothing_are_not_shown_and_scripts_have_them(diagnose: Asked) -> None:
    capture = CAPTURES / "mightyzap_damaged.log"
    told = diagnose.says(capture).out
    assert " 0 %" not in told
    assert " 4 %  emi-load" in told
    (brownout, *_) = diagnose.told(capture)["incidents"]
    assert [c["cause"] for c in brownout["causes"]] == ["brownout", "bus-noise", "emi-load"]


def test_an_echo_is_told_as_what_it_is_and_not_as_one_of_a_number(
    diagnose: Asked, tmp_path: Path
) -> None:
    talk = Conversation("mightyzap")
    for _ in range(40):
        for servo in (1, 2):
            talk.say(talk.tongue.ask(servo))
            talk.read(servo, 0.5)
    told = diagnose.says(said(tmp_path / "echo.log", talk)).out
    assert "every request is heard twice" in told
    assert "1 x adapter-echo" not in told
