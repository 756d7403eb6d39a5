"""Every command with a protocol that a package brings, sound or broken."""

from __future__ import annotations

import subprocess
import threading
from typing import TYPE_CHECKING

import pyarrow.parquet as pq
import pytest

from sniffer.ground.model import Chunk
from sniffer.mcapfile.sink import McapSink
from sniffer.mcapfile.source import session, tables
from tests.commands import COMMAND, Ran, conserved, environment, records, sniffer, talk
from tests.plugin import NAME, PACKAGE, install, runs, speech, write_facts
from tests.recorder import Recorder
from tests.terminals import LINUX_ONLY, PATIENCE_S, Terminal

if TYPE_CHECKING:
    from collections.abc import Sequence
    from pathlib import Path

    from tests.plugin import Command


READ = "A5 A5 A5 01 04 F2 8C 02 7A"
ANSWER = "A5 A5 A5 01 04 00 FF 07 F4"
MISSING = (
    f"bus0 needs the protocol '{NAME}' ({PACKAGE}): install the package that has it, or give its "
    "file with --protocol"
)


def test_decode_finds_it_and_reads_its_table(capture: Path, env: dict[str, str]) -> None:
    ran = sniffer("decode", capture, "--format", "jsonl", env=env)
    assert ran.status == 0
    assert ran.err.startswith(f"sniffer: bus0: {NAME} (sure: explains 100.0% of the bytes)")
    assert conserved(ran.out) == capture.read_bytes()
    rows = records(ran.out)
    frames = [r for r in rows if r["type"] == "frame"]
    assert {f["protocol"] for f in frames} == {NAME}
    assert len(frames) == 60 * 7
    assert not [r for r in rows if r["type"] == "gap"]
    angles = [r for r in rows if r["type"] == "sample" and r["register"] == "angle"]
    assert angles
    assert all(a["value"] == a["raw"] * 0.5 and a["unit"] == "deg" for a in angles)
    assert rows[-1]["buses"]["bus0"]["protocol"] == NAME


def test_text_and_summary_name_it(capture: Path, plugged: Command) -> None:
    ran = plugged("decode", capture, "--summary")
    assert ran.out.startswith(f"bus0: {NAME}\n")
    assert "angle" in plugged("decode", capture, "--protocol", NAME).out


def test_tables_and_plots_are_written(tmp_path: Path, capture: Path, plugged: Command) -> None:
    samples, plots = tmp_path / "t.parquet", tmp_path / "t.rrd"
    ran = plugged("decode", capture, "-o", samples, "--quiet")
    assert (ran.status, ran.err) == (0, "")
    got = pq.read_table(samples).to_pydict()
    assert set(got["register"]) == {"goal_position", "angle", "supply"}
    ran = plugged("view", capture, "-o", plots)
    assert (ran.status, ran.content) == (0, False)
    assert plots.stat().st_size > 10_000


def test_it_is_listed_with_where_it_comes_from(plugged: Command, plain: Command) -> None:
    listed = plugged("protocols")
    assert (listed.status, listed.err) == (0, "")
    shown = listed.out[listed.out.index(NAME) :]
    assert "models  toy-a" in shown
    assert f"plug-in {PACKAGE}" in shown
    assert "plug-in" not in plain("protocols").out
    assert "toy-a               3 registers  Toy servo" in plugged("registers").out
    rows = records(plugged("registers", NAME, "--format", "jsonl").out)
    assert [r["name"] for r in rows] == ["goal_position", "angle", "supply"]
    assert "0x8C  angle" in plugged("registers", "toy-a").out


@pytest.mark.parametrize("command", ["decode", "view", "replay", "record", "doctor", "explain"])
def test_help_lists_it_beside_the_others(command: str, plugged: Command, plain: Command) -> None:
    assert f"[auto|mightyzap|lss|rs30x|wck|{NAME}|FILE.py]" in plugged(command, "-h").out
    assert "[auto|mightyzap|lss|rs30x|wck|FILE.py]" in plain(command, "--help").out


def test_explain_draws_its_frames_and_finds_it(plugged: Command) -> None:
    ran = plugged("explain", ANSWER, "--after", READ)
    assert (ran.status, ran.err) == (0, "")
    assert ran.out.startswith("Toy servos, 9 bytes")
    assert "angle: raw 2047 = 1023.5 deg" in ran.out
    broken = plugged("explain", READ[:-2] + "00")
    assert (broken.status, broken.err) == (1, "")
    assert "damaged" in broken.out
    assert plugged("explain", ANSWER, "--after", READ, "--model", "toy-a").out == ran.out


def test_replay_knows_what_was_recorded(recording: Path, plugged: Command) -> None:
    told = session(recording)
    assert (told["protocol.bus0"], told["plugin.bus0"]) == (NAME, PACKAGE)
    assert [t.model for t in tables(recording)] == ["toy-a"]
    again = plugged("replay", recording, "--redecode")
    assert again == Ran(0, "bus0: 420 frames, the same as recorded\n", "")
    ran = plugged("replay", recording, "--speed", "0")
    assert (ran.status, ran.content) == (0, True)
    assert "angle" in ran.out


