"""Live windows and the served viewer: how they begin, and how they end."""

from __future__ import annotations

import re
import signal
import socket
import subprocess
import sys
import threading
import urllib.request
from typing import TYPE_CHECKING

import pytest

from sniffer.decoding.decoder import Decoder
from sniffer.ground.model import OutputError
from sniffer.viewers import viewer
from tests.test_rerun import talk, write

if TYPE_CHECKING:
    from pathlib import Path

    from tests.viewer import HeadlessViewer


@pytest.fixture
def recording(tmp_path: Path) -> Path:
    path = tmp_path / "talk.rrd"
    write(path, talk(ticks=4))
    return path


def test_without_a_display_it_says_what_to_do_instead(
    recording: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(sys, "platform", "linux")
    monkeypatch.delenv("DISPLAY", raising=False)
    monkeypatch.delenv("WAYLAND_DISPLAY", raising=False)
    with pytest.raises(OutputError, match=r"no display.*--web.*-o x\.rrd") as caught:
        viewer.show(recording)
    assert "\n" not in str(caught.value)


@pytest.fixture
def live(headless_viewer: HeadlessViewer, monkeypatch: pytest.MonkeyPatch) -> viewer.LiveSink:
    """A live window without a display; it needs ``headless_viewer`` only for its reason to skip."""
    monkeypatch.setattr(viewer, "has_display", lambda: True)
    monkeypatch.setattr(viewer, "LOCAL", (*viewer.LOCAL, "--headless"))
    return viewer.live_sink("test")


def test_a_live_window_stays_until_it_is_closed(live: viewer.LiveSink) -> None:
    decoder, chunks, viewer = Decoder("mightyzap", baud=250_000), talk(ticks=4), live._viewer
    live.write("bus0", decoder.protocol, decoder.feed(*chunks[:20]))
    assert viewer.poll() is None
    threading.Timer(0.5, viewer.terminate).start()
    live.close()
    assert viewer.returncode is not None
    live.write("bus0", decoder.protocol, decoder.feed(*chunks[20:]))


def test_a_live_window_is_closed_when_an_exception_passes(live: viewer.LiveSink) -> None:
    try:
        raise SystemExit
    except SystemExit:
        live.close()
    assert live._viewer.returncode is not None


@pytest.mark.skipif(sys.platform == "win32", reason="no Ctrl-C can be sent to one process there")
@pytest.mark.parametrize(("stop", "status"), [(signal.SIGINT, 0), (signal.SIGTERM, 143)])
def test_web_serves_the_viewer_and_the_recording_until_it_is_stopped(
    stop: signal.Signals, status: int, recording: Path
) -> None:
    code = (
        "import sys, pathlib; from sniffer.viewers.viewer import show;"
        "show(pathlib.Path(sys.argv[1]), web=True, say=lambda line: print(line, flush=True))"
    )
    with subprocess.Popen(
        [sys.executable, "-c", code, str(recording)], stdout=subprocess.PIPE, text=True
    ) as process:
        try:
            assert process.stdout is not None
            line = process.stdout.readline()
            ports = [int(port) for port in re.findall(r"127\.0\.0\.1(?::|%3A)(\d+)", line)]
            opener = urllib.request.build_opener(urllib.request.ProxyHandler({}))
            with opener.open(line.split()[1], timeout=180) as page:
                assert page.status == 200
                assert b"rerun" in page.read().lower()
            assert [_listens(port) for port in ports] == [True, True]
            process.send_signal(stop)
            assert process.wait(timeout=180) == status
        finally:
            process.terminate()  # whatever it made of the signal
    assert [_listens(port) for port in ports] == [False, False]


def _listens(port: int) -> bool:
    with socket.socket() as probe:
        return probe.connect_ex(("127.0.0.1", port)) == 0
