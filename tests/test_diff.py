"""``sniffer diff``: in what two runs differ, by tests that hold what they promise."""

from __future__ import annotations

import itertools
import json
import math
from fractions import Fraction
from pathlib import Path
from typing import TYPE_CHECKING, Any, Final

import jsonschema
import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from sniffer.ground.model import Chunk, Clock
from sniffer.ground.registers import schema_path
from sniffer.reports.runs import KEPT
from sniffer.reports.significance import ALPHA, holm, mann_whitney, rates, shares
from sniffer.sinks.raw import LogFile
from sniffer.statistics.thinned import Thinned
from tests.commands import within
from tests.recordings import START_NS
from tests.streams.mightyzap import packet
from tests.test_rerun import read

if TYPE_CHECKING:
    from collections.abc import Callable

Capsys = pytest.CaptureFixture[str]

CAPTURES: Final = Path(__file__).parents[1] / "sample_captures"
SCHEMA: Final = json.loads(schema_path("diff.schema.json").read_text(encoding="utf-8"))
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
    jsonschema.validate(found, SCHEMA)
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


# --- the tests themselves, against what is counted one by one -----------------------------------

SMALL = st.lists(st.integers(0, 6), min_size=8, max_size=12)


@given(a=SMALL, b=SMALL)
def test_the_effect_of_ranks_is_how_much_likelier_one_is_larger(a: list[int], b: list[int]) -> None:
    told = mann_whitney(np.array(a, float), np.array(b, float))
    assert told is not None
    pairs = [(y > x) - (y < x) for x, y in itertools.product(a, b)]
    assert told.effect == pytest.approx(sum(pairs) / len(pairs))
    assert 0 <= told.p <= 1


def test_ranks_are_as_likely_as_shuffling_says() -> None:
    rng = np.random.default_rng(5)
    a, b = rng.normal(0, 1, 30), rng.normal(0.6, 1, 24)
    # neighbours unlike each other: all of them count
    a, b = (np.sort(x).reshape(2, -1).T.ravel() for x in (a, b))
    told = mann_whitney(a, b)
    assert told is not None
    both = np.concatenate([a, b])
    extreme, n = 0, 4000
    for _ in range(n):
        rng.shuffle(both)
        delta = 2 * float((both[30:, None] > both[None, :30]).mean()) - 1
        extreme += abs(delta) >= abs(told.effect)
    assert told.p == pytest.approx(extreme / n, rel=0.4)


def test_numbers_that_follow_their_neighbours_count_for_fewer() -> None:
    """Two walks of one kind: taken for independent, nearly every pair would differ."""
    rng = np.random.default_rng(1)
    wrong = alone = 0
    for _ in range(60):
        walks = []
        for _ in range(2):
            walk = np.zeros(400)
            for k, step in enumerate(rng.normal(0, 1, 399)):
                walk[k + 1] = 0.95 * walk[k] + step
            walks.append(walk)
        told = mann_whitney(*walks)
        assert told is not None
        wrong += told.p < 0.05
        shuffled = [rng.permutation(walk) for walk in walks]
        naive = mann_whitney(*shuffled)
        assert naive is not None
        alone += naive.p < 0.05
    assert alone > 30
    assert wrong < 12


def test_a_state_that_never_changed_was_seen_once() -> None:
    a, b = np.full(500, 30.0), np.full(500, 31.0)
    lasting, single = mann_whitney(a, b, lasts=True), mann_whitney(a, b)
    assert lasting is not None
    assert single is not None
    assert lasting.p > 0.05
    assert single.p < 1e-12
    a[100] = 35
    glitch = mann_whitney(a, b, lasts=True)
    assert glitch is not None
    assert glitch.p > 0.05


@given(st.integers(0, 9), st.integers(1, 9), st.integers(0, 9), st.integers(1, 9))
def test_shares_are_as_likely_as_counting_says(k: int, n: int, j: int, m: int) -> None:
    k, j = min(k, n), min(j, m)
    told = shares(k, n, j, m)
    assert told is not None
    hits = k + j
    chance = {
        i: Fraction(math.comb(n, i) * math.comb(m, hits - i), math.comb(n + m, hits))
        for i in range(max(0, hits - m), min(hits, n) + 1)
    }
    want = sum(p for p in chance.values() if p <= chance[k])
    assert told.p == pytest.approx(float(want), rel=1e-6)


@given(st.integers(0, 9), st.integers(1, 5), st.integers(0, 9), st.integers(1, 5))
def test_rates_are_as_likely_as_counting_says(k: int, s: int, j: int, t: int) -> None:
    told = rates(k, s, j, t)
    n, p = k + j, Fraction(s, s + t)
    if not n:
        assert told is None
        return
    assert told is not None
    chance = [math.comb(n, i) * p**i * (1 - p) ** (n - i) for i in range(n + 1)]
    assert told.p == pytest.approx(float(sum(c for c in chance if c <= chance[k])), rel=1e-6)


def test_very_many_cases_are_as_likely_as_few_ones_say() -> None:
    exact = shares(9_900, 19_900, 10_200, 19_900)
    about = shares(19_800 * 2, 39_800 * 2, 20_100 * 2, 39_800 * 2)
    assert exact is not None
    assert about is not None
    assert (exact.test, about.test) == ("Fisher", "two proportions")
    assert exact.p == pytest.approx(0.0026, rel=0.2)
    told = rates(30_000, 1.0, 30_600, 1.0)
    assert told is not None
    assert told.p == pytest.approx(0.0149, rel=0.05)


@given(st.lists(st.floats(1e-9, 1), max_size=12))
def test_a_corrected_chance_is_never_smaller_and_keeps_the_order(chances: list[float]) -> None:
    out = holm(chances)
    assert all(q >= p for p, q in zip(chances, out, strict=True))
    assert sorted(range(len(out)), key=lambda k: (chances[k], k)) == sorted(
        range(len(out)), key=lambda k: (out[k], chances[k], k)
    )
    if chances:
        assert min(out) == pytest.approx(min(min(chances) * len(chances), 1.0))
    assert 0 < ALPHA < 0.05


@settings(max_examples=20)
@given(st.lists(st.integers(0, 9000), min_size=1, max_size=12))
def test_a_long_series_is_thinned_evenly_however_it_comes(sizes: list[int]) -> None:
    series, at = Thinned(KEPT), 0
    for size in sizes:
        series.add(np.arange(at, at + size, dtype=float))
        at += size
    kept = series.values()
    assert series.count == at
    assert len(kept) <= KEPT
    if len(kept) > 1:
        step = int(kept[1] - kept[0])
        assert kept.tolist() == list(range(0, at, step))
