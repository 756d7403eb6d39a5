"""At which rate is a line spoken? The protocols' rates in turn, until something holds.

A line that is heard at another rate than it is spoken at gives bytes, too, but no frames, and a
UART finds no stop bits. So a rate is judged by what it gives: by the share of its bytes that frames
explain, and by the errors that the UART told. Nobody is asked, and nothing is sent: all that
changes is how the tap listens.
"""

from __future__ import annotations

import enum
from typing import TYPE_CHECKING, Final, NamedTuple

from sniffer.decoding.detect import Scores
from sniffer.decoding.names import joined
from sniffer.decoding.understanding import GOOD, POOR, usual_bauds
from sniffer.ground.cutting import cut
from sniffer.ground.model import NS, MarkKind
from sniffer.ground.remarks import LINE_ERRORS

if TYPE_CHECKING:
    from collections.abc import Iterable, Sequence

    from sniffer.ground.model import Chunk
    from sniffer.protocols.base import BusProtocol

LOOKS: Final = (64, 128, 256, 512)
"""Bytes after which a trial is looked at: a few frames of every protocol, and each time twice as
many. With the last of them a rate at which nothing holds is left."""

ERRORS: Final = 0.1
"""Share of bytes with line errors from which on a rate is left with the first look."""

TRIAL_NS: Final = 3 * NS
"""A rate is left after this time, too, if there is anything to be heard: a line that is much faster
gives few bytes. In each round of all rates it is twice as long, for buses that say little."""

LEAST: Final = 24
"""Bytes by which a rate can be right where no more came in that time."""

MOST_LOOKED: Final = 1 << 15
"""Bytes of a trial that are kept, and looked at."""


class Rate(NamedTuple):
    """A rate that was found: in bit/s, from which offset of the stream on, and the latency then."""

    baud: int
    since: int
    latency_ns: int

    def facts(self) -> dict[str, str]:
        """Return what a recording says of it."""
        told = {"baud": self.baud, "rate_since": self.since, "latency_ns": self.latency_ns}
        return {key: str(value) for key, value in told.items()}


class SearchStep(enum.Enum):
    """What is to be done about a rate."""

    LISTEN = "listen"
    TRY = "try"
    FOUND = "found"


