"""Questions behind what has no answer: which of the two a servo left unanswered."""

from __future__ import annotations

from typing import TYPE_CHECKING

from sniffer.protocols.lss import grammar as lss
from tests.conversations import Conversation
from tests.diagnosed import codes, verdicts

if TYPE_CHECKING:
    from collections.abc import Callable


def told_and_asked(lost: Callable[[str, float], bool]) -> Conversation:
    """Three servos that are sent somewhere and asked four things each, in one go, in a cycle."""
    talk = Conversation("lss")
    for cycle in range(150):
        talk.until(cycle / 5)
        for servo in (1, 2, 3):
            talk.say(lss.command(servo, "D", 10 * (cycle % 40)))
            talk.rest(0.3)
            for word, value in (("QD", 10 * (cycle % 40)), ("QC", 140), ("QV", 11800), ("QT", 301)):
                talk.say(lss.command(servo, word, None))
                if servo == 2 and lost(word, talk.now_s):
                    talk.rest(20)
                    continue
                talk.rest(0.3)
                talk.say(lss.reply(servo, word, value))
                talk.rest(0.3)
    return talk


def test_what_a_servo_is_told_before_its_first_question_does_not_make_it_refuse_that_one() -> None:
    """A goal of LSS has no answer: who goes away before it is missed at the question behind it."""
    told = told_and_asked(lambda word, now_s: now_s % 2.5 < 0.7).diagnosed()
    assert "one-question-unanswered" not in codes(told)
    assert "servo-refuses" not in {cause for cause, _ in verdicts(told.incidents())}


def test_who_is_told_something_before_the_one_question_it_leaves_unanswered_refuses_it() -> None:
    told = told_and_asked(lambda word, now_s: word == "QD" and now_s % 2.5 < 0.7).diagnosed()
    assert "one-question-unanswered" in codes(told)
    assert verdicts(told.incidents())[:1] == [("servo-refuses", (2,))]
