"""What one wire of two holds that is not handed on: its bytes, when they came, its frames."""

from __future__ import annotations

from bisect import bisect_right
from collections import deque
from dataclasses import replace
from typing import TYPE_CHECKING, Final, NamedTuple

from sniffer.ground.model import ANY_ID, NEVER_NS, NO_ALT, Chunk, MarkKind

if TYPE_CHECKING:
    from collections.abc import Iterator

FITS: Final = 4_000_000
"""Worth of an answer that fits; to move one piece costs 1 at most. For others see ``causal``."""

NEARLY: Final = FITS // 2
"""Worth of one of the right servo that does not carry what was asked for."""

GAPS: Final = 32
"""So many times between reads, the latest of a tap, tell how long its adapter holds bytes."""


class Said(NamedTuple):
    """What pairing needs to know about a frame; all but id and token is a request's."""

    servo_id: int
    token: int
    alt_id: int
    many: bool
    must: bool
    raw: bytes
    window_ns: int

    def worth(self, answer: Said) -> int:
        """Return what an answer to this request is worth."""
        may = self.servo_id, NO_ALT if self.alt_id < 0 else self.alt_id
        if self.alt_id != ANY_ID and answer.servo_id not in may:
            return 0
        return FITS if answer.token in (self.token, -1) else NEARLY


class Unit(NamedTuple):
    """What is not cut on one wire: a frame, unclaimed bytes of one chunk, or marks (no bytes).

    ``first_ns`` is the latest moment at which it can have begun, ``last_ns`` ended, ``soonest_ns``
    the soonest at which it can have ended. ``likely_ns`` is the soonest at which it is likely to
    have begun, as the adapter has been seen to pass bytes on. ``said`` is None for frames that
    neither wait for an answer nor are one.
    """

    start: int
    end: int
    first_ns: int
    last_ns: int
    soonest_ns: int
    likely_ns: int
    framed: bool = False
    said: Said | None = None

    @property
    def begun_ns(self) -> int:
        """The soonest moment at which it can have begun."""
        return self.soonest_ns - self.last_ns + self.first_ns

    @property
    def awaited(self) -> Span:
        """The moments between which an answer to it is likely to begin."""
        if self.said is None:
            return ALWAYS
        until = NEVER_NS if self.said.many else self.last_ns + self.said.window_ns
        return self.likely_ns + self.last_ns - self.first_ns, until

    def is_unlikely(self, awaited: Span) -> bool:
        """Tell whether it may have begun between two moments, but is not likely to."""
        return self.begun_ns <= awaited[1] < self.likely_ns or self.first_ns < awaited[0]


Span = tuple[int, int]
"""Two moments and what lies between them."""

ALWAYS: Final[Span] = (-NEVER_NS, NEVER_NS)

Framed = list[tuple[int, int, Said | None]]
"""Start, end and content of the frames on one wire."""

Piece = tuple[Chunk, int, int, int]
"""A part of a chunk, from byte to byte, and the latest moment of its last byte."""


def held_of(chunk: Chunk) -> int:
    """Return by how much a chunk may be older still because the tap itself came late, in ns."""
    return max((m.count for m in chunk.marks if m.kind == MarkKind.HELD), default=0)


def stamp_of(chunk: Chunk) -> int:
    """Return the stamp of a chunk that a lane holds."""
    assert chunk.t_ns is not None  # the lane gave it one
    return chunk.t_ns


