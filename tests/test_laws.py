"""The laws of the design, as properties of every protocol."""

from __future__ import annotations

from typing import TYPE_CHECKING

import pytest
from hypothesis import given
from hypothesis import strategies as st

from sniffer.decoding import pairing
from sniffer.decoding.decoder import Decoder
from sniffer.decoding.reference import Reference
from sniffer.ground.codes import NO_RESPONSE, OK
from sniffer.ground.model import Chunk
from sniffer.ground.timing import byte_time_ns
from sniffer.protocols import PROTOCOLS
from tests.lists import in_turn
from tests.records import batches, gaps, records
from tests.streams import bursts, chunked, recut, stream
from tests.streams.mightyzap import packet as zap
from tests.streams.rs30x import packet, returned

if TYPE_CHECKING:
    from collections.abc import Callable

EVERY = pytest.mark.parametrize("name", PROTOCOLS)
PIPELINED = pytest.mark.parametrize("chain", [pairing.CHAIN, 0], ids=["chain", "no_chain"])
"""How far a place is looked for that no exchange leads across: 0 makes answers cross each cut."""


WINDOW: dict[str, tuple[Callable[[int], bytes], Callable[[int], bytes]]] = {
    "lss": (lambda i: b"#%dQD\r" % (i % 5), lambda i: b"*%dQD%d\r" % (i % 5, i)),
    "mightyzap": (
        lambda i: zap(i % 5 + 1, 0xF2, b"\x8c\x02"),
        lambda i: zap(i % 5 + 1, 0, i.to_bytes(2, "little")),
    ),
    "rs30x": (
        lambda i: packet(i % 5 + 1, 9),
        lambda i: returned(i % 5 + 1, 42, (i % 900).to_bytes(2, "little") + bytes(16)),
    ),
}
"""What a controller asks and what comes back, of the protocols whose answers say whose they are."""


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
    again = batches(Decoder(name), [[c] for c in recut(data, chunks, byte_ns)])
    assert records(again) == records(whole)
    assert gaps(again) == gaps(whole)


@in_turn(2)
@EVERY
@PIPELINED
@given(data=st.data())
def test_with_several_requests_in_flight_a_recut_and_the_reference_give_equal_records(
    name: str, chain: int, data: st.DataObject
) -> None:
    s = data.draw(bursts(name))
    protocol = PROTOCOLS[name]
    byte_ns = byte_time_ns(protocol.baud)
    chunks = data.draw(chunked(s, byte_ns, protocol.tail_ns))
    with pytest.MonkeyPatch.context() as patch:
        patch.setattr(pairing, "CHAIN", chain)
        parts = batches(Decoder(name), [[c] for c in recut(data, chunks, byte_ns)])
    whole = records(batches(Decoder(name), [chunks]))
    again = records(parts)
    want = Reference(protocol).decode(chunks)
    for records_of in ("frames", "transactions", "samples"):
        assert getattr(again, records_of) == getattr(whole, records_of)
        assert getattr(whole, records_of) == getattr(want, records_of)


@in_turn(2)
@EVERY
@PIPELINED
@given(data=st.data())
def test_with_several_requests_in_flight_any_grouping_gives_equal_anomalies(
    name: str, chain: int, data: st.DataObject
) -> None:
    s = data.draw(bursts(name))
    protocol = PROTOCOLS[name]
    chunks = data.draw(chunked(s, byte_time_ns(protocol.baud), protocol.tail_ns))
    with pytest.MonkeyPatch.context() as patch:
        patch.setattr(pairing, "CHAIN", chain)
        one = batches(Decoder(name), [[c] for c in chunks])
    whole = batches(Decoder(name), [chunks])
    assert [a for b in one for a in b.anomalies] == [a for b in whole for a in b.anomalies]


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


@pytest.mark.parametrize("name", WINDOW)
def test_a_window_that_slides_without_end_holds_no_more_than_a_chain(name: str) -> None:
    """A controller that asks the next one whenever an answer comes leaves no place between."""
    ask, answer = WINDOW[name]
    s = b"".join([ask(0), ask(1), *(answer(i) + ask(i + 2) for i in range(1000))])
    decoder, protocol = Decoder(name), PROTOCOLS[name]
    bound = pairing.CHAIN + protocol.longest + protocol.reach + 1024
    parts = []
    for at in range(0, len(s), 256):
        parts.append(decoder.feed(Chunk(s[at : at + 256])))
        assert decoder.pending <= 256 + bound
    parts.append(decoder.close())
    told = records(parts)
    assert told.transactions == records(batches(Decoder(name), [[Chunk(s)]])).transactions
    outcomes = [outcome for _, _, outcome, *_ in told.transactions]
    assert outcomes.count(OK) == 1000
    assert outcomes.count(NO_RESPONSE) == 2  # those asked last
    # Both were still open: what came behind the first of them is the answer to one before it.
    assert [a.code for b in parts for a in b.anomalies] == ["capture-end"]


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
