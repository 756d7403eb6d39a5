"""A plug-in as a package and as a file, what it says, and the commands that see it."""

from __future__ import annotations

from typing import TYPE_CHECKING

import pytest

from tests.plugin import Command, as_file, install, runs, speech, table

if TYPE_CHECKING:
    from pathlib import Path


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


@pytest.fixture
def own(tmp_path: Path) -> Path:
    """Return the table of a mightyZAP model that nobody knows."""
    path = tmp_path / "my_servo.toml"
    path.write_text(table("my-servo", "mightyzap", 0.25), encoding="utf-8")
    return path
