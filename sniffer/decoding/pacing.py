"""What the stamps of a log tell about who made it: the line's rate, and how long bytes were held.

Nobody states either with a text log. A rate that was not stated is estimated where stamps inside
one frame, or of answers of several lengths, allow it; else it is assumed. The slowest one that the
stamps do not contradict bounds what is doubtful about it.

A host may hand bytes on by a timer (FTDI's is 16 ms as delivered). It shows: answers come together
with their question, in deliveries that are never closer than the timer.
"""

from __future__ import annotations

from dataclasses import dataclass, replace
from typing import TYPE_CHECKING, Final

import numpy as np

from sniffer.decoding.matching import outcomes
from sniffer.decoding.pairing import Pairing
from sniffer.ground.chunks import clock_of
from sniffer.ground.codes import OK, RESPONSE
from sniffer.ground.framing import Block
from sniffer.ground.limits import chunks_of
from sniffer.ground.medians import median
from sniffer.ground.model import I64, MS, NS, Chunk, Clock, MarkKind
from sniffer.ground.timing import LATENCY_NS, TOLERANCE, byte_time_ns

if TYPE_CHECKING:
    from collections.abc import Sequence

    from sniffer.ground.model import Frames
    from sniffer.protocols.base import BusProtocol

STATED: Final = "stated"
ESTIMATED: Final = "estimated"
ASSUMED: Final = "assumed"
AT_LEAST: Final = "at least"

FAR: Final = 4
"""A line that may be so many times slower than assumed is worth a word."""

LOOK: Final = 4096
"""Chunks that are looked at: a minute of a bus that is asked fifty times a second."""

ONE_READ_NS: Final = 300_000
"""Lines closer than this may be one read that a program printed piece by piece."""

PACKET: Final = 62
"""Bytes of a full USB packet of an FTDI chip: it is sent at once, whatever the timer says."""

EXCHANGES: Final = 4
"""Fewer answered requests tell nothing."""

MANY: Final = 8
"""Of so many answers one at least would have come faster than a slower line can have it."""

MERGED: Final = 0.05
"""Share of answers that come with their question from which on bytes are said to be held."""

CUTS, HARDLY = 12, 0.1
"""Exchanges that a timer would have cut by chance, and which part of them at most are cut where
there is none: servos that answer at once come as close to their questions as pieces of one read."""

PROMPT_NS: Final = 2 * MS
"""Deliveries that are closer than this are no timer's."""

CLOSEST: Final = 0.03
"""The share of deliveries that may be closer than the timer: one that came late, the next not."""

TIMER_NS: Final = 16 * MS
"""The FTDI latency timer's default (AN232B-04, 2.1), which most hosts leave as it is."""

LONGEST_NS: Final = 40 * MS
"""Deliveries further apart than this are the controller's doing: the timer's default stands."""

BEYOND_NS: Final = 50 * MS
"""No adapter holds bytes as long: stamps that are off by more contradict the rate."""

STALLED_NS: Final = NS
"""No network holds bytes so long as a rule: what comes faster for longer is from a faster line."""

CLOSE: Final = 0.08
"""How far an estimate may be from a rate of the protocol to be taken for it: they are further
apart."""

SPAN_NS: Final = 10 * MS
"""Line time that an estimate by lengths needs: a stamp is good to a millisecond."""


@dataclass(frozen=True, slots=True)
class Pace:
    """By what a bus is timed, and how that is known.

    ``slowest``: the slowest rate that the line may have; ``baud`` itself where that is known.
    ``latency_ns``: how long bytes were held; None: as usual for the kind of clock.
    ``usual``: the protocol's own rate; an estimate that comes to it is no news.
    ``doubtful``: no answer of many came faster than ``slowest`` has it, so it may well be that.
    ``faster``: how many times faster than the rate allows bytes came, 0 where they did not.
    """

    baud: int
    slowest: int
    rate: str = STATED
    latency_ns: int | None = None
    latency: str = ""
    faster: float = 0.0
    doubtful: bool = False
    usual: int = 0

    @property
    def remarks(self) -> tuple[str, ...]:
        """What a person should know, in words."""
        out = []
        if self.rate == ESTIMATED and self.baud != self.usual:
            out.append(f"by its stamps the line runs at {self.baud} baud; state it to be sure")
        if self.rate == AT_LEAST:
            out.append(
                f"{self.usual} baud are too slow for what came: {self.baud} are taken, the least "
                "that are not; state the rate"
            )
        if self.doubtful and self.slowest * FAR <= self.baud:
            out.append(
                f"{self.baud} baud are assumed, but no answer came faster than {self.slowest} baud "
                "would have it: times are that uncertain; state the rate"
            )
        if self.faster:
            out.append(
                f"{self.baud} baud ({self.rate}) cannot be: by their stamps, bytes came "
                f"{self.faster:.1f} times faster"
            )
        if self.latency == ESTIMATED and self.latency_ns is not None:
            out.append(
                f"the host seems to have held bytes for up to {self.latency_ns / MS:.0f} ms: "
                "times are that uncertain; state its latency"
            )
        return tuple(out)


