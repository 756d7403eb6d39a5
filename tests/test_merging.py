"""Two taps on one bus: what each adapter hears becomes one stream in causal order."""

from __future__ import annotations

import itertools
from dataclasses import replace
from typing import TYPE_CHECKING, Final

import pytest
from hypothesis import given
from hypothesis import strategies as st

from sniffer.ground.model import Chunk, Clock, Direction, Mark, MarkKind
from sniffer.ground.timing import byte_time_ns
from sniffer.merging.merger import Merger
from sniffer.protocols import PROTOCOLS
from sniffer.simulation import BUSES, LINE_FAULTS, Fault
from tests.lists import each_in_turn, in_turn
from tests.streams import chunked, stream
from tests.taps import MS, RX, START_NS, TX, Bus, decode, heard, pairs, shares, true_pairs

if TYPE_CHECKING:
    from collections.abc import Callable, Iterable, Sequence

EVERY = each_in_turn(4, "name", PROTOCOLS)

LATENCIES: Final = ((1, 1), (4, 4), (16, 16), (1, 16), (16, 1))


@in_turn(5)
@pytest.mark.parametrize("name", PROTOCOLS)
@pytest.mark.parametrize("ms", LATENCIES, ids=str)
def test_on_a_good_line_every_answer_stands_behind_its_request(
    name: str, ms: tuple[int, int], record_property: Callable[[str, object], None]
) -> None:
    merged, sorted_ = shares(heard(name, (ms[0] * MS, ms[1] * MS)))
    record_property("merged", merged)
    record_property("sorted by stamp", sorted_)
    # One servo of two that are written to answers once: stamps of 4 ms do not tell to which write.
    assert merged == 1.0 or (name == "mightyzap" and max(ms) > 1 and merged > 0.99)
    assert sorted_ < merged


LEAST: Final = {"wck": {(1, 1): 0.95, (4, 4): 0.9, (16, 16): 0.75, (1, 16): 0.65, (16, 1): 0.6}}
"""Answers without a header name nobody: if one is missing, slow stamps fit a wrong one as well."""


@in_turn(5)
@pytest.mark.parametrize("name", PROTOCOLS)
@pytest.mark.parametrize("ms", LATENCIES, ids=str)
def test_on_a_bad_line_answers_that_name_their_servo_still_find_their_request(
    name: str, ms: tuple[int, int], record_property: Callable[[str, object], None]
) -> None:
    faults = [Fault(kind, 0.02) for kind in ("drop", "flip", "cut", "late", "noise")]
    merged, sorted_ = shares(heard(name, (ms[0] * MS, ms[1] * MS), faults=faults))
    record_property("merged", merged)
    record_property("sorted by stamp", sorted_)
    assert merged >= LEAST.get(name, {}).get(ms, 0.98)
    assert sorted_ < merged


@EVERY
def test_a_host_that_is_busy_does_no_harm_if_its_delay_counts_as_latency(name: str) -> None:
    merged, _ = shares(heard(name, (MS, MS), jitter_ns=MS))
    assert merged > 0.99


@each_in_turn(3, "name", [name for name in PROTOCOLS if name != "lss"])
def test_a_late_answer_is_still_seen_as_late(name: str) -> None:
    """Not of lss: its window is as long as the simulated controller waits."""
    bus = heard(name, (MS, MS), faults=[Fault("late", 0.2)])
    late = true_pairs(bus.frames, "late")
    assert len(late) > 10
    assert len(late & pairs(name, bus.merged(), bus.latency_ns)) >= 0.95 * len(late)
    told = [a.code for b in decode(name, bus.merged(), bus.latency_ns) for a in b.anomalies]
    # those that are late by less than the stamps can tell are given the benefit of the doubt
    assert told.count("late-response") >= 0.9 * len(late)


def ping(servo_id: int) -> bytes:
    body = bytes([servo_id, 2, 0xF1])
    return b"\xff\xff\xff" + body + bytes([~sum(body) & 255])


def pong(servo_id: int) -> bytes:
    body = bytes([servo_id, 2, 0])
    return b"\xff\xff\xff" + body + bytes([~sum(body) & 255])


def read(data: bytes, ms: float, wire: Direction, *marks: Mark) -> Chunk:
    return Chunk(data, START_NS + int(ms * MS), Clock.READ, "tap", wire, marks)


def merge(*chunks: Chunk, protocol: str | None = "mightyzap", latency_ms: int = 4) -> list[Chunk]:
    merger = Merger(
        "pair",
        latency_ns=latency_ms * MS,
        baud=400_000,
        protocol=PROTOCOLS[protocol] if protocol else None,
    )
    return [*merger.feed(chunks), *merger.close()]


