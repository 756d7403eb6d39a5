"""Huge captures of a data set: several processes decode one together, and it is what it was."""

from __future__ import annotations

import os
import signal
import subprocess
import sys
import threading
from typing import TYPE_CHECKING, Any, Final

import pyarrow as pa
import pyarrow.parquet as pq
import pytest

import sniffer
from sniffer.decoding.options import Options
from sniffer.fleet import rows
from sniffer.fleet.engines.local import shared
from sniffer.fleet.rows import CaptureRow, CaptureTask
from sniffer.fleet.task import decode_capture
from sniffer.ground.model import Chunk, Clock
from sniffer.jobs import parts
from sniffer.simulation.buses import simulate
from sniffer.sources.stretches import Sizes
from tests.commands import environment, log, talk
from tests.fleets import (
    DEADLY,
    HELD_UP,
    Peril,
    Serial,
    content,
    descendants,
    end,
    eventually,
    is_running,
    serial,
)
from tests.lists import each_in_turn
from tests.parted import Inline, recorded
from tests.plugin import visible

if TYPE_CHECKING:
    from collections.abc import Iterable, Iterator
    from pathlib import Path

    from sniffer.fleet.engines import Batch, Outcome

SMALL: Final = Sizes(head=300, least=400, most=400, warm=200, block=1, first=0)
"""Captures of 1.1 kB are huge."""

LINES: Final = Sizes(head=100, least=200, most=200, warm=100, first=0)

CHUNKS: Final = Sizes(head=60, least=60, most=60, warm=20, first=0)


class Together(Serial):
    """An engine that decodes every capture in parts, one after the other."""

    def run(self, batches: Iterable[Batch]) -> Iterator[Outcome]:
        for batch in batches:
            yield batch, [decode_capture(task, 3) for task in batch]


def both_ways(
    inputs: Path, protocol: str, sizes: Sizes, monkeypatch: pytest.MonkeyPatch
) -> tuple[dict[str, str], dict[str, str], int]:
    """Return what is made of captures by one process and in parts, and how many parts it were."""
    joined: list[int] = []
    usual = parts.JoinedParts.run

    def run(self: parts.JoinedParts, folder: Path) -> None:
        try:
            usual(self, folder)
        finally:
            joined.append(self.joined)

    monkeypatch.setattr(rows, "HUGE", sizes)
    monkeypatch.setattr(parts, "Crew", Inline)
    monkeypatch.setattr(parts.JoinedParts, "run", run)
    options = Options(protocol=protocol)
    one, many = inputs.parent / "serial", inputs.parent / "parts"
    assert serial(inputs, one, options=options).is_whole
    assert not joined
    assert sniffer.decode_fleet([inputs], many, options, engine=Together()).is_whole
    return content(one), content(many), sum(joined)


def conversation(protocol: str, seed: int = 4) -> bytes:
    wire = b"".join(frame.wire for frame in simulate(protocol, seed=seed, duration_s=1))
    return wire + bytes(range(99)) + wire


