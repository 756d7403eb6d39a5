"""A recording shown in Rerun while it is made, by real viewers: they look, hang, die and leave."""

from __future__ import annotations

import contextlib
import http.server
import os
import re
import resource
import signal
import socket
import subprocess
import sys
import threading
import time
import urllib.request
from pathlib import Path
from typing import TYPE_CHECKING, Any

import pytest

from sniffer.diagnosis.tracking import IncidentChange, Stage
from sniffer.ground.model import OutputError
from sniffer.viewers import viewer
from sniffer.viewers.companion import parent
from sniffer.viewers.companion.parcels import CONNECT, WEB, WINDOW
from sniffer.viewers.companion.parent import LiveView
from tests.happenings import incident
from tests.live import (
    MS,
    OPTIONS,
    START_NS,
    Said,
    busy,
    decoded,
    fed,
    group,
    looks,
    saved,
    saver,
    talk,
    until,
    until_it_has,
    viewer_of,
)
from tests.terminals import PATIENCE_S
from tests.viewer import connected

if TYPE_CHECKING:
    from collections.abc import Callable, Iterator

    from tests.viewer import HeadlessViewer

pytestmark = pytest.mark.skipif(sys.platform != "linux", reason="processes are looked up in /proc")


@pytest.fixture
def said() -> Said:
    return Said()


@pytest.fixture
def view(
    said: Said, monkeypatch: pytest.MonkeyPatch, request: pytest.FixtureRequest
) -> Iterator[Callable[..., LiveView]]:
    """Make views whose windows need no display; kill what a failing test leaves behind."""
    monkeypatch.setenv("DISPLAY", ":0")
    made: list[LiveView] = []

    def make(mode: str, **more: Any) -> LiveView:
        if mode == WINDOW:
            more["arguments"] = ("--headless",)
            request.getfixturevalue("headless_viewer")  # for its reason to skip
        made.append(LiveView(mode, options=OPTIONS, name="test", say=said, **more))
        return made[-1]

    yield make
    for each in made:
        if not each._pipe.closed:
            each.close()
        with contextlib.suppress(ProcessLookupError):
            os.killpg(each.pid, signal.SIGKILL)


@pytest.mark.parametrize(
    ("url", "address"),
    [
        ("rerun+http://10.0.0.7:9876/proxy", "rerun+http://10.0.0.7:9876/proxy"),
        ("http://desk:1234", "rerun+http://desk:1234/proxy"),
        ("https://desk/", "rerun+https://desk:9876/proxy"),
        ("rerun://desk/proxy", "rerun://desk:9876/proxy"),
        ("desk", "rerun+http://desk:9876/proxy"),
        ("desk:99", "rerun+http://desk:99/proxy"),
        ("http://[::1]:99", "rerun+http://[::1]:99/proxy"),
    ],
)
def test_an_address_may_be_told_in_several_ways(url: str, address: str) -> None:
    assert viewer.data_address(url)[0] == address


@pytest.mark.parametrize(
    "url",
    [
        "",
        "ftp://desk",
        "http://",
        "http://desk:x",
        "http://desk:99999",
        "desk/app",
        "a b",
        "http://[",
    ],
)
def test_what_is_no_address_is_refused_in_one_line(url: str, view: Any) -> None:
    with pytest.raises(OutputError, match=r"looks like rerun\+http://HOST:PORT/proxy") as caught:
        view(CONNECT, url=url)
    assert "\n" not in str(caught.value)


