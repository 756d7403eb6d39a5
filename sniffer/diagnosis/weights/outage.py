"""Weights of outages that are too few for a habit: whoever explains silences explains them, too."""

from __future__ import annotations

from typing import Final

from sniffer.diagnosis.weights import controller, device, identity, line, tap, wire
from sniffer.diagnosis.weights.table import for_

OUTAGE, SELDOM = "servo-outage", "away-seldom"

STARTS_ANEW: Final = "brownout"
"""What a servo that was away once, and is back, is likeliest to have done where nothing tells that it
kept its power."""

_SILENCES: Final = ("away-for-a-while", "silent-since")

_EXPLAIN: Final = {
    w.cause: w.reason
    for w in (
        *tap.WEIGHTS,
        *line.WEIGHTS,
        *wire.WEIGHTS,
        *device.WEIGHTS,
        *identity.WEIGHTS,
        *controller.WEIGHTS,
    )
    if w.finding in _SILENCES and w.weight > 0
}
"""Causes that explain silences, and why."""

WEIGHTS: Final = (
    *for_(
        OUTAGE,
        (SELDOM, 2.0, "it was away once or twice, and that is all"),
        ("away-for-a-while", 0.2, "it is silent meanwhile"),
        ("silent-since", 0.2, "it was away when nobody listened any more"),
        ("no-response", 0.2, "it answers nothing meanwhile"),
        ("supply-steady", 1.2, "its supply was in order before"),
        ("torque-survives", 1.2, "it kept its power"),
        ("goes-on-unanswered", 0.2, "the controller goes on without it"),
        *(
            (code, 0.1, "it breaks off in an answer")
            for code in ("idle-tail", "truncated-frame", "damaged-response", "bad-checksum")
        ),
        *(
            (code, -3.0, "its supply is low then")
            for code in ("voltage-sag", "supply-runs-down", "device-input-voltage")
        ),
        *(
            (code, -1.0, "it was without power: more is known")
            for code in ("back-at-defaults", "torque-gone", "joint-limp-after-restart")
        ),
        *(
            (code, -5.0, "others go with it: it is what they share")
            for code in ("all-away-at-once", "several-away-at-once")
        ),
        ("device-safe-mode", -2.0, "it protects itself: more is known"),
        ("others-away-too", -1.5, "another servo goes away as well"),
        ("away-for-long", -2.5, "what is over by itself is over in seconds"),
        ("start-takes-long", -3.0, "it is away because it was told to start anew"),
        ("one-question-unanswered", -4.0, "it is the question that it does not answer"),
        *(
            (code, -3.0, "it was told something that silences it")
            for code in (
                "silent-since-an-order",
                "old-id-asked",
                "both-ids-asked",
                "silent-at-old-rate",
                "silent-in-other-mode",
            )
        ),
        *(
            (code, -3.5, "it leaves answers out by a rule")
            for code in ("all-miss-alike", "first-behind-rest", "answers-every-nth")
        ),
    ),
    *(
        weight
        for cause, reason in _EXPLAIN.items()
        for weight in for_(cause, (SELDOM, 0.1, reason))
        if cause != STARTS_ANEW
    ),
    *for_(STARTS_ANEW, (SELDOM, 1.4, "it starts anew, which takes so long")),
)
"""One line each."""