@each_in_turn(2, "protocol", ["wck", "lss"])
def test_raw_bytes_in_parts_make_the_tables_of_the_whole_byte_for_byte(
    protocol: str, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    (tmp_path / "in").mkdir()
    (tmp_path / "in" / "x.bin").write_bytes(conversation(protocol))
    whole, split, joined = both_ways(tmp_path / "in", protocol, SMALL, monkeypatch)
    assert split == whole
    assert joined > 5
    frames = sorted(name for name in whole if name.startswith("frames/"))
    assert len(frames) > 5  # a file a stretch, read in the order of their names
    table = pa.concat_tables(pq.read_table(tmp_path / "serial" / name) for name in frames)
    assert table["offset"].to_pylist() == sorted(table["offset"].to_pylist())


@each_in_turn(2, "ending", ["", "(1700000009.0) what is this\n"], ids=["whole", "damaged"])
def test_a_log_of_several_buses_in_parts_makes_the_tables_of_the_whole_byte_for_byte(
    ending: str, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    (tmp_path / "in").mkdir()
    raw = conversation("wck", 2)
    lines = [
        f"({1700000000 + nth / 1000:.6f}) bus{nth % 2} #{raw[at : at + 9].hex()}"
        for nth, at in enumerate(range(0, 3000, 9))
    ]
    text = "# said in the evening\n" + "\n".join(lines) + "\n"
    (tmp_path / "in" / "x.log").write_text(text + ending, encoding="ascii")
    whole, split, joined = both_ways(tmp_path / "in", "wck", LINES, monkeypatch)
    assert split == whole
    assert joined > 3
    (row,) = (CaptureRow.from_json(p.read_text()) for p in (tmp_path / "parts/_done").iterdir())
    line = f"line {text.count(chr(10)) + 1}: "
    assert (row.status, line in row.error) == (("damaged", True) if ending else ("ok", False))


def test_a_recording_in_parts_makes_the_tables_of_the_whole_byte_for_byte(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    (tmp_path / "in").mkdir()
    raw = conversation("rs30x")
    chunks = [
        Chunk(raw[at : at + 20], 10**18 + at * 10**5, Clock.READ)
        for at in range(0, min(len(raw), 4000), 20)
    ]
    recorded(tmp_path / "in" / "x.mcap", chunks, each=5)
    whole, split, joined = both_ways(tmp_path / "in", "rs30x", CHUNKS, monkeypatch)
    assert split == whole
    assert joined > 5


def test_captures_are_shared_where_the_others_would_wait_for_who_has_them() -> None:
    def of(workers: int, *megabytes: int) -> int:
        return shared(
            [(CaptureTask("x.bin", n << 20, 0, "", "", "", "", ""),) for n in megabytes], workers
        )

    assert of(2, 1000) == 1
    assert of(2, 1000, *[10] * 20) == 1
    assert of(2, 1000, 1000, 1000) == 1  # two beside each other, one together
    assert of(8, 1000, 1000, 1000) == 3
    assert of(2, 1000, 1000) == of(2, *[1000] * 10) == of(4, *[1000] * 40) == 0
    assert of(2, 1000, *[10] * 200) == 0  # the other one has enough to do
    assert of(2, 80) == of(8, 40) == 1
    assert of(2, 60) == of(8, 34) == of(1, 1000) == of(2) == 0  # it would not gain anything
    there = CaptureTask("s3://logs/x.bin", 1 << 30, 0, "", "", "", "", "")
    assert shared([(there,)], 2) == 0
    assert shared([(there, there)], 2) == 0


@pytest.fixture
def peril(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Iterator[Peril]:
    """Return a protocol whose captures may hold up or end processes; nobody is left waiting."""
    visible(monkeypatch)  # what is loaded of it here is forgotten afterwards
    monkeypatch.setattr(rows, "HUGE", SMALL)
    made = Peril(tmp_path / "peril")
    yield made
    made.open()


def huge(folder: Path, mark: bytes) -> Path:
    """Write a huge capture with a mark in its last part, and a small one."""
    folder.mkdir()
    (folder / "huge.bin").write_bytes(talk(200, 1) + mark + talk(8, 2))
    (folder / "text.log").write_text(log(talk(2, 3)), encoding="ascii")
    return folder


def named(peril: Peril) -> dict[str, Any]:
    return {"options": Options(protocol=str(peril.protocol))}


linux = pytest.mark.skipif(sys.platform != "linux", reason="reads the process table of Linux")


@linux
def test_of_the_processes_that_decode_one_capture_any_may_be_killed(
    peril: Peril, tmp_path: Path
) -> None:
    inputs = huge(tmp_path / "in", HELD_UP)
    before, there = descendants(os.getpid()), set[int]()

    def kill() -> None:
        decoding = peril.held_up()
        there.update(descendants(os.getpid()) - before)
        end(decoding)
        peril.held_up()
        peril.open()

    killer = threading.Thread(target=kill)
    killer.start()
    done = sniffer.decode_fleet([inputs], tmp_path / "data", workers=2, **named(peril))
    killer.join()
    assert len(there) >= 4  # who sees to it, those that decode, and who begins them
    assert (done.statuses, done.reasons, done.troubles) == ({"ok": 2}, (), ())
    assert serial(inputs, tmp_path / "serial", **named(peril)).is_whole
    assert content(tmp_path / "data") == content(tmp_path / "serial")


@linux
def test_a_huge_capture_that_always_ends_its_process_has_a_row_as_any_other(
    peril: Peril, tmp_path: Path
) -> None:
    inputs = huge(tmp_path / "in", DEADLY)
    done = sniffer.decode_fleet([inputs], tmp_path / "data", workers=2, **named(peril))
    assert (done.statuses, done.reasons) == ({"ok": 1, "crashed": 1}, ())
    assert done.troubles == (f"crashed: {inputs / 'huge.bin'}: its process died 3 times",)
    assert not (tmp_path / "data" / "_staging").exists()


RUN: Final = """
import sys
from sniffer.__main__ import main
from sniffer.fleet import rows
from sniffer.sources.stretches import Sizes
rows.HUGE = Sizes(head=300, least=400, most=400, warm=200, block=1, first=0)
main()
"""


@linux
def test_who_decodes_a_huge_capture_ends_with_a_run_that_is_killed_or_interrupted(
    peril: Peril, tmp_path: Path
) -> None:
    inputs, data = huge(tmp_path / "in", HELD_UP), tmp_path / "data"
    (tmp_path / "run.py").write_text(RUN, encoding="ascii")
    program = [sys.executable, str(tmp_path / "run.py"), "fleet", str(inputs), "-o", str(data)]
    for how, status in ((signal.SIGKILL, -9), (signal.SIGINT, 130)):
        run = subprocess.Popen(
            [*program, "--workers", "2", "--protocol", str(peril.protocol)],
            env=environment(),
            stdout=subprocess.PIPE,
            stderr=subprocess.PIPE,
            start_new_session=True,
        )
        own = peril.held_up()
        family = descendants(run.pid)
        assert own in family
        os.kill(run.pid, how)
        run.communicate()
        assert run.returncode == status
        eventually(lambda them=family: None if any(map(is_running, them)) else 0)  # type: ignore[misc]
    peril.open()
    last = sniffer.decode_fleet([inputs], data, workers=2, **named(peril))
    assert (last.decoded, last.is_whole) == (2, True)
    assert not (data / "_staging").exists()
    assert serial(inputs, tmp_path / "serial", **named(peril)).is_whole
    assert content(data) == content(tmp_path / "serial")
