"""Two taps on one bus, one on each wire -> one stream in causal order. Pure: no I/O.

A stamp is the latest moment its chunk's last byte can have come; it can have come earlier by the
adapter's latency. Bytes within a read are laid back to back from its stamp, but not before the read
that came before. So where the latest moments of two pieces lie no further apart than the latency,
stamps do not tell which came first. There causality decides (``causal``): each wire is framed for
itself, and a servo's answer is put behind the request that it answers and before the next one.
Where the stamps do tell, or nothing speaks of cause and effect, pieces stand by their latest
moments, the controller's first on ties: a late or unasked answer stays where it was heard.

An answer without a header cannot be told from its own wire. For that the unclaimed bytes of the
servos' wire are tried, from each byte on, behind each request near them: the protocol itself frames
the two together and says whether it is an answer, and how long. Such answers name nobody, so where
one is missing and the stamps allow two places, the one that moves bytes less is a guess.

The stamps of the merged stream never decrease. What stands before a piece came before it, so its
stamp is lowered to the earliest one behind it, which is still the latest moment it can have come:
never by more than the latency, and what the tap itself came late (``HELD``). A stamp is raised, to
the one before it, only where bytes are placed too late: a chunk that is fed after its place was
handed on, or both wires speaking at once while one of them begins what turns out to be no frame.
Pieces whose stamp was changed are marked ``REORDERED``, with how far.
"""

from __future__ import annotations

import itertools
from bisect import bisect_right
from dataclasses import replace
from typing import TYPE_CHECKING, Final

import numpy as np

from sniffer.ground.codes import IF_READ, MANY, MUST, NEVER, REQUEST, RESPONSE
from sniffer.ground.framing import Block
from sniffer.ground.model import I64, NEVER_NS, U8, Chunk, Direction, Mark, MarkKind, Mask, Spans
from sniffer.ground.timing import byte_time_ns
from sniffer.merging.bare import BareAnswers
from sniffer.merging.causal import (
    BARE,
    BURST,
    CELLS,
    TRIALS,
    Bare,
    Rules,
    Spot,
    Step,
    by_cause,
    by_time,
)
from sniffer.merging.lanes import Framed, Lane, Piece, Said, Unit, held_of

if TYPE_CHECKING:
    from collections.abc import Iterable, Sequence

    from sniffer.protocols.base import BusProtocol

TX, RX = range(2)
"""The controller's wire and the servos'."""

RETRIES: Final = 4
"""How often framing goes on behind a false beginning in one pass; then frames inside it count."""

_NONE: Final = np.empty(0, np.int64)


