"""A request that lists several servos: each of them owes an answer."""

from __future__ import annotations

import pytest

from sniffer.decoding.decoder import Decoder
from sniffer.decoding.reference import Reference
from sniffer.decoding.rows import TransactionRow, rows
from sniffer.ground.codes import DAMAGED, NO_RESPONSE, NOT_EXPECTED, OK
from sniffer.ground.model import Batch, Chunk, Clock
from tests.members import heard, outcomes, protocol, values
from tests.records import batches, records
from tests.streams.members import joint, packet, status

MS = 1_000_000

ASK = {
    "dynamixel1": packet("dynamixel1", 254, 0x92, b"\x00" + bytes((2, 1, 36, 2, 2, 36, 2, 3, 36))),
    "dynamixel2": packet("dynamixel2", 254, 0x82, b"\x84\x00\x02\x00\x01\x02\x03"),
    "feetech": packet("feetech", 254, 0x82, b"\x38\x02\x01\x02\x03"),
}
"""Two bytes of servos 1, 2 and 3."""

FAST = packet("dynamixel2", 254, 0x8A, b"\x84\x00\x02\x00\x01\x02\x03")


def answer(name: str, servo_id: int) -> bytes:
    """Return two bytes of a servo."""
    return status(name, servo_id, 0, bytes([servo_id, 8]))


def became(name: str, *said: bytes) -> list[tuple[int, int]]:
    """Return who was asked and what became of it; columns and oracle must agree."""
    p, chunks = protocol(name), [Chunk(b"".join(said))]
    got, want = records(batches(Decoder(p), [chunks])), Reference(p).decode(chunks)
    assert got.transactions == want.transactions
    return [(servo, outcome) for *_, outcome, _, servo in got.transactions]


@pytest.mark.parametrize("name", ASK)
@pytest.mark.parametrize("silent", [1, 2, 3])
def test_a_servo_that_a_list_names_and_that_says_nothing_is_missed(name: str, silent: int) -> None:
    said = [answer(name, servo) for servo in (1, 2, 3) if servo != silent]
    told = became(name, ASK[name], *said)
    assert sorted(told) == [(s, NO_RESPONSE if s == silent else OK) for s in (1, 2, 3)]


@pytest.mark.parametrize("name", ASK)
def test_where_none_of_a_list_answers_each_is_missed(name: str) -> None:
    assert became(name, ASK[name]) == [(s, NO_RESPONSE) for s in (1, 2, 3)]


@pytest.mark.parametrize("name", ASK)
def test_whoever_answers_a_list_owes_nothing_in_whatever_order(name: str) -> None:
    said = (answer(name, servo) for servo in (3, 1, 2))
    assert sorted(became(name, ASK[name], *said)) == [(s, OK) for s in (1, 2, 3)]


@pytest.mark.parametrize("name", ASK)
def test_torn_bytes_between_two_answers_are_those_of_the_servo_listed_there(name: str) -> None:
    torn = answer(name, 2)[:-1] + b"\x7e"
    told = became(name, ASK[name], answer(name, 1), torn, answer(name, 3))
    assert sorted(told) == [(1, OK), (2, DAMAGED), (3, OK)]


def test_torn_bytes_behind_the_request_are_those_of_the_first_and_the_last_is_silent() -> None:
    torn = answer("feetech", 1)[:-1] + b"\x7e"
    told = became("feetech", ASK["feetech"], torn, answer("feetech", 2))
    assert sorted(told) == [(1, DAMAGED), (2, OK), (3, NO_RESPONSE)]


def test_an_answer_of_another_length_is_one_all_the_same() -> None:
    short = status("feetech", 2, 0, b"\x02")
    told = heard("feetech", ASK["feetech"], answer("feetech", 1), short, answer("feetech", 3))
    assert outcomes(told) == ["ok", "mismatched", "ok"]
    assert {a.code for a in told.anomalies} == {"mismatched-response"}


def test_a_servo_that_is_listed_twice_owes_one_answer() -> None:
    ask = packet("feetech", 254, 0x82, b"\x38\x02\x01\x01\x02")
    assert became("feetech", ask, answer("feetech", 2)) == [(1, NO_RESPONSE), (2, OK)]


