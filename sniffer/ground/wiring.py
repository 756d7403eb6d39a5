"""What a user says of the wires of a logic capture; what is not said is found from the edges."""

from __future__ import annotations

from dataclasses import dataclass, field
from typing import TYPE_CHECKING

if TYPE_CHECKING:
    from collections.abc import Mapping


@dataclass(frozen=True, slots=True)
class Wiring:
    """Which channels are read, and how.

    ``channels``: the bus of each channel that is read, by the channel's name; empty: one of its
    own, with that name. Without any, those that carry serial bytes are found.
    ``invert``: the line idles low. ``glitch_us``: shorter pulses are left out; None: those of less
    than 0.3 of a bit. ``baud``: bits per second, None where nobody stated them.
    """

    channels: Mapping[str, str] = field(default_factory=dict)
    invert: bool = False
    glitch_us: float | None = None
    baud: int | None = None
