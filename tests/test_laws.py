"""The laws of the design, as properties of every protocol."""

from __future__ import annotations

import itertools

import pytest
from hypothesis import given
from hypothesis import strategies as st

from sniffer.decoder import Decoder
from sniffer.model import Chunk
from sniffer.protocols import PROTOCOLS
from sniffer.reference import Reference
from sniffer.timing import byte_time_ns
from tests.records import batches, gaps, records
from tests.streams import chunked, stream

EVERY = pytest.mark.parametrize("name", PROTOCOLS)


@EVERY
@given(data=st.data())
def test_frames_and_gaps_joined_in_order_are_exactly_the_input(
    name: str, data: st.DataObject
) -> None:
    s = data.draw(stream(name))
    chunks = data.draw(chunked(s, byte_time_ns(PROTOCOLS[name].baud), PROTOCOLS[name].tail_ns))
    parts = batches(Decoder(name), [[c] for c in chunks])
    spans = sorted(
        [(f[0], f[1]) for f in records(parts).frames] + [(g[0], g[1]) for g in gaps(parts)]
    )
    at = 0
    for start, length in spans:
        assert start == at
        assert length > 0
        at += length
    assert at == len(s)
    assert b"".join(b.data for b in parts) == s


@EVERY
@given(data=st.data())
def test_any_recut_of_the_bytes_with_times_held_gives_equal_records(
    name: str, data: st.DataObject
) -> None:
    s = data.draw(stream(name))
    byte_ns = byte_time_ns(PROTOCOLS[name].baud)
    chunks = data.draw(chunked(s, byte_ns, PROTOCOLS[name].tail_ns))
    whole = batches(Decoder(name), [chunks])
    recut: list[Chunk] = []
    for c in chunks:
        assert c.t_ns is not None
        cuts = data.draw(st.lists(st.integers(1, max(1, len(c.data) - 1)), max_size=6, unique=True))
        edges = [0, *sorted(x for x in cuts if x < len(c.data)), len(c.data)]
        for a, b in itertools.pairwise(edges):
            recut.append(Chunk(c.data[a:b], c.t_ns - (len(c.data) - b) * byte_ns, c.clock))
    again = batches(Decoder(name), [[c] for c in recut])
    assert records(again) == records(whole)
    assert gaps(again) == gaps(whole)


@EVERY
@given(data=st.data())
def test_the_same_chunks_in_any_grouping_give_equal_records(name: str, data: st.DataObject) -> None:
    s = data.draw(stream(name))
    chunks = data.draw(chunked(s, byte_time_ns(PROTOCOLS[name].baud), PROTOCOLS[name].tail_ns))
    one = batches(Decoder(name), [[c] for c in chunks])
    k = data.draw(st.integers(0, len(chunks)))
    many = batches(Decoder(name), [chunks[:k], chunks[k:]])
    assert records(one) == records(many)
    assert gaps(one) == gaps(many)
    assert [a for b in one for a in b.anomalies] == [a for b in many for a in b.anomalies]
    for column in ("uncertainty",):
        assert [x for b in one for x in getattr(b.frames, column).tolist()] == [
            x for b in many for x in getattr(b.frames, column).tolist()
        ]
    assert [x for b in one for x in b.transactions.uncertainty_ns.tolist()] == [
        x for b in many for x in b.transactions.uncertainty_ns.tolist()
    ]


@EVERY
@given(data=st.data())
def test_the_block_decoder_equals_the_reference(name: str, data: st.DataObject) -> None:
    s = data.draw(stream(name))
    chunks = data.draw(chunked(s, byte_time_ns(PROTOCOLS[name].baud), PROTOCOLS[name].tail_ns))
    got = records(batches(Decoder(name), [chunks]))
    want = Reference(PROTOCOLS[name]).decode(chunks)
    assert got.frames == want.frames
    assert got.transactions == want.transactions
    assert got.samples == want.samples


@EVERY
@given(s=st.binary(max_size=3000), data=st.data())
def test_no_input_raises_and_memory_stays_bounded(name: str, s: bytes, data: st.DataObject) -> None:
    decoder = Decoder(name)
    bound = PROTOCOLS[name].longest + PROTOCOLS[name].reach + 2 * 1024
    at = 0
    for cut in [*sorted(data.draw(st.lists(st.integers(0, len(s)), max_size=5))), len(s)]:
        decoder.feed(Chunk(s[at:cut]))
        assert decoder.pending <= (cut - at) + bound
        at = cut
    decoder.close()
    assert decoder.pending == 0


@EVERY
@given(data=st.data())
def test_declaring_a_silence_changes_nothing_that_its_chunks_do_not_say(
    name: str, data: st.DataObject
) -> None:
    """Live, somebody looks at the clock between two reads; a replay sees the reads only."""
    s = data.draw(stream(name))
    byte_ns = byte_time_ns(PROTOCOLS[name].baud)
    chunks = data.draw(chunked(s, byte_ns, PROTOCOLS[name].tail_ns))
    replayed = batches(Decoder(name), [chunks])
    decoder, live = Decoder(name), []
    for c in chunks:
        assert c.t_ns is not None
        began = c.t_ns - len(c.data) * byte_ns
        live += [decoder.idle(began), decoder.feed(c)]
    live.append(decoder.close())
    assert records(live) == records(replayed)
    assert gaps(live) == gaps(replayed)
    assert [a for b in live for a in b.anomalies] == [a for b in replayed for a in b.anomalies]
