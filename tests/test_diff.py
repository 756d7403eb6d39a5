"""``sniffer diff``: in what two runs differ, by tests that hold what they promise."""

from __future__ import annotations

import json
from pathlib import Path
from typing import TYPE_CHECKING, Any, Final

import numpy as np
import pytest

from sniffer.ground.model import Chunk, Clock
from sniffer.sinks.raw import LogFile
from tests.commands import within
from tests.recordings import START_NS
from tests.schemas import hold_to
from tests.streams.mightyzap import packet
from tests.test_rerun import read

if TYPE_CHECKING:
    from collections.abc import Callable

Capsys = pytest.CaptureFixture[str]

CAPTURES: Final = Path(__file__).parents[1] / "sample_captures"
MS: Final = 1_000_000


def run(
    path: Path,
    seed: int,
    alter: Callable[[int, bytes], tuple[bytes, float] | None] = lambda who, data: (data, 0.0),
    cycles: int = 120,
) -> Path:
    """Write a run: three servos are read every 20 ms; ``alter`` changes an answer and its time.

    It returns the answer's bytes and by how many ms it is later, or None where none comes.
    """
    rng = np.random.default_rng(seed)
    told: list[Chunk] = []
    t = 0.0
    for cycle in range(cycles):
        t = cycle * 20.0
        for who in (1, 2, 3):
            ask = packet(who, 0xF2, b"\x8c\x08")
            told.append(Chunk(ask, START_NS + int(t * MS), Clock.FILE))
            measured = (2000 + int(rng.normal(0, 20)), int(rng.integers(0, 900)), 0)
            data = b"".join(v.to_bytes(2, "little") for v in measured) + bytes([120, 30])
            answer = alter(who, packet(who, 0, data))
            if answer is not None:
                late = 4.0 + rng.normal(0, 0.1) + answer[1]
                told.append(Chunk(answer[0], START_NS + int((t + late) * MS), Clock.FILE))
            t += 6.5 + rng.normal(0, 0.02)
    file = LogFile(path)
    file.take(told)
    file.close()
    return path


def compared(capsys: Capsys, *arguments: str | Path) -> tuple[int, Any]:
    ran = within(capsys, "diff", *arguments, "--baud", "57600", "--format", "json")
    found = json.loads(ran.out)
    hold_to("diff", found)
    return ran.status, found


def test_two_runs_of_one_kind_are_the_same(tmp_path: Path, capsys: Capsys) -> None:
    a, b = run(tmp_path / "a.log", 1), run(tmp_path / "b.log", 2)
    status, found = compared(capsys, a, b)
    assert (status, found["differences"]) == (0, [])
    assert found["tests"] > 20
    ran = within(capsys, "diff", a, b)
    assert ran.status == 0
    assert ran.out.splitlines()[-1].startswith("the same, as far as ")


def late(who: int, data: bytes) -> tuple[bytes, float]:
    return data, 2.0 if who == 2 else 0.0


def warm(who: int, data: bytes) -> tuple[bytes, float]:
    if who != 3:
        return data, 0.0
    at = int.from_bytes(data[6:8], "little") + 60
    return packet(who, 0, at.to_bytes(2, "little") + data[8:-1]), 0.0


