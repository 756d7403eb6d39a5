"""Weights of the manner in which one servo misses requests."""

from __future__ import annotations

from typing import Final

from sniffer.diagnosis.weights.table import for_

WEIGHTS: Final = (
    *for_(
        "clock-drift", ("same-request-missed", -1.5, "a clock misreads the same bytes each time")
    ),
    *(
        weight
        for cause in ("servo-reset-loop", "brownout")
        for weight in for_(
            cause, ("missed-one-by-one", -1.5, "who starts anew is away for as long each time")
        )
    ),
    *for_(
        "signal-integrity",
        ("one-question-unanswered", -4.0, "who hears the controller badly chooses no question"),
    ),
    *for_(
        "brownout",
        ("outages-behind-steps", 3.5, "motors that set out take more than it bears"),
    ),
    *for_(
        "servo-reset-loop",
        ("outages-behind-steps", -1.0, "who starts anew by itself waits for no goal"),
    ),
    *for_(
        "bad-cable",
        ("outages-behind-steps", 0.8, "a contact opens as the arm jerks"),
        ("same-request-missed", 0.1, "a contact does not look at the bytes"),
        ("missed-one-by-one", -0.3, "a contact opens for moments of all lengths"),
    ),
)
"""One line each."""
