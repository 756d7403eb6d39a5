"""From when to when a bus was heard, and how long that was where its clock was set back."""

from __future__ import annotations

from collections import Counter
from dataclasses import dataclass, field
from typing import TYPE_CHECKING, Final

import numpy as np

from sniffer.ground.model import NS

if TYPE_CHECKING:
    from sniffer.ground.model import I64, Frames

SET_BACK_NS: Final = NS // 2
"""A time that is so much earlier than the one before was not told late: the clock was set."""


def set_back(t_ns: I64, before_ns: int) -> I64:
    """Return the rows at which the clock was set back; ``before_ns`` is the time in front."""
    return np.flatnonzero(np.diff(t_ns, prepend=before_ns) < -SET_BACK_NS)


@dataclass(slots=True)
class HeardSpan:
    """The times of the first and the last frame, in the order of the stream, and how long it was.

    Where the clock was set back, no time passed: 8 s of frames over a clock that is set back by an
    hour are 8 s. Of protocols that share a wire each has an order of its own.
    """

    first_ns: int | None = None
    _lasts: dict[str, int] = field(default_factory=dict)
    _set_back: Counter[str] = field(default_factory=Counter)

    @property
    def last_ns(self) -> int | None:
        """When the last frame ended, of whichever protocol; None: there was none."""
        return max(self._lasts.values(), default=None)

    @property
    def ns(self) -> int:
        """How long it was, none where nothing was heard."""
        if self.first_ns is None or self.last_ns is None:
            return 0
        return max(self.last_ns - self.first_ns + max(self._set_back.values(), default=0), 0)

    def take(self, protocol: str, frames: Frames) -> None:
        """Take frames of a protocol, of which there is one at least."""
        ends = frames.t_end
        if protocol not in self._lasts:  # its first ones may have come before those of another one
            begun = int(frames.t_start[0])
            self.first_ns = begun if self.first_ns is None else min(begun, self.first_ns)
        last = self._lasts.get(protocol, int(ends[0]))
        for row in set_back(ends, last).tolist():
            before = int(ends[row - 1]) if row else last
            self._set_back[protocol] += before - int(ends[row])
        self._lasts[protocol] = int(ends[-1])

    def join(self, more: HeardSpan) -> None:
        """Take what was heard behind this."""
        if more.first_ns is None:
            return
        if self.last_ns is None:
            self.first_ns = more.first_ns
        elif (by := self.last_ns - more.first_ns) > SET_BACK_NS:
            self._set_back.update(dict.fromkeys(more._lasts, by))
        self._lasts |= more._lasts
        self._set_back += more._set_back
