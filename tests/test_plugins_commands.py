"""Every command with a protocol that a package or a file brings, and with one's own tables."""

from __future__ import annotations

import subprocess
import threading
from collections.abc import Callable
from typing import TYPE_CHECKING

import pyarrow.parquet as pq
import pytest

import sniffer as api
from sniffer.decoding.decoder import Decoder
from sniffer.decoding.pipeline import Options, Pipeline
from sniffer.ground.model import Chunk, InputError, SnifferError
from sniffer.ground.registers import RegisterMap
from sniffer.mcapfile.sink import McapSink
from sniffer.mcapfile.source import session, tables
from sniffer.protocols import protocol_named
from tests.commands import COMMAND, Ran, conserved, environment, records, sniffer, talk, within
from tests.plugin import NAME, PACKAGE, as_file, install, speech, table, visible, write_facts
from tests.recorder import Recorder, assert_true_to_itself
from tests.terminals import LINUX_ONLY, PATIENCE_S, Terminal

if TYPE_CHECKING:
    from collections.abc import Sequence
    from pathlib import Path

    from sniffer.protocols.base import BusProtocol

READ = "A5 A5 A5 01 04 F2 8C 02 7A"
ANSWER = "A5 A5 A5 01 04 00 FF 07 F4"
MISSING = (
    f"bus0 needs the protocol '{NAME}' ({PACKAGE}): install the package that has it, or give its "
    "file with --protocol"
)


Command = Callable[..., Ran]
"""Runs a command within this process."""


