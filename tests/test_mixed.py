"""Two protocols on one wire: each byte claimed once, and each one decoded as if it were alone."""

from __future__ import annotations

import itertools
from collections import Counter
from typing import TYPE_CHECKING

import pytest
from hypothesis import given
from hypothesis import strategies as st

from sniffer.decoding.decoder import Decoder
from sniffer.decoding.mixed import MixedDecoder, protocols_named
from sniffer.ground.model import Chunk, SnifferError
from sniffer.ground.timing import byte_time_ns
from sniffer.protocols import PROTOCOLS
from tests.records import gaps, records
from tests.streams import bursts, chunked, module, stream

if TYPE_CHECKING:
    from collections.abc import Iterable, Sequence

    from sniffer.decoding.reference import Result
    from sniffer.ground.model import Batch

BAUD = 115200
BYTE_NS = byte_time_ns(BAUD)
PAIRS = [("mightyzap", "rs30x"), ("lss", "mightyzap"), ("mightyzap", "wck"), ("lss", "rs30x")]
EVERY = pytest.mark.parametrize("names", PAIRS, ids="+".join)
ONE_OF_TWO = pytest.mark.parametrize(
    ("names", "alone"), [(pair, one) for pair in PAIRS for one in pair], ids=str
)


def mixed(names: Iterable[str]) -> MixedDecoder:
    return MixedDecoder([PROTOCOLS[name] for name in names], baud=BAUD)


def decoded(decoder: MixedDecoder, groups: Iterable[Sequence[Chunk]]) -> list[tuple[Batch, ...]]:
    return [*(decoder.feed(*group) for group in groups), decoder.close()]


def of_each(parts: Iterable[tuple[Batch, ...]]) -> list[Result]:
    """Return the records of each protocol."""
    return [records(batches) for batches in zip(*parts, strict=True)]


def found(batches: Iterable[Batch]) -> Counter[object]:
    return Counter(a for b in batches for a in b.anomalies)


@st.composite
def two(draw: st.DrawFn, names: Sequence[str], *, is_clean: bool = False) -> bytes:
    """Draw what two protocols say on one wire, one exchange after the other."""
    talk = st.one_of(*(module(name).TALK for name in names))
    if is_clean:
        return b"".join(draw(st.lists(talk, max_size=12)))
    part = st.one_of(talk, talk, talk, *(stream(n) for n in names), *(bursts(n, 2) for n in names))
    return b"".join(draw(st.lists(part, max_size=6)))


def recut(data: st.DataObject, chunks: list[Chunk]) -> list[Chunk]:
    """Draw the same bytes in other chunks, each byte at its time."""
    out: list[Chunk] = []
    for c in chunks:
        assert c.t_ns is not None
        cuts = data.draw(st.lists(st.integers(1, max(1, len(c.data) - 1)), max_size=6, unique=True))
        edges = [0, *sorted(x for x in cuts if x < len(c.data)), len(c.data)]
        for a, b in itertools.pairwise(edges):
            out.append(Chunk(c.data[a:b], c.t_ns - (len(c.data) - b) * BYTE_NS, c.clock))
    return out


@EVERY
@given(data=st.data())
def test_each_byte_is_claimed_once_by_one_of_them(
    names: tuple[str, str], data: st.DataObject
) -> None:
    s = data.draw(two(names))
    chunks = data.draw(chunked(s, BYTE_NS, 100_000_000))
    parts = decoded(mixed(names), [[c] for c in chunks])
    spans = [(b.base + start, n) for p in parts for b in p for start, n in _spans(b)]
    at = 0
    for start, length in sorted(spans):
        assert start == at
        assert length > 0
        at += length
    assert at == len(s)
    assert b"".join(p[0].data for p in parts) == s


def _spans(batch: Batch) -> list[tuple[int, int]]:
    f = batch.frames
    spans = list(zip(f.start.tolist(), f.length.tolist(), strict=True))
    return spans + [(g.start, g.length) for g in batch.gaps]


