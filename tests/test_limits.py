"""What a caller may hand over: all else is refused in a sentence, and nothing of it is taken."""

from __future__ import annotations

from typing import TYPE_CHECKING, Any

import numpy as np
import pytest

from sniffer import Chunk, Clock, Decoder, InputError, SnifferError, decode
from sniffer.decoding.pipeline import Options
from sniffer.ground.limits import BAUDS, DURATION_MOST_NS, TIME_END_NS, TIME_LEAST_NS
from sniffer.ground.model import Frames, Mark, MarkKind

if TYPE_CHECKING:
    from collections.abc import Callable

ASK = bytes.fromhex("FFFFFF0104F28C027A")
ANSWER = bytes.fromhex("FFFFFF010400FF07F4")
# as callers without types call them
odd_chunk: Any = Chunk
read: Any = decode

HELD = (Mark(MarkKind.HELD, 0, 0, 1 << 63),)
UNKNOWN_KIND: Any = ((99, 0, 0, 1),)


def decoder(**options: Any) -> Decoder:
    return Decoder("mightyzap", **options)


@pytest.mark.parametrize(
    ("options", "told"),
    [
        ({"models": {300: "mightyzap-l12"}}, "the servo id of a model is a whole number from 0"),
        ({"models": {-1: "mightyzap-l12"}}, "the servo id of a model is a whole number from 0"),
        ({"models": {"1": "mightyzap-l12"}}, "the servo id of a model is a whole number, not '1'"),
        ({"models": ["mightyzap-l12"]}, "models are named by servo id"),
        ({"models": {1: "nonsense" * 1000}}, "mightyzap has no model 'nonsense"),
        ({"baud": 0}, "baud is a whole number from 300 to 10000000, not 0"),
        ({"baud": -5}, "baud is a whole number from 300 to 10000000, not -5"),
        ({"baud": 10**5000}, "baud is a whole number from 300"),
        ({"baud": 9600.5}, "baud is a whole number, not 9600.5"),
        ({"baud": "9600"}, "baud is a whole number, not '9600'"),
        ({"latency_ns": -1}, "latency_ns is a whole number from 0"),
        ({"latency_ns": 1 << 63}, "latency_ns is a whole number from 0"),
        ({"base": -1}, "base is a whole number from 0"),
        ({"slowest": 0}, "slowest is a whole number from 300 to 57600, not 0"),
        ({"slowest": 115200}, "slowest is a whole number from 300 to 57600, not 115200"),
        ({"slowest": "9600"}, "slowest is a whole number, not '9600'"),
    ],
)
def test_what_a_decoder_cannot_be_made_with_is_told_in_a_sentence(
    options: dict[str, Any], told: str
) -> None:
    with pytest.raises(SnifferError) as caught:
        decoder(**options)
    assert str(caught.value).startswith(told)
    assert len(str(caught.value)) < 200


@pytest.mark.parametrize("baud", [0, -5, 9600.5, "9600"])
def test_a_rate_that_cannot_be_is_no_rate_of_a_file_either(baud: Any) -> None:
    with pytest.raises(SnifferError, match="baud is a whole number"):
        decode(ASK, "mightyzap", baud=baud)


@pytest.mark.parametrize("protocol", [None, 5, [], "x" * 100_000])
def test_what_is_no_protocol_is_told_in_a_sentence(protocol: Any) -> None:
    for call in (lambda: Decoder(protocol), lambda: decode(ASK, protocol)):
        with pytest.raises(SnifferError, match="protocol"):
            call()


