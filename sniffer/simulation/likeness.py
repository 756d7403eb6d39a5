"""What a recording showed of a servo, for one that is to be like it."""

from __future__ import annotations

from dataclasses import dataclass, field
from typing import TYPE_CHECKING

if TYPE_CHECKING:
    from collections.abc import Mapping, Sequence


@dataclass(frozen=True, slots=True)
class ServoLikeness:
    """A servo as it was heard.

    ``values`` are the last ones, raw, by register; ``delays_ns`` by command how long after a
    request its answers began; ``missing`` the share of requests, 0..1, that it left unanswered.
    """

    values: Mapping[str, int] = field(default_factory=dict)
    delays_ns: Mapping[str, Sequence[int]] = field(default_factory=dict)
    missing: float = 0.0
