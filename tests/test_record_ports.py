"""Ports of a recording: how they are named, taken, lost and found again, and two as one bus."""

from __future__ import annotations

import signal
import socket
import time
from contextlib import ExitStack
from itertools import pairwise
from typing import TYPE_CHECKING, Final

import pytest

from sniffer.decoding.pipeline import Options
from sniffer.ground.codes import OK
from sniffer.ground.model import Chunk, Clock, Direction, MarkKind
from sniffer.mcapfile.source import chunks
from sniffer.ports.tty import TtyPort
from sniffer.tap.listen import Listening, listen, shared
from sniffer.tap.tap import PortSpec, Tap
from tests.commands import Ran, talk, within
from tests.recorder import (
    Recorder,
    assert_true_to_itself,
    codes,
    facts,
    marks,
    raw,
)
from tests.recordings import messages
from tests.streams.mightyzap import packet
from tests.terminals import AT_115200, LINUX_ONLY, PATIENCE_S, Terminal

if TYPE_CHECKING:
    from collections.abc import Iterator
    from pathlib import Path

pytestmark = LINUX_ONLY

TALK: Final = talk(60)


@pytest.fixture
def line() -> Iterator[Terminal]:
    with Terminal() as terminal:
        yield terminal


# --- mistakes ------------------------------------------------------------------------------------


@pytest.mark.parametrize(
    ("ports", "complaint"),
    [
        (["{}=frob"], "no protocol 'frob': one of auto, mightyzap"),
        (["a={}=frob@9600"], "no protocol 'frob': one of auto, mightyzap"),
        (["a="], "'a=': write [NAME=]PORT[=PROTOCOL][@BAUD]"),
        (["=wck"], "there is no port in it: write [NAME=]PORT[=PROTOCOL][@BAUD]"),
        (["{}@299"], "299 is no baud rate (300..10000000)"),
        (["{}=wck@10000001"], "10000001 is no baud rate (300..10000000)"),
        (["{}=wck", "{}=wck"], "is named twice"),
        (["a={}", "b={}"], "is named twice"),
        (["a={}", "a=/dev/null"], "two ports are called a: name them apart"),
        (["/dev/no-such-port"], "there is no such port; `sniffer ports` lists those"),
        (["{}@fast"], "there is no such port; `sniffer ports` lists those"),
        (["file.txt=wck"], "file.txt is a file, no port: `sniffer decode` reads it"),
        (["."], ". is a directory"),
        (["/dev/null"], "/dev/null is no serial port"),
        (["socket://127.0.0.1:1=wck"], "socket://127.0.0.1:1: cannot be reached"),
        (["{}=wck", "/dev/no-such-port"], "there is no such port"),
        ([], "Missing argument '[NAME=]PORT"),
        (["{}=wck", "/dev/x=lss", "--pair"], "its two ports have one protocol"),
        (["{}@9600", "/dev/x@115200", "--pair"], "its two ports have one baud rate"),
    ],
)
def test_a_mistake_about_ports_is_told_in_one_line(
    tmp_path: Path,
    line: Terminal,
    capsys: pytest.CaptureFixture[str],
    monkeypatch: pytest.MonkeyPatch,
    ports: list[str],
    complaint: str,
) -> None:
    monkeypatch.chdir(tmp_path)
    (tmp_path / "file.txt").write_text("FF", encoding="utf-8")
    ran = within(capsys, "record", *(port.replace("{}", line.path) for port in ports))
    assert ran.status == 2
    assert complaint in ran.complaint
    assert [path.name for path in tmp_path.iterdir()] == ["file.txt"]
    # a port that was opened before the mistake came to light is let go
    TtyPort(line.path, AT_115200).close()


def test_two_names_of_one_port_are_one_port(
    tmp_path: Path, line: Terminal, capsys: pytest.CaptureFixture[str]
) -> None:
    link = tmp_path / "adapter"
    line.plug_in_at(link)
    ran = within(capsys, "record", line.path, link, "-o", tmp_path / "x.mcap")
    assert ran.status == 2
    assert f"{link} is named twice, as {line.path} too" in ran.complaint


