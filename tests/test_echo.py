"""An adapter's echo: every request twice, byte for byte, nothing between."""

from __future__ import annotations

import itertools
from typing import TYPE_CHECKING

import numpy as np
import pytest

from sniffer.decoding.decoder import Decoder
from sniffer.decoding.echo import CONFIRMED
from sniffer.decoding.reference import Reference
from sniffer.decoding.rows import FrameRow, SampleRow, rows
from sniffer.ground.codes import OUTCOMES
from sniffer.ground.model import Batch, Chunk, Clock
from sniffer.protocols import PROTOCOLS
from tests.lists import each_in_turn
from tests.records import batches, records
from tests.streams.mightyzap import packet as zap
from tests.streams.rs30x import packet, returned
from tests.taps import RX, TX

if TYPE_CHECKING:
    from collections.abc import Callable, Sequence

READ, ANSWER = zap(1, 0xF2, b"\x8c\x02"), zap(1, 0, b"\x10\x02")
WRITE = zap(1, 0xF3, b"\x86\x01\x02")
TORN = bytes([*READ[:3], *(byte ^ 0x24 for byte in READ[3:])])
EXCHANGES = {
    "lss": (b"#1QD\r", b"*1QD5\r"),
    "mightyzap": (READ, ANSWER),
    "rs30x": (packet(1, 9), returned(1, 42, bytes(18))),
    "wck": (bytes.fromhex("FFA11031"), bytes([7, 99])),
}


def decoded(name: str, *data: bytes) -> list[Batch]:
    chunk = Chunk(b"".join(data))
    parts = batches(Decoder(name), [[chunk]])
    assert records(parts) == Reference(PROTOCOLS[name]).decode([chunk])
    return parts


def codes(parts: Sequence[Batch]) -> list[str]:
    return [a.code for b in parts for a in b.anomalies]


@pytest.mark.parametrize("name", EXCHANGES)
def test_a_bus_whose_requests_are_echoed_is_healthy_and_the_echo_is_told_once(name: str) -> None:
    request, answer = EXCHANGES[name]
    parts = decoded(name, *[request, request, answer] * 30)
    assert codes(parts) == ["adapter-echo"]
    outcomes = [OUTCOMES[how] for _, _, how, *_ in records(parts).transactions]
    assert outcomes == ["ok", "not_expected"] * 30
    frames = [r for b in parts for r in rows(b, PROTOCOLS[name]) if isinstance(r, FrameRow)]
    assert [r.flags for r in frames] == [(), ("echo",), ()] * 30


def test_commanded_values_are_not_doubled_by_an_echo() -> None:
    told = decoded("mightyzap", *[READ, READ, ANSWER, WRITE, WRITE] * 12)
    found = [r for b in told for r in rows(b, PROTOCOLS["mightyzap"]) if isinstance(r, SampleRow)]
    assert [s.role for s in found] == ["measured", "commanded"] * 12


def test_a_mere_retry_is_no_echo() -> None:
    retried = [READ, READ, ANSWER, READ, ANSWER] * 20
    assert codes(decoded("mightyzap", *retried)) == ["no-response"] * 20
    few = [READ, READ, ANSWER] * (CONFIRMED - 1)
    # the very last one may still be answered by what comes behind the end
    assert codes(decoded("mightyzap", *few)) == ["no-response"] * (CONFIRMED - 2) + ["capture-end"]


def test_a_program_that_sends_its_broadcasts_twice_is_no_echo() -> None:
    everyone = zap(254, 0xF3, b"\x86\x01\x02")
    told = decoded("mightyzap", *[everyone, everyone] * 30)
    assert codes(told) == []
    samples = [s for b in told for s in rows(b, PROTOCOLS["mightyzap"]) if isinstance(s, SampleRow)]
    assert len(samples) == 60


def test_requests_sent_twice_and_answered_twice_are_no_echo() -> None:
    told = decoded("mightyzap", *[READ, READ, ANSWER, ANSWER] * 30)
    assert {OUTCOMES[how] for _, _, how, *_ in records(told).transactions} == {"ok"}
    assert codes(told) == []