@pytest.mark.parametrize(
    "odd",
    [
        *(5, "FFFF", None, [Chunk(ASK)], 1.5, np.frombuffer(ASK, np.uint8)),
        *(odd_chunk("FFFF"), odd_chunk(None), odd_chunk(ASK, 1.5), odd_chunk(ASK, float("nan"))),
        *(Chunk(ASK, 1 << 63), Chunk(ASK, -1 << 63), Chunk(ASK, TIME_END_NS)),
        *(Chunk(ASK, TIME_LEAST_NS - 1), Chunk(ASK, 10**5000)),
        *(odd_chunk(ASK, 1, 7), odd_chunk(ASK, 1, direction=9)),
        *(Chunk(ASK, 1, marks=HELD), Chunk(ASK, 1, marks=UNKNOWN_KIND), odd_chunk(ASK, 1, marks=5)),
    ],
)
def test_an_odd_thing_is_refused_and_the_decoder_goes_on_as_if_it_had_not_come(odd: Any) -> None:
    one, other = decoder(), decoder()
    one.feed(Chunk(ASK, 1000, Clock.READ))
    other.feed(Chunk(ASK, 1000, Clock.READ))
    with pytest.raises(SnifferError) as caught:
        one.feed(Chunk(ASK, 2000, Clock.READ), odd)
    assert len(str(caught.value)) < 200
    batches = [d.feed(Chunk(ANSWER, 5_000_000, Clock.READ)) for d in (one, other)]
    assert batches[0].data == batches[1].data == ASK + ANSWER


@pytest.mark.parametrize("now_ns", [None, 1.5, "now", 1 << 63, -1 << 63, 1 << 200])
def test_a_time_that_cannot_be_is_no_silence(now_ns: Any) -> None:
    with pytest.raises(SnifferError, match="now_ns is a whole number"):
        decoder().idle(now_ns)


def test_what_means_the_same_is_taken_as_it_is_meant() -> None:
    d = decoder(models={np.int64(1): "mightyzap-12lf"}, baud=np.int32(57600))
    d.feed(bytearray(ASK), memoryview(ANSWER))
    assert len(d.close().frames) == 0
    data: Any = bytearray(ASK)
    batch = d.feed(odd_chunk(data, np.int64(5), 2), odd_chunk(ANSWER, np.int64(5)))
    assert (len(batch.frames), batch.clock) == (2, Clock.READ)


def test_the_edges_of_what_can_be_reckoned_with_are_reckoned_with() -> None:
    held = (Mark(MarkKind.HELD, 0, 0, DURATION_MOST_NS),)
    for baud in BAUDS:
        d = decoder(baud=baud, latency_ns=DURATION_MOST_NS)
        first = d.feed(
            Chunk(ASK, TIME_LEAST_NS, Clock.READ, marks=held),
            Chunk(ANSWER, TIME_END_NS - 1, Clock.READ, marks=held),
            Chunk(ASK),
            Chunk(ASK, TIME_LEAST_NS, Clock.READ, marks=held),
        )
        frames = Frames.concat([first.frames, d.close().frames])
        assert (frames.t_start <= frames.t_end).all()
        # one has no stamp
        assert (frames.uncertainty >= 0).tolist() == [True, True, False, True]


@pytest.mark.parametrize(
    ("call", "told"),
    [
        (lambda: read(None), "a path or the bytes of a file are needed, not NoneType"),
        (lambda: read(5), "a path or the bytes of a file are needed, not int"),
        (lambda: decode("a\0b"), "'a\\x00b': cannot be read"),
        (lambda: decode("a" * 100_000), "aaaa"),
    ],
)
def test_what_is_no_input_is_told_in_a_sentence(call: Callable[[], object], told: str) -> None:
    with pytest.raises(InputError) as caught:
        call()
    assert str(caught.value).startswith(told)
    assert len(str(caught.value)) < 500


def test_the_bytes_of_a_file_may_come_in_any_form() -> None:
    text = b"FF FF FF 01 04 F2 8C 02 7A\n" * 5
    whole = decode(text, "mightyzap").summary.as_dict()
    assert decode(bytearray(text), "mightyzap").summary.as_dict() == whole
    assert decode(memoryview(text), "mightyzap").summary.as_dict() == whole


@pytest.mark.parametrize(
    "facts",
    [
        {"model.300": "mightyzap-l12"},
        {f"model.{'9' * 5000}": "mightyzap-l12"},
        {"latency_ns.bus0": str(1 << 63)},
        {"latency_ns.bus0": "9" * 5000},
        {"baud.bus0": "0"},
        {"baud.bus0": "9" * 5000},
    ],
)
def test_a_fact_of_a_recording_that_cannot_be_is_left_out(facts: dict[str, str]) -> None:
    assert Options().with_facts(facts) == Options()