def test_without_a_display_it_says_what_to_do_instead(
    view: Any, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.delenv("DISPLAY", raising=False)
    monkeypatch.delenv("WAYLAND_DISPLAY", raising=False)
    with pytest.raises(OutputError, match=r"view=.web.*view=.connect"):
        view(WINDOW)


def test_what_is_shown_is_what_decoding_finds(
    view: Any, said: Said, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(parent, "CLOSE_S", PATIENCE_S)
    chunks = talk(3000)
    with saver(tmp_path / "a.rrd") as (_, url):
        live = view(CONNECT, url=url)
        fed(live, chunks)
        live.close()  # before it has begun
        assert said == []
        assert (live.dropped_bytes, live.alive) == (0, False)
        until(lambda: not group(live.pid))
    rows = saved(tmp_path / "a.rrd")
    assert rows["/bus0/servo/1/present_position"] == decoded(chunks)
    assert len(decoded(chunks)) == 1500
    assert len(rows["/bus0/servo/2/present_voltage"]) == 60
    assert "/bus0/anomalies" not in rows


def test_incidents_stand_at_their_bus_and_at_their_servos(
    view: Any, said: Said, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(parent, "CLOSE_S", PATIENCE_S)
    change = IncidentChange(Stage.OPENED, START_NS, incident(servo_ids=(1, 2), last_ns=START_NS))
    with saver(tmp_path / "a.rrd") as (_, url):
        live = view(CONNECT, url=url)
        fed(live, talk(500))
        live.incidents([change])
        live.close()
        until(lambda: not group(live.pid))
    rows = saved(tmp_path / "a.rrd")
    for path in ("/bus0/incidents", "/bus0/servo/1/incidents", "/bus0/servo/2/incidents"):
        ((t_ns, _),) = rows[path]
        assert t_ns == START_NS
    assert said == []


def size_of(path: Path) -> int:
    """Return how long a file is, nothing where it is not there yet."""
    return path.stat().st_size if path.exists() else 0


def test_a_viewer_that_hangs_loses_groups_and_then_goes_on(
    view: Any, said: Said, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(parent, "CLOSE_S", PATIENCE_S)  # it is slow here, it does not hang
    first, flood, rest = talk(500), busy(180_000), talk(500, first_ms=300_000)
    with saver(tmp_path / "a.rrd") as (process, url):
        live = view(CONNECT, url=url)
        fed(live, first)
        until_it_has(live, lambda: size_of(tmp_path / "a.rrd") > 10_000)
        process.send_signal(signal.SIGSTOP)
        fed(live, flood, 500)
        assert 8_000_000 < live.dropped_bytes < 92 * len(flood)
        assert live.dropped_chunks == pytest.approx(live.dropped_bytes / 92)
        process.send_signal(signal.SIGCONT)
        until_it_has(live, lambda: not live._backlog)
        fed(live, rest)
        live.close()
        assert said == []
    rows = saved(tmp_path / "a.rrd")
    shown = [(at, x) for at, x in rows["/bus0/servo/1/present_position"] if x == x]  # no hole
    assert set(decoded(first)[:-1]) <= set(shown)
    assert set(decoded(rest)[1:]) <= set(shown)
    assert set(shown) <= set(decoded([*first, *flood, *rest]))
    lines = [text for _, text in rows["/bus0/anomalies"]]
    assert any("not-decoded" in line for line in lines)
    lost = [int(n) for line in lines for n in re.findall(r"not-decoded: (\d+) bytes", line)]
    assert sum(lost) == live.dropped_bytes


def test_a_viewer_that_hangs_does_not_hold_up_the_recorder(view: Any, said: Said) -> None:
    live = view(WINDOW)
    fed(live, talk(100))
    os.kill(looks(live), signal.SIGSTOP)
    groups = [(f"bus{bus}", busy(50)) for bus in range(8)]
    before = _resident()
    for _ in range(20 * 30):  # thirty seconds
        for bus, chunks in groups:
            live.raw(bus, chunks)  # and it comes back, for the viewer never does
    assert live.alive
    assert live.dropped_bytes > 10_000_000
    assert _resident() - before < 16_000_000
    live.close()
    until(lambda: not group(live.pid))
    assert said == []


def _resident() -> int:
    return int(Path("/proc/self/statm").read_text().split()[1]) * resource.getpagesize()


@pytest.mark.parametrize("whose", ["viewer", "watcher"])
def test_a_viewer_that_dies_is_told_of_once_and_the_recording_goes_on(
    whose: str, view: Any, said: Said
) -> None:
    live = view(WINDOW)
    fed(live, talk(100))
    viewer = looks(live)
    os.kill(viewer if whose == "viewer" else live.pid, signal.SIGKILL)
    until_it_has(live, lambda: not live.alive)
    (line,) = said
    assert line.endswith("; the recording goes on")
    assert line.startswith(
        "the Rerun viewer stopped with status -9" if whose == "viewer" else "the process that shows"
    )
    until(lambda: not group(live.pid))
    fed(live, busy(5000))
    assert live.dropped_bytes == 0
    live.close()
    assert len(said) == 1


def test_a_window_stays_open_behind_the_recording_until_it_is_closed(view: Any, said: Said) -> None:
    live = view(WINDOW)
    assert os.getsid(live.pid) == live.pid != os.getsid(0)  # no Ctrl-C reaches it
    fed(live, talk(1000))
    viewer, address = viewer_of(live)
    live.close()
    assert said == ["the Rerun window stays open until it is closed"]
    assert {viewer, live.pid} <= group(live.pid).keys()
    client = connected(address)

    def shown() -> list[int | None]:
        """Return where the recordings end that the viewer has got so far."""
        return [r.timelines[0].end for r in client.get_state().recordings if r.timelines]

    until(lambda: shown() == [talk(1000)[-1].t_ns])
    os.kill(viewer, signal.SIGTERM)
    until(lambda: not group(live.pid))


def test_a_window_that_has_shown_nothing_does_not_stay(view: Any, said: Said) -> None:
    live = view(WINDOW)
    live.close()
    until(lambda: not group(live.pid))
    assert said == []


def test_a_browser_is_served_while_the_recording_lasts(view: Any, said: Said) -> None:
    live = view(WEB)
    until_it_has(live, lambda: said)
    (line,) = said
    page = line.split()[-1]
    assert "url=rerun%2Bhttp%3A%2F%2F127.0.0.1%3A" in page
    opener = urllib.request.build_opener(urllib.request.ProxyHandler({}))
    with opener.open(page, timeout=180) as answer:
        assert b"rerun" in answer.read().lower()
    fed(live, talk(200))
    live.close()
    until(lambda: not group(live.pid))
    assert len(said) == 1


def test_a_viewer_that_is_not_there_is_told_of_and_the_recording_goes_on(
    view: Any, said: Said
) -> None:
    with socket.socket() as taken:
        taken.bind(("127.0.0.1", 0))  # and nobody listens
        live = view(CONNECT, url=f"127.0.0.1:{taken.getsockname()[1]}")
        until_it_has(live, lambda: not live.alive)
    (line,) = said
    assert re.fullmatch(r"no Rerun viewer answers at .*; the recording goes on", line)
    live.close()


class Mute(http.server.BaseHTTPRequestHandler):
    def log_message(self, *_: object) -> None: ...


def test_what_is_no_viewer_is_told_of(view: Any, said: Said) -> None:
    with http.server.HTTPServer(("127.0.0.1", 0), Mute) as other:
        threading.Thread(target=other.serve_forever, daemon=True).start()
        live = view(CONNECT, url=f"127.0.0.1:{other.server_port}")
        until_it_has(live, lambda: not live.alive)
        other.shutdown()
    (line,) = said
    assert re.fullmatch(r"what answers at .* is no Rerun viewer; the recording goes on", line)
    live.close()


@pytest.mark.parametrize("mode", [WEB, WINDOW])
def test_a_recorder_that_is_killed_leaves_nothing_but_a_window_to_be_closed(
    mode: str, headless_viewer: HeadlessViewer
) -> None:
    code = (
        "import sys, time; import tests.live as t\n"
        "from sniffer.viewers.companion.parent import LiveView\n"
        "more = {'arguments': ('--headless',)} if sys.argv[1] == 'window' else {}\n"
        "live = LiveView(sys.argv[1], options=t.OPTIONS, name='x', say=t.Said(), **more)\n"
        "print(live.pid, flush=True)\n"
        "while True: t.fed(live, t.talk(50)); time.sleep(0.05)"
    )
    with subprocess.Popen(
        [sys.executable, "-c", code, mode],
        stdout=subprocess.PIPE,
        text=True,
        env={**os.environ, "DISPLAY": ":0"},
    ) as recorder:
        assert recorder.stdout is not None
        leader = int(recorder.stdout.readline())
        until(lambda: len(group(leader)) == 2)
        recorder.kill()
    if mode == WINDOW:
        time.sleep(1)
        (viewer,) = group(leader).keys() - {leader}
        os.kill(viewer, signal.SIGTERM)
    until(lambda: not group(leader))


def test_a_servo_that_appears_gets_its_place_by_itself_and_the_plots_follow(
    view: Any, said: Said, headless_viewer: HeadlessViewer, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(parent, "CLOSE_S", PATIENCE_S)  # it is slow here, it does not hang
    client = headless_viewer.client
    if client.get_state().recordings:
        client.close("all")
    before = set(headless_viewer.complaints())
    live = view(CONNECT, url=client.url, window_s=2.0)

    def are_shown(*entities: str) -> bool:
        client.take_screenshot(max_size=64)  # without a window it does nothing unasked
        if not client.get_state().recordings:
            return False
        layout = str(client.get_blueprint().blueprint)
        there = {e.entity_path for e in client.get_recording_schema().entities}
        return all(entity in there and entity in layout for entity in entities)

    def follows(last_ms: int) -> bool:
        client.take_screenshot(max_size=64)
        (recording,) = client.get_state().recordings
        return recording.current_time == recording.timelines[0].end == START_NS + last_ms * MS

    first, second = "/bus0/servo/1/present_position", "/bus0/servo/2/present_position"
    fed(live, talk(1000, servos=[1]))
    until_it_has(live, lambda: are_shown(first) and follows(999))
    layout = client.get_blueprint()
    assert second not in str(layout.blueprint)
    fed(live, talk(3000, servos=[1], first_ms=1000))
    until_it_has(live, lambda: follows(3999))
    assert client.get_blueprint().blueprint_id == layout.blueprint_id  # nothing is laid out anew
    fed(live, talk(3000, first_ms=4000))
    until_it_has(live, lambda: are_shown(first, second) and follows(6999))
    assert client.get_blueprint().blueprint_id != layout.blueprint_id
    live.close()
    assert not set(headless_viewer.complaints()) - before
    assert (live.dropped_bytes, said) == (0, [])