class RateSearch:
    """Looks for the rate of one line; ``baud`` is the one that it is to be listened at now.

    Args:
        named: what is spoken; nothing where nobody has said so.
        first: the rate that it is listened at first.
    """

    def __init__(self, named: Sequence[BusProtocol], first: int) -> None:
        self.baud = first
        self.tried: list[int] = []
        """The rates at which nothing held, in order."""
        self.is_found = False
        """Whether something held; else the rate is as good as any."""
        self.begin = 0
        """Offset of the first frame that holds, once the rate is found."""
        self._named = tuple(named)
        name = joined(self._named) if self._named else "auto"
        self._rates = (first, *usual_bauds(name, first))
        self._at = 0
        self._shares: dict[int, float] = {}
        self._is_settled = False
        self._awaits: int | None = None
        self._chunks: list[Chunk] = []
        self._offset = self._start = 0
        self._errors = 0
        self._looks = 0
        self._since_ns: int | None = None
        self._was_heard = False

    def hear(self, chunks: Sequence[Chunk]) -> SearchStep:
        """Take chunks in order, all that comes; say what is to be done.

        After ``TRY`` the line is to be listened at ``baud``, and a mark says from which chunk on it
        is (``TUNED``).
        """
        for chunk in chunks:
            tuned = [m.count for m in chunk.marks if m.kind == MarkKind.TUNED]
            if tuned and tuned[-1] == self._awaits:
                self._begin(chunk.t_ns)
            self._offset += len(chunk.data)
            if self._awaits is None:
                self._take(chunk)
        if self._awaits is not None:
            return SearchStep.LISTEN
        return self._judge()

    def idle(self, now_ns: int) -> SearchStep:
        """Learn how late it is."""
        if self._awaits is not None:
            return SearchStep.LISTEN
        if self._since_ns is None:
            self._since_ns = now_ns
        size = self._offset - self._start
        self._was_heard |= size > 0
        if not self._was_heard or now_ns - self._since_ns < TRIAL_NS << min(self._round, 5):
            return SearchStep.LISTEN
        share, first = self._share()
        if size >= LEAST and share >= GOOD:
            return self._found(first)
        self._shares[self.baud] = share if size >= LEAST else 0.0
        return self._next()

    def cannot(self, baud: int) -> SearchStep:
        """Learn that the port cannot be listened at a rate."""
        if baud != self._awaits:
            return SearchStep.LISTEN
        self._shares[baud] = 0.0
        return self._next()

    def heard(self) -> list[Chunk]:
        """Return what was heard at the rate that was found, from its first frame on."""
        out: list[Chunk] = []
        at = self._start
        for chunk in self._chunks:
            end = at + len(chunk.data)
            if at >= self.begin:
                out.append(chunk)
            elif end > self.begin:
                out.append(cut(chunk, self.begin - at, None)[1])
            at = end
        return out

    def settle(self) -> None:
        """Take the rate as it is: nothing more is coming that could tell."""
        self._is_settled = True
        self.begin = self._start

    @property
    def _round(self) -> int:
        """How often all rates were tried."""
        return len(self.tried) // len(self._rates)

    def _begin(self, t_ns: int | None) -> None:
        self._awaits, self._since_ns = None, t_ns
        self._chunks = []
        self._start = self._offset
        self._errors = self._looks = 0

    def _take(self, chunk: Chunk) -> None:
        self._chunks.append(chunk)
        self._errors += sum(m.count for m in chunk.marks if m.kind in LINE_ERRORS)
        while self._offset - self._start > MOST_LOOKED and len(self._chunks) > 1:
            self._start += len(self._chunks.pop(0).data)

    def _judge(self) -> SearchStep:
        size = self._offset - self._start
        looks = [look << min(self._round, 5) for look in LOOKS]
        spoilt = self._errors >= ERRORS * max(size, LOOKS[0])
        if size < looks[min(self._looks, len(looks) - 1)] and not (spoilt and not self._looks):
            return SearchStep.LISTEN
        self._looks += 1
        share, first = self._share()
        if share >= (POOR if self._is_settled else GOOD) and not spoilt:
            return self._found(first)
        if not spoilt and self._looks < len(looks):
            return SearchStep.LISTEN
        self._shares[self.baud] = share
        return self._next()

    def _found(self, first: int) -> SearchStep:
        self.begin = self._start + first if self.tried else 0
        self.is_found = True
        return SearchStep.FOUND

    def _share(self) -> tuple[float, int]:
        """Return the share of the bytes that frames explain, and where the first of them begins."""
        scores = Scores(self._chunks, self.baud, self._named)
        names = [p.name for p in self._named] or list(scores.shares)
        if not scores.size:
            return 0.0, 0
        if self._named:
            return scores.share_of(joined(self._named)), scores.begin(names)
        best = max(names, key=lambda name: scores.shares[name])
        return scores.shares[best], scores.begin([best])

    def _next(self) -> SearchStep:
        """Go on to another rate; after a round without any, back to the best, if it is good."""
        self.tried.append(self.baud)
        self._at = (self._at + 1) % len(self._rates)
        self._is_settled = False
        if not self._at and (best := max(self._shares, key=lambda b: self._shares[b])):
            if self._shares[best] >= POOR:
                self._is_settled = True
                self._at = self._rates.index(best)
            self._shares = {}
        self.baud = self._awaits = self._rates[self._at]
        return SearchStep.TRY


class Late:
    """The beginning of a bus, ``size`` bytes, that is left out: it was heard at other rates."""

    def __init__(self, size: int) -> None:
        self.size = self._left = size

    def of(self, chunks: Iterable[Chunk]) -> list[Chunk]:
        """Return chunks without it."""
        out: list[Chunk] = []
        for chunk in chunks:
            left, size = self._left, len(chunk.data)
            self._left = max(left - size, 0)
            if not left:
                out.append(chunk)
            elif size > left:
                out.append(cut(chunk, left, None)[1])
        return out
