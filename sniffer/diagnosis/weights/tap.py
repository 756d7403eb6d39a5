"""Weights of the causes that are the tap's."""

from __future__ import annotations

from typing import Final

from sniffer.diagnosis.weights.table import for_

WEIGHTS: Final = (
    *for_(
        "echo",
        ("adapter-echo", 4.0, "every request stands there twice, byte for byte"),
    ),
    *for_(
        "tap-loss",
        ("bytes-lost", 4.0, "the tap's driver counted losses"),
        ("port-lost", 3.0, "the port went away"),
        ("not-decoded", 0.5, "the recorder was too slow to decode"),
        ("no-response", 0.5, "answers are missing where the tap lost bytes"),
        ("damaged-response", 0.5, "answers lack bytes where the tap lost them"),
        ("truncated-frame", 0.5, "frames lack bytes"),
        ("bad-checksum", 0.3, "frames lack bytes"),
    ),
    *for_(
        "tap-swapped",
        ("direction-mismatch", 4.0, "frames came in on the other wire than theirs"),
    ),
    *for_(
        "tap-one-way",
        ("no-answer-heard", 3.5, "many requests to several servos, and not one answer"),
        ("no-request-heard", 4.0, "answers, and not one request"),
        ("no-response", 0.5, "the answers are on the wire that is not heard"),
        ("unsolicited-response", 0.5, "the requests are on the wire that is not heard"),
    ),
)
"""One line each."""