def pace(
    protocol: BusProtocol,
    chunks: Sequence[Chunk],
    *,
    baud: int | None = None,
    latency_ns: int | None = None,
) -> Pace:
    """Return by what to time a bus, from its first chunks and from what was stated.

    Only stamps of files and logic analysers are judged: a recorder states both, but of an address
    on the network, of whose line nobody knows the rate. Its bytes only tell which is too slow.
    """
    chosen = baud or protocol.baud
    rate = STATED if baud else ASSUMED
    stated = STATED if latency_ns is not None else ""
    slowest = chosen if baud else min(*protocol.bauds, chosen)
    known = Pace(chosen, slowest, rate, latency_ns, stated, usual=protocol.baud)
    told = chunks_of([k for k in chunks if k.data][:LOOK])
    clocks = {clock_of(k) for k in told}
    if baud is None and len(told) > 1 and clocks == {Clock.READ}:
        return _not_slower(known, protocol, _Look(protocol, told))
    if len(told) < 2 or not clocks <= {Clock.FILE, Clock.SAMPLE}:
        return known
    looked = _Look(protocol, told)
    if latency_ns is None and clocks == {Clock.FILE}:
        fastest = byte_time_ns(baud or max(*protocol.bauds, chosen))
        asks = bool(looked.sent.any())
        held = looked.waited_ns(fastest) if asks else looked.held_ns(byte_time_ns(chosen))
        if held > LATENCY_NS[Clock.FILE]:
            known = replace(known, latency_ns=held, latency=ESTIMATED)
    spare = known.latency_ns if known.latency_ns is not None else LATENCY_NS[max(clocks)]
    # a busy host is not called a wrong rate, nor are stamps of whole seconds
    spare = max(spare, 3 * MS) + looked.coarse
    if baud:
        return replace(known, faster=looked.faster(byte_time_ns(baud), BEYOND_NS + spare))
    rates = sorted({*protocol.bauds, protocol.baud})
    possible = [r for r in rates if looked.behind_ns(byte_time_ns(r)) <= spare]
    possible = [r for r in possible if looked.has_room(byte_time_ns(r))] or possible
    if not possible:
        return replace(known, faster=looked.faster(byte_time_ns(chosen), BEYOND_NS + spare))
    byte_ns = looked.byte_ns(is_prompt=known.latency != ESTIMATED)
    near = [r for r in possible if abs(byte_ns / byte_time_ns(r) - 1) < CLOSE]
    if near:
        chosen = min(near, key=lambda r: abs(byte_ns / byte_time_ns(r) - 1))
        return replace(known, baud=chosen, slowest=chosen, rate=ESTIMATED)
    if possible[0] > chosen:
        return replace(known, baud=possible[0], slowest=possible[0], rate=ESTIMATED)
    return replace(known, slowest=possible[0], doubtful=len(looked.asked) >= MANY)


def _not_slower(known: Pace, protocol: BusProtocol, looked: _Look) -> Pace:
    """Return a pace with the least rate at which so many bytes can come in the time."""
    faster = looked.faster(byte_time_ns(known.baud), STALLED_NS)
    if not faster:
        return known
    took = int(looked.t[-1] - looked.t[0]) / int(looked.n[1:].sum())
    least = [r for r in sorted(protocol.bauds) if byte_time_ns(r) <= took * (1 + 1 / TOLERANCE)]
    if not least:
        return replace(known, faster=faster)
    return replace(known, baud=least[0], slowest=least[0], rate=AT_LEAST)


def exchanges_in(protocol: BusProtocol, data: bytes) -> tuple[Frames, I64, I64]:
    """Return the frames in some bytes, and the rows of requests with those of their answers.

    They are those that a decoder finds, without what else it says of them: no times, no values.
    """
    block = Block(np.frombuffer(data, np.uint8), np.empty(0, np.int64), True)
    spans, decided = protocol.frame(block)
    frames, partner = Pairing(protocol).match(protocol.describe(block, spans), block, decided, 0)
    answer, asked, how = outcomes(partner)
    fits = (how == OK) & (frames.kind[answer] == RESPONSE)
    return frames, asked[fits], answer[fits]


