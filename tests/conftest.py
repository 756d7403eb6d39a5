"""What all tests share: Hypothesis profiles, and the viewer."""

from __future__ import annotations

import gc
import os
import signal
from typing import TYPE_CHECKING, Any, Final

import pytest
from hypothesis import HealthCheck, settings

from sniffer.ground.collecting import collect_seldom
from sniffer.wireshark import tables
from tests.commands import talk
from tests.hostile import Victim, recording
from tests.lists import passed_over
from tests.viewer import HeadlessViewer, headless

if TYPE_CHECKING:
    from collections.abc import Iterator, Sequence
    from pathlib import Path

MANY: Final = 3000
"""More tests than any selection of them is."""

# No deadline and no "too slow": the tests run on shared machines. "ci" draws the same examples for
# the same code, so a build that fails can be repeated; the others go and look for new ones.
_SHARED = settings(deadline=None, suppress_health_check=[HealthCheck.too_slow], print_blob=True)
settings.register_profile("fast", _SHARED, max_examples=10)
settings.register_profile("ci", _SHARED, max_examples=6, derandomize=True)
settings.register_profile("thorough", _SHARED, max_examples=100)
settings.register_profile("long", _SHARED, max_examples=3000)
settings.load_profile(os.environ.get("HYPOTHESIS_PROFILE", "fast"))

# Where no bytecode may be written, as in many containers, each process that a test starts would
# compile all of the package: that takes twice as long as all else it does.
os.environ.pop("PYTHONDONTWRITEBYTECODE", None)

# What is loaded makes no garbage: no need to look through it again and again.
collect_seldom()

# What a shell starts in the background ignores Ctrl-C and Ctrl-\, and so would every program under
# test.
if signal.getsignal(signal.SIGINT) == signal.SIG_IGN:
    signal.signal(signal.SIGINT, signal.default_int_handler)
if hasattr(signal, "SIGQUIT") and signal.getsignal(signal.SIGQUIT) == signal.SIG_IGN:
    signal.signal(signal.SIGQUIT, signal.SIG_DFL)


def pytest_collection_modifyitems(config: pytest.Config, items: list[pytest.Item]) -> None:
    """Leave cases out that are not in turn (tests/lists.py), unless they were asked for by name."""
    if any("[" in argument for argument in config.args):
        return
    over = passed_over(items)
    config.hook.pytest_deselected(items=over)
    left_out = set(over)
    items[:] = [item for item in items if item not in left_out]


def pytest_collection_finish() -> None:
    """Keep what was collected as tests, which stays until the end, from each later look around."""
    gc.freeze()


@pytest.hookimpl(optionalhook=True)
def pytest_xdist_node_collection_finished(node: Any, ids: Sequence[str]) -> None:
    """Say once how many tests there are, before the dots that show how far they are."""
    if node.gateway.id == "gw0":
        said = f"{len(ids)} tests, a dot each, and behind each line how far it is"
        long = "; all of them take ten to fifteen minutes on two idle cores, longer on busy ones"
        reporter = node.config.pluginmanager.get_plugin("terminalreporter")
        reporter.write_line(said + (long if len(ids) > MANY else ""))


@pytest.fixture(scope="session")
def headless_viewer(tmp_path_factory: pytest.TempPathFactory) -> Iterator[HeadlessViewer]:
    """A real Rerun viewer without a window, one for each worker; skips where none can run.

    A test that what it wrote is shown without fault::

        state = headless_viewer.show(path)              # .rrd or .mcap; returns once drawn
        assert {view.name for view in state.views} == {"Position", "Log"}
        assert headless_viewer.complaints() == []

    ``complaints()`` holds what each view reports (``get_state().views[].reports``, errors and
    warnings) and what the viewer logged. Two faults it cannot see: a view whose ``contents`` match
    no entity is silently empty, and a view in a background tab is not drawn and reports nothing.
    For these assert the entities (``headless_viewer.client.get_recording_schema()``), open every
    view beside the others, or look at ``headless_viewer.picture("Position")`` (PNG bytes).
    """
    with headless(tmp_path_factory.mktemp("viewer")) as viewer:
        yield viewer


@pytest.fixture(scope="session")
def dissector(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """Wireshark's dissector as a file."""
    path = tmp_path_factory.mktemp("dissector") / "servo.lua"
    path.write_text(tables.dissector(), encoding="utf-8")
    return path


@pytest.fixture
def good(tmp_path: Path) -> Path:
    path = tmp_path / "good.bin"
    path.write_bytes(talk(20))
    return path


@pytest.fixture(scope="module")
def victim() -> Iterator[Victim]:
    """The program in a process of its own, whose memory is limited and measured."""
    with Victim() as program:
        yield program


@pytest.fixture(scope="module")
def base(tmp_path_factory: pytest.TempPathFactory) -> bytes:
    """A recording, to do harm to."""
    return recording(tmp_path_factory.mktemp("base") / "run.mcap")


@pytest.fixture(autouse=True)
def _cut_files_are_old(monkeypatch: pytest.MonkeyPatch) -> None:
    """Let nobody wait whether a file that was just cut is still being written."""
    monkeypatch.setattr("sniffer.mcapfile.recover.STILL_S", 0.0)
