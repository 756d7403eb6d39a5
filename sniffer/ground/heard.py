"""From when to when a bus was heard, and how long that was where its clock was set."""

from __future__ import annotations

from collections import Counter
from dataclasses import dataclass, field
from typing import TYPE_CHECKING, Any, Final, NamedTuple

import numpy as np

from sniffer.ground.gaps import Gaps
from sniffer.ground.limits import DATED_NS
from sniffer.ground.model import NS

if TYPE_CHECKING:
    from collections.abc import Iterable, Sequence

    from sniffer.ground.model import I64, Batch, Frames

SET_BACK_NS: Final = NS // 2
"""A time that is so much earlier than the one before was not told late: the clock was set."""


def is_set(t_ns: Any, before_ns: Any) -> Any:
    """Tell whether the clock was set between two times, or of columns between each two.

    It was set back, or it got a date: a computer without a battery counts from 1970 until somebody
    tells it the time.
    """
    got_a_date = (before_ns < DATED_NS) & (t_ns >= DATED_NS)
    return (t_ns - before_ns < -SET_BACK_NS) | got_a_date


def was_set(t_ns: I64, before_ns: int) -> I64:
    """Return the rows at which the clock was set; ``before_ns`` is the time in front."""
    return np.flatnonzero(is_set(t_ns, np.concatenate([[before_ns], t_ns[:-1]])))


def set_back(t_ns: I64, before_ns: int) -> I64:
    """Return by how much the clock was set back before each row, 0 where it was not."""
    before = np.concatenate([[before_ns], t_ns[:-1]])
    out: I64 = np.where(is_set(t_ns, before), before - t_ns, 0)
    return out


class SteadyTime:
    """Times of a stream as though its clock had never been set: none passed where it was."""

    def __init__(self) -> None:
        self._last_ns: int | None = None
        self._set_ns = 0

    def of(self, t_ns: I64) -> I64:
        """Return times that follow in the stream, moved by what the clock was set before them."""
        if not len(t_ns):
            return t_ns
        before = int(t_ns[0]) if self._last_ns is None else self._last_ns
        moved = self._set_ns + np.cumsum(set_back(t_ns, before))
        self._last_ns, self._set_ns = int(t_ns[-1]), int(moved[-1])
        out: I64 = t_ns + moved
        return out

    def at(self, t_ns: int) -> int:
        """Return a time that follows in the stream, moved alike."""
        if self._last_ns is not None and is_set(t_ns, self._last_ns):
            self._set_ns += self._last_ns - t_ns
        self._last_ns = t_ns
        return t_ns + self._set_ns

    def records(self, batches: Sequence[Batch]) -> SteadyPass:
        """Return when frames and gaps of a pass were told, of all protocols in the stream's order.

        Args:
            batches: what each protocol said in it; their bytes are the same ones.
        """
        gaps = [Gaps.of(batch.gaps) for batch in batches]
        start = np.concatenate([b.frames.start for b in batches] + [g.start for g in gaps])
        t_ns = np.concatenate([b.frames.t_end for b in batches] + [g.t_ns for g in gaps])
        order = np.argsort(start, kind="stable")
        t_ns = t_ns[order]
        return SteadyPass(start[order], t_ns, self.of(t_ns) - t_ns)


class SteadyPass(NamedTuple):
    """Frames and gaps of a pass in order: where each begins, and when it was told.

    On a clock that was never set that was later by what they are ``moved``.
    """

    start: I64
    t_ns: I64
    moved: I64

    def rows(self, start: I64) -> I64:
        """Return the records in which bytes stand, the first one for those before it."""
        out: I64 = np.maximum(np.searchsorted(self.start, start, "right") - 1, 0)
        return out

    def of(self, t_ns: I64, start: I64) -> I64:
        """Return times, of what begins at some bytes, as though the clock had never been set."""
        return t_ns + self.moved[self.rows(start)] if len(self.moved) else t_ns


@dataclass(slots=True)
class HeardSpan:
    """The times of the first and the last frame, in the order of the stream, and how long it was.

    Where the clock was set, no time passed: 8 s of frames over a clock that is set back by an hour
    are 8 s. Of protocols that share a wire each has an order of its own.
    """

    first_ns: int | None = None
    _lasts: dict[str, int] = field(default_factory=dict)
    _set: Counter[str] = field(default_factory=Counter)
    """By how much it was set back in all."""

    @property
    def last_ns(self) -> int | None:
        """When the last frame ended, of whichever protocol; None: there was none."""
        return max(self._lasts.values(), default=None)

    @property
    def ns(self) -> int:
        """How long it was, none where nothing was heard."""
        if self.first_ns is None:
            return 0
        lasts = (last + self._set[protocol] for protocol, last in self._lasts.items())
        return max(max(lasts) - self.first_ns, 0)

    def take(self, protocol: str, frames: Frames) -> None:
        """Take frames of a protocol, of which there is one at least."""
        ends = frames.t_end
        if protocol not in self._lasts:  # its first ones may have come before those of another one
            begun = int(frames.t_start[0])
            self.first_ns = begun if self.first_ns is None else min(begun, self.first_ns)
        last = self._lasts.get(protocol, int(ends[0]))
        self._set[protocol] += int(set_back(ends, last).sum())
        self._lasts[protocol] = int(ends[-1])

    def join(self, more: HeardSpan) -> None:
        """Take what was heard behind this."""
        if more.first_ns is None:
            return
        if self.last_ns is None:
            self.first_ns = more.first_ns
        elif is_set(more.first_ns, self.last_ns):
            self._set.update(dict.fromkeys(more._lasts, self.last_ns - more.first_ns))
        self._lasts |= more._lasts
        self._set.update(more._set)


def span_of(heard: Iterable[HeardSpan]) -> int:
    """Return how long several buses were heard in all, in ns: from the first to the last of them.

    Of one whose clock was set no time counts that nobody heard.
    """
    known = [(h.first_ns, h.ns) for h in heard if h.first_ns is not None]
    if not known:
        return 0
    return max(first + ns for first, ns in known) - min(first for first, _ in known)