def test_reads_are_cut_so_that_each_answer_follows_its_request_and_its_stamp_goes_along() -> None:
    out = merge(read(ping(1) + ping(2), 10, TX), read(pong(1) + pong(2), 11, RX))
    assert [c.data for c in out] == [ping(1), pong(1), ping(2), pong(2)]
    assert [c.direction for c in out] == [TX, RX, TX, RX]
    assert {c.bus for c in out} == {"pair"}
    assert {c.clock for c in out} == {Clock.READ}
    frame_ns = 7 * byte_time_ns(400_000)
    times = [(c.t_ns or 0) - START_NS for c in out]
    assert times == [10 * MS - frame_ns, 10 * MS, 10 * MS, 11 * MS]
    assert [c.marks for c in out] == [
        (),
        (Mark(MarkKind.REORDERED, 0, 7, MS - frame_ns),),
        (),
        (),
    ]


def test_an_answer_whose_stamp_lies_before_its_request_is_put_behind_it() -> None:
    out = merge(read(pong(1), 9, RX), read(ping(1), 11, TX))
    assert [c.data for c in out] == [ping(1), pong(1)]
    assert [c.t_ns for c in out] == [START_NS + 9 * MS] * 2
    assert out[0].marks == (Mark(MarkKind.REORDERED, 0, 7, 2 * MS),)


def test_nothing_is_moved_beyond_the_latency() -> None:
    early = merge(read(pong(1), 9, RX), read(ping(1), 14, TX))
    assert [c.data for c in early] == [pong(1), ping(1)]
    late = merge(read(ping(1), 10, TX), read(ping(2), 12, TX), read(pong(1), 17, RX))
    assert [c.data for c in late] == [ping(1), ping(2), pong(1)]
    assert not any(c.marks for c in early + late)


def test_an_answer_that_fits_no_request_stays_where_its_stamp_is() -> None:
    out = merge(read(ping(1), 10, TX), read(ping(2), 11, TX), read(pong(3), 12, RX))
    assert [c.data for c in out] == [ping(1), ping(2), pong(3)]


def test_a_damaged_answer_stands_behind_the_request_that_has_no_other() -> None:
    torn = pong(1)[:-1] + b"\x00"
    out = merge(read(ping(1) + ping(2), 10, TX), read(torn + pong(2), 11, RX))
    assert [c.data for c in out] == [ping(1), torn, ping(2), pong(2)]


def test_without_a_protocol_reads_stand_by_their_stamps_the_controller_first() -> None:
    chunks = [read(b"bb", 10, RX), read(b"aa", 10, TX), read(b"cc", 9, RX), read(b"dd", 12, TX)]
    out = merge(*chunks, protocol=None)
    assert [c.data for c in out] == [b"cc", b"aa", b"bb", b"dd"]
    assert not any(c.marks for c in out)


def test_the_protocol_can_be_told_later() -> None:
    merger = Merger("pair", latency_ns=4 * MS, baud=400_000, protocol=None)
    assert merger.feed([read(pong(1), 9, RX), read(ping(1), 11, TX)]) == []
    merger.protocol = PROTOCOLS["mightyzap"]
    assert [c.data for c in merger.close()] == [ping(1), pong(1)]


def test_marks_stay_with_their_bytes() -> None:
    marks = [Mark(MarkKind.FRAMING, -3, 3), Mark(MarkKind.PARITY, 9, 1), Mark(MarkKind.BREAK, 14)]
    lost = read(b"", 30, RX, Mark(MarkKind.LOST, 0))
    out = merge(read(ping(1) + ping(2), 10, TX, *marks), read(pong(1) + pong(2), 10.2, RX), lost)
    told = [tuple(m for m in c.marks if m.kind != MarkKind.REORDERED) for c in out]
    assert told == [
        (marks[0],),
        (),
        (Mark(MarkKind.PARITY, 2, 1), Mark(MarkKind.BREAK, 7)),
        (),
        (Mark(MarkKind.LOST, 0),),
    ]


def test_time_that_passes_settles_what_is_held() -> None:
    merger = Merger("pair", latency_ns=4 * MS, baud=400_000, protocol=PROTOCOLS["mightyzap"])
    assert merger.feed([read(ping(1), 10, TX)]) == []
    assert merger.pending == 7
    assert merger.idle(START_NS + 10 * MS + 4 * MS) == []
    assert [c.data for c in merger.idle(START_NS + 10 * MS + merger.hold_ns + 1)] == [ping(1)]
    assert merger.pending == 0
    assert merger.close() == []


