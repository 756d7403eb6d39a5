"""Connections that get worse: how much is lost when is told."""

from __future__ import annotations

import random
from dataclasses import replace

import pytest

from tests.conversations import BAUD, Conversation, robot, swinging
from tests.diagnosed import codes, diagnosed, found, verdicts
from tests.lists import each_in_turn


def losing(*, gets_worse: bool) -> Conversation:
    """Return a loop in which one servo loses answers: more and more of them, or a few all along."""
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
    return talk


@pytest.mark.parametrize("gets_worse", [False, True])
def test_a_servo_that_loses_more_and_more_answers_is_told_so_by_quarters(
    *, gets_worse: bool
) -> None:
    told = losing(gets_worse=gets_worse).diagnosed()
    (lost,) = (f for f in found(told) if f.code == "comes-and-goes")
    more = [f.what for f in found(told) if f.code == "lost-more-and-more"]
    assert [what.startswith("servo 2 loses more and more: 0, ") for what in more] == [
        True
    ] * gets_worse
    assert (lost.brief == "servo 2 loses more and more answers") == gets_worse


@pytest.mark.parametrize(
    "bad",
    [
        pytest.param([range(1400, 1500)], id="the end"),
        pytest.param([range(1000, 1250)], id="it is over"),
        pytest.param([range(k, k + 20) for k in (700, 1000, 1300, 1400)], id="clusters"),
    ],
)
def test_bad_whiles_late_in_the_time_are_not_more_and_more(bad: list[range]) -> None:
    rng = random.Random(5)
    talk = Conversation("mightyzap")
    for k in range(1500):
        is_bad = any(k in some for some in bad) and rng.random() < 0.5
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


@each_in_turn(2, "gets_worse", [False, True])
def test_a_line_on_which_more_and_more_is_damaged_is_told_so_by_quarters(
    *, gets_worse: bool
) -> None:
    rng = random.Random(3)
    chunks = robot("mightyzap", 40).chunks
    for k, chunk in enumerate(chunks):
        if rng.random() < 0.02 * (k / len(chunks) if gets_worse else 0.5):
            place = rng.randrange(len(chunk.data))
            data = bytearray(chunk.data)
            data[place] ^= 1 << rng.randrange(8)
            chunks[k] = replace(chunk, data=bytes(data))
    told = diagnosed(chunks, "mightyzap", baud=BAUD)
    assert verdicts(told.incidents())[0] == ("bus-noise", ())
    (damage,) = (f for f in found(told) if f.code == "damage-everywhere")
    assert ("; more and more: " in damage.what) == gets_worse
