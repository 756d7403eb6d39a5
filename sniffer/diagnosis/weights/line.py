"""Weights of the causes that are the line's."""

from __future__ import annotations

from typing import Final

from sniffer.diagnosis.weights.table import for_

WEIGHTS: Final = (
    *for_(
        "bus-noise",
        ("damage-everywhere", 4.0, "all senders are hit alike"),
        ("damage-one-servo", -3.0, "only one servo is hit"),
        ("bad-checksum", 0.8, "frames fail their checksum"),
        ("damaged-frame", 0.8, "frames contradict themselves"),
        ("truncated-frame", 0.6, "frames are cut"),
        ("idle-tail", 0.5, "frames are cut by silence"),
        ("noise", 0.6, "bytes that are no frame"),
        ("no-response", 0.4, "a damaged request is not answered"),
        ("damaged-response", 0.6, "answers are torn"),
        ("mismatched-response", 0.4, "a torn answer may hold by chance"),
        ("unsolicited-response", 0.4, "the request before it was damaged"),
        ("ambiguous-response", 0.3, "an answer is missing"),
        ("unknown-command", 0.3, "a torn frame may hold by chance"),
        ("malformed-body", 0.2, "a torn frame may hold by chance"),
        ("line-error", 0.8, "the UART saw bytes without a stop bit"),
        ("late-response", 0.2, "the answer to a damaged request may be taken for a late one"),
    ),
    *for_(
        "bad-cable",
        ("damage-one-servo", 3.0, "only this servo's answers are hit"),
        ("bad-checksum", 0.5, "its frames fail their checksum"),
        ("damaged-response", 0.6, "its answers are torn"),
        ("truncated-frame", 0.5, "its frames are cut"),
        ("no-response", 0.5, "it misses requests"),
        ("noise", 0.3, "bytes that are no frame"),
        ("away-for-a-while", 1.5, "it is away for moments"),
    ),
)
"""One line each."""