class Merger:
    """Merges the chunks of two taps on one bus.

    Nothing is held longer than ``hold_ns``: by then a frame that began is whole, and whatever can
    stand before it has come. Chunks are to be fed in the order of their stamps (in one call in any
    order); how they are grouped into calls changes nothing.

    Args:
        bus: the name that the merged chunks carry.
        latency_ns: by how much a stamp may lag behind its bytes, the greater of both taps'.
        baud: bits per second.
        protocol: whose frames tell what belongs together; None: by time only, until it is set.
    """

    def __init__(
        self, bus: str, *, latency_ns: int, baud: int, protocol: BusProtocol | None
    ) -> None:
        self.protocol = protocol
        self._bus = bus
        self._latency_ns = latency_ns
        self._byte_ns = byte_time_ns(baud)
        self._lanes = Lane(self._byte_ns, latency_ns), Lane(self._byte_ns, latency_ns)
        self._place = Spot()
        self._bare = BareAnswers()
        self._now = self._out = 0

    @property
    def hold_ns(self) -> int:
        """The longest time that anything is held: the latency and the longest frame."""
        longest = self.protocol.longest if self.protocol is not None else 0
        return self._latency_ns + longest * self._byte_ns

    @property
    def pending(self) -> int:
        """Bytes held back because their place is not settled."""
        return sum(len(lane.data) for lane in self._lanes)

    def feed(self, chunks: Iterable[Chunk]) -> list[Chunk]:
        """Take chunks of both wires; return what is settled, in order."""
        out: list[Chunk] = []
        timed = [(self._now if k.t_ns is None else k.t_ns, k) for k in chunks]
        for t_ns, chunk in sorted(timed, key=lambda e: e[0]):
            out += self.idle(t_ns)
            self._lanes[RX if chunk.direction == Direction.RX else TX].add(chunk, t_ns)
        return out

    def idle(self, now_ns: int) -> list[Chunk]:
        """Tell how late it is: no chunk with an earlier stamp will come; return what is settled."""
        self._now = max(self._now, now_ns)
        out: list[Chunk] = []
        while (due := self._due_ns) < self._now:
            out += self._settle(due)
        return out

    def close(self) -> list[Chunk]:
        """Return all that is held, in order; the merger may be fed again afterwards."""
        return self._settle(NEVER_NS) if self._due_ns < NEVER_NS else []

    @property
    def _due_ns(self) -> int:
        return min(lane.due_ns(self.hold_ns) for lane in self._lanes)

    def _settle(self, now_ns: int) -> list[Chunk]:
        """Order what came by then; hand on what nothing that comes later can change."""
        # Two reads and their answers (units that begin at 9.1 and 11.6, and at 8.6 and 12.1 ms),
        # settled at 38.7 ms with a hold of 30:
        #
        #     steps      Q1    A1    Q2    A2
        #     first_ns   9.1   8.6   11.6  12.1
        #     due        8.7: A1 must be handed on, and Q1, as it stands before it
        #     settled    21.7: the others may be, as nothing that waits begins before they end
        #
        # Only a prefix of the order is handed on, up to the last step that is due or settled; the
        # rest is ordered anew in the next pass, with more known. ``Spot`` carries what that must
        # know of it.
        due = now_ns - self.hold_ns
        # Half a frame's time is left for the rest of an answer that cannot be told from its wire.
        settled = now_ns - (self._latency_ns + self.hold_ns) // 2
        units: list[list[Unit]] = []
        ahead: list[int] = []
        for wire, lane in enumerate(self._lanes):
            frames, until = self._frames(wire, due)
            units.append(lane.units(frames, until))
            ahead += lane.times[until : until + 1]
        waits = min(ahead, default=NEVER_NS)
        steps = self._order(units[TX], units[RX], now_ns - self._latency_ns)
        n = 1 + max(
            i
            for i, (_, (first, *more), _) in enumerate(steps)
            if first.first_ns <= due
            or (first.first_ns <= settled and [first, *more][-1].last_ns < waits)
        )
        ahead += [s.units[-1].last_ns for s in steps[n:]]
        ends = {s.wire: s.units[-1].end for s in steps[:n]}
        self._place = steps[n - 1].place.carried(sum(ends.values()))
        return self._hand_on(steps[:n], min(ahead, default=NEVER_NS))

    def _frames(self, wire: int, due: int) -> tuple[Framed, int]:
        """Frame one wire; return its frames, and where the bytes begin that may become one.

        Bytes that came at ``due`` or before wait no longer.
        """
        lane = self._lanes[wire]
        n = len(lane.data)
        if self.protocol is None or not n:
            return [], n
        # FF FF FF 01 20 F2 begins a packet of 37 bytes, of which no more come; a read stands behind
        # it, at 6 to 15. First nothing is decided: the read may be inside that packet. But the
        # packet's first byte came at ``due`` or before (``late`` is 1, the first byte that did
        # not), so it is none: framing goes on behind that byte, finds 6 to 15, and all 15 bytes are
        # decided.
        data = np.frombuffer(bytes(lane.data), np.uint8)
        spans, decided = self._framed(wire, data, 0, final=lane.times[-1] <= due)
        late = bisect_right(lane.times, due)
        for attempt in range(RETRIES):
            # What waits for bytes may be a longer frame: only those in front of it are told.
            more, _ = self._framed(wire, data, decided, final=True)
            more = more.take(np.logical_and.accumulate(more.start == _shifted(more.end, decided)))
            spans = Spans.concat([spans, more])
            decided = int(more.end[-1]) if len(more) else decided
            if decided >= late:
                break
            # What has waited so long is no frame: framing goes on behind its first byte.
            final = attempt == RETRIES - 1
            more, end = self._framed(wire, data, decided + 1, final=final)
            spans = Spans.concat([spans, more])
            decided = max(int(more.end[-1]) if len(more) else 0, late) if final else end
        if not len(spans):
            return [], decided
        protocol = self.protocol
        f = protocol.describe(Block(data, _NONE, True), spans)
        windows = protocol.window_ns(f)
        speaks = (f.kind == REQUEST) & (f.reply != NEVER) if wire == TX else f.kind == RESPONSE
        columns = f.start, f.end, speaks, f.servo_id, f.token, f.alt_id, f.reply, windows
        out: Framed = []
        for start, end, says, who, token, alt, reply, window in zip(
            *(c.tolist() for c in columns), strict=True
        ):
            must = reply in (IF_READ, MUST)
            raw = data[start:end].tobytes()
            said = Said(who, token, alt, reply == MANY, must, raw, window)
            out.append((start, end, said if says else None))
        return out, decided

    def _framed(self, wire: int, data: U8, start: int, *, final: bool) -> tuple[Spans, int]:
        """Frame from an offset on; return the frames, and how far every byte has its fate."""
        assert self.protocol is not None
        if start == len(data):
            return Spans.empty(), start
        rest = data[start:]
        spans, decided = self.protocol.frame(Block(rest, _NONE, final))
        if wire == TX and (bare := _bare(spans)).any():
            # The answer is on the other wire: these bytes are the beginning of something else.
            spans, decided = self.protocol.frame(Block(rest, spans.start[bare], final))
            spans = spans.take(~_bare(spans))
        return Spans(spans.start + start, spans.end + start, spans.kind), decided + start

    def _order(self, asked: list[Unit], heard: list[Unit], known_ns: int) -> list[Step]:
        protocol = self.protocol
        if protocol is None:
            return by_time(asked, heard, self._place, Rules(0, 0, ordered=False))[0]
        rules = Rules(protocol.reach, protocol.tail_ns, protocol.ordered)
        asks = self._place.ask is not None or bool(self._place.pending)
        asks = asks or any(u.said for u in asked)
        # What the tap read late came in any order: more of it must be weighed at once.
        more = BURST if any(held_of(c) for lane in self._lanes for c in lane.chunks) else 1
        steps, is_best = by_time(asked, heard, self._place, rules)
        if is_best or not asks or not heard or len(asked) * len(heard) > CELLS * more:
            return steps
        heard, bare = self._bare_answers(asked, heard, TRIALS * more)
        if len(asked) * len(heard) > CELLS * more:
            return by_time(asked, heard, self._place, rules)[0]
        return by_cause(asked, heard, self._place, known_ns, bare, rules)

    def _bare_answers(
        self, asked: list[Unit], heard: list[Unit], most: int
    ) -> tuple[list[Unit], Bare]:
        """Find answers without a header; return the servos' units, cut at them, and where.

        ``most`` is how many bytes are tried as their beginning.
        """
        lane = self._lanes[RX]
        offsets, stops = _unclaimed(heard)
        requests = [(0, self._place.ask, 0)]
        requests += [(i, u.said, u.soonest_ns) for i, u in enumerate(asked, 1) if u.framed]
        protocol = self.protocol
        # Many more bytes than so many requests can have as answers are no answers.
        if not 0 < len(offsets) <= BARE * (BARE + len(requests)) or protocol is None:
            return heard, {}
        # A read at 10 ms and an io_write of 01 at 12 ms, and one read of four bytes at 12.5:
        #
        #     offset      0            1            2            3
        #     byte        07           63           01           01
        #     behind 1    2, FITS      2, FITS      2, FITS      -         the read
        #     behind 2    2, NEARLY    2, NEARLY    2, FITS      -         the io_write
        #     units       0..1         1..2         2..3         3..4      cut at ``cuts``
        #
        # Which of them it was is not decided here: the units are cut wherever an answer may begin
        # or end, and ``by_cause`` weighs all. Here 07 63 goes behind the read and 01 01 behind the
        # io_write; by their stamps alone all four would stand behind both.
        pairs: list[tuple[int, int]] = []
        tries: list[tuple[bytes, bytes]] = []
        for i, ask, soonest in requests:
            if ask is None:
                continue
            until = asked[i].last_ns if i < len(asked) else NEVER_NS
            if len(tries) + len(offsets) > most:
                return heard, {}
            for at, stop in zip(offsets, stops, strict=True):
                t = lane.times[at]
                if soonest <= t - self._byte_ns and lane.soonest[at] <= until:
                    pairs.append((i, at))
                    tries.append((ask.raw, bytes(lane.data[at : min(stop, at + BARE)])))
        found = self._bare.find(protocol, tries)
        hits = [(p, told) for p, told in zip(pairs, found, strict=True) if told[0]]
        cuts = {at for (_, at), _ in hits} | {at + length for (_, at), (length, _) in hits}
        units: list[Unit] = []
        for unit in heard:
            inside = () if unit.framed else sorted(c for c in cuts if unit.start < c < unit.end)
            edges = [unit.start, *inside, unit.end]
            units += [lane.unit(*e) for e in itertools.pairwise(edges)] if inside else [unit]
        number = {u.start: j for j, u in enumerate(units) if u.end > u.start}
        behind = {u.end: j + 1 for j, u in enumerate(units) if u.end > u.start}
        return units, {
            (i, number[at]): (behind[at + length], worth) for (i, at), (length, worth) in hits
        }

    def _hand_on(self, steps: Sequence[Step], ahead: int) -> list[Chunk]:
        """Cut the chunks as the order asks; ``ahead`` is the earliest stamp of what follows."""
        pieces: list[Piece] = []
        done = [0, 0]
        for step in steps:
            for unit in step.units:
                done[step.wire] = unit.end
                for chunk, start, end, t_ns in self._lanes[step.wire].take(unit):
                    if pieces and pieces[-1][0] is chunk:
                        start = pieces.pop()[1]
                    pieces.append((chunk, start, end, t_ns))
        for lane, end in zip(self._lanes, done, strict=True):
            lane.forget(end)
        # Backwards, each stamp is lowered to the earliest behind it: 10.0, 9.5, 12.5, 13.0 become
        # 9.5, 9.5, 12.5, 13.0. It stays the latest moment, as what stands before came before.
        # Lowering stops at the latency; what is still out of order then is raised on the way
        # forwards (``_out``).
        stamps: list[int] = []
        for chunk, *_, t_ns in reversed(pieces):
            ahead = max(min(ahead, t_ns), t_ns - self._latency_ns - held_of(chunk))
            stamps.append(ahead)
        out: list[Chunk] = []
        for piece in pieces:
            self._out = max(stamps.pop(), self._out)
            out.append(self._piece(piece, self._out))
        return out

    def _piece(self, piece: Piece, t_ns: int) -> Chunk:
        """Return a part of a chunk; a mark goes with the byte that it begins at."""
        chunk, start, end, told_ns = piece
        size = len(chunk.data)
        marks = tuple(
            m._replace(start=m.start - start)
            for m in chunk.marks
            if (m.start >= start or not start) and (m.start < end or end == size)
        )
        if t_ns != told_ns:
            marks += (Mark(MarkKind.REORDERED, 0, end - start, abs(t_ns - told_ns)),)
        data = chunk.data[start:end]
        return replace(chunk, data=data, t_ns=t_ns, bus=self._bus, marks=marks)


def _shifted(ends: I64, first: int) -> I64:
    """Return where each frame begins if they stand end to end."""
    return np.concatenate([[first], ends])[:-1]


def _bare(spans: Spans) -> Mask:
    """Tell which spans are answers that stand right behind their request."""
    out = np.zeros(len(spans), bool)
    out[1:] = (spans.kind[1:] == RESPONSE) & (spans.kind[:-1] == REQUEST)
    out[1:] &= spans.start[1:] == spans.end[:-1]
    return out


def _unclaimed(units: Sequence[Unit]) -> tuple[list[int], list[int]]:
    """Return the offsets of bytes that no frame claims, and where each one's run ends."""
    offsets: list[int] = []
    stops: list[int] = []
    # Bytes 0..4 and 4..6 unclaimed, a frame 6..15, byte 15..16: runs end at 6, 6 and 16. From
    # behind, as a unit is of the same run as the next one if it ends where that begins.
    stop = -1
    for unit in reversed(units):
        if unit.framed or unit.start == unit.end:
            continue
        stop = stop if unit.end in offsets[-1:] else unit.end
        offsets += range(unit.end - 1, unit.start - 1, -1)
        stops += [stop] * (unit.end - unit.start)
    return offsets[::-1], stops[::-1]