@EVERY
@given(data=st.data())
def test_any_recut_gives_equal_records_of_both(names: tuple[str, str], data: st.DataObject) -> None:
    s = data.draw(two(names))
    chunks = data.draw(chunked(s, BYTE_NS, 100_000_000))
    whole = decoded(mixed(names), [chunks])
    again = decoded(mixed(names), [[c] for c in recut(data, chunks)])
    assert of_each(again) == of_each(whole)
    for one, other in zip(zip(*again, strict=True), zip(*whole, strict=True), strict=True):
        assert gaps(one) == gaps(other)


@EVERY
@given(data=st.data())
def test_the_same_chunks_in_any_grouping_give_equal_anomalies(
    names: tuple[str, str], data: st.DataObject
) -> None:
    s = data.draw(two(names))
    chunks = data.draw(chunked(s, BYTE_NS, 100_000_000))
    whole = decoded(mixed(names), [chunks])
    again = decoded(mixed(names), [[c] for c in chunks])
    for one, other in zip(zip(*again, strict=True), zip(*whole, strict=True), strict=True):
        assert found(one) == found(other)


@ONE_OF_TWO
@given(data=st.data())
def test_a_stream_of_one_alone_decodes_as_it_does_alone(
    names: tuple[str, str], alone: str, data: st.DataObject
) -> None:
    s = b"".join(data.draw(st.lists(module(alone).TALK, max_size=10)))
    chunks = data.draw(chunked(s, BYTE_NS, PROTOCOLS[alone].tail_ns))
    decoder = Decoder(alone, baud=BAUD)
    want = [*(decoder.feed(c) for c in chunks), decoder.close()]
    parts = decoded(mixed(names), [[c] for c in chunks])
    mine = [p[names.index(alone)] for p in parts]
    other = [p[1 - names.index(alone)] for p in parts]
    assert records(mine) == records(want)
    if any(f[0] == 0 for f in records(want).frames):  # before the first frame nobody is known
        assert gaps(mine) == gaps(want)
        assert found(mine) == found(want)
        assert not any(len(b.frames) or b.gaps or b.anomalies for b in other)


@EVERY
@given(data=st.data())
def test_declaring_a_silence_changes_nothing_that_the_chunks_do_not_say(
    names: tuple[str, str], data: st.DataObject
) -> None:
    s = data.draw(two(names))
    chunks = data.draw(chunked(s, BYTE_NS, 100_000_000))
    replayed = decoded(mixed(names), [chunks])
    decoder, live = mixed(names), []
    for c in chunks:
        assert c.t_ns is not None
        live += [decoder.idle(c.t_ns - len(c.data) * BYTE_NS), decoder.feed(c)]
    live.append(decoder.close())
    assert of_each(live) == of_each(replayed)


@EVERY
@given(data=st.data())
def test_talk_of_both_is_told_apart(names: tuple[str, str], data: st.DataObject) -> None:
    """What each says, decoded with the other's exchanges left out, is what it says beside them."""
    talk = data.draw(
        st.lists(
            st.sampled_from(range(2)).flatmap(
                lambda k: st.tuples(st.just(k), module(names[k]).TALK)
            ),
            max_size=10,
        )
    )
    got = of_each(decoded(mixed(names), [[Chunk(b"".join(s for _, s in talk))]]))
    covered = sum(f[1] for one in got for f in one.frames)
    for k, name in enumerate(names):
        decoder = Decoder(name, baud=BAUD)
        own = [decoder.feed(b"".join(s for who, s in talk if who == k)), decoder.close()]
        want = records(own)
        if covered == sum(len(s) for _, s in talk):
            assert [f[1:6] for f in got[k].frames] == [f[1:6] for f in want.frames]


@pytest.mark.parametrize("order", [("mightyzap", "rs30x"), ("rs30x", "mightyzap")])
def test_the_order_in_which_they_are_named_does_not_matter(order: tuple[str, str]) -> None:
    assert [p.name for p in protocols_named("+".join(order))] == ["mightyzap", "rs30x"]
    assert mixed(order).name == "mightyzap+rs30x"


@pytest.mark.parametrize(
    ("name", "why"), [("lss+lss", "twice"), ("lss+abc", "no protocol 'abc'"), ("+", "twice")]
)
def test_names_that_cannot_be_are_refused(name: str, why: str) -> None:
    with pytest.raises(SnifferError, match=why):
        protocols_named(name)
