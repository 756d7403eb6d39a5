"""Log lines of two taps, one on each wire: mixed ones are merged, those in order stay."""

from __future__ import annotations

from dataclasses import replace
from typing import TYPE_CHECKING, Final

import pytest

from sniffer.decoding.pipeline import Options
from sniffer.ground.codes import NO_RESPONSE, OK
from sniffer.ground.model import NS, Chunk, Clock, DamagedInputError, Direction, Mark, MarkKind
from sniffer.merging.wires import in_order
from sniffer.protocols import PROTOCOLS
from sniffer.simulation import BUSES, Fault, TrueFrame, simulate
from tests.commands import Ran, records, within
from tests.lists import each_in_turn
from tests.taps import (
    MS,
    RX,
    START_NS,
    TX,
    Bus,
    by_stamp,
    decode,
    heard,
    pairs,
    shares,
    tap,
    true_pairs,
)

if TYPE_CHECKING:
    from collections.abc import Callable, Iterator, Sequence
    from pathlib import Path

Capsys = pytest.CaptureFixture[str]

EVERY: Final = each_in_turn(4, "name", PROTOCOLS)
HOST_NS: Final = 16 * MS


def line(chunk: Chunk, bus: str = "bus0") -> str:
    """Return a chunk as a line of a log, with microseconds."""
    seconds, us = divmod(-(-(chunk.t_ns or 0) // 1000), 1_000_000)
    return f"({seconds}.{us:06d}) {bus} {chunk.direction.name}#{chunk.data.hex().upper()}\n"


def mixed(name: str, **more: object) -> Bus:
    """Return a simulated bus as a host with a latency of 16 ms hears its two wires."""
    return heard(name, (HOST_NS, HOST_NS), **more)  # type: ignore[arg-type]


def labelled(name: str, rate: float = 0.0, seconds: float = 3) -> list[Chunk]:
    """Return what one tap that hears both ways writes: a line a frame, in order, with its wire."""
    faults = [Fault(kind, rate) for kind in ("drop", "flip", "cut", "late", "noise") if rate]
    frames = simulate(name, seed=5, duration_s=seconds, faults=faults, start_ns=START_NS)
    return [
        Chunk(f.wire, f.t_end_ns, Clock.FILE, "bus0", RX if f.kind == "response" else TX)
        for f in frames
        if f.wire
    ]


def ordered(chunks: Sequence[Chunk], size: int = 1 << 20, **options: str | int) -> list[Chunk]:
    groups = [chunks[k : k + size] for k in range(0, len(chunks), size)]
    told: list[str] = []
    return [c for group in in_order(groups, Options(**options), told.append) for c in group]  # type: ignore[arg-type]


def as_logged(bus: Bus) -> list[Chunk]:
    return [replace(c, clock=Clock.FILE, bus="bus0") for c in bus.reads]


@EVERY
def test_lines_that_a_host_mixed_lose_no_frame_and_no_exchange(
    name: str, record_property: Callable[[str, object], None]
) -> None:
    bus = mixed(name)
    whole = sum(1 for frame in bus.frames if frame.wire)
    before = sum(len(b.frames) for b in decode(name, as_logged(bus), HOST_NS))
    chunks = ordered(as_logged(bus))
    after = sum(len(b.frames) for b in decode(name, chunks, HOST_NS))
    record_property("frames lost as they stand", 1 - before / whole)
    assert before < whole == after
    true = true_pairs(bus.frames)
    # One servo of two that are written to answers once: stamps do not tell to which write.
    assert len(pairs(name, chunks, HOST_NS) & true) >= 0.99 * len(true)


@pytest.mark.parametrize("first", [RX, TX], ids=["answers_first", "requests_first"])
def test_lines_that_cut_requests_only_are_merged_though_no_exchange_fails(first: Direction) -> None:
    """A host of 1 ms: the first byte of a prompt answer stands before the last one of its request.

    The request is no frame then and nothing was asked: no exchange goes wrong, all of it is gaps.
    """
    ask, answer = bytes.fromhex("FFFFFF0104F28C027A"), bytes.fromhex("FFFFFF0104001002E8")
    chunks = []
    for k in range(100):
        t_ns = START_NS + 10 * k * MS
        both = [(ask[8:], TX), (answer[:1], RX)]
        lines = [(ask[:8], TX, 0), *((*x, 1) for x in sorted(both, key=lambda x: x[1] != first))]
        for data, wire, tick in [*lines, (answer[1:], RX, 2)]:
            chunks.append(Chunk(data, t_ns + tick * MS, Clock.FILE, "bus0", wire))
    decoded = decode("mightyzap", ordered(chunks, protocol="mightyzap"), MS)
    outcomes = [o for b in decoded for o in b.transactions.outcome.tolist()]
    assert outcomes == [OK] * 100


def text_of_two_wires(asked: Sequence[int], present: int, end: bytes) -> list[Chunk]:
    """Return one position query of LSS after the other, each 20 ms, through two 16 ms adapters."""
    frames: list[TrueFrame] = []
    byte_ns = 10 * NS // 115_200
    for k, who in enumerate(asked):
        at = START_NS + 20 * MS * k + k * k % 13 * MS // 2
        for kind, data in (
            ("request", b"#%dQD" % who + end),
            ("response", b"*%dQD900\r" % who if who <= present else b""),
        ):
            until = at + len(data) * byte_ns
            frames.append(TrueFrame(at, until, data, data, kind, who, "query"))
            at = until + MS // 2
    taps = (tap(frames, wire, 115_200, HOST_NS, phase) for wire, phase in ((TX, 0), (RX, 7 * MS)))
    return [replace(c, clock=Clock.FILE, bus="bus0") for c in by_stamp(*taps)]


@pytest.mark.parametrize(
    ("asked", "present", "end"),
    [([5] * 100, 5, b"\r\n"), ([*range(1, 251), *[1, 2, 3] * 20], 3, b"\r")],
    ids=["line_feeds_behind_requests", "scan_of_all_ids"],
)
def test_lines_are_told_to_be_mixed_whatever_goes_wrong_that_merging_does_not_mend(
    asked: Sequence[int], present: int, end: bytes
) -> None:
    chunks = ordered(text_of_two_wires(asked, present, end), protocol="lss", baud=115_200)
    assert all(any(m.kind == MarkKind.MERGED for m in c.marks) for c in chunks)
    outcomes = [o for b in decode("lss", chunks, HOST_NS) for o in b.transactions.outcome.tolist()]
    assert outcomes == [OK if who <= present else NO_RESPONSE for who in asked]


@EVERY
def test_their_times_are_uncertain_by_the_whole_latency(name: str) -> None:
    for batch in decode(name, ordered(as_logged(mixed(name, seconds=1))), MS):
        assert (batch.frames.uncertainty == HOST_NS).all()


@EVERY
@pytest.mark.parametrize("rate", [0.0, 0.05])
def test_lines_in_order_stay_as_they_are(name: str, rate: float) -> None:
    chunks = labelled(name, rate)
    assert ordered(chunks) == chunks
    assert ordered(chunks, protocol=name) == chunks


@EVERY
def test_what_is_merged_does_not_depend_on_how_lines_are_grouped(name: str) -> None:
    chunks = as_logged(mixed(name, seconds=1))
    whole = ordered(chunks)
    assert ordered(chunks, 1) == ordered(chunks, 7) == whole
    assert any(m.kind == MarkKind.MERGED for c in whole for m in c.marks)


def test_lines_that_are_mixed_only_later_are_merged_from_there_on() -> None:
    good = labelled("mightyzap", seconds=4)
    later = [replace(c, t_ns=(c.t_ns or 0) + 10_000 * MS) for c in as_logged(mixed("mightyzap"))]
    out = ordered([*good, *later])
    assert out[: len(good)] == good
    assert out[-1].marks


def test_lines_without_a_time_or_a_wire_are_left_alone() -> None:
    bus = as_logged(mixed("mightyzap", seconds=1))
    for chunks in (
        [replace(c, t_ns=None, clock=Clock.NONE) for c in bus],
        [replace(c, direction=Direction.UNKNOWN) for c in bus],
    ):
        assert ordered(chunks) == chunks


def test_what_was_read_before_damage_comes_before_it() -> None:
    chunks = as_logged(mixed("mightyzap", seconds=1))

    def broken() -> Iterator[list[Chunk]]:
        yield chunks
        raise DamagedInputError("line 9")

    out: list[Chunk] = []
    groups = in_order(broken(), Options(), lambda message: None)
    with pytest.raises(DamagedInputError):
        out.extend(chunk for group in groups for chunk in group)
    assert out == ordered(chunks)


def decoded(capsys: Capsys, path: Path, *more: str | Path) -> Ran:
    return within(capsys, "decode", path, "--format", "jsonl", *more)


@EVERY
def test_a_recording_made_of_mixed_lines_decodes_to_the_same(
    name: str, tmp_path: Path, capsys: Capsys
) -> None:
    log, recording = tmp_path / "mixed.log", tmp_path / "mixed.mcap"
    log.write_text("".join(map(line, as_logged(mixed(name, seconds=1)))))
    ran = decoded(capsys, log, "-o", recording)
    assert "its TX and RX lines are of two taps, mixed by their host" in ran.err
    assert not records(ran.out)[-1]["gaps"]
    again = decoded(capsys, recording)
    assert "mixed" not in again.err
    assert again.out == ran.out


def test_two_buses_in_one_log_are_told_apart(tmp_path: Path, capsys: Capsys) -> None:
    lines = [(c.t_ns or 0, line(c, "leg")) for c in mixed("rs30x", seconds=1).reads]
    lines += [(c.t_ns or 0, line(c, "arm")) for c in labelled("mightyzap", seconds=1)]
    log = tmp_path / "two.log"
    log.write_text("".join(text for _, text in sorted(lines)))
    ran = decoded(capsys, log)
    assert [text.split(": ")[1] for text in ran.err.splitlines() if "mixed" in text] == ["leg"]
    buses = records(ran.out)[-1]["buses"]
    assert all(not bus["gaps"] and bus["outcomes"]["ok"] > 50 for bus in buses.values())


# --- a tap that itself came late ---------------------------------------------------------------


def stalled(chunks: Sequence[Chunk], ms: int) -> list[Chunk]:
    """Return what is read where the program stands still for so long, three times a second."""
    out: list[Chunk] = []
    for chunk in chunks:
        begun = (chunk.t_ns or 0) - ((chunk.t_ns or 0) - START_NS) % (300 * MS)
        until = begun + ms * MS
        if begun == START_NS or (chunk.t_ns or 0) > until:
            out.append(chunk)
            continue
        held = out.pop().data if out and out[-1].t_ns == until else b""
        mark = Mark(MarkKind.HELD, 0, len(held + chunk.data), ms * MS)
        out.append(replace(chunk, data=held + chunk.data, t_ns=until, marks=(mark,)))
    return out


@EVERY
def test_what_both_taps_held_while_the_host_stood_still_is_put_in_order(
    name: str, record_property: Callable[[str, object], None]
) -> None:
    bus = heard(name, (MS, MS))
    late = replace(bus, tx=stalled(bus.tx, 40), rx=stalled(bus.rx, 40))
    merged, sorted_ = shares(late)
    record_property("merged", merged)
    assert merged > 0.99 > sorted_
    unmarked = replace(
        late, tx=[replace(c, marks=()) for c in late.tx], rx=[replace(c, marks=()) for c in late.rx]
    )
    assert shares(unmarked)[0] < 0.97


# --- two servos of one id ----------------------------------------------------------------------


@EVERY
@pytest.mark.parametrize("rate", [1.0, 0.4])
def test_two_servos_of_one_id_are_called_so_whatever_their_answers_look_like(
    name: str, rate: float
) -> None:
    faults = [Fault("duplicate", rate, 1)]
    frames = simulate(name, seed=3, duration_s=3, faults=faults, start_ns=START_NS)
    chunks = [Chunk(f.wire, f.t_end_ns, Clock.FILE) for f in frames if f.wire]
    parts = decode(name, chunks, MS)
    told = [a for b in parts for a in b.anomalies]
    twice = [a.servo_id for a in told if a.code == "duplicate-response"]
    assert len(twice) > 20
    assert set(twice) == {1}
    assert sum(a.code == "noise" for a in told) <= 3  # the first ones look like it
    assert b"".join(b.data for b in parts) == b"".join(c.data for c in chunks)
    assert sum(int((b.transactions.outcome == OK).sum()) for b in parts) > 50


@EVERY
def test_noise_on_a_bad_line_is_no_second_servo(name: str) -> None:
    faults = [Fault("noise", 0.1), Fault("flip", 0.02), Fault("cut", 0.02)]
    frames = simulate(name, seed=4, duration_s=3, faults=faults, start_ns=START_NS)
    chunks = [Chunk(f.wire, f.t_end_ns, Clock.FILE) for f in frames if f.wire]
    told = [a.code for b in decode(name, chunks, MS) for a in b.anomalies]
    assert "noise" in told
    assert "duplicate-response" not in told


def test_every_simulated_bus_is_tried() -> None:
    assert set(BUSES) == set(PROTOCOLS)
