"""The laws, where models show themselves on the way and servos take new ids."""

from __future__ import annotations

import itertools

import pytest
from hypothesis import given
from hypothesis import strategies as st

from sniffer.decoding.decoder import Decoder
from sniffer.decoding.reference import Reference
from sniffer.ground.model import Chunk
from sniffer.protocols import PROTOCOLS
from tests.records import batches, records
from tests.streams import damaged, lss, mightyzap

TALK = {"mightyzap": mightyzap.MODELS, "lss": lss.MODELS}
EACH = pytest.mark.parametrize("protocol", TALK)


def named(protocol: str) -> st.SearchStrategy[dict[int | None, str]]:
    default, other = [m.model for m in PROTOCOLS[protocol].models]
    return st.sampled_from(
        [
            {},
            {},
            {1: other},
            {None: other},
            {None: other, 2: default},
            {2: default},
        ]
    )


def stream(protocol: str) -> st.SearchStrategy[bytes]:
    talk = TALK[protocol]
    return st.one_of(talk, talk, talk.flatmap(damaged))


@EACH
@given(data=st.data())
def test_the_block_decoder_equals_the_reference_whatever_models_show(
    protocol: str, data: st.DataObject
) -> None:
    models = data.draw(named(protocol))
    chunks = [Chunk(data.draw(stream(protocol)), 1_700_000_000_000_000_000)]
    got = records(batches(Decoder(protocol, models=models), [chunks]))
    want = Reference(PROTOCOLS[protocol], models=models).decode(chunks)
    assert got.frames == want.frames
    assert got.transactions == want.transactions
    assert got.samples == want.samples


@EACH
@given(data=st.data())
def test_any_grouping_reads_the_same_models_and_tells_the_same_of_them(
    protocol: str, data: st.DataObject
) -> None:
    models, said = data.draw(named(protocol)), data.draw(stream(protocol))
    cuts = data.draw(st.lists(st.integers(0, 600), max_size=6))
    whole = batches(Decoder(protocol, models=models), [[Chunk(said)]])
    edges = [0, *sorted(c for c in cuts if c < len(said)), len(said)]
    parts = [[Chunk(said[a:b])] for a, b in itertools.pairwise(edges)]
    again = batches(Decoder(protocol, models=models), parts)
    assert records(again) == records(whole)
    told = [
        [(a.code, a.servo_id, a.detail, a.evidence, a.remedy) for b in some for a in b.anomalies]
        for some in (whole, again)
    ]
    assert told[0] == told[1]


@pytest.mark.parametrize(
    ("protocol", "model"),
    # a word that the LSS lacks is read by the table that has it, named or not
    [("mightyzap", "mightyzap-l12"), ("mightyzap", "mightyzap-12lf"), ("lss", "lss-pro")],
)
@given(data=st.data())
def test_a_named_model_is_never_overruled(protocol: str, model: str, data: st.DataObject) -> None:
    decoder = Decoder(protocol, models={None: model})
    registers = PROTOCOLS[protocol].registers
    for b in batches(decoder, [[Chunk(data.draw(TALK[protocol]))]]):
        assert {registers[i].model for i in b.values.register.tolist()} <= {model}
