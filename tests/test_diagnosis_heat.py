"""A servo that is far hotter than those beside it, and not yet at its limit."""

from __future__ import annotations

import pytest

from tests.conversations import Conversation, robot
from tests.diagnosed import codes, found, verdicts
from tests.servos import heard, mightyzap_read

TEMPERATURE = 0x93
"""Of a mightyZAP, in degrees."""


def measured(*levels: list[int]) -> list[tuple[float, bytes]]:
    """Ask all servos once a second how hot they are."""
    return sorted(
        row
        for servo, told in enumerate(levels, 1)
        for k, level in enumerate(told)
        for row in mightyzap_read(servo, k + servo / 10, TEMPERATURE, bytes([level]))
    )


COOL = [[30 + k // 40 for k in range(120)]] * 3
WARMS = [30 + k // 3 for k in range(120)]


def test_a_servo_that_is_far_hotter_than_all_others_is_too_hot_before_its_limit() -> None:
    d = heard(measured(*COOL, WARMS), "mightyzap")
    assert verdicts(d.incidents()) == [("overheat", (4,))]
    (above,) = found(d)
    assert above.what.startswith(
        "servo 4 measures 69 °C, and none of the other 3 ever more than 32 °C; "
    )
    assert d.incidents()[0].causes[0].confidence < 0.7


@pytest.mark.parametrize(
    "levels",
    [
        pytest.param([*COOL, WARMS, WARMS], id="two joints that do the same"),
        pytest.param([*COOL[:2], WARMS], id="two others tell too little"),
        pytest.param([*COOL, WARMS[:84]], id="no hotter than work makes it"),
        pytest.param([*COOL, [30] * 60 + [69] * 8 + [30] * 52], id="a value that passes"),
    ],
)
def test_what_may_be_work_or_a_misread_value_is_not(levels: list[list[int]]) -> None:
    assert "hotter-than-others" not in codes(heard(measured(*levels), "mightyzap"))


@pytest.mark.parametrize(
    ("reason", "cause"), [(1, "overload"), (2, "brownout"), (3, "overheat")], ids=str
)
def test_the_reason_for_which_a_servo_says_that_it_protects_itself_is_the_cause(
    reason: int, cause: str
) -> None:
    """By its safe mode alone it was too hot, whatever it said when it was asked why."""

    def asks(talk: Conversation, cycle: int) -> None:
        is_safe = cycle > 160
        for question, answer in (("Q", 10 if is_safe else 1), ("Q1", reason if is_safe else 0)):
            talk.say(f"#2{question}\r".encode())
            talk.rest(0.3)
            talk.say(f"*2Q{answer}\r".encode())
            talk.rest(0.4)

    told = robot("lss", 12, rate_hz=20, behind=asks, goals=False).diagnosed().incidents()
    assert verdicts(told) == [(cause, (2,))]
    assert told[0].causes[0].confidence > 0.8
