"""The laws, where models show themselves on the way and servos take new ids."""

from __future__ import annotations

import itertools

from hypothesis import given
from hypothesis import strategies as st

from sniffer.decoder import Decoder
from sniffer.model import Chunk
from sniffer.protocols import PROTOCOLS
from sniffer.reference import Reference
from tests.records import batches, records
from tests.streams import damaged
from tests.streams.mightyzap import MODELS

NAMED = st.sampled_from(
    [
        {},
        {},
        {1: "mightyzap-12lf"},
        {None: "mightyzap-12lf"},
        {None: "mightyzap-12lf", 2: "mightyzap-l12"},
        {2: "mightyzap-l12"},
    ]
)
STREAM = st.one_of(MODELS, MODELS, MODELS.flatmap(damaged))


@given(data=STREAM, models=NAMED)
def test_the_block_decoder_equals_the_reference_whatever_models_show(
    data: bytes, models: dict[int | None, str]
) -> None:
    chunks = [Chunk(data, 1_700_000_000_000_000_000)]
    got = records(batches(Decoder("mightyzap", models=models), [chunks]))
    want = Reference(PROTOCOLS["mightyzap"], models=models).decode(chunks)
    assert got.frames == want.frames
    assert got.transactions == want.transactions
    assert got.samples == want.samples


@given(data=STREAM, models=NAMED, cuts=st.lists(st.integers(0, 600), max_size=6))
def test_any_grouping_reads_the_same_models_and_tells_the_same_of_them(
    data: bytes, models: dict[int | None, str], cuts: list[int]
) -> None:
    whole = batches(Decoder("mightyzap", models=models), [[Chunk(data)]])
    edges = [0, *sorted(c for c in cuts if c < len(data)), len(data)]
    parts = [[Chunk(data[a:b])] for a, b in itertools.pairwise(edges)]
    again = batches(Decoder("mightyzap", models=models), parts)
    assert records(again) == records(whole)
    told = [
        [(a.code, a.servo_id, a.detail, a.evidence, a.remedy) for b in some for a in b.anomalies]
        for some in (whole, again)
    ]
    assert told[0] == told[1]


@given(data=MODELS)
def test_a_named_model_is_never_overruled(data: bytes) -> None:
    parts = batches(Decoder("mightyzap", models={None: "mightyzap-l12"}), [[Chunk(data)]])
    registers = PROTOCOLS["mightyzap"].registers
    for b in parts:
        models = {registers[i].model for i in b.values.register.tolist()}
        assert models <= {"mightyzap-l12"}
