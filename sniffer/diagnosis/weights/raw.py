"""Weights of a capture that is not raw: it explains what any damage does, and acquits all others."""

from __future__ import annotations

from typing import Final

from sniffer.diagnosis.weights import tap, wire
from sniffer.diagnosis.weights.table import Weight, for_

TAP_NOT_RAW: Final = "tap-not-raw"

PROOF: Final = "bytes-translated"

_LIKE: Final = ("tap-loss", "wrong-baud")
"""Causes that tear frames of all senders alike: what follows from them follows from this as well."""

_TORN: Final = dict.fromkeys(
    w.finding for w in (*tap.WEIGHTS, *wire.WEIGHTS) if w.cause in _LIKE and w.weight > 0
)

_BEFORE: Final = ("line-error", "line-break", "bytes-lost")
"""What the UART or its driver finds."""

_ACQUITTED: Final = (
    *("wrong-baud", "bus-noise", "emi-load", "signal-integrity", "turnaround", "line-stuck"),
    *("mixed-protocols", "bad-cable", "clock-drift", "duplicate-id", "chatty-device"),
    *("two-masters", "impatient-controller", "malformed-command", "retry-storm", "servo-refuses"),
    *("tap-loss", "tap-one-way", "echo"),
)
"""Causes that are concluded from torn frames, or from frames that are missing."""

WEIGHTS: Final[tuple[Weight, ...]] = (
    *for_(
        TAP_NOT_RAW,
        (PROOF, 9.0, "frames hold as soon as the exchange is undone"),
        *((code, 0.1, "frames are torn by it") for code in _TORN if code not in _BEFORE),
        *((code, -2.0, "bytes were torn before any program had them") for code in _BEFORE),
    ),
    *(
        weight
        for cause in _ACQUITTED
        for weight in for_(cause, (PROOF, -7.0, "what is torn here was whole on the wire"))
    ),
)
"""One line each."""