@pytest.mark.parametrize(
    "arguments",
    [
        ("decode", "{}"),
        ("replay", "{}", "--speed", "0"),
        ("replay", "{}", "--redecode"),
        ("view", "{}", "-o", "{}.rrd"),
    ],
    ids=lambda a: " ".join(a),
)
def test_a_recording_without_its_plug_in_is_told_in_one_line(
    arguments: Sequence[str], recording: Path, plain: Command
) -> None:
    ran = plain(*(a.format(recording) for a in arguments))
    assert (ran.status, ran.out) == (2, "")
    assert ran.complaint == MISSING
    assert not recording.with_suffix(".mcap.rrd").exists()


def test_a_recording_is_not_guessed_at_where_it_says_what_it_is(
    tmp_path: Path, plugged: Command
) -> None:
    said = tmp_path / "real.mcap"
    with_it = McapSink(said, {"protocol.bus0": "lss"})
    with_it.raw("bus0", [Chunk(talk(20), 1_000_000_000)])
    with_it.close()
    ran = plugged("replay", said, "--speed", "0")
    assert ran.status == 2
    (line,) = ran.err.splitlines()
    assert line.startswith("sniffer: bus0: no frame of lss")


def test_simulate_says_that_it_has_no_simulator(plugged: Command, plain: Command) -> None:
    ran = plugged("simulate", NAME, "--duration", "1s")
    assert (ran.status, ran.out) == (2, "")
    assert ran.complaint == f"{NAME} has no simulator: there is one of mightyzap, lss, wck, rs30x"
    assert NAME not in plugged("simulate", "--help").out
    assert "'nix' is not one of" in plain("simulate", "nix").complaint


@LINUX_ONLY
@pytest.mark.parametrize("port", ["{}", f"{{}}={NAME}@57600"])
def test_it_is_recorded_from_a_port(port: str, tmp_path: Path, env: dict[str, str]) -> None:
    said = speech(60)
    with Terminal() as line, Recorder(tmp_path, port, "--quiet", lines=[line], env=env) as run:
        line.say(said)
        run.wait_for(len(said))
        assert run.stop() == Ran(0, "", "")
    told = session(run.path)
    assert (told["protocol.bus0"], told["plugin.bus0"]) == (NAME, PACKAGE)
    again = sniffer("replay", run.path, "--redecode", env=env)
    assert again.out == "bus0: 420 frames, the same as recorded\n"
    assert sniffer("replay", run.path, "--redecode").complaint == MISSING


@LINUX_ONLY
def test_doctor_knows_it(env: dict[str, str]) -> None:
    with Terminal() as line:
        ran = _while_spoken(line, ("doctor", line.path, "--seconds", "2", "--format", "jsonl"), env)
    rows = records(ran.out)
    assert (rows[-1]["protocol"], rows[-1]["baud"]) == (NAME, 57600)
    told = next(r for r in rows if r.get("about") == "protocol")
    assert told["scores"][NAME] > 0.9


def _while_spoken(line: Terminal, arguments: Sequence[str | Path], env: dict[str, str]) -> Ran:
    """Run a command on a line that is spoken on from when it listens until it ends."""
    process = subprocess.Popen(
        [*COMMAND, *map(str, arguments)],
        stdout=subprocess.PIPE,
        stderr=subprocess.PIPE,
        env=environment(**env),
    )
    ended = threading.Event()

    def speak() -> None:
        line.wait_for_tap()
        while not ended.is_set():
            line.say(speech(1))
            ended.wait(0.05)

    speaker = threading.Thread(target=speak)
    speaker.start()
    out, err = process.communicate(timeout=PATIENCE_S)
    ended.set()
    speaker.join()
    return Ran(process.returncode, out.decode(), err.decode())


def test_a_broken_plug_in_costs_one_line_and_nothing_else(
    tmp_path: Path,
    capture: Path,
    capsys: pytest.CaptureFixture[str],
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    path = tmp_path / "site"
    install(path)
    run = runs(capsys, monkeypatch, path)
    write_facts(path, "broken = it_breaks:PROTOCOL", package="sniffer-broken 0.1")
    (path / "it_breaks.py").write_text("import nowhere_to_be_found\n", encoding="utf-8")
    why = (
        "the plug-in 'broken' of sniffer-broken 0.1 is left out: ModuleNotFoundError: No module "
        "named 'nowhere_to_be_found' (it_breaks.py, line 1)"
    )
    ran = run("decode", capture, "--summary")
    assert (ran.status, ran.complaint) == (0, why)
    assert run("decode", capture, "--protocol", NAME, "--quiet") == Ran(0, "", "")
    named = run("decode", capture, "--protocol", "broken")
    assert (named.status, named.out, named.complaint) == (2, "", why)
    listed = run("protocols")
    assert (listed.status, listed.complaint) == (0, why)
    assert NAME in listed.out
    assert run("--help").err == run("decode", "--help").err == ""
    monkeypatch.setenv("SNIFFER_DEBUG", "1")
    assert "Traceback" in run("decode", capture, "--protocol", "broken").err


def test_a_plug_in_cannot_take_the_place_of_what_is_built_in(
    tmp_path: Path, capsys: pytest.CaptureFixture[str], monkeypatch: pytest.MonkeyPatch
) -> None:
    install(tmp_path / "site")
    write_facts(tmp_path / "site", f"lss = {NAME}:PROTOCOL", package="sniffer-taker 3")
    ran = runs(capsys, monkeypatch, tmp_path / "site")("protocols")
    assert ran.complaint == (
        "the plug-in 'lss' of sniffer-taker 3 is left out: that name is taken by a built-in one"
    )
    assert "Lynxmotion" in ran.out
