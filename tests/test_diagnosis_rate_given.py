"""A servo is told another rate, and the line goes on at that: to this receiver it is noise."""

from __future__ import annotations

import pytest

from tests.conversations import Conversation
from tests.diagnosed import verdicts
from tests.streams import mightyzap

GIVES = {
    "mightyzap": (mightyzap.packet(1, 0xF3, b"\x04\x10"), mightyzap.packet(1, 0xF8)),
    "lss": (b"#1CB9600\r", b"#1RESET\r"),
}
HEARD = {
    "mightyzap": bytes.fromhex("9453b8"),  # said at twice the rate
    "lss": bytes(8),  # of one that is twelve times slower the starts of its bits are left
}


def told(protocol: str, *, behind: int, gives: bool = True) -> Conversation:
    """Ask a servo, tell it another rate, and hear so many answers that are none at this one."""
    talk = Conversation(protocol)
    for _ in range(60):
        talk.read(1, 0.5)
        talk.rest(20)
    for request in GIVES[protocol] if gives else ():
        talk.write(request)
    for _ in range(behind):
        talk.rest(25)
        talk.say(HEARD[protocol])
    return talk


@pytest.mark.parametrize("protocol", GIVES)
def test_a_line_on_which_nothing_holds_since_a_servo_was_told_another_rate_is_not_disturbed(
    protocol: str,
) -> None:
    """It was a line that is stuck, or noise; and the frame that explains all of it was known."""
    (incident,) = told(protocol, behind=80).diagnosed().incidents()
    assert verdicts([incident]) == [("baud-changed", (1,))]
    assert incident.causes[0].confidence > 0.9


@pytest.mark.parametrize("protocol", GIVES)
def test_nobody_blames_a_rate_that_was_not_given_or_was_not_used(protocol: str) -> None:
    assert "baud-changed" not in {
        cause
        for cause, _ in verdicts(told(protocol, behind=80, gives=False).diagnosed().incidents())
    }
    assert not told(protocol, behind=0).diagnosed().incidents()