@st.composite
def two_taps(draw: st.DrawFn, name: str) -> Bus:
    """Draw what two adapters hear: a bus with faults, or two streams of anything."""
    latency_ns = draw(st.sampled_from([0, MS, 4 * MS, 16 * MS]))
    if latency_ns and draw(st.booleans()):
        faults = [Fault(kind, draw(st.sampled_from([0, 0.1, 0.4]))) for kind in LINE_FAULTS]
        other_ns = draw(st.sampled_from([MS, latency_ns]))
        seed = draw(st.integers(0, 1000))
        seconds = draw(st.sampled_from([0.02, 0.08]))
        bus = heard(name, (latency_ns, other_ns), seed=seed, seconds=seconds, faults=faults)
    else:
        byte_ns, tail_ns = byte_time_ns(BUSES[name].baud), PROTOCOLS[name].tail_ns
        wires = [
            [replace(c, direction=wire) for c in draw(chunked(s, byte_ns, tail_ns))]
            for wire in (TX, RX)
            for s in [draw(stream(name))]
        ]
        bus = Bus(name, [], wires[0], wires[1], latency_ns)
    wires = [_marked(draw, wire) for wire in (bus.tx, bus.rx)]
    return replace(bus, tx=wires[0], rx=wires[1])


def _marked(draw: st.DrawFn, chunks: Sequence[Chunk]) -> list[Chunk]:
    """Draw marks for one read in sixteen, and for as many a chunk of marks alone behind it."""
    out: list[Chunk] = []
    for chunk in chunks:
        number = draw(st.integers(0, 15))
        start = draw(st.integers(-5, len(chunk.data))) if number < 2 else 0
        marks = (Mark(MarkKind.FRAMING, start, 1, 7),) if number < 2 else ()
        if number == 1:
            out += [chunk, replace(chunk, data=b"", marks=marks)]
        else:
            out.append(replace(chunk, marks=marks))
    return out


@EVERY
@given(data=st.data())
def test_every_byte_and_mark_comes_out_once_in_the_order_of_its_wire(
    name: str, data: st.DataObject
) -> None:
    bus = data.draw(two_taps(name))
    out = bus.merged()
    for wire, fed in ((TX, bus.tx), (RX, bus.rx)):
        mine = [c for c in out if c.direction == wire]
        assert b"".join(c.data for c in mine) == b"".join(c.data for c in fed)
        assert _marks(mine) == _marks(fed)


def _marks(chunks: Iterable[Chunk]) -> list[tuple[int, Mark]]:
    """Return the marks of the taps at their places in the stream."""
    out: list[tuple[int, Mark]] = []
    at = 0
    for c in chunks:
        told = [m for m in c.marks if m.kind != MarkKind.REORDERED]
        out += [(at + m.start, m._replace(start=0)) for m in told]
        at += len(c.data)
    return out


@EVERY
@given(data=st.data())
def test_stamps_never_decrease_and_no_piece_is_moved_far(name: str, data: st.DataObject) -> None:
    bus = data.draw(two_taps(name))
    out = bus.merged()
    times = [c.t_ns or 0 for c in out]
    assert times == sorted(times)
    moved = [m.count for c in out for m in c.marks if m.kind == MarkKind.REORDERED]
    assert all(ns > 0 for ns in moved)
    # Streams of anything have both wires speak at once: then the stamps allow no order at all.
    assert not bus.frames or max(moved, default=0) <= bus.latency_ns


@EVERY
@given(data=st.data())
def test_nothing_is_held_longer_than_promised(name: str, data: st.DataObject) -> None:
    bus = data.draw(two_taps(name))
    merger = bus.merger()
    fed, settled = {TX: 0, RX: 0}, {TX: 0, RX: 0}
    came: dict[Direction, list[tuple[int, int]]] = {TX: [], RX: []}
    for c in bus.reads:
        now_ns = c.t_ns or 0
        for piece in [*merger.feed([c]), *merger.idle(now_ns)]:
            settled[piece.direction] += len(piece.data)
        fed[c.direction] += len(c.data)
        came[c.direction].append((now_ns, fed[c.direction]))
        for wire, reads in came.items():
            due = [end for t_ns, end in reads if t_ns + merger.hold_ns < now_ns]
            assert settled[wire] >= max(due, default=0)
    assert merger.pending == sum(fed.values()) - sum(settled.values())


@EVERY
@given(data=st.data())
def test_the_grouping_of_reads_into_calls_changes_nothing(name: str, data: st.DataObject) -> None:
    bus = data.draw(two_taps(name))
    merger, reads = bus.merger(), bus.reads
    cuts = sorted(data.draw(st.lists(st.integers(0, len(reads)), max_size=6)))
    out: list[Chunk] = []
    for a, b in itertools.pairwise([0, *cuts, len(reads)]):
        group = sorted(reads[a:b], key=lambda c: c.direction)  # each tap's reads in a row
        out += merger.feed(group)
        if group and len(out) % 2:
            out += merger.idle(max(c.t_ns or 0 for c in group))
    out += merger.close()
    assert out == bus.merged()