def test_a_port_that_another_recorder_has_is_refused_and_the_recorder_is_named(
    tmp_path: Path, line: Terminal, capsys: pytest.CaptureFixture[str]
) -> None:
    with Recorder(tmp_path, "{}=mightyzap", "--quiet", lines=[line]) as run:
        ran = within(capsys, "record", line.path, "-o", tmp_path / "second.mcap")
        assert ran.status == 2
        assert ran.complaint.startswith(f"{line.path} is in use by ")
        assert f"(process {run.process.pid}); end that first" in ran.complaint
        line.say(TALK)  # nobody took any of it
        assert run.stop() == Ran(0, "", "")
    assert raw(run.path) == {"bus0": TALK}
    assert not (tmp_path / "second.mcap").exists()


def test_a_program_that_has_the_port_open_without_a_lock_is_told_of(line: Terminal) -> None:
    class Shared(TtyPort):
        def facts(self) -> dict[str, str]:
            return {**super().facts(), "also_open_in": "minicom (process 7)"}

    port = TtyPort(line.path, AT_115200)
    assert shared([Tap(PortSpec("arm", line.path), port)]) == []
    port.close()
    port = Shared(line.path, AT_115200)
    (warning,) = shared([Tap(PortSpec("arm", line.path), port)])
    assert warning.startswith(f"arm: {line.path} is also open in minicom (process 7): ")
    port.close()


# --- unplugged -----------------------------------------------------------------------------------


def test_a_port_that_comes_back_under_its_name_goes_on_and_the_others_have_not_waited(
    tmp_path: Path, line: Terminal
) -> None:
    link = tmp_path / "adapter"
    with ExitStack() as stack:
        first, second = stack.enter_context(Terminal()), stack.enter_context(Terminal())
        first.plug_in_at(link)
        told = (f"arm={link}=mightyzap", f"leg={line.path}=mightyzap")
        run = stack.enter_context(Recorder(tmp_path, *told))
        first.wait_for_tap()
        line.wait_for_tap()
        first.say(TALK)
        run.wait_for(len(TALK), "arm")
        link.unlink()
        first.hang_up()
        run.wait_until(lambda: " away=1 " in run.said, "not missed")
        line.say(TALK)
        run.wait_for(len(TALK), "leg")  # while the other one is away
        second.plug_in_at(link)
        second.wait_for_tap()
        run.wait_until(lambda: run.said.rpartition(" away=")[2].startswith("0 "), "not back")
        second.say(TALK)
        run.wait_for(2 * len(TALK), "arm")
        assert run.stop().status == 0
    assert raw(run.path) == {"arm": TALK * 2, "leg": TALK}
    assert marks(run.path, "arm") == [MarkKind.LOST, MarkKind.BACK]
    assert marks(run.path, "leg") == []
    away = next(m for c in chunks(run.path) for m in c.marks if m.kind == MarkKind.BACK)
    assert 0.1e9 < away.count < PATIENCE_S * 1e9
    assert {"port-lost", "port-back"} <= set(codes(run.path, "arm"))
    assert "port-lost" not in codes(run.path, "leg")
    assert_true_to_itself(run.path)


@pytest.mark.parametrize("how", ["idle", "SIGTERM"])
def test_a_port_that_never_comes_back_keeps_no_recording_from_its_end(
    tmp_path: Path, line: Terminal, how: str
) -> None:
    # longer than a busy machine takes to tell that the port is gone
    told = ["--idle", "2"] if how == "idle" else []
    with Recorder(tmp_path, "{}=mightyzap", "--quiet", *told, lines=[line]) as run:
        line.say(TALK)
        run.wait_for(len(TALK))
        line.hang_up()
        if how == "SIGTERM":
            run.wait_until(lambda: MarkKind.LOST in marks(run.path), "not missed")
            run.tell(signal.SIGTERM)
        assert run.ended() == Ran(0, "", "")
    assert raw(run.path) == {"bus0": TALK}
    assert marks(run.path) == [MarkKind.LOST]
    assert_true_to_itself(run.path)


# --- addresses -----------------------------------------------------------------------------------


