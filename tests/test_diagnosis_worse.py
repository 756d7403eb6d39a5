"""Connections that get worse: how much is lost when is told."""

from __future__ import annotations

import random

import pytest

from tests.conversations import Conversation, swinging
from tests.diagnosed import codes, found


@pytest.mark.parametrize("gets_worse", [False, True])
def test_a_servo_that_loses_more_and_more_answers_is_told_so_by_quarters(
    *, gets_worse: bool
) -> None:
    rng = random.Random(9)
    talk = Conversation("mightyzap")
    for k in range(1500):
        share = 0.2 * (k - 500) / 1000 if gets_worse else 0.07
        for servo in (1, 2, 3):
            if servo == 2 and rng.random() < share:
                talk.ask_in_vain(servo)
            else:
                talk.read(servo, swinging(servo, talk.now_s))
        talk.rest(15)
    told = talk.diagnosed()
    (lost,) = (f for f in found(told) if f.code == "comes-and-goes")
    more = [f.what for f in found(told) if f.code == "lost-more-and-more"]
    assert [what.startswith("servo 2 loses more and more: 0, ") for what in more] == [
        True
    ] * gets_worse
    assert (lost.brief == "servo 2 loses more and more answers") == gets_worse


@pytest.mark.parametrize("ends", [False, True])
def test_a_bad_while_late_in_the_time_is_not_more_and_more(*, ends: bool) -> None:
    rng = random.Random(5)
    talk = Conversation("mightyzap")
    for k in range(1500):
        is_bad = (1000 < k < 1250 if ends else 1400 < k < 1500) and rng.random() < 0.5
        for servo in (1, 2, 3):
            if servo == 2 and is_bad:
                talk.ask_in_vain(servo)
            else:
                talk.read(servo, swinging(servo, talk.now_s))
        talk.rest(15)
    told = talk.diagnosed()
    assert "comes-and-goes" in codes(told)
    assert "lost-more-and-more" not in codes(told)
    assert not any("more and more" in f.brief for f in found(told))


def test_what_gets_worse_is_a_contact_and_no_clock_that_is_off() -> None:
    """Each time it is away for one question, whole before and behind: so a clock has it, too."""
    rng = random.Random(21)
    talk = Conversation("mightyzap")
    for k in range(4000):
        share = 0 if k < 2400 else 0.005 + 0.08 * (k - 2400) / 1600
        for servo in (1, 2, 3, 4):
            if servo == 3 and rng.random() < share:
                talk.ask_in_vain(servo)
            else:
                talk.read(servo, swinging(servo, talk.now_s))
        talk.rest(40)
    (incident,) = talk.diagnosed().incidents()
    assert (incident.cause, incident.servo_ids) == ("bad-cable", (3,))
