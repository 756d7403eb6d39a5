"""Arrival stamps -> time on the wire, with an uncertainty.

A stamp is the latest moment its chunk's last byte can have come. Bytes are laid back to back from
there. They can have come earlier, by the *slack*: the time the line had to spare since the chunk
before, counted from when that can have come at the earliest. An adapter holds bytes back for so
long at most (its latency), and the slack is never more than that.
"""

from __future__ import annotations

from dataclasses import replace
from types import MappingProxyType
from typing import TYPE_CHECKING, Any, Final

import numpy as np

from sniffer.ground.chunks import ChunkColumns
from sniffer.ground.memory import Remembering
from sniffer.ground.model import I64, NS, U8, Chunk, Clock, Frames, MarkKind, Mask

if TYPE_CHECKING:
    from collections.abc import Mapping, Sequence

LATENCY_NS: Final[Mapping[Clock, int]] = MappingProxyType(
    {
        Clock.NONE: 0,
        # The stamps of a text file are taken at their word, to one USB full-speed frame.
        Clock.FILE: 1_000_000,
        # The FTDI latency timer's default; an adapter that merges bytes holds them this long.
        Clock.READ: 16_000_000,
        Clock.SAMPLE: 0,
    }
)
"""How long a stamp may lag behind its bytes, by kind of clock."""

TOLERANCE: Final = 50
"""A sender's bytes are as long as the nominal rate says to one part in so many (2 %): what a UART
must keep to be understood, and what the recorder asks of a port."""


def byte_time_ns(baud: int) -> int:
    """Return the wire time of one byte, 8N1: ten bits."""
    return 10 * NS // baud


_NONE, _SAMPLE = np.uint8(Clock.NONE), np.uint8(Clock.SAMPLE)


