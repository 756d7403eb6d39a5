"""When a recording is over by itself."""

from __future__ import annotations

from dataclasses import dataclass
from typing import TYPE_CHECKING

from sniffer.ground.model import NS

if TYPE_CHECKING:
    from sniffer.decoding.summary import Summary


@dataclass(frozen=True, slots=True)
class Stops:
    """Conditions that end a recording; None: not that one. The first that is met counts.

    ``max_size`` is in bytes, of all files of the recording together. ``idle_ns`` counts from the
    last byte on any bus. ``until`` are what ``watching.awaited_in`` reads: codes, causes, rules.
    """

    duration_ns: int | None = None
    max_size: int | None = None
    frames: int | None = None
    idle_ns: int | None = None
    until: tuple[str, ...] = ()

    def met(self, summary: Summary, *, ran_ns: int, silent_ns: int, size: int) -> str | None:
        """Return in words what has been reached, None if the recording goes on."""
        if self.duration_ns is not None and ran_ns >= self.duration_ns:
            return f"{self.duration_ns / NS:g} s are over"
        if self.max_size is not None and size >= self.max_size:
            return f"{size} bytes are written"
        if self.frames is not None:
            frames = sum(sum(b.kinds.values()) for b in summary.buses.values())
            if frames >= self.frames:
                return f"{frames} frames are decoded"
        if self.idle_ns is not None and silent_ns >= self.idle_ns:
            return f"no byte for {silent_ns / NS:.1f} s"
        return None
