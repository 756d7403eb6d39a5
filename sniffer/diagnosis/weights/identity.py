"""Weights of the causes that are what a servo was told to be: another id, another rate, silent."""

from __future__ import annotations

from typing import Final

from sniffer.diagnosis.weights.table import Weight, for_

_GONE: Final = (
    ("goes-on-unanswered", 0.2, "the controller goes on without it"),
    ("supply-steady", 0.1, "its supply was in order"),
)
"""What goes with a servo that is heard no more, and does not say why."""

WEIGHTS: Final[tuple[Weight, ...]] = (
    *for_(
        "id-changed",
        ("old-id-asked", 3.5, "the old id is asked still, in vain"),
        ("both-ids-asked", 3.5, "the old id is asked still, in vain, beside the new one"),
        ("id-changed", 1.5, "a frame gives the servo another id"),
        ("silent-since", 1.4, "the old id is silent since"),
        ("never-answered", 1.2, "the old id does not answer"),
        ("no-response", 0.6, "the old id is asked still"),
        *_GONE,
        ("duplicate-response", 0.2, "the new id was another servo's already"),
    ),
    *for_(
        "baud-changed",
        ("silent-at-old-rate", 3.5, "it is silent since it was told another rate"),
        ("torn-at-old-rate", 4.0, "nothing holds since it was told another rate"),
        ("baud-changed", 1.5, "a frame gives the servo another rate"),
        ("silent-since", 1.4, "it is silent since"),
        ("no-response", 0.6, "it is asked at the old rate still"),
        *_GONE,
        ("noise", 0.2, "what it says at its rate is none at this one"),
        ("away-for-a-while", 0.2, "it begins anew"),
    ),
    *for_(
        "silenced",
        ("reads-unanswered-as-told", 5.0, "it is asked what it was told not to answer"),
        (
            "silent-since-an-order",
            2.8,
            "it is silent since it was told what it is told hardly ever",
        ),
        ("silent-in-other-mode", 4.5, "it is silent since it was told to leave this protocol"),
        ("silent-since", 1.4, "it is silent since"),
        ("no-response", 0.6, "it is asked still"),
        *_GONE,
        ("away-for-a-while", 0.2, "it begins anew"),
    ),
)
"""One line each."""