def test_who_was_told_to_answer_pings_alone_owes_a_list_nothing() -> None:
    silenced = packet("dynamixel2", 2, 3, b"\x44\x00\x00")  # status return level 0
    told = became("dynamixel2", silenced, ASK["dynamixel2"], answer("dynamixel2", 1))
    assert sorted(told[1:]) == [(1, OK), (2, NOT_EXPECTED), (3, NO_RESPONSE)]


def test_one_packet_that_answers_for_all_is_the_answer_of_each() -> None:
    whole = joint([(servo, 0, bytes([servo, 8])) for servo in (1, 2, 3)])
    assert became("dynamixel2", FAST, whole) == [(s, OK) for s in (1, 2, 3)]
    assert became("dynamixel2", FAST) == [(s, NO_RESPONSE) for s in (1, 2, 3)]


@pytest.mark.parametrize(("size", "torn"), [(5, 1), (14, 1), (15, 2), (20, 2), (21, 3), (25, 3)])
def test_of_a_packet_for_all_that_is_cut_short_each_owes_what_is_not_in_it(
    size: int, torn: int
) -> None:
    whole = joint([(servo, 0, bytes([servo, 8])) for servo in (1, 2, 3)])
    told = became("dynamixel2", FAST, whole[:size])
    assert told == [(s, DAMAGED if s <= torn else NO_RESPONSE) for s in (1, 2, 3)]


def test_who_owes_is_named_in_the_record_and_in_the_anomaly() -> None:
    ping = packet("feetech", 1, 1) + status("feetech", 1, 0)
    batch = heard("feetech", ASK["feetech"], answer("feetech", 1), answer("feetech", 3), ping)
    (told,) = (
        row
        for row in rows(batch, protocol("feetech"))
        if isinstance(row, TransactionRow) and row.outcome == "no_response"
    )
    assert (told.request_offset, told.response_offset, told.servo_id) == (0, None, 2)
    assert told.op == "sync_read"
    (found,) = (a for a in batch.anomalies if a.code == "no-response")
    assert (found.servo_id, found.detail) == (2, "servo 2 did not answer sync_read")
    assert found.evidence == ((0, len(ASK["feetech"])),)
    assert len(values("feetech", batch)) == 2


def test_an_answer_that_comes_late_is_that_of_the_servo_that_owed_it() -> None:
    ask, p = ASK["dynamixel2"], protocol("dynamixel2")
    decoder = Decoder(p, baud=57600, latency_ns=0)
    said = [
        Chunk(ask + answer("dynamixel2", 1) + answer("dynamixel2", 2), 10 * MS, Clock.READ),
        Chunk(answer("dynamixel2", 3), 900 * MS, Clock.READ),
    ]
    told = [a for b in (decoder.feed(*said), decoder.close()) for a in b.anomalies]
    assert [(a.code, a.servo_id) for a in told] == [("no-response", 3), ("late-response", 3)]


def test_an_adapters_echo_owes_no_answers_of_its_own() -> None:
    once = [ASK["feetech"], ASK["feetech"], *(answer("feetech", s) for s in (1, 2, 3))]
    ping = packet("feetech", 1, 1)
    proof = [ping, ping, status("feetech", 1, 0)] * 9
    told = became("feetech", *proof, *once)
    assert [t for t in told if t[1] == NO_RESPONSE] == []


@pytest.mark.parametrize(("size", "times"), [(1, 6), (7, 50), (64, 90), (4096, 90)])
def test_what_a_list_is_owed_does_not_depend_on_how_the_bytes_come(size: int, times: int) -> None:
    once = [ASK["dynamixel2"], *(answer("dynamixel2", servo) for servo in (1, 3))]
    fast = [FAST, joint([(servo, 0, bytes([servo, 8])) for servo in (1, 2, 3)])]
    data, p = b"".join([*once, *fast] * times), protocol("dynamixel2")

    def told(groups: list[list[Chunk]]) -> list[Batch]:
        return batches(Decoder(p), groups)

    cut = [[Chunk(data[at : at + size])] for at in range(0, len(data), size)]
    assert records(told(cut)).transactions == records(told([[Chunk(data)]])).transactions
