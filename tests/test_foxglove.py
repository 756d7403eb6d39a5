"""``sniffer record --foxglove``: what a client gets, and what the recorder suffers from it."""

from __future__ import annotations

import contextlib
import importlib.util
import os
import re
import signal
import socket
from pathlib import Path
from typing import TYPE_CHECKING, Any

import pytest

from sniffer.decoding.called import ServoNames
from sniffer.ground.model import Severity
from sniffer.messages.log_pb2 import Log
from sniffer.sinks.foxglove import INCIDENTS, FoxgloveSink
from sniffer.viewers.companion.parcels import address_in
from tests.commands import within
from tests.foxglove_client import FoxgloveClient
from tests.live import START_NS, group, until
from tests.recorder import Recorder, assert_true_to_itself, raw, said_by, say_slowly
from tests.recordings import messages
from tests.terminals import LINUX_ONLY, Terminal

if TYPE_CHECKING:
    from collections.abc import Iterator

    from tests.test_convert import Capsys

pytest.importorskip("foxglove", reason="foxglove-sdk is not installed")
pytestmark = LINUX_ONLY

ANY_PORT = ("--foxglove-at", "127.0.0.1:0")


@pytest.fixture
def line() -> Iterator[Terminal]:
    with Terminal() as terminal:
        yield terminal


def served(run: Recorder) -> int:
    """Return the port at which a recording is served, once it is."""
    found: list[int] = []

    def is_told() -> bool:
        found.extend(
            map(int, re.findall(r"finds the recording at ws://127\.0\.0\.1:(\d+)", run.said))
        )
        return bool(found)

    run.wait_until(is_told, "nobody said where it is served")
    return found[0]


def test_who_looks_on_gets_what_is_recorded_and_a_server_that_dies_takes_nothing_with_it(
    tmp_path: Path, line: Terminal
) -> None:
    said = said_by("mightyzap")
    third = len(said) // 3
    told = ("{}=mightyzap@57600", *ANY_PORT)
    with Recorder(tmp_path, *told, lines=[line]) as run, FoxgloveClient(served(run)) as client:

        def is_announced() -> bool:
            client.look()
            return bool(client.topics)

        run.wait_until(is_announced, "nothing is announced")
        assert client.topics.keys() >= {"/bus0/frames", "/bus0/log", "/bus0/stats"}
        say_slowly(line, said[:third], 50)

        def has_state() -> bool:
            client.look()
            return any("/servo/" in topic for topic in client.topics)

        run.wait_until(has_state, "no servo is announced")
        say_slowly(line, said[third : 2 * third], 50)

        def has_all() -> bool:
            client.look()
            return len(client.got["/bus0/frames"]) > 20 and any(
                rows for topic, rows in client.got.items() if topic.endswith("/state")
            )

        run.wait_until(has_all, "messages are missing")
        assert "the recording goes on" not in run.said
        (pid,) = children(run.process.pid)
        os.kill(pid, signal.SIGKILL)
        say_slowly(line, said[2 * third :], 50)
        run.wait_for(len(said))
        gone = "the process that shows it in Foxglove has stopped; the recording goes on"
        run.wait_until(lambda: gone in run.said, "nobody was told")
        assert run.stop().status == 0
    assert raw(run.path) == {"bus0": said}
    assert_true_to_itself(run.path)
    recorded = messages(run.path)
    for topic, rows in client.got.items():
        if rows and not topic.endswith("/stats") and topic in recorded:
            if topic.endswith("/state"):
                assert_stated([m for _, m in rows], recorded[topic])
            else:
                there = {m.SerializeToString(deterministic=True) for m in recorded[topic]}
                mine = {m.SerializeToString(deterministic=True) for _, m in rows}
                assert mine <= there, topic
            assert [t for t, _ in rows] == sorted(t for t, _ in rows)


def assert_stated(shown: list[Any], recorded: list[Any]) -> None:
    """Live a frame has a message of its own; a recording has all that came in one read in one."""
    for state in shown:
        whole = next(m for m in recorded if m.offset >= state.offset)
        said = {f.name: value for f, value in whole.ListFields()}
        for field, value in state.ListFields():
            assert field.name in ("offset", "kind") or said[field.name] == value


def test_what_becomes_of_an_incident_is_told_in_words() -> None:
    sink = FoxgloveSink(["bus0"], {}, "127.0.0.1", 0)
    sink.call(ServoNames({2: "elbow"}))
    with FoxgloveClient(int(sink.address.rpartition(":")[2])) as client:
        told = client.got[INCIDENTS]

        def has_come() -> bool:
            client.look()  # it subscribes first: nobody is sent what was said before
            sink.incident("bus0", START_NS, Severity.WARN, "bad-cable at servo 2")
            return bool(told)

        until(has_come)
    t_ns, log = told[0]
    assert (t_ns, log.timestamp.ToNanoseconds()) == (START_NS, START_NS)
    assert (log.level, log.name, log.message) == (
        Log.Level.WARNING,
        "bus0",
        "bad-cable at servo 2 elbow",
    )
    sink.close()


def children(pid: int) -> list[int]:
    """Return the processes that were started by ``pid`` and still run."""
    found = []
    for place in Path("/proc").glob("[0-9]*"):
        with contextlib.suppress(OSError):
            stat = (place / "stat").read_text().rpartition(")")[2].split()
            if int(stat[1]) == pid:
                found.append(int(place.name))
    return found


def test_a_port_that_is_taken_is_told_and_the_recording_goes_on(
    tmp_path: Path, line: Terminal
) -> None:
    with socket.socket() as taken:
        taken.bind(("127.0.0.1", 0))
        taken.listen()
        at = f"127.0.0.1:{taken.getsockname()[1]}"
        told = ("{}=mightyzap@57600", "--foxglove-at", at)
        with Recorder(tmp_path, *told, lines=[line]) as run:
            say_slowly(line, said_by("mightyzap"), 100)
            run.wait_until(lambda: "the recording goes on" in run.said, "nobody was told")
            assert f"nobody can be served at {at}" in run.said
            assert run.stop().status == 0
    assert raw(run.path) == {"bus0": said_by("mightyzap")}
    assert not [pid for pid in group(run.process.pid) if pid != run.process.pid]


def test_what_is_missing_is_told_before_anything_is_recorded(
    tmp_path: Path, line: Terminal, capsys: Capsys, monkeypatch: pytest.MonkeyPatch
) -> None:
    out = tmp_path / "x.mcap"
    find = importlib.util.find_spec
    gone = {"foxglove": None}
    monkeypatch.setattr(importlib.util, "find_spec", lambda n: gone[n] if n in gone else find(n))
    done = within(capsys, "record", f"{line.path}=mightyzap", "--foxglove", "-o", out)
    assert done.status == 2
    assert done.complaint.endswith("`pip install 'servo-sniffer[foxglove]'`")
    assert not out.exists()


def test_where_it_is_served_is_a_host_and_a_port(
    tmp_path: Path, line: Terminal, capsys: Capsys
) -> None:
    out = tmp_path / "x.mcap"
    for said in ("8765", "here:port", "127.0.0.1:70000"):
        done = within(capsys, "record", f"{line.path}=lss", "--foxglove-at", said, "-o", out)
        assert (done.status, out.exists()) == (2, False)
        assert done.complaint == f"{said!r} is no address: write HOST:PORT, as in 127.0.0.1:8765"
    done = within(capsys, "record", f"{line.path}=lss", "--foxglove", "--rerun", "-o", out)
    assert "choose one of --rerun, --web, --rerun-connect, --foxglove" in done.complaint
    assert address_in("[::1]:8765") == ("::1", 8765)
