"""Damage in columns is what the slow way tells, object by object."""

from __future__ import annotations

from dataclasses import replace
from typing import Final

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from sniffer import Chunk, Decoder
from sniffer.anomalies.found import CODES, NUMBER, Anomalies
from sniffer.anomalies.rules import anomaly, gap_anomalies
from sniffer.ground.gaps import IDLE_TAIL, REASONS, Gaps
from sniffer.ground.model import Batch, Gap
from sniffer.protocols import PROTOCOLS
from sniffer.protocols.explaining import Surveyor, pieces
from sniffer.sources import open_source
from tests.golden import captures

SURVEYORS = sorted(name for name, p in PROTOCOLS.items() if isinstance(p, Surveyor))

NUMBERS: Final = ("expected", "got", "is_told")

ALPHABET = bytes.fromhex("FFFFFFFF FAAFFDDF 00 01 02 04 07 10 F1 F2 F3 FE 7F 80 FF")


def runs() -> st.SearchStrategy[list[bytes]]:
    """Return runs of bytes that look much like headers, ids and lengths."""
    byte = st.sampled_from(list(ALPHABET)) | st.integers(0, 255)
    head = st.sampled_from([b"\xff\xff\xff", b"\xfa\xaf", b"\xfd\xdf", b"\xff\xff\xff\x01\x04"])
    part = head | st.lists(byte, min_size=1, max_size=12).map(bytes)
    return st.lists(st.lists(part, min_size=1, max_size=12).map(b"".join), min_size=1, max_size=6)


def test_protocols_with_headers_and_lengths_explain_in_columns() -> None:
    assert SURVEYORS == ["mightyzap", "rs30x"]


@pytest.mark.parametrize("name", SURVEYORS)
@given(found=runs(), between=st.lists(st.integers(0, 9), min_size=6, max_size=6))
def test_columns_say_what_the_slow_way_says(
    name: str, found: list[bytes], between: list[int]
) -> None:
    protocol = PROTOCOLS[name]
    assert isinstance(protocol, Surveyor)
    data, edges = b"", []
    for run, apart in zip(found, between, strict=False):
        data += bytes(apart)
        edges.append((len(data), len(data) + len(run)))
        data += run
    start, end = np.array(edges, np.int64).T
    told = pieces(protocol, np.frombuffer(data, np.uint8), start, end)
    slow = Gaps.of(tuple(g for a, b in edges for g in protocol.explain(data[a:b], a)))
    assert told.start.tolist() == slow.start.tolist()
    assert (told.end - told.start).tolist() == slow.length.tolist()
    assert told.kind.tolist() == slow.kind.tolist()
    assert told.servo_id.tolist() == slow.servo_id.tolist()
    assert told.expected.tolist() == slow.expected.tolist()
    assert told.got.tolist() == slow.got.tolist()
    many = [len(protocol.explain(data[a:b], a)) for a, b in edges]
    assert told.run.tolist() == np.repeat(np.arange(len(edges)), many).tolist()


def damaged(name: str) -> list[Batch]:
    """Decode traffic of which every hundredth byte is not what was sent."""
    (capture,) = (path for path in captures() if path.name.startswith(f"{name}_clean"))
    data = bytearray(b"".join(k.data for group in open_source(capture) for k in group))
    for at in range(50, len(data), 97):
        data[at] ^= 0x15
    decoder = Decoder(name)
    return [decoder.feed(Chunk(bytes(data))), decoder.close()]


@pytest.mark.parametrize("name", sorted(PROTOCOLS))
def test_columns_of_gaps_and_anomalies_are_those_of_their_objects(name: str) -> None:
    batches = damaged(name)
    assert sum(len(b.gaps) for b in batches)
    assert sum(len(b.anomalies) for b in batches)
    for batch in batches:
        if len(batch.gaps):
            gaps = Gaps.of(batch.gaps)
            again = Gaps.of(tuple(batch.gaps))
            for column in (*("start", "length", "kind", "servo_id", "t_ns"), *NUMBERS):
                assert getattr(gaps, column).tolist() == getattr(again, column).tolist(), column
            assert [REASONS[k] for k in gaps.kind] == [g.reason for g in batch.gaps]
        if len(batch.anomalies):
            found = Anomalies.of(batch.anomalies)
            objects = Anomalies.of(list(batch.anomalies))
            for column in ("code", "t_ns", "servo_id", "at", "length", "known_at"):
                assert getattr(found, column).tolist() == getattr(objects, column).tolist(), column


@pytest.mark.parametrize("name", sorted(PROTOCOLS))
def test_sentences_and_evidence_are_told_without_objects_as_with_them(name: str) -> None:
    for batch, another in zip(damaged(name), damaged(name), strict=True):
        told = Anomalies.of(batch.anomalies).told()
        assert told == [(a.detail, a.evidence) for a in another.anomalies]
        assert told == Anomalies.of(list(another.anomalies)).told()


