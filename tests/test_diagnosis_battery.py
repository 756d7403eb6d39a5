"""Supplies that run down: a battery that is empty is charged, and no sag under load."""

from __future__ import annotations

import pytest

from tests.conversations import Conversation
from tests.diagnosed import codes, verdicts
from tests.streams import rs30x

SERVOS = (1, 2, 3)


def powered(volts: list[float], *, dies: bool) -> Conversation:
    """Return a loop that reads three servos' voltage, so many volts a second; then silence."""
    talk = Conversation("rs30x")
    for second, volt in enumerate(volts):
        while talk.now_s < second + 1:
            for servo in SERVOS:
                talk.say(rs30x.packet(servo, 0x0F, 0x34, 2, 0))
                talk.rest(0.3)
                talk.say(rs30x.returned(servo, 0x34, round(volt * 100).to_bytes(2, "little")))
                talk.rest(10)
    for _ in range(40 if dies else 0):
        for servo in SERVOS:
            talk.ask_in_vain(servo)
    return talk


def test_a_battery_that_runs_down_until_all_are_silent_is_one_incident_and_wants_charging() -> None:
    volts = [11.5 - 0.09 * k for k in range(40)]
    told = powered(volts, dies=True).diagnosed().incidents()
    assert verdicts(told) == [("brownout", SERVOS)]
    assert told[0].next.startswith("Charge or replace the battery")


@pytest.mark.parametrize(
    "volts",
    [
        pytest.param([11.5 - 0.03 * k for k in range(40)], id="it is a tenth lower, and enough"),
        pytest.param([11.5] * 40, id="it stays"),
    ],
)
def test_a_battery_that_gives_what_servos_need_is_no_incident(volts: list[float]) -> None:
    assert not powered(volts, dies=False).diagnosed().incidents()


def test_a_supply_that_comes_back_does_not_run_down() -> None:
    volts = [11.5 - 0.09 * k for k in range(30)] + [11.5] * 10
    assert "supply-runs-down" not in codes(powered(volts, dies=False).diagnosed())
