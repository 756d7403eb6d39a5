"""``sniffer diagnose`` of several buses: whose an incident is, and which are one fault."""

from __future__ import annotations

import functools
import json
import re
from typing import TYPE_CHECKING

import pytest

from sniffer.diagnosis.shared import numbered
from sniffer.simulation.buses import simulate
from sniffer.simulation.faults import read_fault
from sniffer.simulation.render import candump, frame_reads
from tests.commands import within
from tests.lists import each_in_turn

if TYPE_CHECKING:
    from collections.abc import Sequence
    from pathlib import Path


@functools.cache
def heard(
    name: str, protocol: str, *faults: str, seed: int = 1, seconds: float = 12
) -> Sequence[str]:
    """Return the lines of a log that a bus has, with its faults."""
    struck = [read_fault(fault) for fault in faults]
    frames = simulate(protocol, seed=seed, faults=struck, duration_s=seconds)
    return tuple(candump(frame_reads(frames), name).splitlines())


def robot(path: Path, **buses: tuple[str, ...]) -> Path:
    """Write what is heard of a robot: each bus with its faults."""
    seeds = enumerate(buses.items())
    return beside(path, *(heard(bus, "mightyzap", *f, seed=n) for n, (bus, f) in seeds))


def beside(path: Path, *buses: Sequence[str]) -> Path:
    """Write what is heard of buses side by side in one log."""
    lines = [line for bus in buses for line in bus]
    lines.sort(key=lambda line: float(line.split(")")[0][1:]))
    path.write_text("\n".join(lines) + "\n", encoding="ascii")
    return path


def told(capsys: pytest.CaptureFixture[str], path: Path, *arguments: str) -> str:
    done = within(capsys, "diagnose", path, *arguments)
    assert done.status == 0, done.err
    return " ".join(done.out.split())


def test_each_incident_of_several_buses_is_told_with_its_bus(
    capsys: pytest.CaptureFixture[str], tmp_path: Path
) -> None:
    path = robot(tmp_path / "a.log", arm=("dead:2@3s",), leg=("dead:2@8s",))
    words = told(capsys, path)
    assert words.startswith(
        "2 incidents: 1 servo-dead of servo 2 on arm (96 %), 2 servo-dead of servo 2 on leg (96 %) "
    )
    assert "error arm: a servo that stopped answering (servo 2)" in words
    assert "error leg: a servo that stopped answering (servo 2)" in words
    assert " see byte leg:" in words, "as --from @byte: takes it"
    assert told(capsys, path, "--why", "2").startswith("leg: a servo that stopped answering")


def test_the_bus_of_an_incident_is_not_told_where_there_is_one(
    capsys: pytest.CaptureFixture[str], tmp_path: Path
) -> None:
    words = told(capsys, robot(tmp_path / "a.log", arm=("dead:2@3s",)))
    assert "arm: a servo" not in words


def test_what_strikes_several_buses_at_once_is_told_as_one_fault(
    capsys: pytest.CaptureFixture[str], tmp_path: Path
) -> None:
    path = robot(tmp_path / "a.log", arm=("dead:2@6s",), leg=("dead:3@6s",), head=())
    words = told(capsys, path)
    assert words.startswith(
        "2 incidents: 1 and 2 servo-dead of 2 servos on arm and leg (96 %) Incidents 1 and 2 "
    )
    assert "look first at what these buses share (their supply, its switch and fuse, " in words
    assert words.count("next: ") == 2
    assert "next: as 1 " in words
    found = json.loads(within(capsys, "diagnose", path, "--format", "json").out)["incidents"]
    assert [i["bus"] for i in found] == ["arm", "leg"], "scripts have one a bus"


def test_buses_on_which_nobody_ever_answers_are_told_as_one_fault(
    capsys: pytest.CaptureFixture[str], tmp_path: Path
) -> None:
    """As with cables in each other's port: nobody asked is there, and nothing was seen to begin."""
    nobody = tuple(f"absent:{servo}" for servo in (1, 2, 3))
    words = told(capsys, robot(tmp_path / "a.log", arm=nobody, leg=nobody, head=()))
    assert "Nobody answers on arm and leg from the first request on (incidents 1 and 2): " in words
    assert "these buses share (cables in each other's port, their supply, " in words
    one = told(capsys, robot(tmp_path / "b.log", arm=nobody, head=()))
    assert "not one answer" in one
    assert "likelier" not in one


def wires(protocol: str, asked: str, answered: str, *, seed: int = 1) -> list[str]:
    """Return what is heard of a bus, each direction as if it were a bus."""
    frames = list(simulate(protocol, seed=seed, duration_s=12))
    return [
        line
        for bus, kind in ((asked, "request"), (answered, "response"))
        for line in candump(frame_reads(f for f in frames if f.kind == kind), bus).splitlines()
    ]