def test_an_address_on_the_network_is_recorded_like_a_port(tmp_path: Path) -> None:
    with socket.create_server(("127.0.0.1", 0)) as server:
        server.settimeout(PATIENCE_S)
        address = f"socket://127.0.0.1:{server.getsockname()[1]}"
        with Recorder(tmp_path, f"far={address}=mightyzap@57600") as run:
            far, _ = server.accept()
            run.wait_until(run.path.exists, "not opened")  # what came before is dropped
            far.sendall(TALK)
            run.wait_for(len(TALK), "far")
            far.close()
            far, _ = server.accept()  # it has come back by itself
            run.wait_until(lambda: MarkKind.BACK in marks(run.path, "far"), "not back")
            far.sendall(TALK)
            run.wait_for(2 * len(TALK), "far")
            assert run.stop().status == 0
            far.setblocking(False)
            assert far.recv(1) == b""  # nothing was sent, and it is closed
            far.close()
    assert raw(run.path) == {"far": TALK * 2}
    assert marks(run.path, "far") == [MarkKind.LOST, MarkKind.BACK]
    assert facts(run.path)["port.far"] == address
    assert facts(run.path)["latency_ns.far"] == "17000000"  # nobody knows: the usual, and a breath
    assert_true_to_itself(run.path)


# --- two ports, one bus --------------------------------------------------------------------------


def exchanges(n: int) -> Iterator[tuple[bytes, bytes]]:
    """Yield requests and their answers."""
    for i in range(n):
        who = 1 + i % 3
        yield packet(who, 0xF2, b"\x8c\x02"), packet(who, 0, i.to_bytes(2, "little"))


@pytest.mark.parametrize("protocol", ["mightyzap", "auto"])
def test_two_wires_are_one_bus_with_every_answer_behind_its_request(
    tmp_path: Path, line: Terminal, protocol: str
) -> None:
    with Terminal() as other:
        # so late may we be run on a busy machine, and cause and effect still tell the order
        told = (f"arm={{}}={protocol}@57600", "{}", "--pair", "--quiet", "--latency", "40")
        with Recorder(tmp_path, *told, lines=[line, other]) as run:
            for asked, answered in exchanges(150):
                line.say(asked)
                time.sleep(0.002)
                other.say(answered)
                time.sleep(0.002)
            assert run.stop() == Ran(0, "", "")
    wires: dict[Direction, bytes] = {Direction.TX: b"", Direction.RX: b""}
    for chunk in chunks(run.path):
        if chunk.data:  # a mark between two bytes, on a machine that stalls, is no wire's
            wires[chunk.direction] += chunk.data
    assert wires[Direction.TX] == b"".join(asked for asked, _ in exchanges(150))
    assert wires[Direction.RX] == b"".join(answered for _, answered in exchanges(150))
    found = messages(run.path)
    # of the loop of this test, which a busy machine may hold up, the diagnosis may have its say
    assert {topic.split("/")[1] for topic in found} - {"incidents"} == {"arm"}
    # RESPONSE has the number 1, TX 1 and RX 2
    assert all(f.direction == f.kind + 1 for f in found["/arm/frames"])
    ok = [t.outcome for t in found["/arm/transactions"]].count(OK)
    # until the protocol is known, times alone tell what belongs together; and where the machine
    # kept the speaker or the recorder waiting, the pauses are longer than any servo's
    heard_at = [chunk.t_ns or 0 for chunk in chunks(run.path)]
    kept_time = max(b - a for a, b in pairwise(heard_at)) < 20_000_000
    kept_time &= not any(m.kind == MarkKind.HELD for c in chunks(run.path) for m in c.marks)
    assert ok > 0
    assert not kept_time or (ok == 150 if protocol == "mightyzap" else ok > 75)
    told_of = facts(run.path)
    assert told_of["pair.arm"] == "two taps, merged by time and by cause and effect"
    assert (told_of["port.arm.tx"], told_of["port.arm.rx"]) == (line.path, other.path)
    assert_true_to_itself(run.path)


def test_an_answer_that_was_read_just_before_its_request_is_its_answer(line: Terminal) -> None:
    """A busy machine reads both ports at once, 2 ms late, the servos' first, and does not know."""
    asked, answered = next(exchanges(1))
    with Terminal() as other:
        specs = [PortSpec("arm", tap.path, "mightyzap", 57600) for tap in (line, other)]
        tapping = listen(specs, Options(), Listening(pair=True))
        tapping.listener.stop()
    t_ns = tapping.anchor.wall_ns
    reads = [
        Chunk(answered, t_ns, Clock.READ, "arm", Direction.RX),
        Chunk(asked, t_ns + 59_000, Clock.READ, "arm", Direction.TX),
    ]
    merger = tapping.mergers["arm"]
    merged = [*merger.feed(reads), *merger.close()]
    assert [c.direction for c in merged] == [Direction.TX, Direction.RX]