class Warming:
    """What servo 2 states last rises by a count every 40 answers, from some beginning on."""

    def __init__(self, first: int) -> None:
        self.first, self.n = first, 0

    def __call__(self, who: int, data: bytes) -> tuple[bytes, float]:
        self.n += who == 2
        warmth = bytes([self.first + self.n // 40])
        return (packet(who, 0, data[6:-2] + warmth), 0.0) if who == 2 else (data, 0.0)


def test_slow_values_that_lie_apart_are_told_though_nothing_is_proven(
    tmp_path: Path, capsys: Capsys
) -> None:
    """A servo that is 12 degrees hotter from end to end: the runs were called the same."""
    a, b = run(tmp_path / "a.log", 1, Warming(35)), run(tmp_path / "b.log", 2, Warming(47))
    status, found = compared(capsys, a, b)
    assert (status, found["differences"]) == (0, [])
    (one,) = found["unproven"]
    assert (one["about"], one["servo_id"], one["effect"]) == ("value", 2, 1)
    ran = within(capsys, "diff", a, b, "--baud", "57600")
    assert ran.status == 0
    assert "\n1 not proven: all of one run lie beyond all of the other, " in ran.out
    assert ran.out.splitlines()[-2].endswith(" is 36 in A, 48 in B (medians)")
    assert "unproven" not in compared(capsys, a, run(tmp_path / "c.log", 3, Warming(35)))[1]


class Dropping:
    """Leaves out every sixth answer of servo 1."""

    def __init__(self) -> None:
        self.n = 0

    def __call__(self, who: int, data: bytes) -> tuple[bytes, float] | None:
        self.n += who == 1
        return None if who == 1 and self.n % 6 == 0 else (data, 0.0)


@pytest.mark.parametrize(
    ("alter", "about", "name", "servo", "test"),
    [
        (late, "response_time", "load_data", 2, "Mann-Whitney"),
        (warm, "value", "position_mm", 3, "Mann-Whitney"),
        (Dropping(), "missing", "", 1, "Fisher"),
    ],
)
def test_what_differs_is_told_first_with_its_servo_and_its_test(
    alter: Callable[[int, bytes], tuple[bytes, float] | None],
    about: str,
    name: str,
    servo: int,
    test: str,
    tmp_path: Path,
    capsys: Capsys,
) -> None:
    a, b = run(tmp_path / "a.log", 1), run(tmp_path / "b.log", 2, alter)
    status, found = compared(capsys, a, b)
    assert status == 1
    mine = [d for d in found["differences"] if d["servo_id"] is not None]
    first = mine[0]
    assert (first["about"], first["name"], first["servo_id"]) == (about, name, servo)
    assert first["test"] == test
    assert first["p"] < 1e-3
    assert {d["servo_id"] for d in mine} == {servo}
    chances = [d["p"] for d in found["differences"]]
    assert chances == sorted(chances)
    ran = within(capsys, "diff", a, b, "--baud", "57600")
    assert ran.status == 1
    assert first["sentence"] in ran.out


def test_settings_commands_and_servos_of_one_run_only_are_told(
    tmp_path: Path, capsys: Capsys
) -> None:
    a = run(tmp_path / "a.log", 1)
    more = [
        Chunk(packet(1, 0xF3, b"\x07\x05"), START_NS + 3_000 * MS, Clock.FILE),
        *(
            Chunk(packet(7, 0xF2, b"\x8c\x08"), START_NS + (3_100 + 20 * k) * MS, Clock.FILE)
            for k in range(30)
        ),
    ]
    b = run(tmp_path / "b.log", 2)
    with b.open("a") as file:
        extra = LogFile(tmp_path / "more.log")
        extra.take(more)
        extra.close()
        file.write((tmp_path / "more.log").read_text())
    status, found = compared(capsys, a, b)
    told = {(d["about"], d["servo_id"], d["name"]) for d in found["differences"]}
    assert status == 1
    assert ("servo", 7, "") in told
    assert ("command", 7, "load_data") in told


def test_a_difference_that_the_stamps_cannot_carry_is_none(tmp_path: Path, capsys: Capsys) -> None:
    """Half a millisecond, and stamps that may lag by sixteen."""
    a = run(tmp_path / "a.log", 1)
    b = run(tmp_path / "b.log", 2, lambda who, data: (data, 0.5))
    told = compared(capsys, a, b, "--latency", "16")[1]["differences"]
    assert "response_time" not in {d["about"] for d in told}
    sharp = compared(capsys, a, b, "--latency", "0")[1]["differences"]
    assert "response_time" in {d["about"] for d in sharp}


def test_both_runs_stand_in_one_picture(tmp_path: Path, capsys: Capsys) -> None:
    a, b = run(tmp_path / "a.log", 1, cycles=20), run(tmp_path / "b.log", 2, late, cycles=20)
    out = tmp_path / "both.rrd"
    ran = within(capsys, "diff", a, b, "-o", out)
    assert ran.status in (0, 1)
    _, styles = read(out)
    for run_name in "AB":
        of_servo = styles[f"/{run_name}/servo/1/present_position"]
        assert of_servo["SeriesLines:names"] == [f"servo 1 {run_name}"]
        assert styles[f"/{run_name}/bus_load"]["SeriesLines:names"] == [f"bus {run_name}"]
    again = within(capsys, "diff", a, b, "-o", out)
    assert again.status == 2
    assert again.complaint.endswith("is there already: choose another name, or --force")


def test_a_run_is_compared_with_a_later_part_of_another(tmp_path: Path, capsys: Capsys) -> None:
    def later(who: int, data: bytes) -> tuple[bytes, float]:
        later.asked += 1  # type: ignore[attr-defined]
        return data, 2.0 if later.asked > 180 else 0.0  # type: ignore[attr-defined]

    later.asked = 0  # type: ignore[attr-defined]
    path = run(tmp_path / "a.log", 1, later)  # 2.4 s, slower from 1.2 s on
    part = ("--from", "0.1", "--to", "1.1")
    status, found = compared(capsys, path, path, *part, "--from-b", "1.3")
    assert status == 1
    assert found["parts"] == [
        "from second 0.1 to second 1.1",
        "from second 1.3 to second 2.3",
    ]
    assert found["a"]["frames"] == found["b"]["frames"]
    assert {d["about"] for d in found["differences"]} == {"response_time"}
    status, found = compared(capsys, path, path, *part, "--from-b", "0.1", "--to-b", "1.1")
    assert (status, found["differences"]) == (0, [])


def test_parts_of_two_runs_lie_one_over_the_other_in_the_picture(
    tmp_path: Path, capsys: Capsys
) -> None:
    a, b = run(tmp_path / "a.log", 1), run(tmp_path / "b.log", 2)
    out = tmp_path / "both.rrd"
    part = ("--from", "0.2", "--to", "0.6")
    assert within(capsys, "diff", a, b, *part, "--from-b", "1.2", "-o", out).status in (0, 1)
    rows, _ = read(out)
    for entity in ("/A/servo/1/present_position", "/B/servo/1/present_position"):
        times = [t for t, *_ in rows[entity]]
        assert 1.2 <= min(times) / 1e9 < 1.23
        assert 1.57 < max(times) / 1e9 <= 1.6


@pytest.mark.parametrize(
    ("arguments", "told"),
    [
        (("-o", "x.mcap"), "x.mcap: plots of both end in .rrd"),
        (("--format", "xml"), "Invalid value for '--format'"),
        (
            ("--from", "@first-error", "--to", "3", "--from-b", "1"),
            "--from-b: nobody knows how long the part of A is: say --to-b, too",
        ),
        (("--from-b", "3", "--to-b", "2"), "--to must lie behind --from"),
        (("--to-b", "soon"), "Invalid value for '--to-b'"),
    ],
)
def test_a_call_that_cannot_be_says_what_to_do(
    arguments: tuple[str, ...], told: str, tmp_path: Path, capsys: Capsys
) -> None:
    a = run(tmp_path / "a.log", 1, cycles=3)
    ran = within(capsys, "diff", a, a, *arguments)
    assert (ran.status, ran.complaint[: len(told)]) == (2, told)


def test_runs_without_a_bus_in_common_are_a_mistake(tmp_path: Path, capsys: Capsys) -> None:
    one = run(tmp_path / "a.log", 1, cycles=9)
    for name, buses in (("x.log", ("a", "b")), ("y.log", ("c", "d"))):
        lines = one.read_text()
        (tmp_path / name).write_text("".join(lines.replace("bus0", bus) for bus in buses))
    ran = within(capsys, "diff", tmp_path / "x.log", tmp_path / "y.log", "--protocol", "mightyzap")
    assert ran.status == 2
    assert "no bus in common; name one of each: --bus a,c" in ran.complaint


def test_a_bus_that_is_named_of_each_run_is_compared_with_the_other(
    tmp_path: Path, capsys: Capsys
) -> None:
    one, other = (run(tmp_path / f"{n}.log", n, cycles=30) for n in (1, 2))
    alone = within(capsys, "diff", one, other, "-q")
    for name, log, buses in (("x.log", one, ("arm", "b")), ("y.log", other, ("c", "left"))):
        lines = log.read_text()
        (tmp_path / name).write_text("".join(lines.replace("bus0", bus) for bus in buses))
    mixed = ("diff", tmp_path / "x.log", tmp_path / "y.log", "--protocol", "mightyzap", "-q")
    named = within(capsys, *mixed, "--bus", "arm,left")
    assert named.status == alone.status
    head, *told = named.out.splitlines()
    assert head == "of each what is selected: bus IN ('arm', 'left')"
    assert [line.replace("arm ", "bus0 ") for line in told[2:]] == alone.out.splitlines()[2:]
    assert within(capsys, *mixed, "--bus", "arm").status == 2


@pytest.mark.parametrize("asked", [("--code", "noise"), ("--where", "reason = 'noise'")])
def test_anomalies_and_gaps_alone_are_compared_by_how_often_they_are_told(
    asked: tuple[str, str], tmp_path: Path, capsys: Capsys
) -> None:
    a, damaged = run(tmp_path / "a.log", 1, cycles=30), tmp_path / "b.log"
    lines = run(tmp_path / "c.log", 2, cycles=30).read_text().splitlines()
    noisy = [f"{line}5a5a" if k % 5 == 1 else line for k, line in enumerate(lines)]
    damaged.write_text("\n".join(noisy) + "\n")
    status, found = compared(capsys, a, damaged, *asked)
    assert (status, found["tests"]) == (1, 1)
    (told,) = found["differences"]
    assert (told["name"], told["a"]) == ("noise", {"n": 180, "count": 0})
    assert told["b"] == {"n": 180, "count": 36}
    assert compared(capsys, damaged, damaged, *asked)[0] == 0
    assert within(capsys, "diff", a, a, *asked).status == 2


def test_runs_of_two_protocols_say_so_first_and_compare_no_registers(capsys: Capsys) -> None:
    """The gain of one was held against that of the other, as though it had been changed."""
    done = within(
        capsys,
        *("diff", CAPTURES / "mightyzap_clean.log", CAPTURES / "wck_clean.log"),
        *("--format", "json"),
    )
    assert done.status == 1
    first, *others = json.loads(done.out)["differences"]
    assert (first["about"], first["bus"], first["servo_id"]) == ("protocol", "bus0", None)
    assert first["sentence"].startswith("mightyzap is spoken in A, wck in B")
    assert (first["a"]["protocol"], first["b"]["protocol"]) == ("mightyzap", "wck")
    assert not [each for each in others if each["about"] in ("setting", "protocol")]