class Stamps(Remembering):
    """One row a chunk that is still in the buffer: offset behind it, stamp, slack, direction.

    A chunk without a stamp has a nominal time, which follows the bytes before it without a pause,
    and a slack of -1: nothing is known of it.

    Args:
        baud: the rate by which bytes are laid out.
        tail_ns: the protocol's; a longer silence is a barrier, if no adapter holds bytes so long.
        latency_ns: how long the adapter may hold bytes back; by kind of clock where None.
        base: offset of the first byte.
        slowest: the slowest that the line may be; pauses are reckoned by it. ``baud`` where None.
        doubtful: the line may well be as slow as that.
    """

    LASTING = ("clock",)
    PASSING = (
        *("_end", "_t", "_slack", "_exact", "_direction"),
        *("_first", "_offset", "_last", "_open_ns", "_slack_before", "_stamped"),
    )

    def __init__(
        self,
        baud: int,
        tail_ns: int,
        latency_ns: int | None = None,
        base: int = 0,
        *,
        slowest: int | None = None,
        doubtful: bool = False,
    ) -> None:
        self.byte_ns = byte_time_ns(baud)
        self.clock = Clock.NONE
        self._pause_ns = byte_time_ns(slowest or baud)
        self._doubt_ns = self._pause_ns - self.byte_ns if doubtful else 0
        self._tail_ns = tail_ns
        self._latency_ns = latency_ns
        self._end = np.empty(0, np.int64)
        self._t = np.empty(0, np.int64)
        self._slack = np.empty(0, np.int64)
        self._exact = np.empty(0, bool)
        self._direction = np.empty(0, np.uint8)
        self._first = self._offset = base
        self._last: int | None = None  # the latest time, nominal or not
        self._open_ns = 0  # by how much the last chunk may have been over later
        self._slack_before = -1  # of the last chunk
        self._stamped = False

    def matters(self, at: int) -> Mapping[str, Any]:
        """Return the rows of bytes from ``at`` on, and all that later ones depend on."""
        ahead = self._end > at
        rows = (self._end, self._t, self._slack, self._exact, self._direction)
        return {
            "rows": [column[ahead] for column in rows],
            "offset": self._offset,
            "begun": self._offset > self._first,
            "clock": self.clock,
            "last": (self._last, self._open_ns, self._slack_before, self._stamped),
        }

    def add(self, chunks: Sequence[Chunk]) -> I64:
        """Take chunks in; return the stream offsets of the silences (barriers) before them."""
        return self.take(ChunkColumns(chunks))

    def take(self, k: ChunkColumns) -> I64:
        """Take chunks in that are columns already, as ``add`` does."""
        end = self._offset + np.cumsum(k.sizes)
        told = k.clocks != _NONE
        if told.any():
            t = self._known(k)
            most = k.counts(MarkKind.SENT, -1)
            # What was stamped before it was sent was over when its last byte was.
            t = t + np.where(most < 0, 0, np.minimum(most, k.sizes * self.byte_ns))
            slack, silent = self._slacks(k, t, most)
            barriers = (end - k.sizes)[silent]
        else:  # nominal, all of them
            before = end[0] * self.byte_ns - k.sizes[0] * self.byte_ns
            before = before if self._last is None else self._last
            t = before + np.cumsum(k.sizes) * self.byte_ns
            slack = np.full(len(end), -1)
            barriers = np.empty(0, np.int64)
            self._slack_before, self._open_ns = -1, 0
        self.clock = max(self.clock, Clock(int(k.clocks.max())))
        self._last = int(t[-1])
        self._stamped = self._stamped or bool(told.any())
        self._end = np.concatenate([self._end, end])
        self._t = np.concatenate([self._t, t])
        self._slack = np.concatenate([self._slack, slack])
        self._exact = np.concatenate([self._exact, k.clocks == _SAMPLE])
        self._direction = np.concatenate([self._direction, k.directions])
        self._offset = int(end[-1])
        return barriers[barriers > self._first]

    def _known(self, chunks: ChunkColumns) -> I64:
        """Return the stamps; a chunk without one follows the chunk before it without a pause."""
        if isinstance(chunks.times, np.ndarray):
            return chunks.times
        if None not in chunks.times:
            return np.array(chunks.times, np.int64)
        out: list[int] = []
        last = self._last
        for t_ns, size in zip(chunks.times, chunks.sizes.tolist(), strict=True):
            if t_ns is not None:
                last = t_ns
            else:
                before = last if last is not None else self._offset * self.byte_ns
                last = before + size * self.byte_ns
            out.append(last)
        return np.array(out, np.int64)

    def _slacks(self, chunks: ChunkColumns, t: I64, most: I64) -> tuple[I64, Mask]:
        """Return the slack of each chunk, and whether a silence precedes it.

        ``most``: how long after its stamp a chunk was over at the latest; -1 where it was over.
        """
        sizes, clocks = chunks.sizes, chunks.clocks
        told = clocks != _NONE
        before = t[0] - sizes[0] * self.byte_ns if self._last is None else self._last
        previous = np.concatenate([[before], t[:-1]])
        # Nominal times at the very beginning say nothing of the pause behind them.
        dated = np.logical_or.accumulate(told) | self._stamped
        since = np.concatenate([[self._stamped], dated[:-1]])
        lull = np.where(since, t - sizes * self.byte_ns - previous, 0)
        held = chunks.counts(MarkKind.HELD)
        ever = np.maximum.accumulate(np.maximum(clocks, int(self.clock) if self._stamped else 0))
        usual = self._usual_ns(ever)
        latency = usual + held
        merged = chunks.merged(latency)
        # What follows nothing that has a stamp may be late by the whole latency.
        beside = since & np.concatenate([[self._slack_before >= 0], told[:-1]])
        slack = self._reckoned(np.where(beside, lull, latency), latency)
        self._slack_before = int(slack[-1]) if told[-1] else -1
        # Of two taps the pause on the wire is not known: each stamp may be late by all of it.
        slack = np.where(merged, latency, slack)
        # Nor is it known when a program's bytes left the machine: at once, or at the line's rate.
        own = np.minimum(most, sizes * self.byte_ns)
        coarse = chunks.counts(MarkKind.COARSE)
        sent = own + np.minimum(latency, _USUAL_NS[Clock.FILE])  # no adapter holds what is sent
        slack = np.where(most < 0, slack, sent) + coarse
        slack[~told] = -1
        # The bytes of a tap that came late may follow those before without a pause.
        pause = t - sizes * self._pause_ns - previous - held - coarse
        longer = np.where(most < 0, 0, np.minimum(most, sizes * self._pause_ns) - own)
        pause -= np.concatenate([[self._open_ns], longer[:-1]])
        self._open_ns = int(longer[-1])
        # When bytes without a stamp were over nobody knows: there may be no pause behind them.
        # A frame that an adapter hands over in two reads is none that silence cuts.
        return slack, beside & told & (pause > np.maximum(usual, self._tail_ns))

    def _reckoned(self, lull: I64, latency: I64) -> I64:
        """Return the slacks: each is the lull and the slack before it, from none to the latency.

        For example five chunks, each held for 16 at most::

            lull   0    5    -3   20   2       time to spare since the chunk before
            spare  0    5    2    18   20      summed up, of row 3 no more than 16
            floor  0    -16  -11  -14  2    4  the sum at which a chunk was held for 16
            slack  0    5    2    16   16      above the highest floor so far

        Row by row it is min(max(lull + the one before, 0), 16); the loop below says that. The sum
        above its highest floor is the same without a loop, as long as it never falls below none.
        """
        if not latency.any():
            return np.zeros(len(lull), np.int64)
        # A lull beyond the latency says no more than one of just that, whatever the clock did.
        most_ns = max(int(latency.max()), self._slack_before)
        lull = np.clip(lull, -most_ns, latency)
        # Where no stamp contradicts those before it: the running maximum of the earliest times.
        spare = np.cumsum(lull)
        last = max(self._slack_before, 0)
        floor = np.concatenate([[-last], spare - latency])
        slack: I64 = spare - np.maximum.accumulate(floor)[1:]
        if (slack >= 0).all():
            return slack
        out: list[int] = []
        for spared, most in zip(lull.tolist(), latency.tolist(), strict=True):
            last = min(max(spared + last, 0), most)
            out.append(last)
        return np.array(out, np.int64)

    @property
    def last_ns(self) -> int:
        """The latest stamp; 0 before the first."""
        return self._last or 0

    def silent_since(self, now_ns: int) -> bool:
        """Tell whether the line has been silent for so long that nothing crosses it."""
        barrier_ns = max(self._tail_ns, int(self._usual_ns(self.clock)))
        return self._last is not None and now_ns - self._last > barrier_ns

    def _usual_ns(self, ever: Any) -> Any:
        """Return how long bytes are held back at most, by the best clock that there was so far."""
        return _USUAL_NS[ever] if self._latency_ns is None else self._latency_ns

    def forget(self, offset: int) -> None:
        """Drop the rows of chunks that end at or before ``offset``."""
        keep = int(np.searchsorted(self._end, offset, "right"))
        # A chunk's last byte is needed as long as a gap may end on it: keep one row back.
        keep = max(0, keep - 1)
        if keep:
            self._end, self._t = self._end[keep:], self._t[keep:]
            self._slack, self._direction = self._slack[keep:], self._direction[keep:]
            self._exact = self._exact[keep:]

    def at(self, end: I64) -> I64:
        """Return the time of the byte before each stream offset."""
        k = np.searchsorted(self._end, end, "left")
        return np.asarray(self._t[k] - (self._end[k] - end) * self.byte_ns)

    def time(self, frames: Frames, base: int) -> Frames:
        """Fill in times, uncertainty and direction.

        The uncertainty covers both times: the end's slack, the start's (in an earlier read it may
        be greater), and what the rate's tolerance adds to bytes that are laid out by it.

        For example two frames of 9 bytes, a byte taking 100: 4 bytes of the first were read at
        1000, all others at 5000::

            end      9     18
            behind   9     0         bytes of its last read that stand behind each frame
            t_end    4100  5000
            laid     4     9         bytes from its begin to the end of its first read
            t_first  600   4100      that read's stamp, less these
            whole    3200  4100      its end, less its own bytes
            t_start  600   4100      the earlier: no frame takes less than its bytes do

        Nothing is averaged over reads: what later ones say must not move what was told.
        """
        if not len(frames):
            return frames
        start, end = frames.start + base, frames.end + base
        if not self._stamped and not self._direction.any():
            # Nominal times from the first byte on follow each other without a pause.
            first = int(self._t[-1]) - int(self._end[-1]) * self.byte_ns
            return replace(
                frames,
                t_end=first + end * self.byte_ns,
                t_start=first + start * self.byte_ns,
                uncertainty=np.full(len(frames), -1, np.int64),
                direction=np.zeros(len(frames), np.uint8),
            )
        k = np.searchsorted(self._end, end, "left")
        behind = self._end[k] - end
        t_end = self._t[k] - behind * self.byte_ns
        j = np.searchsorted(self._end, start, "right")
        laid = self._end[j] - start
        t_first = self._t[j] - laid * self.byte_ns
        whole = t_end - frames.length * self.byte_ns
        # A frame takes its time on the line; where each stamp is exact, the first one knows better.
        t_start = np.minimum(t_first, whole)
        if self._exact.any():
            t_start = np.where(self._exact[j], t_first, t_start)
        nominal = self._slack < 0
        if nominal.all():
            return replace(
                frames,
                t_end=t_end,
                uncertainty=np.full(len(frames), -1, np.int64),
                t_start=np.minimum(t_start, t_end),
                direction=self._direction[k],
            )
        if nominal.any():  # a nominal time is none beside a stamp
            t_start = np.where(nominal[j] & ~nominal[k], whole, t_start)
        doubt = np.maximum(laid, behind) * self.byte_ns // TOLERANCE
        unsure = np.maximum(self._slack[k], self._slack[j] - (t_first - t_start))
        if self._doubt_ns:
            unsure = unsure + np.maximum(frames.length, behind) * self._doubt_ns
        # An edge is late by a sample at most, and the sender off the rate either way: they add up.
        # A stamp is late for other reasons, mostly by more.
        unsure = np.where(self._exact[k], unsure + doubt, np.maximum(unsure, doubt))
        directions: U8 = self._direction[k]
        return replace(
            frames,
            t_end=t_end,
            uncertainty=np.where(self._slack[k] < 0, -1, unsure),
            t_start=np.minimum(t_start, t_end),
            direction=directions,
        )


_USUAL_NS: Final[I64] = np.array([LATENCY_NS[c] for c in Clock], np.int64)
