"""Talk of two who ask the same servos, each in rounds of its own period."""

from __future__ import annotations

import itertools
from typing import Final

from tests.conversations import Conversation, swinging

SERVOS: Final = range(1, 6)


def two_rounds(*periods_ms: float, apart_ms: float) -> Conversation:
    """Return rounds of the same questions; what begins too near the last one is torn."""
    asked = sorted(
        (cycle * period + servo * 1.7 + nth, servo)
        for nth, period in enumerate(periods_ms)
        for cycle, servo in itertools.product(range(round(9000 / period)), SERVOS)
    )
    talk, last_ms = Conversation("lss"), -9.0
    for at_ms, servo in asked:
        if at_ms - last_ms < apart_ms:
            talk.say(talk.tongue.ask(servo)[1:] + b"\x8f")
            talk.rest(0.3)
        else:
            talk.until(at_ms / 1e3)
            talk.say(talk.tongue.ask(servo))
            talk.rest(0.3)
            talk.say(talk.tongue.answer(servo, swinging(servo, talk.now_s)))
        last_ms = at_ms
    return talk
