"""A protocol that a file brings, on the command line and from Python."""

from __future__ import annotations

import threading
from typing import TYPE_CHECKING

import pytest

import sniffer as api
from sniffer.decoding.decoder import Decoder
from sniffer.decoding.pipeline import Options, Pipeline
from sniffer.ground.model import Chunk, InputError, SnifferError
from sniffer.ground.registers import RegisterMap
from sniffer.mcapfile.sink import McapSink
from sniffer.mcapfile.source import session, tables
from sniffer.protocols import protocol_named
from tests.commands import Ran, talk
from tests.plugin import NAME, PACKAGE, speech, table, visible
from tests.recorder import Recorder
from tests.terminals import LINUX_ONLY, Terminal

if TYPE_CHECKING:
    from pathlib import Path

    from sniffer.protocols.base import BusProtocol
    from tests.plugin import Command


READ = "A5 A5 A5 01 04 F2 8C 02 7A"
ANSWER = "A5 A5 A5 01 04 00 FF 07 F4"
MISSING = (
    f"bus0 needs the protocol '{NAME}' ({PACKAGE}): install the package that has it, or give its "
    "file with --protocol"
)


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