def test_a_servo_that_does_not_answer_is_missed_once_an_exchange_also_on_an_echoed_bus() -> None:
    gone = zap(2, 0xF2, b"\x8c\x02")
    told = decoded("mightyzap", *[READ, READ, ANSWER] * 12, *[gone, gone, READ, READ, ANSWER] * 3)
    assert codes(told) == ["adapter-echo", "no-response", "no-response", "capture-end"]


@pytest.mark.parametrize("name", EXCHANGES)
@pytest.mark.parametrize("is_first", [True, False], ids=["the request", "its echo"])
def test_where_one_of_the_two_is_torn_the_others_are_still_echoes(
    name: str, is_first: bool
) -> None:
    """A hit beside a request makes no retries of the echoes that follow."""
    request, answer = EXCHANGES[name]
    torn = bytes([request[0], *(byte ^ 0x81 for byte in request[1:])])
    hit = [torn, request, answer] if is_first else [request, torn, answer]
    echoed = [request, request, answer]
    parts = decoded(name, *echoed * 12, *hit, *echoed * 3, *hit, *echoed * 3)
    told = records(parts).transactions
    outcomes = [OUTCOMES[how] for _, _, how, *_ in told]
    assert outcomes.count("not_expected") == 18
    assert "no_response" not in outcomes


def test_the_response_time_counts_from_the_echo() -> None:
    byte = 173_612
    t, chunks = 0, []
    for _ in range(12):
        for part, pause in ((READ, 5_000_000), (READ, 0), (ANSWER, 400_000)):
            t += pause + len(part) * byte
            chunks.append(Chunk(part, t, Clock.SAMPLE))
    told = records(batches(Decoder("mightyzap", latency_ns=0), [chunks])).transactions
    times = [took for *_, how, took, _ in told if OUTCOMES[how] == "ok"]
    assert all(abs(took - 400_000) <= byte for took in times)


def random_talk(rng: np.random.Generator) -> list[bytes]:
    parts: list[Callable[[], list[bytes]]] = [
        lambda: [WRITE, WRITE],
        lambda: [READ, ANSWER],
        lambda: [READ, READ],
        lambda: [READ, READ, ANSWER, ANSWER],
        lambda: [WRITE],
        lambda: [READ, TORN, ANSWER],
        lambda: [TORN, READ, ANSWER],
        lambda: [TORN],
    ]
    out: list[bytes] = []
    for _ in range(int(rng.integers(1, 25))):
        often = rng.random() < 0.75
        out += [READ, READ, ANSWER] if often else parts[int(rng.integers(len(parts)))]()
    return out


@each_in_turn(3, "first", range(0, 60, 20))
def test_what_is_an_echo_does_not_depend_on_how_the_stream_was_cut(first: int) -> None:
    echoed = 0
    for case in range(first, first + 20):
        rng = np.random.default_rng(case)
        data = b"".join(random_talk(rng))
        cuts = sorted(
            {0, len(data), *rng.integers(0, len(data), int(rng.choice([3, 40]))).tolist()}
        )
        t, chunks = 0, []
        for a, b in itertools.pairwise(cuts):
            t += (b - a) * 174_000 + (200_000_000 if rng.random() < 0.05 else 0)
            chunks.append(Chunk(data[a:b], t, Clock.READ))
        whole = records(batches(Decoder("mightyzap"), [chunks]))
        assert records(batches(Decoder("mightyzap"), [[c] for c in chunks])) == whole, case
        assert Reference(PROTOCOLS["mightyzap"]).decode(chunks) == whole, case
        echoed += sum(f[11] >= 128 for f in whole.frames)
    assert echoed > 20


def test_an_echo_on_the_wire_that_is_listened_to_is_no_swapped_wire() -> None:
    """A program that logs what it writes and what it reads has the echo among what it reads."""
    chunks = []
    for k in range(30):
        for j, (data, wire) in enumerate([(READ, TX), (READ, RX), (ANSWER, RX)]):
            chunks.append(Chunk(data, (20 * k + 3 * j) * 1_000_000, Clock.FILE, direction=wire))
    assert codes(batches(Decoder("mightyzap"), [chunks])) == ["adapter-echo"]
