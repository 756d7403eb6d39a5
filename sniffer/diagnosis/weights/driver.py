"""Weights of what shows that a driver is on or off at the wrong time: nothing else takes only ends."""

from __future__ import annotations

from typing import Final

from sniffer.diagnosis.weights.table import Weight, for_

_OF_ANSWERS: Final = ("answers-begin-undriven", "answers-end-undriven")
_OF_REQUESTS: Final = ("requests-begin-undriven", "requests-end-undriven")

_ELSE: Final = (
    *("bus-noise", "bad-cable", "clock-drift", "duplicate-id", "impatient-controller"),
    *("two-masters", "wrong-baud", "mixed-protocols", "malformed-command", "chatty-device"),
)
"""Causes that tear frames anywhere."""

WEIGHTS: Final[tuple[Weight, ...]] = (
    *for_(
        "turnaround",
        *((code, 7.0, "the driver of who answers is not on then") for code in _OF_ANSWERS),
        *((code, 7.0, "the controller's driver is not on then") for code in _OF_REQUESTS),
    ),
    *(
        weight
        for cause in _ELSE
        for weight in for_(
            cause,
            *(
                (code, -6.0, "only what nobody drives is wrong, and all the rest is right")
                for code in (*_OF_ANSWERS, *_OF_REQUESTS)
            ),
        )
    ),
    *(
        weight
        for cause in ("tap-loss", "tap-not-raw")
        for weight in for_(
            cause,
            *(
                (code, 0.1, "what is left out may be the end of a frame")
                for code in (*_OF_ANSWERS, *_OF_REQUESTS)
            ),
        )
    ),
    *for_(
        "signal-integrity",
        *(
            (code, -2.0, "a weak signal does not choose the ends")
            for code in (*_OF_ANSWERS, *_OF_REQUESTS)
        ),
    ),
)
"""One line each."""