@each_in_turn(
    2,
    ("asked", "answering", "files"),
    [("ctl", "srv", ("ctl", "srv")), ("/dev/tty0", "/dev/tty1", ("_dev_tty0", "_dev_tty1"))],
)
def test_two_buses_that_are_the_wires_of_one_line_are_told_so(
    asked: str,
    answering: str,
    files: tuple[str, str],
    capsys: pytest.CaptureFixture[str],
    tmp_path: Path,
) -> None:
    """They were sent to tap anew, twice."""
    path = beside(tmp_path / "a.log", wires("mightyzap", asked, answering))
    words = told(capsys, path)
    assert f"What is asked on {asked} is answered on {answering}, by the same servos at o" in words
    both = [tmp_path / f"wire-{name}.mcap" for name in files]
    first, second = (path.name for path in both)
    assert f"`sniffer merge {first} {second} --pair -o bus.mcap` make them one" in words
    assert "likelier" not in words
    assert within(capsys, "cut", path, "--split", "bus", "-o", tmp_path / "wire.mcap").status == 0
    bus = tmp_path / "bus.mcap"
    assert within(capsys, "merge", *both, "--pair", "-o", bus).status == 0
    assert told(capsys, bus).startswith("nothing is wrong")


def test_two_files_that_are_the_wires_of_one_line_are_told_so(
    capsys: pytest.CaptureFixture[str], tmp_path: Path
) -> None:
    """Each was said to be half of a conversation, and which command joins them was not."""
    paths = []
    for name, kind in (("my ctl.log", "request"), ("srv.log", "response")):
        frames = [f for f in simulate("mightyzap", seed=1, duration_s=12) if f.kind == kind]
        paths.append(beside(tmp_path / name, candump(frame_reads(frames), "bus0").splitlines()))
    for format_ in ("text", "json"):
        done = within(capsys, "diagnose", *paths, "--format", format_)
        first, second = (str(path) for path in paths)
        assert f"What is asked in {first} is answered in {second}, by the same" in done.err
        assert f"`sniffer merge '{first}' {second} --pair -o bus.mcap` makes them one" in done.err
    assert "is answered in" not in within(capsys, "diagnose", paths[0], paths[0]).err
    refused = within(capsys, "decode", *paths)
    assert refused.status == 2
    assert "`sniffer merge --pair`" in refused.err


def test_which_wires_belong_together_is_not_guessed_where_arms_have_servos_of_the_same_ids(
    capsys: pytest.CaptureFixture[str], tmp_path: Path
) -> None:
    pairs = (wires("mightyzap", f"ctl{n}", f"srv{n}", seed=n) for n in (1, 2))
    words = told(capsys, beside(tmp_path / "a.log", *pairs))
    assert "is answered on" not in words
    assert "Nobody answers on ctl1 and ctl2" in words


@pytest.mark.parametrize("suffix", ["md", "html"])
def test_a_report_tells_what_strikes_several_buses_at_once_as_one_fault(
    capsys: pytest.CaptureFixture[str], tmp_path: Path, suffix: str
) -> None:
    path = robot(tmp_path / "a.log", arm=("dead:2@6s",), leg=("dead:3@6s",))
    out = tmp_path / f"a.{suffix}"
    assert within(capsys, "report", path, "-o", out).status == 0
    assert "on arm and leg: one fault is likelier than 2" in out.read_text("utf-8")


def test_faults_of_several_buses_that_begin_apart_are_faults_of_their_own(
    capsys: pytest.CaptureFixture[str], tmp_path: Path
) -> None:
    words = told(capsys, robot(tmp_path / "a.log", arm=("dead:2@3s",), leg=("dead:3@8s",)))
    assert "likelier" not in words


def test_what_is_there_from_the_begin_on_is_not_told_to_begin_together(
    capsys: pytest.CaptureFixture[str], tmp_path: Path
) -> None:
    words = told(capsys, robot(tmp_path / "a.log", arm=("dead:2@0.5s",), leg=("dead:3@0.5s",)))
    assert words.startswith("2 incidents: ")
    assert "likelier" not in words


def test_a_rule_of_check_that_fails_names_the_bus(
    capsys: pytest.CaptureFixture[str], tmp_path: Path
) -> None:
    path = robot(tmp_path / "a.log", arm=(), leg=("dead:2@6s",))
    rules = tmp_path / "rules.toml"
    rules.write_text(
        "[[rule]]\nwhat = 'incidents'\nfrom = 'error'\nat_most = 0\n", encoding="utf-8"
    )
    assert "servo-dead on leg: " in within(capsys, "check", path, "--rules", rules).out


def test_the_verdict_of_a_report_names_the_bus(
    capsys: pytest.CaptureFixture[str], tmp_path: Path
) -> None:
    path, out = robot(tmp_path / "a.log", arm=(), leg=("dead:2@6s",)), tmp_path / "a.md"
    assert within(capsys, "report", path, "-o", out).status == 0
    assert "error: A servo that stopped answering on leg (servo 2)**" in out.read_text("utf-8")


