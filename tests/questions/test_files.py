"""Questions for several captures, other files, and what a capture says of itself."""

from __future__ import annotations

import json
import re
import tomllib
from typing import TYPE_CHECKING

import numpy as np
import pandas as pd
import pytest
from mcap.reader import make_reader

from sniffer.mcapfile.source import session
from tests.commands import log, talk
from tests.questions.asking import Capture, frames
from tests.recorder import Recorder, raw
from tests.streams.mightyzap import packet
from tests.terminals import LINUX_ONLY, Terminal
from tests.test_discover import planted

if TYPE_CHECKING:
    from pathlib import Path

    from tests.questions.asking import Asker, Rows

NS = 1_000_000_000


def bare(rows: Rows, *, but: tuple[str, ...] = ()) -> list[dict[str, object]]:
    """Return the records of rows, without what is said of all of them."""
    kept = [r for r in rows if r["type"] in ("frame", "gap", "sample", "transaction", "anomaly")]
    return [{k: v for k, v in r.items() if k not in but} for r in kept]


def thirds(capture: Capture, folder: Path) -> list[Path]:
    """Write a log in three pieces."""
    lines = capture.path.read_text().splitlines(keepends=True)
    lines = [line for line in lines if line.startswith("(")]
    size = -(-len(lines) // 3)
    paths = [folder / f"part-{n}.log" for n in range(3)]
    for n, path in enumerate(paths):
        path.write_text("".join(lines[n * size : (n + 1) * size]))
    return paths


def test_two_buses_as_one_capture(capture: Capture, asker: Asker) -> None:
    other = asker.folder / "other.log"
    other.write_text(log(talk(30), start_ns=capture.of("frame")[0]["t_ns"]))
    out = asker.folder / "both.jsonl"
    assert asker.ask("merge", capture.path, other, "-o", out, led_by="one of several").status == 0
    told = [json.loads(line) for line in out.read_text().splitlines()]
    by_bus = pd.DataFrame([r for r in told if r["type"] == "frame"]).groupby("bus")
    assert sorted(by_bus.groups) == sorted({capture.path.stem, "other"})
    mine = by_bus.get_group(capture.path.stem)
    assert list(zip(mine["offset"], mine["hex"], strict=True)) == frames(capture.rows)
    theirs = by_bus.get_group("other")
    assert "".join(theirs["hex"]) == talk(30).hex()


def test_pieces_of_a_log_are_the_whole_log(capture: Capture, asker: Asker) -> None:
    parts = thirds(capture, asker.folder)
    told = asker.rows("decode", *parts, "--format", "jsonl", led_by="several are one capture")
    assert bare(told) == bare(capture.rows)
    bus = asker.bus("--together", *parts, led_by="together")
    assert bus["frames"] == len(capture.of("frame"))


def test_in_which_file_the_first_error_is(capture: Capture, asker: Asker) -> None:
    parts = thirds(capture, asker.folder)
    first = "SELECT file, min(t_ns) AS t_ns FROM anomalies WHERE severity = 'error' GROUP BY file"
    told = asker.rows("query", first, *parts, "--format", "json", led_by="several files column")
    alone = {str(path): Capture(path) for path in parts}
    mine = {
        name: min(r["t_ns"] for r in one.of("anomaly", severity="error"))
        for name, one in alone.items()
        if one.of("anomaly", severity="error")
    }
    assert {r["file"]: r["t_ns"] for r in told} == mine != {}


def test_what_differs_between_two_runs(capture: Capture, asker: Asker) -> None:
    same = asker.ask("diff", capture.path, capture.path, "--format", "json", led_by="two runs")
    assert (same.status, json.loads(same.out)["differences"]) == (0, [])
    who = capture.servo
    quiet = asker.folder / "quiet.log"
    silent = {r["hex"].upper() for r in capture.of("frame", kind="response", servo_id=who)}
    lines = capture.path.read_text().splitlines(keepends=True)
    kept = [x for x in lines if x.split("#")[-1].split(" ")[0].strip().upper() not in silent]
    quiet.write_text("".join(kept))
    lost = sum(r["outcome"] == "no_response" for r in Capture(quiet).of("transaction"))
    had = sum(r["outcome"] == "no_response" for r in capture.of("transaction"))
    ran = asker.ask("diff", capture.path, quiet, "--format", "json")
    told = json.loads(ran.out)
    if lost - had < 20:
        pytest.skip("too few of its answers stand in lines of their own")
    assert ran.status == 1
    missing = [d for d in told["differences"] if d["about"] == "missing"]
    assert who in {d["servo_id"] for d in missing}
    assert told["a"]["frames"] == len(capture.of("frame"))


def test_registers_that_nobody_named(asker: Asker) -> None:
    path = planted(asker.folder / "hidden.log")
    ran = asker.ask("discover", path, led_by="registers no table names")
    assert ran.status == 0, ran.err
    answers = Capture(path).of("frame", kind="response", length=15)
    columns = np.array([list(bytes.fromhex(r["hex"])[6:14]) for r in answers])
    assert len(columns) > 100
    counts = [k for k in range(8) if (np.diff(columns[:, k]) % 256 == 1).all()]
    constant = [k for k in range(8) if (columns[:, k] == columns[0, k]).all()]
    alone = {*counts, *constant}
    wide = [256 * columns[:, k] + columns[:, k + 1] for k in range(7)]
    steady = [k for k in range(7) if len(set(np.diff(wide[k]).tolist())) == 1]
    counts_wide = [k for k in steady if not alone & {k, k + 1}]  # by two bytes, the high one first
    told = dict(x.split(maxsplit=1) for x in ran.out.splitlines() if x.startswith("  "))
    assert [at for at, what in told.items() if "a counter" in what] == [
        f"0x{0xA0 + k:02X}" for k in sorted([*counts, *counts_wide])
    ]
    assert [at for at, what in told.items() if "always" in what] == [
        f"0x{0xA0 + k:02X}" for k in constant
    ]
    table = asker.ask("discover", path, "--format", "toml", led_by="register table").out
    assert {0xA0 + k for k in counts} <= {r["address"] for r in tomllib.loads(table)["register"]}


def test_what_a_recording_says_of_itself(capture: Capture, asker: Asker) -> None:
    run = asker.folder / "run.mcap"
    assert asker.ask("convert", capture.path, run, led_by=".mcap").status == 0
    told = asker.ask("report", run, led_by="metadata of a recording").out
    with run.open("rb") as file:
        held = {k for m in make_reader(file).iter_metadata() for k in m.metadata}
    assert held
    facts = session(run)
    assert f"- tool: {facts['tool']}" in told
    frame = capture.of("frame")[0]
    assert f"{len(capture.of('frame'))} {frame['protocol']} frames" in told


def test_a_recording_and_a_capture_for_wireshark_say_what_the_log_says(
    capture: Capture, asker: Asker
) -> None:
    for suffix in (".mcap", ".pcapng"):
        out = asker.folder / f"same{suffix}"
        ran = asker.ask("convert", capture.path, out, led_by=".pcapng .mcap")
        assert ran.status == 0, ran.err
        assert bare(asker.rows("decode", out, "--format", "jsonl")) == bare(capture.rows), suffix


def test_a_capture_that_may_be_shared(capture: Capture, asker: Asker) -> None:
    out = asker.folder / "shared.log"
    ran = asker.ask("convert", capture.path, out, "--anonymise", led_by="serial numbers names")
    assert ran.status == 0, ran.err
    shared = Capture(out)
    apart = capture.of("frame")[0]["t_ns"] - shared.of("frame")[0]["t_ns"]
    assert apart == pytest.approx(min(r["t_ns"] for r in capture.in_order), abs=NS)
    assert [r["t_ns"] + apart for r in shared.of("frame")] == pytest.approx(
        [r["t_ns"] for r in capture.of("frame")], abs=2000
    )
    assert [r["op"] for r in shared.of("frame")] == [r["op"] for r in capture.of("frame")]


def test_what_a_code_means(capture: Capture, asker: Asker) -> None:
    for code in {r["code"] for r in capture.of("anomaly")}:
        (row, *_) = capture.of("anomaly", code=code)
        told = " ".join(asker.ask("explain", code, led_by="CODE means").out.split())
        assert row["means"] in told


def test_whether_a_rule_is_kept(capture: Capture, asker: Asker) -> None:
    answered = ("ok", "no_response", "damaged")
    asked = pd.DataFrame([r for r in capture.of("transaction") if r["outcome"] in answered])
    lost = asked.assign(lost=asked["outcome"] == "no_response")
    worst = lost.groupby("servo_id")["lost"].mean().max()
    assert worst > 0
    for bound, status in ((worst * 1.01, 0), (worst * 0.99, 1)):
        rules = asker.folder / "rules.toml"
        rules.write_text(f'[[rule]]\nname = "x"\nwhat = "answers_missing"\nat_most = {bound}\n')
        ran = asker.ask("check", "--rules", rules, capture.path, led_by="rules")
        assert ran.status == status, ran.out


WAY = (1000, 1000, 1350, 1700, 2100, 2080, 2000, 2000, 2000, 2000, 2000)
"""Positions after a goal of 2000, every 10 ms: a tenth too far, at rest from the seventh on."""


def test_how_long_a_goal_takes_to_settle_and_how_far_it_is_overshot(asker: Asker) -> None:
    lines, now = list[str](), 1_700_000_000_000_000

    def say(after_us: int, data: bytes) -> None:
        nonlocal now
        now += after_us
        lines.append(f"({now / 1e6:.6f}) bus0 #{data.hex().upper()}\n")

    def read(place: int) -> None:
        say(7000, packet(1, 0xF2, b"\x8c\x02"))
        say(3000, packet(1, 0, place.to_bytes(2, "little")))

    read(WAY[0])
    for cycle in range(6):
        sign = 1 if cycle % 2 == 0 else -1
        say(0, packet(1, 0xF3, b"\x86" + (1500 + 500 * sign).to_bytes(2, "little")))
        for at in WAY[1:]:
            read(1500 + (at - 1500) * sign)
    path = asker.folder / "steps.log"
    path.write_text("".join(lines))
    (servo,) = asker.bus(path, led_by="goals settle")["servos"]
    (steps,) = servo["steps"]
    assert steps["count"] == 6
    assert steps["fates"] == {"settled": 6}
    low, high = steps["overshoot_percent"]["p50"]
    assert low * 0.98 <= 10 <= high * 1.02
    low, high = steps["settle_ns"]["p50"]
    # at 50 ms it is still 8 % of the way off, at 60 ms and from then on it is there
    assert 45_000_000 <= low <= high <= 75_000_000


@LINUX_ONLY
def test_a_live_log_of_some_servos(asker: Asker) -> None:
    said = talk(60)
    with Terminal() as line:
        asked = ("--log", "--servo", "2", "--kind", "response")
        overview = asker.ask("record", "--help", led_by="print each frame only these servos").out
        assert all(word in overview for word in asked if word.startswith("--"))
        with Recorder(asker.folder, "{}=mightyzap", *asked, lines=[line]) as run:
            line.say(said)
            run.wait_for(len(said))
            ran = run.stop()
    told = re.findall(r"(?m)^\d\d:\S+ +(?:\S+ +)?(\d+) ([<>]) ", ran.out)
    every = asker.folder / "all.bin"
    every.write_bytes(said)
    mine = Capture(every).of("frame", servo_id=2, kind="response")
    assert told == [("2", "<")] * len(mine) != []
    assert raw(run.path) == {"bus0": said}, "all of it is recorded"