class Lane:
    """What one wire holds that is not handed on yet.

    ``times`` is the latest moment at which each byte can have come, ``soonest`` the earliest, and
    ``likely`` the earliest if the adapter holds bytes no longer than its reads lie apart.
    """

    def __init__(self, byte_ns: int, latency_ns: int) -> None:
        self.chunks: list[Chunk] = []
        self.data = bytearray()
        self.times: list[int] = []
        self.soonest: list[int] = []
        self.likely: list[int] = []
        self._gaps: deque[int] = deque(maxlen=GAPS)
        self._byte_ns = byte_ns
        self._latency_ns = latency_ns
        self._begun = 0  # bytes of the first chunk that were handed on
        self._last = self._read_ns = 0  # when something came, and when bytes did

    def add(self, chunk: Chunk, t_ns: int) -> None:
        """Take a chunk in; the stamp of one without is ``t_ns``."""
        # Bytes last 0.1 ms, the adapter holds them for 4 ms at most. A read of nine at 10.0 ms and
        # one of three at 10.2 ms:
        #
        #     byte      0    1    2   ...  7    8    | 9    10   11
        #     times     9.2  9.3  9.4      9.9  10.0 | 10.0 10.1 10.2   the latest it came
        #     soonest   6.0  6.1  6.2      6.7  6.8  | 6.2  6.3  6.4    its first: 4 ms before it
        #
        # ``times`` never decrease, so offsets can be looked up by time. ``soonest`` may: each read
        # is taken for itself, and that its bytes came behind those of the read before is left to
        # the order of the units, which never changes on one wire.
        n, before = len(chunk.data), self._last
        self._last = t_ns = max(t_ns, before)
        self.chunks.append(chunk if chunk.t_ns == t_ns else replace(chunk, t_ns=t_ns))
        self.data += chunk.data
        times = [max(t_ns - k * self._byte_ns, before) for k in range(n - 1, -1, -1)]
        self.times += times
        if n:
            self._gaps.append(t_ns - self._read_ns)
            self._read_ns = t_ns
        held = held_of(chunk)
        self.soonest += self._not_before(t_ns - held, n, self._latency_ns)
        self.likely += self._not_before(t_ns - held, n, self._lag_ns())

    def _lag_ns(self) -> int:
        """Return how long the adapter seems to hold bytes: as long as its reads lie apart.

        A host that is busy gets some reads at once, and others later than they came: the shortest
        times do not count, and the next one counts twice.
        """
        if len(self._gaps) < GAPS // 4:
            return self._latency_ns
        return min(self._latency_ns, 2 * sorted(self._gaps)[len(self._gaps) // 4])

    def _not_before(self, t_ns: int, n: int, lag_ns: int) -> list[int]:
        """Return the earliest moments of a read's bytes.

        The adapter held the first no longer than its latency, and the others came behind it; a read
        that holds more than comes in that time has been held up elsewhere.
        """
        first = t_ns - (max(lag_ns - (n - 1) * self._byte_ns, 0) or lag_ns)
        return [first - k * self._byte_ns for k in range(n - 1, -1, -1)]

    def due_ns(self, hold_ns: int) -> int:
        """Return when what has been held longest must be handed on."""
        if not self.chunks:
            return NEVER_NS
        stamp = stamp_of(self.chunks[0])
        if not self.chunks[0].data or held_of(self.chunks[0]):
            return stamp + hold_ns  # what was held up with it on the other wire may come after it
        # A long read may be due before it came; then it is as soon as all of its time has come.
        return max(self.times[0] + hold_ns, stamp)

    def unit(self, start: int, end: int, *, framed: bool = False, said: Said | None = None) -> Unit:
        """Return the bytes between two offsets as a unit."""
        first = self.times[start] - self._byte_ns
        likely = self.likely[start] - self._byte_ns
        last, soonest = self.times[end - 1], self.soonest[end - 1]
        return Unit(start, end, first, last, soonest, likely, framed, said)

    def units(self, frames: Framed, until: int) -> list[Unit]:
        """Return frames and what lies between them, up to offset ``until``."""
        # Reads of 5, 6 and 1 bytes at 9.5, 10.1 and 10.3 ms, and a mark without bytes at 10.5; nine
        # bytes are an answer, the others noise:
        #
        #     bytes    0..9    9..11   11..12  12..12
        #     framed   yes     no      no      no
        #     first    9.0     9.9     10.2    10.5     the latest it can have begun
        #     last     9.9     10.1    10.3    10.5     ... ended
        #     soonest  6.4     6.6     6.3     6.5      the soonest it can have ended
        #
        # A frame is one unit though it came in two reads: nothing of the other wire may get into
        # it. Noise is cut where reads end, as what happened between the two may belong there.
        ends: list[int] = []
        empty: list[tuple[int, int]] = []
        at = -self._begun
        for chunk in self.chunks:
            at += len(chunk.data)
            if chunk.data:
                ends.append(at)
            else:
                empty.append((at, stamp_of(chunk)))
        empty.reverse()
        out: list[Unit] = []
        at = 0
        for start, stop, said in [*frames, (until, until, None)]:
            while True:
                while empty and empty[-1][0] <= at:
                    offset, t_ns = empty.pop()
                    if offset == at:  # else a frame goes across it, and takes it along
                        soonest = t_ns - self._latency_ns
                        out.append(Unit(at, at, t_ns, t_ns, soonest, soonest))
                if at >= start:
                    break
                out.append(self.unit(at, min(start, ends[bisect_right(ends, at)])))
                at = out[-1].end
            if stop > start:
                out.append(self.unit(start, stop, framed=True, said=said))
                at = stop
        return out

    def take(self, unit: Unit) -> Iterator[Piece]:
        """Yield the parts of chunks that a unit is made of; units are taken in order."""
        # The frame of the example above gives bytes 0..5 of the first chunk (9.5 ms) and 0..4 of
        # the second, whose last byte can have come at 9.9; the noise behind it gets the rest of
        # that chunk, at 10.1.
        at = unit.start
        while True:
            chunk = self.chunks[0]
            size = len(chunk.data)
            stop = min(self._begun + unit.end - at, size)
            at += stop - self._begun
            yield chunk, self._begun, stop, self.times[at - 1] if size else stamp_of(chunk)
            self._begun = stop
            if stop == size:
                del self.chunks[0]
                self._begun = 0
            if at == unit.end:
                return

    def forget(self, end: int) -> None:
        """Drop the bytes before an offset; their chunks have been taken."""
        del self.data[:end]
        del self.times[:end]
        del self.soonest[:end]
        del self.likely[:end]
