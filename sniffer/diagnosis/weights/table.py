"""One line of the table of weights."""

from __future__ import annotations

from typing import NamedTuple


class Weight(NamedTuple):
    """What a finding counts for a cause, about as the logarithm of how much likelier it makes it.

    3 is as good as proof, 1 a hint, 0.3 a consequence that other causes have as well; negative ones
    speak against it. ``is_key``: without such a finding the cause is not considered at all.
    """

    cause: str
    finding: str
    weight: float
    reason: str
    is_key: bool = False


def for_(cause: str, *rows: tuple[str, float, str]) -> tuple[Weight, ...]:
    """Return the lines of one cause; what counts 1.5 or more is a key."""
    return tuple(
        Weight(cause, finding, weight, reason, weight >= KEY) for finding, weight, reason in rows
    )


KEY = 1.5
"""From this weight on a finding is reason enough to think of a cause."""
