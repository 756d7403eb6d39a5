"""What becomes of a data set when processes are killed, disks fill up, and runs meet."""

from __future__ import annotations

import contextlib
import errno
import os
import platform
import signal
import subprocess
import sys
import threading
import time
from pathlib import Path
from types import ModuleType
from typing import TYPE_CHECKING, Any
from unittest.mock import Mock

import pytest

import sniffer
from sniffer.decoding.options import Options
from sniffer.fleet.dataset import CAPTURES_FILE
from sniffer.fleet.store import STAGING, Store
from tests.commands import COMMAND, environment, talk, within
from tests.disks import disk
from tests.fleets import (
    DEADLY,
    HELD_UP,
    Peril,
    captures,
    content,
    descendants,
    end,
    eventually,
    is_running,
    parent,
    serial,
    talks,
)
from tests.plugin import visible

if TYPE_CHECKING:
    from collections.abc import Iterator

Capsys = pytest.CaptureFixture[str]

pytestmark = pytest.mark.skipif(sys.platform != "linux", reason="reads the process table of Linux")


@pytest.fixture
def peril(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Iterator[Peril]:
    """Return a protocol whose captures may hold up or end processes; nobody is left waiting."""
    visible(monkeypatch)  # what is loaded of it here is forgotten afterwards
    made = Peril(tmp_path / "peril")
    yield made
    made.open()


def begun(inputs: Path, dataset: Path, peril: Peril) -> subprocess.Popen[bytes]:
    """Begin a run in a session of its own."""
    return subprocess.Popen(
        [*COMMAND, "fleet", inputs, "-o", dataset, "--protocol", peril.protocol, "--workers", "2"],
        env=environment(),
        stdout=subprocess.PIPE,
        stderr=subprocess.PIPE,
        start_new_session=True,
    )


def expected(inputs: Path, peril: Peril, dataset: Path) -> dict[str, str]:
    """Return what a run in which nothing happens makes of captures."""
    peril.open()
    assert serial(inputs, dataset, options=Options(protocol=str(peril.protocol))).is_whole
    return content(dataset)


def test_a_worker_that_is_killed_twice_takes_nothing_with_it(
    peril: Peril, tmp_path: Path, capsys: Capsys
) -> None:
    inputs, data = talks(tmp_path / "in", HELD_UP, b"", b"", b""), tmp_path / "data"

    def kill() -> None:
        for _ in range(2):
            end(peril.held_up())
        peril.held_up()
        peril.open()

    killer = threading.Thread(target=kill)
    killer.start()
    done = within(
        capsys, "fleet", inputs, "-o", data, "--protocol", peril.protocol, "--workers", "2"
    )
    killer.join()
    assert (done.status, done.err) == (0, "")
    assert done.out == "4 captures: 4 ok (4 decoded, 0 there already)\n"
    assert content(data) == expected(inputs, peril, tmp_path / "serial")


def test_a_run_goes_on_where_the_process_is_killed_that_begins_its_workers(
    peril: Peril, tmp_path: Path
) -> None:
    inputs, data = talks(tmp_path / "in", HELD_UP, b"", b"", b""), tmp_path / "data"
    run = begun(inputs, data, peril)
    end(parent(peril.held_up()))
    peril.held_up()
    peril.open()
    out, err = run.communicate()
    assert (run.returncode, err) == (0, b"")
    assert out == b"4 captures: 4 ok (4 decoded, 0 there already)\n"
    assert content(data) == expected(inputs, peril, tmp_path / "serial")


def test_a_capture_that_always_ends_its_process_has_a_row_and_every_run_tries_it(
    peril: Peril, tmp_path: Path, capsys: Capsys
) -> None:
    inputs, data = talks(tmp_path / "in", b"", DEADLY, b""), tmp_path / "data"
    arguments = ("fleet", inputs, "-o", data, "--protocol", peril.protocol)
    for decoded, there in ((3, 0), (1, 2)):
        done = within(capsys, *arguments)
        assert done.status == 1
        assert done.err == f"sniffer: crashed: {inputs / '1.bin'}: its process died 3 times\n"
        counts = f"({decoded} decoded, {there} there already)"
        assert done.out == f"3 captures: 2 ok, 1 crashed {counts}\n"
    assert not (data / STAGING).exists()
    (inputs / "1.bin").unlink()
    assert {name for name in content(data) if "_done" not in name} == {
        name for name in expected(inputs, peril, tmp_path / "serial") if "_done" not in name
    }


def test_a_damaged_list_of_captures_is_written_anew_of_the_commits(tmp_path: Path) -> None:
    (tmp_path / "a.bin").write_bytes(talk(2))
    data = tmp_path / "data"
    assert serial(tmp_path / "a.bin", data).is_whole
    whole = (data / "captures.parquet").read_bytes()
    mark = whole.index(b"fingerprint")  # in what stands at its end of its columns
    for damaged in (whole[:-40], b"", whole[: mark - 400] + b"\xff" * 420 + whole[mark + 20 :]):
        (data / "captures.parquet").write_bytes(damaged)
        done = serial(tmp_path / "a.bin", data)
        assert (done.skipped, done.is_whole) == (1, True)
        assert (data / "captures.parquet").read_bytes() == whole
    with pytest.MonkeyPatch.context() as patch:
        refused = OSError(errno.EIO, os.strerror(errno.EIO))
        patch.setattr("pyarrow.parquet.read_table", Mock(side_effect=refused))
        with pytest.raises(sniffer.InputError, match="Input/output error"):
            serial(tmp_path / "a.bin", data)


def test_of_two_runs_one_is_killed_and_one_interrupted_and_the_next_one_goes_on(
    peril: Peril, tmp_path: Path
) -> None:
    inputs, data = talks(tmp_path / "in", HELD_UP, b"longer " * 99), tmp_path / "data"
    killed, interrupted = runs = [begun(inputs, data, peril) for _ in range(2)]
    for _ in runs:
        peril.held_up()
    eventually(lambda: 0 if list((data / "_done").glob("*")) else None)
    families = [descendants(run.pid) for run in runs]
    assert min(map(len, families)) >= 2
    end(killed.pid)
    killed.communicate()
    eventually(lambda: None if any(map(is_running, families[0])) else 0)
    for _ in range(3):  # a hand that trembles
        os.killpg(interrupted.pid, signal.SIGINT)
        time.sleep(0.005)
    out, err = interrupted.communicate()
    assert interrupted.returncode == 130
    # the one that begins later may find there what the other one decoded
    own = {b"1 decoded, 0 there already", b"0 decoded, 1 there already"}
    assert out.strip() in {b"2 captures: 1 ok (" + one + b")" for one in own}
    said = f"interrupted: 1 capture not done: what is in {data} stays; run it again to go on"
    assert err.decode().splitlines() == [f"sniffer: {said}"]
    eventually(lambda: None if any(map(is_running, families[1])) else 0)
    assert (data / "captures.parquet").exists()
    peril.open()
    last = serial(inputs, data, options=Options(protocol=str(peril.protocol)))
    assert (last.decoded, last.skipped, last.is_whole) == (1, 1, True)
    assert content(data) == expected(inputs, peril, tmp_path / "serial")


def test_two_runs_at_once_do_no_harm(tmp_path: Path) -> None:
    inputs, data = talks(tmp_path / "in", b"", b"a", b"b"), tmp_path / "data"
    barrier = threading.Barrier(2)
    done: list[sniffer.FleetRun] = []

    def run() -> None:
        barrier.wait()
        done.append(serial(inputs, data, options=Options(protocol="mightyzap")))

    both = [threading.Thread(target=run) for _ in range(2)]
    for thread in both:
        thread.start()
    for thread in both:
        thread.join()
    assert [run.is_whole for run in done] == [True, True]
    serial(inputs, tmp_path / "serial", options=Options(protocol="mightyzap"))
    assert content(data) == content(tmp_path / "serial")


def test_workers_load_nothing_of_the_script_that_begins_them(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    script = ModuleType("__main__")
    script.__file__ = str(tmp_path / "script.py")
    (tmp_path / "script.py").write_text("raise SystemExit('it runs again')\n", encoding="ascii")
    monkeypatch.setitem(sys.modules, "__main__", script)
    done = sniffer.decode_fleet([talks(tmp_path / "in", b"")], tmp_path / "data", workers=1)
    assert done.statuses == {"ok": 1}
    assert sys.modules["__main__"] is script


def test_no_capture_is_blamed_where_workers_end_before_they_begin(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr("sniffer.jobs.crew._work", contextlib.suppress)
    done = sniffer.decode_fleet([talks(tmp_path / "in", b"", b"")], tmp_path / "data", workers=1)
    assert done.reasons == ("worker processes end here before they begin",)
    assert (len(done.undone), done.statuses) == (2, {})


def test_a_disk_that_is_full_is_told_in_a_line_and_with_room_the_run_goes_on(
    tmp_path: Path, capsys: Capsys
) -> None:
    inputs = tmp_path / "in"
    inputs.mkdir()
    for nth in range(3):
        (inputs / f"{nth}.bin").write_bytes(talk(250, nth))
    serial(inputs, tmp_path / "serial")
    # less than half of what all of it takes: tmpfs gives files whole pages of 4 KiB
    room = sum(path.stat().st_size for path in (tmp_path / "serial").rglob("*.*")) // 2048
    with disk(tmp_path / "small", f"{room}k") as small:
        data = small / "data"
        done = within(capsys, "fleet", inputs, "-o", data, "--workers", "1")
        assert done.status == 3
        first, last = done.err.splitlines()
        assert first == f"sniffer: {data}: cannot be written (No space left on device)"
        assert last.endswith(f"not done: what is in {data} stays; run it again to go on")
        remount = ["mount", "-o", "remount,size=8m", str(small)]
        subprocess.run(remount, check=True)
        assert within(capsys, "fleet", inputs, "-o", data).status == 0
        assert content(data) == content(tmp_path / "serial")


def test_whatever_cannot_be_written_leaves_a_data_set_that_says_it_is_not_whole(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    inputs = talks(tmp_path / "in", b"")
    serial(inputs, tmp_path / "serial")
    put, puts = Store.put, 0
    wanted = -1

    def failing(store: Store, path: str, file: Path) -> None:
        nonlocal puts
        puts += 1
        if puts == wanted:
            raise OSError(errno.EIO, os.strerror(errno.EIO), path)
        put(store, path, file)

    monkeypatch.setattr(Store, "put", failing)
    assert serial(inputs, tmp_path / "counted").is_whole
    for wanted in range(1, puts + 1):
        puts, data = 0, tmp_path / f"data{wanted}"
        done = serial(inputs, data)
        assert not done.is_whole
        assert len(done.reasons) == 1
        assert "Input/output error" in done.reasons[0]
        assert serial(inputs, data).is_whole
        assert content(data) == content(tmp_path / "serial")


def test_what_workers_left_is_swept_away_also_where_the_list_cannot_be_written(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    inputs, data, put = talks(tmp_path / "in", b""), tmp_path / "data", Store.put
    gone = subprocess.Popen([sys.executable, "-c", ""])
    gone.wait()
    left = data / STAGING / f"{platform.node()}-{gone.pid}-it"

    def full(store: Store, path: str, file: Path) -> None:
        if path == CAPTURES_FILE:
            raise OSError(errno.ENOSPC, os.strerror(errno.ENOSPC), path)
        put(store, path, file)

    def ended(so_far: sniffer.FleetProgress) -> None:
        left.mkdir()
        (left / "samples.parquet").write_bytes(b"begun")

    monkeypatch.setattr(Store, "put", full)
    assert not serial(inputs, data, progress=ended).is_whole
    assert not left.exists()


def test_a_program_is_told_how_far_it_is(tmp_path: Path) -> None:
    inputs = captures(tmp_path / "in")
    told: list[sniffer.FleetProgress] = []
    done = serial(inputs, tmp_path / "data", progress=told.append)
    assert told[-1].captures == told[-1].of_captures == done.decoded == 3
    assert told[-1].bytes == told[-1].of_bytes == done.bytes > 0
    assert told[-1].bytes_per_second > 0
    assert told[-1].seconds_left == 0


def test_a_folder_that_another_run_sweeps_away_while_it_is_made_is_made_again(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    make, swept = Path.mkdir, iter(range(3))

    def swept_away(path: Path, *arguments: Any, **options: Any) -> None:
        if path.name == STAGING and next(swept, None) is not None:
            raise FileExistsError(errno.EEXIST, "it was there, and is no folder any more")
        make(path, *arguments, **options)

    monkeypatch.setattr(Path, "mkdir", swept_away)
    with Store.of(tmp_path / "data").staging() as folder:
        assert folder.is_dir()


def test_a_data_set_behind_a_link_to_nowhere_cannot_be_written(tmp_path: Path) -> None:
    link = tmp_path / "data"
    link.symlink_to(tmp_path / "nowhere" / "at" / "all")
    with pytest.raises(OSError, match="exists"), Store.of(link).staging():
        pass