@pytest.fixture(scope="module")
def site(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """Return a folder in which the plug-in is installed."""
    path = tmp_path_factory.mktemp("site")
    install(path)
    return path


@pytest.fixture(scope="module")
def env(site: Path) -> dict[str, str]:
    """Return an environment in which the plug-in is found."""
    return {"PYTHONPATH": str(site)}


@pytest.fixture(scope="module")
def file(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """Return the file of a plug-in that nobody installed."""
    return as_file(tmp_path_factory.mktemp("own"))


def runs(
    capsys: pytest.CaptureFixture[str], monkeypatch: pytest.MonkeyPatch, path: Path | None
) -> Command:
    """Return what runs a command that sees the plug-ins of a folder."""

    def run(*arguments: str | Path) -> Ran:
        with monkeypatch.context() as patch:
            visible(patch, path)
            return within(capsys, *arguments)

    return run


@pytest.fixture
def plugged(
    capsys: pytest.CaptureFixture[str], monkeypatch: pytest.MonkeyPatch, site: Path
) -> Command:
    """Return what runs a command where the plug-in is installed."""
    return runs(capsys, monkeypatch, site)


@pytest.fixture
def plain(capsys: pytest.CaptureFixture[str], monkeypatch: pytest.MonkeyPatch) -> Command:
    """Return what runs a command where no plug-in is installed."""
    return runs(capsys, monkeypatch, None)


@pytest.fixture
def capture(tmp_path: Path) -> Path:
    path = tmp_path / "toy.bin"
    path.write_bytes(speech(60))
    return path


@pytest.fixture
def recording(tmp_path: Path, capture: Path, plugged: Command) -> Path:
    """Return a recording that was made with the plug-in."""
    path = tmp_path / "toy.mcap"
    ran = plugged("decode", capture, "-o", path, "--quiet")
    assert (ran.status, ran.err) == (0, "")
    return path


# --- installed ---------------------------------------------------------------------------------


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


# --- a plug-in that is broken ------------------------------------------------------------------


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


# --- a file ------------------------------------------------------------------------------------


def test_a_file_is_a_plug_in_too(
    tmp_path: Path, capture: Path, recording: Path, file: Path, plain: Command
) -> None:
    out = tmp_path / "own.mcap"
    ran = plain("decode", capture, "--protocol", file, "-o", out, "--summary")
    assert (ran.status, ran.err) == (0, "")
    assert ran.out.startswith(f"bus0: {NAME}\n")
    assert session(out)["plugin.bus0"] == file.name
    assert session(out)["protocol"] == NAME
    assert plain("replay", out, "--redecode").complaint.startswith(
        f"bus0 needs the protocol '{NAME}'"
    )
    again = plain("replay", recording, "--redecode", "--protocol", file)
    assert again == Ran(0, "bus0: 420 frames, the same as recorded\n", "")
    assert "angle" in plain("explain", ANSWER, "--after", READ, "--protocol", file).out
    assert "0x8C  angle" in plain("registers", file).out


def test_a_file_stands_for_its_protocol_only_where_a_recording_has_several(
    tmp_path: Path, file: Path, plain: Command, monkeypatch: pytest.MonkeyPatch
) -> None:
    visible(monkeypatch)
    path = tmp_path / "both.mcap"
    options = Options(protocols={"toy": str(file), "real": "mightyzap"})
    pipeline = Pipeline(options, [McapSink(path, {})])
    pipeline.feed([Chunk(speech(5), bus="toy"), Chunk(talk(5), bus="real")])
    pipeline.close()
    pipeline.finish()
    ran = plain("replay", path, "--redecode", "--protocol", file)
    assert ran.out.splitlines() == [
        "toy: 35 frames, the same as recorded",
        "real: 35 frames, the same as recorded",
    ]


@LINUX_ONLY
def test_a_port_may_be_said_to_speak_a_file(tmp_path: Path, file: Path, plain: Command) -> None:
    said = speech(30)
    told = f"arm={{}}={file}@57600"
    with Terminal() as line, Recorder(tmp_path, told, "--quiet", lines=[line]) as run:
        line.say(said)
        run.wait_for(len(said), "arm")
        assert run.stop() == Ran(0, "", "")
    assert session(run.path)["protocol.arm"] == NAME
    ran = plain("replay", run.path, "--redecode", "--protocol", file)
    assert ran.out == "arm: 210 frames, the same as recorded\n"


@pytest.mark.parametrize(
    ("code", "told"),
    [
        ("", "it defines no PROTOCOL"),
        ("1 / 0", "ZeroDivisionError: division by zero (x.py, line 1)"),
        ("import sys; sys.exit(3)", "SystemExit: 3"),
        ("def", "SyntaxError: "),
        ("PROTOCOL = 7", "it says no interface"),
    ],
)
def test_a_file_that_is_no_plug_in_says_why(
    code: str, told: str, tmp_path: Path, plain: Command
) -> None:
    path = tmp_path / "x.py"
    path.write_text(code, encoding="utf-8")
    ran = plain("decode", "nothing.bin", "--protocol", path)
    assert (ran.status, ran.out) == (2, "")
    assert ran.complaint.startswith(f"{path}: {told}")
    assert "there is no such file" in plain("decode", "-", "--protocol", "nix.py").complaint
    assert told in plain("record", f"/dev/null={path}").complaint


# --- a table of one's own ----------------------------------------------------------------------


@pytest.fixture
def own(tmp_path: Path) -> Path:
    """Return the table of a mightyZAP model that nobody knows."""
    path = tmp_path / "my_servo.toml"
    path.write_text(table("my-servo", "mightyzap", 0.25), encoding="utf-8")
    return path


@pytest.fixture
def real(tmp_path: Path) -> Path:
    path = tmp_path / "real.bin"
    path.write_bytes(talk(30))
    return path


def angles(ran: Ran) -> dict[int, set[str]]:
    """Return the names of what each servo's bytes 8C and 8D were read as."""
    out: dict[int, set[str]] = {}
    for row in records(ran.out):
        if row["type"] == "sample" and row["quantity"] == "position":
            out.setdefault(row["servo_id"], set()).add(row["register"])
    return out


def test_a_table_makes_a_new_model_without_code(
    own: Path, real: Path, tmp_path: Path, plain: Command
) -> None:
    mine = ("--registers", own, "--model", "3=my-servo")
    ran = plain("decode", real, *mine, "--format", "jsonl")
    assert (ran.status, ran.content) == (0, True)
    assert angles(ran) == {1: {"present_position"}, 2: {"present_position"}, 3: {"angle"}}
    shown = plain("explain", "FFFFFF010400FF07F4", "--after", "FFFFFF0104F28C027A",
                    "--registers", own, "--model", "my-servo")  # fmt: skip
    assert "angle: raw 2047 = 511.75 deg" in shown.out
    assert "0x8C  angle" in plain("registers", own).out
    for command in (("view", real, "-o", tmp_path / "x.rrd"), ("replay", real, "--speed", "0")):
        assert plain(*command, *mine).status == 0


def test_a_recording_brings_the_tables_that_it_was_read_by(
    own: Path, real: Path, tmp_path: Path, plain: Command
) -> None:
    path, again = tmp_path / "run.mcap", tmp_path / "again.mcap"
    told = ("--registers", own, "--model", "3=my-servo", "--quiet")
    assert plain("decode", real, *told, "-o", path).status == 0
    own.unlink()
    ran = plain("decode", path, "--format", "jsonl", "-o", again)
    assert (ran.status, ran.err) == (0, "")
    assert angles(ran)[3] == {"angle"}
    assert angles(plain("decode", again, "--format", "jsonl"))[3] == {"angle"}
    assert plain("replay", again, "--redecode").out.endswith("the same as recorded\n")


@LINUX_ONLY
def test_a_port_is_recorded_with_a_table(own: Path, tmp_path: Path, plain: Command) -> None:
    said = talk(30)
    told = ("{}=mightyzap", "--registers", own, "--model", "3=my-servo", "--quiet")
    with Terminal() as line, Recorder(tmp_path, *told, lines=[line]) as run:
        line.say(said)
        run.wait_for(len(said))
        assert run.stop() == Ran(0, "", "")
    assert_true_to_itself(run.path)
    assert angles(plain("decode", run.path, "--format", "jsonl"))[3] == {"angle"}


@pytest.mark.parametrize(
    ("head", "arguments", "told"),
    [
        ('protocol = ""', (), "my-servo: it does not say whose it is"),
        ('protocol = "nix"', (), "my-servo: no protocol 'nix': one of mightyzap, lss"),
        ('protocol = "lss"', (), "my-servo: lss takes no further tables"),
        ('protocol = "wck"', (), "my-servo: wck takes no further tables"),
        ('protocol = "mightyzap"', ("--protocol", "lss"), "it is a table of mightyzap, and what"),
        ('protocol = "mightyzap"', ("--model", "my-other"), "no model 'my-other': one of"),
        ("protocl = 1", (), "there is no key 'protocl'"),
    ],
)
def test_a_table_of_no_use_is_told(
    head: str, arguments: Sequence[str], told: str, own: Path, real: Path, plain: Command
) -> None:
    text = own.read_text(encoding="utf-8").replace('protocol = "mightyzap"', head)
    own.write_text(text, encoding="utf-8")
    ran = plain("decode", real, "--registers", own, *arguments)
    assert (ran.status, ran.out) == (2, "")
    assert told in ran.complaint


# --- from Python -------------------------------------------------------------------------------


@pytest.fixture
def protocol(file: Path, monkeypatch: pytest.MonkeyPatch) -> BusProtocol:
    """Return the plug-in's protocol; the registry forgets it afterwards."""
    visible(monkeypatch)
    return protocol_named(str(file))


def test_an_object_is_taken_wherever_a_name_is(protocol: BusProtocol, tmp_path: Path) -> None:
    said = speech(10)
    capture = api.decode(said, protocol=protocol)
    assert {p.name for _, p, _ in capture.batches} == {NAME}
    assert capture.summary.buses["bus0"].usual_model == "toy-a"
    assert len(capture.frames()) == 70
    decoder = Decoder(protocol)
    assert sum(len(b.frames) for b in (decoder.feed(said), decoder.close())) == 70
    path = tmp_path / "x.mcap"
    pipeline = Pipeline(Options(protocol=protocol), [McapSink(path, {})])
    pipeline.feed([Chunk(said)])
    pipeline.close()
    assert pipeline.protocol_of("bus0") is protocol
    pipeline.finish()
    assert [t.text for t in tables(path)] == [table()]


@LINUX_ONLY
def test_an_object_is_recorded_from_a_port(protocol: BusProtocol, tmp_path: Path) -> None:
    path = tmp_path / "run.mcap"
    with Terminal() as line:

        def speak() -> None:
            line.wait_for_tap()
            line.say(speech(20))

        speaker = threading.Thread(target=speak)
        speaker.start()
        recorded = api.record(
            [api.PortSpec("arm", line.path, protocol, 57600)],
            api.Files(path),
            stops=api.Stops(frames=100),
        )
        speaker.join()
    assert recorded.summary.buses["arm"].protocol == NAME
    assert (session(path)["protocol.arm"], session(path)["plugin.arm"]) == (NAME, "toy_protocol.py")


def test_a_table_can_be_given_from_python(own: Path) -> None:
    for given in (own, str(own), RegisterMap.from_toml(own)):
        got = api.decode(talk(5), protocol="mightyzap", registers=[given], models={3: "my-servo"})
        read = {r.register for r in got if isinstance(r, api.SampleRow) and r.servo_id == 3}
        assert {"angle", "supply"} <= read
    with pytest.raises(SnifferError, match="mightyzap has no model 'my-servo'"):
        api.decode(talk(5), protocol="mightyzap", models={3: "my-servo"})


def test_a_recording_that_needs_a_protocol_raises_from_python(
    recording: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    visible(monkeypatch)
    with pytest.raises(InputError, match="needs the protocol"):
        api.decode(recording)
