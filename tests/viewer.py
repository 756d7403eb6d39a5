"""A real Rerun viewer without a window, for tests of what people will see.

Written against rerun-sdk 0.41, whose ``ViewerClient`` is experimental: this is the only file of the
tests that speaks to it.
"""

from __future__ import annotations

import contextlib
import os
import re
import shutil
import socket
import subprocess
import sys
import time
from pathlib import Path
from typing import TYPE_CHECKING, Any, Final, cast

import pytest
from rerun.experimental import ViewerClient

if TYPE_CHECKING:
    from collections.abc import Iterator

    from rerun.experimental import LogEntry, ViewerState

PATIENCE_S: Final = 180.0
"""Longest wait for a recording to load or a picture to rest; software drawing on a busy machine."""

NO_GRAPHICS: Final = ("No graphics adapter was found", "Failed to get render context")
"""What viewer 0.41 panics with where no usable driver is: none at all, or GL without Vulkan."""


LATE: Final = "The requested Wait timed out before the submission was completed"
"""What viewer 0.41 says where a busy machine takes long to draw a picture, which is taken again."""


SOFTWARE: Final = "Software rasterizer detected"
"""What it says where there is no graphics card, at some moment."""


class PatientClient:
    """The SDK's client, which asks again where a busy viewer does not answer in the SDK's time."""

    def __init__(self, client: ViewerClient) -> None:
        self._client = client

    def __getattr__(self, name: str) -> Any:
        call = getattr(self._client, name)
        if not callable(call):
            return call

        def patiently(*arguments: Any, **options: Any) -> Any:
            deadline = time.monotonic() + PATIENCE_S
            while True:
                try:
                    return call(*arguments, **options)
                except TimeoutError:
                    if time.monotonic() > deadline:
                        raise

        return patiently


def connected(address: str) -> ViewerClient:
    """Return a client of the viewer that listens there."""
    return cast("ViewerClient", PatientClient(ViewerClient.connect(address)))


class HeadlessViewer:
    """The running viewer: ``client`` has all calls; ``show`` and ``complaints`` serve tests."""

    def __init__(self, client: ViewerClient) -> None:
        self.client = client
        self._log_seen = 0

    def show(self, path: Path) -> ViewerState:
        """Close what is open, open ``path``, and return the viewer's state once its picture rests.

        The viewer is reset first: it keeps the first blueprint that it saw of an application id,
        and would go on drawing that one whatever ``path`` holds. Playback is paused. The first
        picture after loading may be drawn on axes that are not yet settled, therefore two equal
        ones in a row are waited for.
        """
        if self.client.get_state().recordings:
            self.client.close("all")
        self.client.run_command("ui.reset_viewer")
        logs = self.client.get_logs()
        self._log_seen = logs[-1].sequence if logs else 0
        self.client.open(str(path.resolve()))
        deadline = time.monotonic() + PATIENCE_S
        while (state := self.client.get_state()).loading or not state.active_recording:
            refused = [entry.message for entry in self._new_logs("ERROR")]
            if refused or time.monotonic() > deadline:
                raise RuntimeError(f"{path.name} does not load: {state.loading} {refused}")
            time.sleep(0.05)
        self.client.set_time(play_state="paused")
        last = None
        while (now := (self._view_ids(), self.client.take_screenshot())) != last:
            if time.monotonic() > deadline:
                raise TimeoutError(f"{path.name}: the picture does not come to rest")
            last = now
            time.sleep(0.2)
        return self.client.get_state()

    def complaints(self) -> list[str]:
        """All that the viewer found wrong since ``show``: reports of its views, and its log."""
        reports = [
            f"{view.name}: {report.severity}: {report.summary} ({report.details})"
            for view in self.client.get_state().views
            for report in view.reports
        ]
        logs = [
            f"viewer log: {e.level}: {e.message}"
            for e in self._new_logs("WARN", "ERROR")
            if not any(words in e.message for words in (LATE, SOFTWARE))
        ]
        return reports + logs

    def picture(self, view_name: str) -> bytes:
        """One view as PNG bytes; a view in a background tab has none and raises."""
        (view,) = (v for v in self.client.get_state().views if v.name == view_name)
        return self.client.take_screenshot(view.view_id)

    def _view_ids(self) -> list[str]:
        return [view.view_id for view in self.client.get_state().views]

    def _new_logs(self, *levels: str) -> list[LogEntry]:
        return [e for e in self.client.get_logs(self._log_seen) if e.level in levels]


@contextlib.contextmanager
def headless(home: Path) -> Iterator[HeadlessViewer]:
    """Run a viewer that keeps all its files in ``home``; skip the test where none can run."""
    executable = _executable()
    if executable is None:
        pytest.skip("no Rerun viewer: no `rerun` beside this Python nor on PATH")
    log = home / "viewer.log"
    with pytest.MonkeyPatch.context() as environment:
        for name in ("RUNTIME_DIR", "CONFIG_HOME", "DATA_HOME", "CACHE_HOME"):
            folder = home / name.lower()
            folder.mkdir(mode=0o700)
            environment.setenv(f"XDG_{name}", str(folder))
        # Into the config folder above, not the user's.
        subprocess.run([executable, "analytics", "disable"], check=True, capture_output=True)
        try:
            with _stderr_into(log):
                spawned = ViewerClient.spawn(
                    headless=True,
                    port=_free_port(),
                    hide_welcome_screen=True,
                    executable_path=executable,
                )
            client = cast("ViewerClient", PatientClient(spawned))
            client.take_screenshot(max_size=64)  # it answers before it has tried to draw
        except (ConnectionError, RuntimeError) as error:
            said = log.read_text(errors="replace")
            if any(words in said for words in NO_GRAPHICS):
                panic = re.search(r"panicked at '(.*)'", said)
                pytest.skip(
                    f"no Vulkan driver for the headless Rerun viewer ({panic and panic[1]}); "
                    "on Debian: apt-get install mesa-vulkan-drivers libvulkan1 libegl1"
                )
            raise RuntimeError(f"the headless Rerun viewer did not start:\n{said}") from error
    try:
        yield HeadlessViewer(client)
    finally:
        client.quit()


def _executable() -> str | None:
    beside = Path(sys.executable).with_name("rerun")
    return str(beside) if beside.exists() else shutil.which("rerun")


def _free_port() -> int:
    with socket.socket() as probe:
        probe.bind(("127.0.0.1", 0))
        port: int = probe.getsockname()[1]
        return port


@contextlib.contextmanager
def _stderr_into(path: Path) -> Iterator[None]:
    """Send file descriptor 2 to a file: a child started meanwhile inherits it and keeps it."""
    sys.stderr.flush()
    kept = os.dup(2)
    try:
        with path.open("ab") as file:
            os.dup2(file.fileno(), 2)
        yield
    finally:
        os.dup2(kept, 2)
        os.close(kept)
