"""Silence that somebody declared live is silence when the recording is decoded again."""

from __future__ import annotations

import itertools
from typing import TYPE_CHECKING

import pytest
from hypothesis import given
from hypothesis import strategies as st

from sniffer.decoding.pipeline import Options, Pipeline
from sniffer.ground.model import Chunk, Clock, MarkKind
from sniffer.ground.timing import byte_time_ns
from sniffer.protocols import PROTOCOLS
from tests.lists import in_turn
from tests.records import gaps, records
from tests.streams import chunked, stream

if TYPE_CHECKING:
    from collections.abc import Sequence

    from sniffer.ground.model import Batch
    from sniffer.protocols.base import BusProtocol

EVERY = pytest.mark.parametrize("name", PROTOCOLS)
START_NS = 1_700_000_000_000_000_000
MS = 1_000_000
REQUEST = bytes.fromhex("ffffff0104f28c027a")
REPLY = bytes.fromhex("ffffff010400ff07f4")


class Kept:
    """A sink that is a recording: what it is handed, and what was decoded meanwhile."""

    def __init__(self) -> None:
        self.chunks: list[Chunk] = []
        self.batches: list[Batch] = []

    def raw(self, bus: str, chunks: Sequence[Chunk]) -> None:
        self.chunks += chunks

    def write(self, bus: str, protocol: BusProtocol, batch: Batch) -> None:
        self.batches.append(batch)

    def close(self) -> None:
        """Do nothing."""


def live(name: str, steps: Sequence[Chunk | int], baud: int | None = None) -> Kept:
    """Feed chunks, tell times (int), as a recorder does."""
    kept = Kept()
    pipeline = Pipeline(Options(name, baud=baud), [kept], live=True)
    for step in steps:
        if isinstance(step, int):
            pipeline.idle(step)
        else:
            pipeline.feed([step])
    pipeline.close()
    return kept


def again(name: str, recorded: Sequence[Chunk], baud: int | None = None) -> Kept:
    kept = Kept()
    pipeline = Pipeline(Options(name, baud=baud), [kept])
    if recorded:
        pipeline.feed(recorded)
    pipeline.close()
    return kept


def told(batches: Sequence[Batch]) -> list[tuple[str, str]]:
    return [(a.code, a.detail) for b in batches for a in b.anomalies]


@in_turn(2)
@EVERY
@given(data=st.data())
def test_a_silence_declared_at_any_time_is_one_when_the_recording_is_decoded_again(
    name: str, data: st.DataObject
) -> None:
    """Also where bytes come later that were held so long that they fill the pause."""
    s = data.draw(stream(name))
    byte_ns, tail_ns = byte_time_ns(PROTOCOLS[name].baud), PROTOCOLS[name].tail_ns
    chunks = data.draw(chunked(s, byte_ns, tail_ns))
    steps: list[Chunk | int] = []
    for before, chunk in itertools.pairwise([None, *chunks]):
        assert chunk is not None
        if before is not None and data.draw(st.booleans()):
            assert before.t_ns is not None
            assert chunk.t_ns is not None
            steps.append(data.draw(st.integers(before.t_ns, chunk.t_ns)))
        steps.append(chunk)
    baud = data.draw(st.sampled_from([None, PROTOCOLS[name].baud]))
    one = live(name, steps, baud)
    two = again(name, one.chunks, baud)
    assert b"".join(c.data for c in one.chunks) == s
    assert records(one.batches) == records(two.batches)
    assert gaps(one.batches) == gaps(two.batches)
    assert told(one.batches) == told(two.batches)


def test_a_burst_that_fills_the_pause_after_half_a_frame_is_read_alike_live_and_again() -> None:
    stalled = REQUEST + (REPLY + REQUEST) * 125  # 390 ms of line time
    first, rest = stalled[:5], stalled[5:]
    end_ns = START_NS + 400 * MS
    steps: list[Chunk | int] = [
        Chunk(first, START_NS, Clock.READ),
        START_NS + 390 * MS,
        Chunk(rest, end_ns, Clock.READ),
    ]
    one = live("mightyzap", steps)
    two = again("mightyzap", one.chunks)
    assert [m.kind for c in one.chunks for m in c.marks] == [MarkKind.SILENT]
    assert records(one.batches) == records(two.batches)
    assert gaps(one.batches) == gaps(two.batches)
    assert len(records(two.batches).frames) == 250
    # without what was recorded of the silence, the cut frame would be whole
    bare = [c for c in one.chunks if c.data]
    assert len(records(again("mightyzap", bare).batches).frames) == 251


def test_nothing_is_recorded_of_a_silence_that_ends_nothing() -> None:
    chunk = Chunk(REQUEST + REPLY, START_NS, Clock.READ)
    kept = live("mightyzap", [chunk, START_NS + 50 * MS, START_NS + 900 * MS])
    assert kept.chunks == [chunk]
