"""What stamps tell: frames lie where their bytes were, within the uncertainty that is stated."""

from __future__ import annotations

import itertools
from typing import TYPE_CHECKING

import pytest
from hypothesis import given
from hypothesis import strategies as st

from sniffer.decoding.decoder import Decoder
from sniffer.decoding.reference import Reference
from sniffer.ground.limits import DURATION_MOST_NS, TIME_END_NS, TIME_LEAST_NS
from sniffer.ground.model import NS, Chunk, Clock, Mark, MarkKind
from sniffer.ground.timing import byte_time_ns
from sniffer.protocols import PROTOCOLS
from tests.conversations import robot, through_usb
from tests.lists import in_turn, thinned, walks_a_list
from tests.records import batches, records
from tests.streams import stream

if TYPE_CHECKING:
    from collections.abc import Sequence

    from sniffer.ground.model import Batch

EVERY = pytest.mark.parametrize("name", PROTOCOLS)

REQUEST = bytes.fromhex("ffffff0104f28c027a")
REPLY = bytes.fromhex("ffffff010400ff07f4")
START_NS = 1_700_000_000 * NS
MS = 1_000_000

LIMITS = (TIME_LEAST_NS, -1, 0, TIME_END_NS - 1)


@st.composite
def mixed(draw: st.DrawFn, data: bytes, byte_ns: int) -> list[Chunk]:
    """Cut a stream into chunks of any clock, with and without stamps, that may jump anywhere."""
    cuts = draw(st.lists(st.integers(1, max(1, len(data) - 1)), max_size=9, unique=True))
    t, out = draw(st.sampled_from([START_NS, 0, -5 * NS])), []
    wild = draw(st.booleans())
    for a, b in itertools.pairwise([0, *sorted(c for c in cuts if c < len(data)), len(data)]):
        t += (b - a) * byte_ns + draw(st.sampled_from([0, 0, 1, 7 * MS, 3 * NS]))
        if wild and draw(st.integers(0, 4)) == 0:
            t = draw(st.sampled_from([*LIMITS, START_NS]))
        clock = draw(st.sampled_from([Clock.FILE, Clock.READ, Clock.SAMPLE, Clock.NONE]))
        if b > a:
            told = min(t, TIME_END_NS - 1)
            out.append(Chunk(data[a:b], draw(st.sampled_from([told, told, None])), clock))
    return out


def uncertainties(parts: Sequence[Batch]) -> list[tuple[list[int], list[int]]]:
    return [
        (
            [x for b in parts for x in b.frames.uncertainty.tolist()],
            [x for b in parts for x in b.transactions.uncertainty_ns.tolist()],
        )
    ]


@in_turn(2)
@EVERY
@given(data=st.data())
def test_stamps_of_any_kind_in_any_mixture_give_times_that_make_sense(
    name: str, data: st.DataObject
) -> None:
    s = data.draw(stream(name))
    byte_ns = byte_time_ns(PROTOCOLS[name].baud)
    chunks = data.draw(mixed(s, byte_ns))
    one = batches(Decoder(name), [[c] for c in chunks])
    k = data.draw(st.integers(0, len(chunks)))
    many = batches(Decoder(name), [chunks[:k], chunks[k:]])
    assert records(one) == records(many)
    assert uncertainties(one) == uncertainties(many)
    want = Reference(PROTOCOLS[name]).decode(chunks)
    assert records(one).frames == want.frames
    assert records(one).transactions == want.transactions
    for b in one:
        f, t = b.frames, b.transactions
        assert (f.t_start <= f.t_end).all()
        assert (f.uncertainty >= -1).all()
        assert ((t.response_time_ns >= 0) <= (t.uncertainty_ns >= 0)).all()


@walks_a_list
def test_a_clock_that_goes_from_end_to_end_and_misses_stamps_leaves_the_same_doubt() -> None:
    ends = (TIME_LEAST_NS, TIME_END_NS - 1, None)
    for times in thinned([*itertools.product(ends, repeat=5)], 5):
        chunks = [Chunk(REQUEST, t, Clock.READ) for t in times]
        one, many = (
            uncertainties(batches(Decoder("mightyzap", latency_ns=DURATION_MOST_NS), groups))
            for groups in ([chunks], [[c] for c in chunks])
        )
        assert one == many
        assert max(one[0][0]) <= 2 * DURATION_MOST_NS