@pytest.mark.parametrize("seconds", [2, 7])
def test_what_came_behind_the_last_frame_is_told_beside_how_long_frames_were_heard(
    seconds: int, capsys: pytest.CaptureFixture[str], tmp_path: Path
) -> None:
    """Of 10 s of which the last 7 were torn it said 2.8 s."""
    frames = list(simulate("mightyzap", seed=1, duration_s=3))
    lines = candump(frame_reads(frames), "bus0").splitlines()
    last = float(lines[-1][1:].partition(")")[0])
    torn = [f"({last + k / 10:.6f}) bus0 #{k * 37 % 251:02X}A5" for k in range(1, 10 * seconds + 1)]
    words = told(capsys, beside(tmp_path / "a.log", [*lines, *torn]))
    assert ("then bytes of no frame for 7 s" in words) == (seconds == 7)


def test_a_bus_that_says_nothing_more_while_others_go_on_is_told(
    capsys: pytest.CaptureFixture[str], tmp_path: Path
) -> None:
    """Its port came off, or what drives it stopped: no byte tells which, and all was sound."""
    arm, leg = (heard(bus, "rs30x", seconds=n) for bus, n in (("arm", 16.0), ("leg", 8.0)))
    words = told(capsys, beside(tmp_path / "a.log", arm, leg))
    arms, legs = words.removeprefix("nothing is wrong, judged on ").split("; ")
    assert "nothing" not in arms
    assert legs.endswith("then nothing for the last 8 s, while others go on")
    few = beside(tmp_path / "b.log", arm, heard("leg", "rs30x", seconds=13))
    assert "then nothing" not in told(capsys, few), "no two of them end at once"


def at_another_rate(lines: Sequence[str]) -> list[str]:
    """Return lines in which every byte is another one, always the same: no frame holds."""
    told = (line.rpartition("#") for line in lines)
    return [f"{head}#{bytes(b ^ 0xD5 for b in bytes.fromhex(h)).hex()}" for head, _, h in told]


def test_a_bus_whose_bytes_nothing_explains_leaves_the_others_their_protocols(
    capsys: pytest.CaptureFixture[str], tmp_path: Path
) -> None:
    """All were judged as the first protocol's: seven sound buses were not raw, at 99 %."""
    torn = at_another_rate(heard("leg", "lss", seconds=6))
    path = beside(tmp_path / "a.log", heard("arm", "lss", seconds=6), torn, heard("tail", "rs30x"))
    done = within(capsys, "diagnose", path, "--format", "json")
    found = json.loads(done.out)
    assert [(i["bus"], i["causes"][0]["cause"]) for i in found["incidents"]] == [
        ("leg", "wrong-baud")
    ]
    assert {j["bus"]: j["protocol"] for j in found["judged"]} == {
        "arm": "lss",
        "leg": "mightyzap",
        "tail": "rs30x",
    }
    silent = re.findall(r"nothing for the last (\d+) s", told(capsys, path))
    assert len(set(silent)) == 1, "arm and leg end together, tail goes on"


def test_a_bus_whose_bytes_nothing_explains_is_judged_by_reports_and_checks_too(
    capsys: pytest.CaptureFixture[str], tmp_path: Path
) -> None:
    """Both were refused, the other bus as well."""
    torn = at_another_rate(heard("leg", "lss", seconds=6))
    path, out = beside(tmp_path / "a.log", heard("arm", "lss", seconds=6), torn), tmp_path / "a.md"
    rules = tmp_path / "rules.toml"
    rules.write_text("[[rule]]\nwhat = 'incidents'\nat_most = 0\n", encoding="utf-8")
    checked = within(capsys, "check", path, "--rules", rules)
    assert (checked.status, "wrong-baud on leg: " in checked.out) == (1, True)
    assert within(capsys, "report", path, "-o", out).status == 0
    assert "error: Wrong baud rate on leg" in out.read_text("utf-8")


def test_where_nothing_can_be_said_of_one_bus_the_others_are_judged_and_it_is_named(
    capsys: pytest.CaptureFixture[str], tmp_path: Path
) -> None:
    few = ["(3.000000) leg #0102030405"]
    path = beside(tmp_path / "a.log", heard("arm", "rs30x", "dead:2@6s"), few)
    done = within(capsys, "diagnose", path, "--format", "json")
    found = json.loads(done.out)
    assert [i["causes"][0]["cause"] for i in found["incidents"]] == ["servo-dead"]
    assert [j["bus"] for j in found["judged"]] == ["arm"]
    assert "cannot tell the protocol of these 5 bytes on leg" in done.err
    assert "--protocol" in done.err, "as the option is called"
    out, rules = tmp_path / "a.md", tmp_path / "rules.toml"
    rules.write_text("[[rule]]\nwhat = 'incidents'\nat_most = 0\n", encoding="utf-8")
    reported = within(capsys, "report", path, "-o", out)
    checked = within(capsys, "check", path, "--rules", rules)
    assert (reported.status, checked.status) == (0, 1)
    for again in (reported, checked):
        assert "cannot tell the protocol of these 5 bytes on leg" in again.err
    assert "stopped answering (servo 2)" in out.read_text("utf-8")


@pytest.mark.parametrize(
    ("numbers", "words"),
    [((1, 2), "1 and 2"), ((1, 2, 3, 4), "1 to 4"), ((1, 3, 4), "1, 3 and 4")],
)
def test_incidents_are_numbered_as_people_write_it(numbers: tuple[int, ...], words: str) -> None:
    assert numbered(numbers) == words