class _Look:
    """The first chunks as columns, with the frames in them."""

    def __init__(self, protocol: BusProtocol, chunks: Sequence[Chunk]) -> None:
        self.t = np.array([k.t_ns or 0 for k in chunks], np.int64)
        size = np.array([len(k.data) for k in chunks], np.int64)
        self.end = np.cumsum(size)
        self.begin = self.end - size
        self.sent = np.array([any(m.kind == MarkKind.SENT for m in k.marks) for k in chunks])
        self.coarse = max(
            (m.count for k in chunks for m in k.marks if m.kind == MarkKind.COARSE), default=0
        )
        # Before a stamp lie the bytes that it is of, but for those that were yet to be sent.
        self.n = np.where(self.sent, 0, size)
        # Which answer belongs to which question is told by the bytes alone here.
        f, asked, answered = exchanges_in(protocol, b"".join(k.data for k in chunks))
        self.start, self.stop = f.start, f.end
        self.asks_from = f.start[asked]
        self.asked, self.begun, self.answered = f.end[asked], f.start[answered], f.end[answered]

    def waited_ns(self, byte_ns: int) -> int:
        """Return how long the host may have held answers, by how long it waited for them.

        It is the asking program's own log: of an answer that came, the line had question and answer
        for their length, and the adapter what is left at most.
        """
        size, took = self._asked_and_answered()
        most = _with_margin(TIMER_NS)
        if len(size) < EXCHANGES:
            return most
        left = np.quantile(took - size * byte_ns, 1 - CLOSEST, method="higher")
        return int(np.clip(left + self.coarse, 0, most))

    def has_room(self, byte_ns: int) -> bool:
        """Tell whether questions and answers had the time on the line that a rate asks for."""
        size, took = self._asked_and_answered()
        if len(size) < EXCHANGES:
            return True
        room = took + self.coarse >= size * (byte_ns - byte_ns // TOLERANCE)
        return bool(room.mean() >= 1 - CLOSEST)

    def _asked_and_answered(self) -> tuple[I64, I64]:
        """Return the bytes of questions with their answers, and how long they took together."""
        asked = np.searchsorted(self.end, self.asked, "left")
        ends = np.searchsorted(self.end, self.answered, "left")
        rows = self.sent[asked] & ~self.sent[ends] & (self.end[asked] == self.asked)
        size = (self.answered - self.begin[asked])[rows]
        return size, (self.t[ends] - self.t[asked])[rows]

    def held_ns(self, byte_ns: int) -> int:
        """Return how long the host may have held bytes, by how deliveries and answers lie."""
        if self.coarse >= PROMPT_NS:  # by such stamps no timer can be seen, only what it held
            return _with_margin(TIMER_NS) if self._is_held(byte_ns) else 0
        gap = np.diff(self.t)
        apart = (gap < 0) | (gap > np.maximum(self.n[1:] * byte_ns // 2, ONE_READ_NS))
        number = np.concatenate([[0], np.cumsum(apart)])
        last = np.flatnonzero(np.concatenate([apart, [True]]))
        size = np.bincount(number, self.n).astype(np.int64)
        between = np.diff(self.t[last])
        # A full packet does not wait for the timer, and what follows it waits for less.
        full = size % PACKET == 0
        between = between[(between > 0) & ~full[1:] & ~full[:-1]]
        if len(self.asked) < EXCHANGES:
            return 0
        # A packet that takes longer to fill than a prompt host waits says that it was waited for.
        packed = full.sum() >= EXCHANGES and full.mean() >= MERGED and PACKET * byte_ns > PROMPT_NS
        if len(between) < EXCHANGES:
            return _with_margin(TIMER_NS) if packed else 0
        closest = int(np.quantile(between, CLOSEST, method="lower"))
        chunk_of = np.searchsorted(self.end, np.stack([self.asked, self.answered]), "left")
        together = number[chunk_of[0]] == number[chunk_of[1]]
        merged = together.sum() >= 2 and together.mean() >= MERGED and closest >= PROMPT_NS
        merged = merged and not self._is_uncut(number, byte_ns, closest)
        grid = np.gcd.reduce(np.abs(self.t - self.t[0]))
        resolution = int(grid) if grid >= PROMPT_NS and grid < 60_000 * MS else 0
        if merged and closest > PROMPT_NS and _share_on(between, closest) > 1 - 2 * MERGED:
            timer = closest if closest <= LONGEST_NS else TIMER_NS
        elif merged or packed:
            timer = max(TIMER_NS, min(closest, LONGEST_NS))
        elif (
            len(between) >= 3 * EXCHANGES
            and closest > TIMER_NS - 2 * MS
            and _share_on(between, TIMER_NS) > 1 - 2 * MERGED
        ):
            timer = TIMER_NS
        else:
            return resolution
        return max(_with_margin(timer), resolution)

    def _is_uncut(self, number: I64, byte_ns: int, timer_ns: int) -> bool:
        """Tell whether deliveries (``number`` by chunk) spare exchanges, which no timer does.

        It runs on by itself, and ends wherever it does: in as many as their part of the time.
        """
        first = np.searchsorted(self.end, self.asks_from, "right")
        cut = number[first] != number[np.searchsorted(self.end, self.answered, "left")]
        by_chance = int((self.answered - self.asks_from).sum()) * byte_ns / max(timer_ns, 1)
        return bool(by_chance >= CUTS and cut.sum() <= HARDLY * by_chance)

    def _is_held(self, byte_ns: int) -> bool:
        """Tell whether questions came with answers that took longer than a prompt host waits."""
        asked, answered = np.searchsorted(self.end, np.stack([self.asked, self.answered]), "left")
        held = (asked == answered) & (self.n[answered] * byte_ns > PROMPT_NS)
        return bool(held.sum() >= EXCHANGES and held.mean() >= MERGED)

    def byte_ns(self, *, is_prompt: bool) -> float:
        """Return the time of a byte as the stamps have it; 0 where they do not tell."""
        inside = self._inside() if is_prompt else 0.0
        return inside or (self._by_length() if is_prompt else 0.0)

    def _inside(self) -> float:
        """Return it from stamps within frames, whose bytes follow each other without a pause."""
        first = np.searchsorted(self.end, self.start, "right")
        last = np.searchsorted(self.end, self.stop, "right") - 1
        rows = np.flatnonzero((last > first) & ~self.sent[first])
        size = (self.end[last] - self.end[first])[rows]
        took = (self.t[last] - self.t[first])[rows]
        if len(rows) < EXCHANGES or took.min() <= 0:
            return 0.0
        each = took / size
        middle = float(median(each))
        steady = np.abs(each / middle - 1) < CLOSE / 2
        return middle if steady.mean() > 0.5 and took.sum() > SPAN_NS // 8 else 0.0

    def _by_length(self) -> float:
        """Return it from answers of different lengths: what the longer ones take longer."""
        ends = np.searchsorted(self.end, self.answered, "left")
        asked = np.searchsorted(self.end, self.asked, "left")
        whole = (self.end[ends] == self.answered) & (self.end[asked] == self.asked)
        size = self.answered - np.where(self.sent[asked], self.begin[asked], self.asked)
        size = size[whole & (self.begun == self.asked)]
        took = (self.t[ends] - self.t[asked])[whole & (self.begun == self.asked)]
        sizes, count = np.unique(size, return_counts=True)
        sizes = sizes[count >= EXCHANGES]
        if len(sizes) < 2:
            return 0.0
        least = [int(took[size == n].min()) for n in (sizes[0], sizes[-1])]
        more = least[1] - least[0]
        return more / float(sizes[-1] - sizes[0]) if more >= SPAN_NS else 0.0

    def behind_ns(self, byte_ns: int) -> int:
        """Return how far the stamps fall behind a line of this rate, less its tolerance."""
        return int(self._behind(byte_ns - byte_ns // TOLERANCE).max(initial=0))

    def _behind(self, byte_ns: int) -> I64:
        gap = np.diff(self.t, prepend=self.t[0])
        step = np.where(gap < 0, 0, self.n * byte_ns - gap)  # a clock that was set starts anew
        step[0] = 0
        run = np.cumsum(step)
        out: I64 = run - np.minimum.accumulate(run)
        return out

    def faster(self, byte_ns: int, most_ns: int) -> float:
        """Return how many times faster bytes came than a rate allows; 0 within ``most_ns``."""
        behind = self._behind(byte_ns - byte_ns // TOLERANCE)
        worst = int(behind.argmax())
        if behind[worst] <= most_ns:
            return 0.0
        run = np.flatnonzero(behind[: worst + 1] == 0)
        begun = int(run[-1]) if len(run) else 0
        line_ns = int(self.n[begun + 1 : worst + 1].sum()) * byte_ns
        return line_ns / max(int(self.t[worst] - self.t[begun]), MS)


def _with_margin(timer_ns: int) -> int:
    """Return a timer with what it and a busy host are late themselves: an eighth, a USB frame."""
    return timer_ns + timer_ns // 8 + MS


def _share_on(between: I64, timer_ns: int) -> float:
    """Return the share of deliveries that are whole periods of a timer apart."""
    near = np.round(between / timer_ns) * timer_ns
    return float((np.abs(between - near) <= min(1.25 * MS, timer_ns / 5)).mean())
