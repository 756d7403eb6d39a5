"""Limits that are written hold from then on: what was so before broke none."""

from __future__ import annotations

import pytest

from tests.conversations import T0, Conversation, swinging
from tests.diagnosed import found, verdicts
from tests.streams import mightyzap, rs30x

LONG_LIMIT_AT, CW_LIMIT_AT = 0x08, 0x08
"""Addresses of mightyZAP and RS30x."""

TEMPERATURE_LIMIT_AT, LOWEST_VOLTAGE_AT, HIGHEST_VOLTAGE_AT = 0x0B, 0x0C, 0x0D
TEMPERATURE_AT, VOLTAGE_AT = 0x93, 0x92
"""Addresses of mightyZAP."""

INPUT_VOLTAGE, OVERHEATING = 0x01, 0x04
"""Bits of its status."""


def measured(
    limit_at: int, limit: int, address: int, raw: int, *, alarm: int = 0, since: int = 200
) -> Conversation:
    """Read a value that never changes; after five seconds its limit is written.

    ``alarm`` is what each answer has for its status from the round ``since`` on.
    """
    talk = Conversation("mightyzap")
    for k in range(400):
        talk.until(k / 40)
        if k == 200:
            talk.write(mightyzap.packet(1, 0xF3, bytes([limit_at, limit])))
        talk.say(mightyzap.packet(1, 0xF2, bytes([address, 1])))
        talk.rest(0.3)
        talk.say(mightyzap.packet(1, alarm if k >= since else 0, bytes([raw])))
        talk.rest(1)
    return talk


@pytest.mark.parametrize(
    ("talk", "code", "told"),
    [
        (
            measured(TEMPERATURE_LIMIT_AT, 40, TEMPERATURE_AT, 42),
            "temperature-high",
            "42 °C, its limit is 40 °C, written at 5.0",
        ),
        (
            measured(LOWEST_VOLTAGE_AT, 115, VOLTAGE_AT, 110),
            "voltage-sag",
            "11 V at least, usually 11 V, its limit is 11.5 V, written at 5.0",
        ),
    ],
)
def test_a_limit_holds_from_when_it_is_written(talk: Conversation, code: str, told: str) -> None:
    (finding,) = (f for f in found(talk.diagnosed()) if f.code == code)
    assert finding.first_ns >= T0 + 5_000_000_000
    assert told in finding.what


def test_what_is_at_its_lowest_what_it_usually_is_does_not_sag() -> None:
    talk = measured(LOWEST_VOLTAGE_AT, 115, VOLTAGE_AT, 110)
    (finding,) = (f for f in found(talk.diagnosed()) if f.code == "voltage-sag")
    assert finding.brief == "supply of servo 1 is below its limit, 11.5 V: 11 V"


@pytest.mark.parametrize(
    ("protocol", "request_"),
    [
        ("mightyzap", mightyzap.packet(1, 0xF3, bytes([LONG_LIMIT_AT, 0xE8, 3]))),
        ("rs30x", rs30x.write(1, CW_LIMIT_AT, (300).to_bytes(2, "little"))),
    ],
)
def test_of_two_limits_the_one_that_nobody_said_is_as_shipped(
    protocol: str, request_: bytes
) -> None:
    talk = Conversation(protocol)
    for k in range(400):
        talk.until(k / 40)
        if k == 200:
            talk.write(request_)
        talk.send(1, swinging(1, talk.now_s))
        talk.read(1, 0.3)
    (told,) = (f for f in found(talk.diagnosed()) if f.code == "goal-beyond-limits")
    assert told.first_ns >= T0 + 5_000_000_000


@pytest.mark.parametrize(
    ("limit_at", "limit", "address", "raw", "alarm"),
    [
        (TEMPERATURE_LIMIT_AT, 40, TEMPERATURE_AT, 42, OVERHEATING),
        (LOWEST_VOLTAGE_AT, 115, VOLTAGE_AT, 110, INPUT_VOLTAGE),
        (HIGHEST_VOLTAGE_AT, 110, VOLTAGE_AT, 120, INPUT_VOLTAGE),
    ],
)
def test_an_alarm_that_a_limit_brings_is_no_fault_of_what_is_measured(
    limit_at: int, limit: int, address: int, raw: int, alarm: int
) -> None:
    talk = measured(limit_at, limit, address, raw, alarm=alarm)
    assert verdicts(talk.diagnosed().incidents()) == [("limit-misplaced", (1,))]


def test_an_alarm_of_before_the_limit_was_written_is_not_the_limits() -> None:
    talk = measured(LOWEST_VOLTAGE_AT, 115, VOLTAGE_AT, 110, alarm=INPUT_VOLTAGE, since=100)
    assert verdicts(talk.diagnosed().incidents()) == [("brownout", (1,))]
