"""Ids that are staged and executed, and ids that a factory reset gives."""

from __future__ import annotations

import pytest

import sniffer
from tests.streams.mightyzap import packet


def told(data: bytes) -> list[sniffer.Record]:
    return list(sniffer.decode(data, "mightyzap", input_format="bin"))


def outcomes(data: bytes) -> list[str]:
    return [r.outcome for r in told(data) if r.type == "transaction"]


def ok(servo: int, status: int = 0) -> bytes:
    return packet(servo, status)


def stage(new: int) -> bytes:
    return packet(1, 0xF4, bytes([0x03, new])) + ok(1)


def execute(servo: int) -> bytes:
    return packet(servo, 0xF5)


ANSWERS_ALL = packet(1, 0xF3, b"\x10\x02") + ok(1)
STAGED = ANSWERS_ALL + stage(2)
POLL = packet(3, 0xF2, b"\x8c\x02") + packet(3, 0, bytes(2))


def test_the_answer_to_an_execution_under_the_staged_id_is_its_answer() -> None:
    assert outcomes(STAGED + execute(1) + ok(2)) == ["ok"] * 3
    assert outcomes(STAGED + execute(1) + ok(1)) == ["ok"] * 3  # it has not obeyed yet
    assert outcomes(STAGED + 99 * POLL + execute(1) + ok(2))[-1] == "ok"
    assert outcomes(STAGED + stage(4) + execute(1) + ok(4))[-1] == "ok"


def test_the_answer_to_an_execution_under_any_other_id_is_no_answer_of_it() -> None:
    assert outcomes(STAGED + execute(1) + ok(3))[-1] == "mismatched"
    assert outcomes(STAGED + execute(254) + execute(1) + ok(2))[-1] == "mismatched"
    assert outcomes(STAGED + execute(1) + ok(2) + execute(1) + ok(2))[-1] == "mismatched"
    assert outcomes(execute(1) + ok(2))[-1] == "mismatched"


@pytest.mark.parametrize(
    ("option", "status", "ids"), [(1, 0, [0]), (3, 0, [0]), (2, 0, []), (0, 0, []), (1, 0x08, [])]
)
def test_a_factory_reset_that_gives_an_id_says_so_unless_it_is_refused(
    option: int, status: int, ids: list[int]
) -> None:
    data = packet(1, 0xF6, bytes([option])) + ok(1, status)
    found = [r for r in told(data) if r.type == "anomaly" and r.code == "id-changed"]
    said = [f"servo 1 was given the id {i} by a factory reset" for i in ids]
    assert [r.detail for r in found] == said