def test_bytes_without_a_stamp_before_stamped_ones_are_not_dated_beside_them() -> None:
    chunks = [Chunk(REQUEST[:4]), Chunk(REQUEST[4:], START_NS), Chunk(REPLY, START_NS + 3 * MS)]
    for groups in ([chunks], [[c] for c in chunks]):
        frames = [b.frames for b in batches(Decoder("mightyzap"), groups) if len(b.frames)]
        asked = frames[0]
        assert asked.t_end[0] == START_NS
        assert asked.t_end[0] - asked.t_start[0] == len(REQUEST) * byte_time_ns(57600)
        assert sum(len(f) for f in frames) == 2


def test_no_response_time_is_stated_where_a_stamp_is_missing() -> None:
    for chunks in (
        [Chunk(REQUEST), Chunk(REPLY, START_NS)],
        [Chunk(REQUEST, START_NS), Chunk(REPLY)],
    ):
        told = [t for b in batches(Decoder("mightyzap"), [chunks]) for t in [b.transactions]]
        assert [x for t in told for x in t.response_time_ns.tolist()] == [-1]


@pytest.mark.parametrize("drift", [-0.015, -0.005, 0.0, 0.005, 0.015])
@pytest.mark.parametrize("piece", [1, 4, 9])
def test_exact_stamps_of_a_sender_a_little_off_its_rate_hold_the_truth(
    drift: float, piece: int
) -> None:
    byte_ns = byte_time_ns(57600) * (1 + drift)
    frames, chunks, t = [], [], float(START_NS)
    for data in (REQUEST, REPLY) * 4:
        t += 300_000
        frames.append((t, t + len(data) * byte_ns))
        for at in range(0, len(data), piece):
            stamp = t + min(at + piece, len(data)) * byte_ns
            chunks.append(Chunk(data[at : at + piece], round(stamp), Clock.SAMPLE))
        t = frames[-1][1]
    parts = batches(Decoder("mightyzap"), [chunks])
    got = [
        row
        for b in parts
        for row in zip(
            b.frames.t_start.tolist(),
            b.frames.t_end.tolist(),
            b.frames.uncertainty.tolist(),
            strict=True,
        )
    ]
    assert len(got) == len(frames)
    for (start, end), (t_start, t_end, unsure) in zip(frames, got, strict=True):
        assert abs(t_end - end) <= unsure + 1
        assert abs(t_start - start) <= unsure + 1
        assert 0 < unsure <= max(piece, 1) * byte_ns / 40
    for b in parts:
        t_ = b.transactions
        spread = zip(t_.response_time_ns.tolist(), t_.uncertainty_ns.tolist(), strict=True)
        assert all(abs(took - 300_000) <= unsure + 2 for took, unsure in spread)


def test_reads_that_come_in_one_burst_are_as_unsure_as_the_burst() -> None:
    talk = REQUEST + REPLY
    chunks = [
        Chunk(talk, START_NS, Clock.READ),
        # 16 ms later three pieces come within a tenth of a millisecond: they had waited together
        *(Chunk(talk, START_NS + 16 * MS + k * 30_000, Clock.READ) for k in range(3)),
    ]
    parts = batches(Decoder("mightyzap", latency_ns=16 * MS), [chunks])
    unsure = [x for b in parts for x in b.transactions.uncertainty_ns.tolist()]
    assert min(unsure[1:]) > 5 * MS


def test_a_late_tap_and_its_adapter_add_up() -> None:
    late = Mark(MarkKind.HELD, 0, len(REPLY), 40 * MS)
    chunks = [
        Chunk(REQUEST, START_NS, Clock.READ),
        Chunk(REPLY, START_NS + 60 * MS, Clock.READ, marks=(late,)),
    ]
    parts = batches(Decoder("mightyzap", latency_ns=16 * MS), [chunks])
    assert [x for b in parts for x in b.transactions.uncertainty_ns.tolist()] == [56 * MS]


@pytest.mark.parametrize("handed_over_ms", [120, 250])
def test_a_frame_that_is_handed_over_in_two_reads_is_torn_by_no_silence(
    handed_over_ms: int,
) -> None:
    """A bridge that flushes seldom: nothing crosses 100 ms of silence, and here is none."""
    talk = robot("mightyzap", 20, rate_hz=17.3, baud=57600)
    how = Decoder(PROTOCOLS["mightyzap"], baud=talk.baud, latency_ns=handed_over_ms * MS)
    each = [
        Chunk(chunk.data[k : k + 1], chunk.t_ns - (len(chunk.data) - 1 - k) * talk.byte_ns)
        for chunk in talk.chunks
        if chunk.t_ns is not None
        for k in range(len(chunk.data))
    ]
    told = [how.feed(chunk) for chunk in through_usb(each, handed_over_ms)]
    told.append(how.close())
    assert sum(len(batch.frames) for batch in told) == len(talk.chunks)
    assert not any(len(batch.gaps) for batch in told)
