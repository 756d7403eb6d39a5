"""Weights of the causes that are the controller's."""

from __future__ import annotations

from typing import Final

from sniffer.diagnosis.weights.table import for_

WEIGHTS: Final = (
    *for_(
        "malformed-command",
        ("malformed-body", 3.0, "frames whose body their command cannot have"),
        ("unknown-command", 2.5, "commands that stand in no manual"),
        ("no-response", 0.3, "servos do not answer it"),
    ),
)
"""One line each."""
