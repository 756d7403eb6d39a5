"""Captures of all protocols, and somebody who asks of them."""

from __future__ import annotations

from typing import TYPE_CHECKING

import pytest

from tests.lists import in_turn
from tests.questions.asking import NAMES, Asker, Capture, sample, simulated

if TYPE_CHECKING:
    from pathlib import Path


@pytest.fixture(scope="session")
def drawn(tmp_path_factory: pytest.TempPathFactory) -> Path:
    return tmp_path_factory.mktemp("drawn")


def pytest_itemcollected(item: pytest.Item) -> None:
    """Ask each question of some captures, each of them one of other questions."""
    if "capture" in getattr(item, "fixturenames", ()):
        item.add_marker(in_turn(8))


@pytest.fixture(params=NAMES)
def capture(request: pytest.FixtureRequest, drawn: Path) -> Capture:
    name = str(request.param)
    protocol, _, is_simulated = name.partition(" ")
    return simulated(protocol, drawn) if is_simulated else sample(name)


@pytest.fixture
def asker(
    capsys: pytest.CaptureFixture[str], tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> Asker:
    monkeypatch.delenv("COLUMNS", raising=False)
    return Asker(capsys, tmp_path)
