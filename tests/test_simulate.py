"""``sniffer simulate``: what is on its port, and what its truth says of it."""

from __future__ import annotations

import contextlib
import select
import signal
import time
from typing import TYPE_CHECKING

import pytest

from sniffer.simulation import BUSES, TrueFrame
from sniffer.simulation import simulate as frames_of
from sniffer.simulation.play.outlet import HOLD_MOST, FrameWriter
from sniffer.simulation.play.ports import Pty
from tests.commands import within
from tests.lists import each_in_turn, in_turn
from tests.simulations import DEADLINE_S, ear, framed, heard, running, told

if TYPE_CHECKING:
    from pathlib import Path

EVERY_BUS = pytest.mark.parametrize("name", BUSES)


@in_turn(4)
@EVERY_BUS
def test_a_reader_gets_exactly_the_bytes_of_the_truth(name: str, tmp_path: Path) -> None:
    truth = tmp_path / "truth.jsonl"
    faults = [
        f"--fault={kind}:2%" for kind in ("drop-reply", "flip", "cut", "noise", "duplicate-id")
    ]
    with running(name, *faults, "--duration", "1s", "--truth", truth) as it, ear(it.ports[0]) as me:
        data = me.listen()
        err = it.end()
    rows = told(truth)
    assert it.process.returncode == 0
    assert len(data) > 40
    assert heard(framed(truth)) == data
    assert rows[0]["type"] == "simulation"
    assert (rows[0]["protocol"], rows[0]["baud"]) == (name, BUSES[name].baud)
    assert rows[0]["servos"] == list(BUSES[name].servo_ids)
    assert {f["kind"] for f in rows[0]["faults"]} == {"drop", "flip", "cut", "noise", "duplicate"}
    end = rows[-1]
    assert (end["type"], end["bytes"], end["frames"]) == ("end", len(data), len(rows) - 2)
    said = sum(len(row["wire"]) // 2 for row in framed(truth))
    assert end["dropped_bytes"] == said - len(data)
    assert f"{len(data)} bytes written" in err


@in_turn(4)
@EVERY_BUS
def test_the_truth_is_that_of_the_generator_and_the_same_for_the_same_seed(
    name: str, tmp_path: Path
) -> None:
    truths = [tmp_path / f"{nth}.jsonl" for nth in range(2)]
    runs = [("--seed", "7"), ("--seed", "8")]
    for truth, seed in zip(truths, runs, strict=True):
        with running(name, *seed, "--duration", "400ms", "--truth", truth) as it:
            it.end()
    rows = framed(truths[0])
    meant = list(frames_of(name, seed=7, duration_s=0.4))
    assert [(r["hex"], r["wire"], r["kind"], r["op"]) for r in rows] == [
        (f.data.hex(), f.wire.hex(), f.kind, f.op) for f in meant
    ]
    later = [
        (r["t_end_ns"] - rows[0]["t_end_ns"]) - (f.t_end_ns - meant[0].t_end_ns)
        for r, f in zip(rows, meant, strict=True)
    ]
    assert later == sorted(later), "a bus that is held up goes on later, by what the truth says"
    assert 0 <= later[-1] <= round(told(truths[0])[-1]["behind_ms"] * 1e6) + 1000
    assert [tuple(v.values()) for r in rows for v in r["values"]] == [
        v for f in meant for v in f.values
    ]
    assert [r["wire"] for r in rows] != [r["wire"] for r in framed(truths[1])]


def test_frames_come_in_real_time_and_never_before_their_last_byte(tmp_path: Path) -> None:
    truth = tmp_path / "truth.jsonl"
    began = time.monotonic()
    with running("rs30x", "--duration", "2s", "--truth", truth) as it, ear(it.ports[0]) as me:
        me.listen()
        it.end()
        took = time.monotonic() - began
    rows = [row for row in framed(truth) if row["offset"] is not None]
    assert took >= 1.9
    times = [row["t_end_ns"] for row in rows]
    assert times == sorted(times)
    ends = [row["offset"] + len(row["wire"]) // 2 for row in rows]
    nth, late = 0, []
    for t_ns, size in me.reads:
        while nth < len(ends) and ends[nth] <= size:
            late.append(t_ns - times[nth])
            nth += 1
    assert len(late) == len(rows) > 100
    assert min(late) > -2_000_000  # not before its time, as far as two clocks agree


@in_turn(4)
@EVERY_BUS
def test_a_full_line_is_loaded_for_more_than_nine_tenths(name: str) -> None:
    for baud in (BUSES[name].baud, 921600):
        size = sum(len(f.wire) for f in frames_of(name, baud=baud, full=True, duration_s=0.5))
        assert size * 10 / baud > 0.9 * 0.5


def test_a_full_line_at_921600_is_played_in_real_time(tmp_path: Path) -> None:
    truth = tmp_path / "truth.jsonl"
    fast = ("--baud", "921600", "--rate", "max", "--duration", "1s")
    with running("wck", *fast, "--truth", truth) as it, ear(it.ports[0]) as me:
        data = me.listen()
        it.end()
    rows = framed(truth)
    assert told(truth)[0]["full"]
    assert heard(rows) == data
    assert sum(len(row["wire"]) // 2 for row in rows) > 0.9 * 92160


def test_what_nobody_reads_is_dropped_and_time_goes_on(tmp_path: Path) -> None:
    truth = tmp_path / "truth.jsonl"
    with running("lss", "--full", "--duration", "1s", "--truth", truth) as it:
        err = it.end()
    rows = framed(truth)
    said = sum(len(row["wire"]) // 2 for row in rows)
    assert {row["offset"] for row in rows} == {None}
    assert told(truth)[-1]["dropped_bytes"] == said > 9000
    assert f"0 bytes written, {said} that nobody read" in err


def test_who_comes_late_hears_no_stale_bytes_and_who_comes_again_neither(tmp_path: Path) -> None:
    truth = tmp_path / "truth.jsonl"
    with running("rs30x", "--full", "--truth", truth) as it:
        came = said_so_far(truth, more_than=50)
        with ear(it.ports[0]) as me:
            first = me.listen(until=500)
        back = said_so_far(truth, more_than=came + 500)
        with ear(it.ports[0]) as me:
            second = me.listen(until=500)
        it.end(signal.SIGTERM)
    rows = framed(truth)
    data = heard(rows)
    played = [row for row in rows if row["offset"] is not None]
    assert rows[0]["offset"] is None
    assert data.startswith(first)
    assert rows.index(played[0]) >= came
    place = data.find(second)
    assert place >= len(first)
    start = next(row for row in played if row["offset"] + len(row["wire"]) // 2 > place)
    assert rows.index(start) >= back


def said_so_far(truth: Path, more_than: int) -> int:
    """Wait until more frames than these are said and noted; return how many."""
    deadline = time.monotonic() + DEADLINE_S
    while True:
        count = truth.read_bytes().count(b'"type":"frame"') if truth.exists() else 0
        if count > more_than:
            return count
        assert time.monotonic() < deadline
        time.sleep(0.02)


def test_a_reader_that_is_slow_loses_nothing(tmp_path: Path) -> None:
    truth = tmp_path / "truth.jsonl"
    fast = ("--baud", "921600", "--full", "--duration", "1500ms")
    with running("rs30x", *fast, "--truth", truth) as it, ear(it.ports[0]) as me:
        me.listen(until=5000)
        time.sleep(0.7)  # the system keeps 20 KB, the line says 65 KB meanwhile
        data = me.listen()
        it.end()
    rows = framed(truth)
    assert heard(rows) == data
    played = [row["offset"] is not None for row in rows]
    assert all(played[played.index(True) :])  # only what was said before the port was opened
    assert len(data) + told(truth)[-1]["dropped_bytes"] > 0.9 * 1.5 * 92160


def test_a_reader_that_is_stopped_for_good_costs_frames_and_never_halves() -> None:
    notes: list[tuple[TrueFrame, int | None]] = []
    port = Pty()
    outlet = FrameWriter(port, lambda frame, offset: notes.append((frame, offset)))
    frames = [
        TrueFrame(0, 0, bytes([k % 251]) * 1000, bytes([k % 251]) * 1000, "request", 1, "echo")
        for k in range(HOLD_MOST // 1000 + 100)
    ]
    with contextlib.closing(port), ear(port.name) as me:
        for frame in frames:
            outlet.say([frame])
        assert outlet.waits
        assert outlet.overrun > 0
        data = bytearray()
        while outlet.waits:
            outlet.flush()
            data = bytearray(me.listen(seconds=0.005))
        outlet.say(frames[:1])
        data = bytearray(me.listen(seconds=0.005))
        outlet.finish()
    kept = [frame for frame, offset in notes if offset is not None]
    assert len(notes) == len(frames) + 1
    assert b"".join(frame.wire for frame in kept) == data
    assert outlet.size == len(data)
    assert outlet.size + outlet.overrun == 1000 * len(notes)
    assert outlet.lost == 0


@each_in_turn(2, "number", [signal.SIGINT, signal.SIGTERM])
def test_a_signal_ends_it_cleanly(number: int, tmp_path: Path) -> None:
    truth, link = tmp_path / "truth.jsonl", tmp_path / "bus"
    with running("mightyzap", "--truth", truth, "--link", link) as it, ear(it.ports[0]) as me:
        me.listen(until=50)
        it.end(number)
    assert it.process.returncode == 0
    assert told(truth)[-1]["type"] == "end"
    assert not link.is_symlink()


def test_a_process_that_is_killed_leaves_a_truth_that_can_be_read(tmp_path: Path) -> None:
    truth, link = tmp_path / "truth.jsonl", tmp_path / "bus"
    with running("wck", "--truth", truth, "--link", link) as it, ear(it.ports[0]) as me:
        data = me.listen(until=300)
        it.process.kill()
        data = me.listen()
        it.process.wait()
    known = heard(framed(truth))
    assert data.startswith(known) or known.startswith(data)
    assert min(len(known), len(data)) > 200
    # its link is left, and leads nowhere, unless somebody else has got a port of that name since
    assert link.is_symlink()
    link.unlink()
    link.symlink_to("/dev/pts/nobody")
    with running("wck", "--link", link, "--duration", "50ms") as it:
        assert link.readlink().as_posix() == it.ports[0]
        it.end()
    assert not link.is_symlink()


def test_a_link_leads_to_the_port_and_never_takes_the_place_of_something(
    tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    link, file = tmp_path / "bus", tmp_path / "file"
    link.symlink_to(tmp_path / "nothing")
    with running("lss", "--link", link) as it:
        assert link.readlink().as_posix() == it.ports[0]
        again = within(capsys, "simulate", "lss", "--link", link)
        assert (again.status, again.out) == (2, "")
        assert "remove it or name another" in again.complaint
        assert link.readlink().as_posix() == it.ports[0]
        it.end(signal.SIGINT)
    assert not link.is_symlink()
    file.write_text("mine")
    refused = within(capsys, "simulate", "lss", "--link", file)
    assert refused.status == 2
    assert "is there already" in refused.complaint
    assert file.read_text() == "mine"
    nowhere = within(capsys, "simulate", "lss", "--link", tmp_path / "no" / "bus")
    assert "there is no folder" in nowhere.complaint
    assert sorted(p.name for p in tmp_path.iterdir()) == ["file"]


def test_it_plays_on_a_port_that_is_there(tmp_path: Path) -> None:
    truth = tmp_path / "truth.jsonl"
    port = Pty()  # the other end of a cable
    data = bytearray()
    with (
        contextlib.closing(port),
        running(
            "rs30x",
            "--baud",
            "153600",
            "--port",
            port.name,
            "--duration",
            "500ms",
            "--truth",
            truth,
        ) as it,
    ):
        assert it.ports == [port.name]
        while it.process.poll() is None:
            select.select([port], [], [], 0.05)
            data += port.read()
        it.end()
        data += port.read()
    assert len(data) > 500
    assert heard(framed(truth)) == data
