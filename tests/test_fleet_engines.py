"""Clusters: they make what one process makes, and nothing where they would make something else."""

from __future__ import annotations

import os
import signal
import sys
from importlib.util import find_spec
from typing import TYPE_CHECKING, Any

import pytest

from sniffer.decoding.options import Options
from sniffer.fleet.engines import dask as dask_engine
from sniffer.fleet.engines.dask import DaskEngine
from sniffer.fleet.engines.spread import OtherProgramError
from sniffer.fleet.recipe import write_recipe
from sniffer.fleet.rows import CaptureTask
from sniffer.fleet.run import decode_fleet
from tests.commands import within
from tests.fleets import HELD_UP, Peril, captures, content, descendants, serial, talks
from tests.plugin import visible

if TYPE_CHECKING:
    from collections.abc import Collection, Iterator
    from pathlib import Path

Capsys = pytest.CaptureFixture[str]

# Found, not loaded: each worker would load it to collect what one of them runs.
pytestmark = pytest.mark.skipif(find_spec("distributed") is None, reason="Dask is not installed")


@pytest.fixture(scope="module")
def scheduler() -> Iterator[str]:
    """The address of a Dask cluster of one worker, in this process."""
    from distributed import LocalCluster

    with LocalCluster(
        n_workers=1,
        threads_per_worker=1,
        processes=False,
        protocol="tcp://",
        dashboard_address="127.0.0.1:0",
        silence_logs=dask_engine.SILENT,
    ) as cluster:
        yield cluster.scheduler_address


def test_a_dask_cluster_makes_the_same_data_set_as_one_process(
    scheduler: str, tmp_path: Path, capsys: Capsys
) -> None:
    logs = captures(tmp_path / "captures")
    engine = ("--engine", "dask", "--scheduler", scheduler)
    ran = within(capsys, "fleet", logs, "-o", tmp_path / "dask", *engine)
    assert (ran.status, ran.err) == (0, "")
    assert serial(logs, tmp_path / "serial").is_whole
    assert content(tmp_path / "dask") == content(tmp_path / "serial")


def test_a_dask_worker_that_is_killed_with_a_capture_costs_nothing_but_time(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    visible(monkeypatch)  # the registry forgets its protocol afterwards
    peril = Peril(tmp_path / "peril")
    logs = talks(tmp_path / "captures", b"", HELD_UP, b"")
    options = Options(protocol=str(peril.protocol))
    killed: list[int] = []

    class Killing(DaskEngine):
        """Its worker is killed while it decodes."""

        def first(self, handles: Collection[Any]) -> Any:
            if not killed:
                killed.append(peril.held_up())
                os.kill(killed[-1], signal.SIGKILL)
                peril.open()
            return super().first(handles)

    done = decode_fleet([logs], tmp_path / "dask", options, engine=Killing(1))
    assert len(killed) == 1
    assert (done.statuses, done.reasons) == ({"ok": 3}, ())
    assert serial(logs, tmp_path / "serial", options=options).is_whole
    assert content(tmp_path / "dask") == content(tmp_path / "serial")
    assert killed[0] not in descendants(os.getpid())


def test_workers_with_another_program_are_refused_before_they_write(
    scheduler: str, tmp_path: Path
) -> None:
    recipe = write_recipe(Options(), None, "auto")
    task = CaptureTask("x.log", 1, 0, "r", str(tmp_path), recipe, "00000000", "1")
    with (
        DaskEngine(1, scheduler) as engine,
        pytest.raises(OtherProgramError, match=r"than this one \(00000000\): install the same"),
    ):
        list(engine.run([(task,)]))
    assert not list(tmp_path.iterdir())


def test_a_scheduler_that_does_not_answer_is_told_in_a_line(
    good: Path, tmp_path: Path, capsys: Capsys, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(dask_engine, "ANSWERS_S", 0.2)
    nobody = ("--engine", "dask", "--scheduler", "tcp://127.0.0.1:1")
    ran = within(capsys, "fleet", good, "-o", tmp_path / "data", *nobody)
    assert ran.status == 2
    assert ran.complaint.startswith("no Dask scheduler answers at tcp://127.0.0.1:1 (")
    assert "`dask scheduler`" in ran.complaint


@pytest.mark.parametrize(
    ("engine", "library", "extra"), [("dask", "distributed", "fleet"), ("ray", "ray", "ray")]
)
def test_an_engine_that_is_not_installed_says_what_to_install(
    engine: str,
    library: str,
    extra: str,
    good: Path,
    tmp_path: Path,
    capsys: Capsys,
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    monkeypatch.setitem(sys.modules, library, None)
    ran = within(capsys, "fleet", good, "-o", tmp_path / "data", "--engine", engine)
    assert ran.status == 2
    assert ran.complaint.endswith(f"`pip install 'servo-sniffer[{extra}]'`")
    assert not (tmp_path / "data").exists()
