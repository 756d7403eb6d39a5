"""Weights of the causes that are a servo's."""

from __future__ import annotations

from typing import Final

from sniffer.diagnosis.weights.table import for_

WEIGHTS: Final = (
    *for_(
        "brownout",
        ("voltage-sag", 3.0, "its supply is measured low"),
        ("device-input-voltage", 3.0, "it complains of its supply"),
        ("away-for-a-while", 1.0, "it is silent meanwhile"),
        ("device-recovered", 0.3, "it comes back"),
        ("no-response", 0.5, "it answers nothing meanwhile"),
        ("damaged-response", 0.3, "it breaks off an answer"),
        ("idle-tail", 0.5, "it breaks off in a frame"),
    ),
    *for_(
        "servo-dead",
        ("silent-since", 4.0, "it answered and never again"),
        ("no-response", 0.6, "requests without an answer"),
    ),
    *for_(
        "servo-absent",
        ("never-answered", 4.0, "it never answered"),
        ("no-response", 0.6, "requests without an answer"),
    ),
    *for_(
        "id-changed",
        ("id-changed", 3.0, "a frame gives the servo another id"),
        ("silent-since", 2.0, "the old id is silent since"),
        ("no-response", 0.6, "the old id is asked still"),
    ),
    *for_(
        "baud-changed",
        ("baud-changed", 3.0, "a frame gives the servo another rate"),
        ("silent-since", 2.0, "it is silent since"),
        ("no-response", 0.6, "it is asked at the old rate still"),
    ),
)
"""One line each."""