@pytest.mark.parametrize("name", SURVEYORS)
def test_sentences_of_gaps_in_columns_are_those_of_gaps_that_are_objects(name: str) -> None:
    for batch in damaged(name):
        objects = replace(batch, gaps=tuple(batch.gaps))
        assert gap_anomalies(batch).told() == gap_anomalies(objects).told()


def test_a_gap_that_a_plug_in_explains_in_words_is_told_in_its_words() -> None:
    detail = {"checksum_expected": "A5 or 5A", "checksum_got": "none", "fields": {}}
    heard = Decoder("mightyzap").feed(Chunk(b""))
    batch = replace(heard, data=b"\x01\x02", gaps=(Gap(0, 2, "damaged", detail, 7),))
    ((sentence, evidence),) = gap_anomalies(batch).told()
    assert sentence == "checksum should be A5 or 5A but is none in 01 02"
    assert evidence == ((0, 2),)


@pytest.mark.parametrize("name", sorted(PROTOCOLS))
def test_one_gap_or_anomaly_alone_is_the_one_among_all(name: str) -> None:
    for alone, together in zip(damaged(name), damaged(name), strict=True):
        assert [alone.gaps[i] for i in range(len(alone.gaps))] == list(together.gaps)
        found = [alone.anomalies[i] for i in range(len(alone.anomalies))]
        assert found == list(together.anomalies)


def test_what_is_made_late_is_like_a_tuple() -> None:
    batch, _ = damaged("mightyzap")
    gaps, made = batch.gaps, tuple(batch.gaps)
    assert gaps == made
    assert made == gaps
    assert gaps != made[1:]
    assert gaps[-1] == made[-1]
    assert gaps[1:3] == made[1:3]
    assert [*gaps] == [*made]
    assert made[0] in gaps
    assert gaps.index(made[1]) == 1
    assert [*made[:0], *gaps] == [*gaps, *made[:0]]
    assert made[:1].__add__(made) == Gaps.of(made[:1]) + made
    assert gaps.__reduce__() == (tuple, (made,))
    assert repr(gaps) == repr(made)
    with pytest.raises(IndexError):
        gaps[len(gaps)]
    assert bool(gaps)


def test_the_last_piece_before_silence_is_an_idle_tail() -> None:
    decoder = Decoder("mightyzap")
    decoder.feed(Chunk(bytes.fromhex("FFFFFF0104F2")))
    (gap,) = decoder.close().gaps
    assert gap.reason == REASONS[IDLE_TAIL]
    assert gap.detail["have"] == 6


def test_every_code_has_a_number() -> None:
    assert [NUMBER[code] for code in CODES] == list(range(len(CODES)))
    one = anomaly("noise", 7, -1, "a byte", (3, 1))
    assert list(Anomalies.of([one])) == [one]
    assert Anomalies.of([one]).servo_id.tolist() == [-1]


def packet(*body: int) -> bytes:
    return b"\xff\xff\xff" + bytes(body) + bytes([~sum(body) & 0xFF])


def complaining(status: list[int]) -> bytes:
    """Return talk in which two servos answer with these status bytes."""
    return b"".join(
        packet(1 + i % 2, 4, 0xF2, 0x8C, 2) + packet(1 + i % 2, 4, byte, 0x34, 0x08)
        for i, byte in enumerate(status)
    )


@given(
    status=st.lists(st.sampled_from([0, 0x02, 0x08, 0x20, 0x28]), min_size=1, max_size=30),
    cut=st.integers(1, 400),
)
def test_what_servos_complain_of_is_one_in_columns_in_objects_and_however_it_is_cut(
    status: list[int], cut: int
) -> None:
    data = complaining(status)
    decoder, pieces_of = Decoder("mightyzap"), Decoder("mightyzap")
    whole = [decoder.feed(Chunk(data)), decoder.close()]
    parts = [pieces_of.feed(Chunk(data[a : a + cut])) for a in range(0, len(data), cut)]
    told = [one for b in whole for one in Anomalies.of(b.anomalies).told()]
    found = [a for b in (*parts, pieces_of.close()) for a in b.anomalies]
    assert told == [(a.detail, a.evidence) for a in found]
    for batch in whole:
        columns, objects = Anomalies.of(batch.anomalies), Anomalies.of(list(batch.anomalies))
        assert columns.code.tolist() == objects.code.tolist()
        assert columns.servo_id.tolist() == objects.servo_id.tolist()
        assert columns.at.tolist() == objects.at.tolist()


def test_a_refusal_is_told_each_time_and_a_fault_when_it_begins_and_ends() -> None:
    decoder = Decoder("mightyzap")
    data = complaining([0x08, 0x20, 0x08, 0x20, 0x08, 0x00])
    batches = [decoder.feed(Chunk(data)), decoder.close()]
    told = [a.detail for b in batches for a in b.anomalies]
    assert told == [
        "servo 1 reports range (status 08)",
        "servo 2 reports overload (status 20)",
        "servo 1 reports range (status 08)",
        "servo 1 reports range (status 08)",
        "servo 2 no longer reports overload",
    ]
