"""Ray: the same data set as one process makes, and who ends its worker is told."""

from __future__ import annotations

import os
from typing import TYPE_CHECKING

import pytest

from sniffer.decoding.options import Options
from sniffer.fleet.run import decode_fleet
from tests.fleets import DEADLY, Peril, content, serial, talks
from tests.plugin import visible

if TYPE_CHECKING:
    from pathlib import Path

pytest.importorskip("ray", reason="Ray is not installed; `make test-ray` installs it")


def test_ray_makes_the_same_data_set_but_for_a_capture_that_ends_its_worker(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr("sniffer.fleet.run.BATCH_CAPTURES", 2)
    visible(monkeypatch)  # the registry forgets its protocol afterwards
    options = Options(protocol=str(Peril(tmp_path / "peril").protocol))
    logs = talks(tmp_path / "captures", b"", b"", b"", DEADLY)
    done = decode_fleet([logs], tmp_path / "ray", options, engine="ray", workers=2)
    assert (done.statuses, done.reasons) == ({"ok": 3, "crashed": 1}, ())
    assert os.environ["RAY_USAGE_STATS_ENABLED"] == "0"

    (logs / "3.bin").unlink()
    assert serial(logs, tmp_path / "serial", options=options).is_whole
    made = content(tmp_path / "ray")
    (crashed,) = (name for name, held in made.items() if "'crashed'" in held)
    del made[crashed]
    assert made == content(tmp_path / "serial")
