"""The ring of the flight recorder: what it keeps, what it takes, and what it gives back."""

from __future__ import annotations

import tracemalloc
from typing import TYPE_CHECKING

import pytest

from sniffer.decoding.pipeline import Options
from sniffer.ground.model import NS, Chunk, Clock, Mark, MarkKind
from sniffer.mcapfile.flight import Around, FlightRecorder
from sniffer.mcapfile.ring import Ring
from tests.lists import each_in_turn

if TYPE_CHECKING:
    from pathlib import Path


@pytest.mark.parametrize(
    ("around", "says"),
    [(Around(60 * NS, most=1 << 12), True), (Around(None, most=1 << 12), False)],
)
def test_a_ring_that_is_full_is_told_where_a_time_was_asked_for(
    around: Around, says: bool, tmp_path: Path
) -> None:
    told: list[str] = []
    now = [0]
    recorder = FlightRecorder(
        tmp_path / "x.mcap", {}, Options(), around, now=lambda: now[0], tell=told.append
    )
    for tick in range(400):
        now[0] = tick * NS // 20
        recorder.raw("bus0", [Chunk(bytes(20), now[0], Clock.READ)])
        recorder.turn({})
    assert bool(told) == says
    assert recorder.ring.size > 1 << 11


def test_the_past_of_a_ring_is_what_was_said_from_the_last_place_where_nothing_was_open() -> None:
    ring = Ring(3600 * NS, 1 << 20)
    for tick in range(100):
        ring.add("bus0", [Chunk(bytes([tick, k]), tick * 10 + k, Clock.READ) for k in range(5)])
        ring.decided({"bus0": 10 * tick + 3})
    ring.add("late", [Chunk(b"ab", 5000, Clock.READ)])
    for t_ns, begin in ((502, 503), (499, 493), (0, 0), (10**9, 993)):
        past = ring.since(t_ns)
        assert past["bus0"].start == begin
        chunks = list(past["bus0"].chunks())
        whole = b"".join(bytes([tick, k]) for tick in range(100) for k in range(5))
        assert b"".join(c.data for c in chunks) == whole[begin:]
        assert past["bus0"].first_ns == chunks[0].t_ns
        assert [c.data for c in past["late"].chunks()] == [b"ab"]


@each_in_turn(3, "marks", [0, 1, 3])
def test_a_ring_of_a_bus_that_says_little_is_bounded_by_what_it_takes_in_memory(
    marks: int, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr("sniffer.mcapfile.ring.MEMORY", 1 << 18)
    ring = Ring(3600 * NS, 1 << 18)
    tracemalloc.start()
    for tick in range(2000):
        said, t_ns = tick.to_bytes(20, "big"), tick * NS // 20
        noisy = tuple(Mark(MarkKind.FRAMING, k, 1) for k in range(marks))
        ring.add("bus0", [Chunk(said, t_ns, Clock.READ, marks=noisy)])
        ring.trim(tick * NS // 20)
    taken, _ = tracemalloc.get_traced_memory()
    tracemalloc.stop()
    assert 1 << 17 < taken < 3 << 17
    assert ring.is_short
