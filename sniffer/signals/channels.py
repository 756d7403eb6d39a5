"""Which channels of a capture carry serial bytes, and those bytes as chunks.

A rate alone cannot tell: a clock has a perfect one. What its bytes say can: of a clock, a PWM or
the wires of another bus next to nothing is explained by any protocol, of a servo bus nearly all. So
each channel is gathered until it has said enough, its rate is found, and the protocols are asked.
What none of them explains is read where it looks like serial bytes and runs at the rate of one that
is, or where there is nothing better.
"""

from __future__ import annotations

import itertools
import math
import re
from collections import Counter
from typing import TYPE_CHECKING, Final

import numpy as np

from sniffer.decoding.detect import FEW, Scores
from sniffer.ground.limits import BUSES_MOST
from sniffer.ground.model import Direction, InputError
from sniffer.ground.runs import ChunkRun
from sniffer.ground.wording import Sentence, and_, nearly
from sniffer.protocols import PROTOCOLS
from sniffer.signals.chunking import Chunker
from sniffer.signals.gathering import ChannelVerdict, SignalChannel
from sniffer.signals.rates import (
    EDGES,
    EDGES_LEAST,
    SAMPLES_LEAST,
    STANDARD,
    BitTime,
    WireEdges,
    bit_time,
    received,
    shortest_pulse,
)
from sniffer.signals.stretch import Stretch
from sniffer.signals.uart import NO_PARITY

if TYPE_CHECKING:
    from collections.abc import Mapping, Sequence

    from sniffer.ground.model import Chunk
    from sniffer.ground.wiring import Wiring
    from sniffer.signals.stretch import LogicInput

ACTIVE_MOST: Final = 64
"""Channels that say something and are looked at without being named: no analyser has more."""

WAITING_MOST: Final = 1 << 21
"""Edges that are kept while it is open whether their channels are read: it bounds memory."""

PLAUSIBLE: Final = 0.95
"""Share of bytes without an error from which on a wire looks like serial ..."""

ALIKE: Final = 2
"""... if it says more than so many different bytes: a clock says one, a PWM few."""

SPREAD_MOST: Final = 0.2
"""Spread of edges about the borders of bits, in bits, of what looks like serial."""

SAMPLES_GOOD: Final = 8
"""Samples a bit that a person is told to use: edges are known to an eighth of a bit."""

SHOWN: Final = 16
"""Names of channels in a message."""

_WAY: Final = re.compile(r"(?:^|[^a-z])([tr])xd?(?:[^a-z]|$)", re.IGNORECASE)


class Channels:
    """The channels of a capture, stretch by stretch, as chunks of buses.

    Two channels of one bus are its two wires: their chunks come in order of time, with a direction
    where one is called TX and the other RX.

    Args:
        given: the capture; its stretches are handed in by ``take``.
        wiring: what was said of its wires.

    Raises:
        InputError: a channel was named that is not there.
    """

    def __init__(self, given: LogicInput, wiring: Wiring) -> None:
        self._given, self._wiring = given, wiring
        self._tick_ns, self._sample = given.tick_ns, given.sample
        self._glitch = None if wiring.glitch_us is None else wiring.glitch_us * 1e3 / given.tick_ns
        self._rates = frozenset(rate for p in PROTOCOLS.candidates() for rate in p.bauds)
        self._channels = _named(given.names, wiring)
        if len(wiring.channels) > BUSES_MOST:
            raise InputError(f"{len(wiring.channels)} channels are named: {BUSES_MOST} at most")
        wires = Counter(channel.bus for channel in self._channels.values())
        self._held: dict[str, list[Chunk]] = {bus: [] for bus, n in wires.items() if n > 1}
        for channel in self._channels.values():
            if channel.bus in self._held:
                channel.direction = _wire(channel.name)
        # those that nobody named and that say nothing are not gone through each time: of a chip
        # there are sixty thousand
        self._heard = {row: c for row, c in self._channels.items() if c.is_asked}
        self._is_over = False
        self._none = [np.empty(0, np.int64)] * len(given.names)
        self._end = Stretch([1] * len(given.names), self._none, 0)

    @property
    def is_settled(self) -> bool:
        """Whether it is known of all channels how they are read."""
        if self._is_over:
            return True
        is_all = len(self._heard) == len(self._channels)
        return is_all and not any(c.is_open for c in self._heard.values())

    def take(self, stretch: Stretch) -> Sequence[Chunk]:
        """Return what is complete, in order of time.

        Raises:
            InputError: a channel that was named cannot be read.
        """
        return self._take(stretch, last=False)

    def end(self) -> Sequence[Chunk]:
        """Return what is left when no more comes.

        Raises:
            InputError: a channel that was named cannot be read, or none can.
        """
        return self._take(self._end, last=True)

    def _take(self, stretch: Stretch, *, last: bool) -> Sequence[Chunk]:
        out: list[Sequence[Chunk]] = []
        self._is_over = last
        self._end = Stretch(stretch.levels, self._none, stretch.until)
        self._listen(stretch)
        for row, channel in self._heard.items():
            edges = stretch.edges[row]
            if channel.is_read:
                out.append(channel.read(edges, stretch.until, last=last))
            elif not channel.is_left_out:
                channel.gather(stretch.levels[row], edges, stretch.until)
        self._need_few()
        for channel in self._heard.values():
            is_enough = channel.count >= EDGES or last
            if channel.is_open and channel.verdict is None and is_enough:
                channel.verdict = self._judged(channel)
        out += self._decided(last=last)
        if last:
            self._need_any()
            for row, channel in self._channels.items():
                if row not in self._heard:
                    channel.drop()
        return self._in_order([part for part in out if part], last=last)

    def _listen(self, stretch: Stretch) -> None:
        """Take in the channels that say something for the first time."""
        rows = self._channels if stretch.active is None else stretch.active
        new = [
            row
            for row in rows
            if row not in self._heard and row in self._channels and len(stretch.edges[row])
        ]
        if new:
            self._heard = {row: self._channels[row] for row in sorted((*self._heard, *new))}

    def facts(self) -> dict[str, str]:
        """Return what is known of the buses, as a recording would say it."""
        out: dict[str, str] = {}
        for channel in self._read():
            told = self._told(channel)
            out.setdefault(f"baud.{channel.bus}", str(told.baud))
            out.setdefault(f"latency_ns.{channel.bus}", str(self._late_ns(channel)))
        return out

    def notes(self) -> list[str]:
        """Return what a person should know."""
        out = []
        for channel in self._read():
            told = self._told(channel)
            words = [f"{channel.name} is read at {told.baud} baud"]
            if abs(told.measured / told.baud - 1) >= 0.005:
                words.append(f"{told.measured:.0f} measured")
            words += ["inverted"] * told.invert
            words += [f"with {told.parity} parity"] * (told.parity != NO_PARITY)
            if channel.short_pulses:
                words.append(f"{channel.short_pulses} short pulses left out")
            out.append(", ".join(words))
        for one, other in itertools.combinations(self._read(), 2):
            if one.bus != other.bus and one.is_like(other):
                way = ", upside down" * (self._told(one).invert != self._told(other).invert)
                out.append(f"{other.name} says what {one.name} says{way}: name one of them")
        out += [
            f"{c.name} is left out: {c.verdict.why}"
            for c in self._heard.values()
            if c.is_left_out and c.verdict is not None and c.count
        ]
        buses = {channel.bus: channel for channel in self._read()}
        if {Direction.TX, Direction.RX} <= {_wire(c.name) for c in buses.values()}:
            out.append("TX and RX are two buses here: name one bus for both if they are its wires")
        return out

    def _late_ns(self, channel: SignalChannel) -> int:
        """Return by how much an edge may be older than its sample."""
        return math.ceil((channel.sample or 1) * self._tick_ns)

    def _read(self) -> list[SignalChannel]:
        return [channel for channel in self._heard.values() if channel.is_read]

    def _told(self, channel: SignalChannel) -> BitTime:
        told = channel.verdict and channel.verdict.told
        assert told is not None, "it is read"
        return told

    def _judged(self, channel: SignalChannel) -> ChannelVerdict:
        """Say what is to be thought of a channel by what it said."""
        found = channel.found()
        if len(found.edges) > 2 * EDGES:
            found = WireEdges(found.level, found.edges[: 2 * EDGES], int(found.edges[2 * EDGES]))
        told = bit_time(
            found,
            self._tick_ns,
            sample=self._sample,
            preferred=self._rates,
            baud=self._wiring.baud,
            invert=self._wiring.invert,
            glitch=self._glitch,
        )
        if told is None:
            return ChannelVerdict(None, why=self._too_little(found))
        if self._sample and told.bit < SAMPLES_LEAST * self._sample:
            return ChannelVerdict(None, why=self._too_slow(told.bit, told.baud))
        got = received(found, told, self._glitch)
        chunks = Chunker(told, self._given, channel.bus).chunks(got)
        share = max(Scores(chunks, told.baud).shares.values(), default=0.0)
        is_serial = (
            told.good >= PLAUSIBLE
            and told.spread < SPREAD_MOST
            and (told.baud in STANDARD or told.baud in self._rates or self._wiring.baud is not None)
            and len(np.unique(got.value)) > ALIKE
        )
        if share >= FEW and told.good >= 0.5:
            return ChannelVerdict(told, is_explained=True, is_plausible=is_serial)
        return ChannelVerdict(told, is_plausible=is_serial, why=self._no_bytes(found, told))

    def _too_little(self, found: WireEdges) -> str:
        n = len(found.edges)
        if n < EDGES_LEAST:
            return f"{n} edges are too few to tell a rate"
        return self._undersampled(found) or "its edges fit no rate"

    def _no_bytes(self, found: WireEdges, told: BitTime) -> str:
        if why := self._undersampled(found):
            return why
        return f"no serial bytes are on it that a protocol knows (best at {told.baud} baud)"

    def _undersampled(self, found: WireEdges) -> str:
        pulse = shortest_pulse(found)
        if not 0 < pulse < SAMPLES_LEAST * self._sample:  # none at all: rows of one time
            return ""
        return self._too_slow(pulse, 0)

    def _too_slow(self, bit: float, baud: int) -> str:
        """Say that there are too few samples of a bit, and how many a second are needed."""
        a_bit = bit / self._sample
        rate = 1e9 / self._tick_ns / self._sample
        least = _hertz(SAMPLES_LEAST * (baud or rate / a_bit))
        good = _hertz(SAMPLES_GOOD * (baud or rate / a_bit))
        what = f"{baud} baud" if baud else "its shortest pulses"
        return (
            f"{what} have {a_bit:.1f} samples a bit at {_hertz(rate)}: capture it at {least} or "
            f"more, better {good}"
        )

    def _decided(self, *, last: bool) -> list[Sequence[Chunk]]:
        """Begin to read what is known to be serial; return what that gives."""
        waiting = [c for c in self._heard.values() if c.is_open and c.verdict is not None]
        out: list[Sequence[Chunk]] = []
        for channel, verdict in ((c, c.verdict) for c in waiting if c.verdict is not None):
            self._need_if_asked(channel)
            if channel.is_left_out:
                continue
            if verdict.is_explained or channel.is_asked:
                out.append(self._begun(channel, last=last))
            elif not verdict.is_plausible:
                channel.drop()
        bauds = {self._told(channel).baud for channel in self._read()}
        full = last or sum(c.count for c in self._heard.values() if c.is_open) > WAITING_MOST
        for channel in (c for c in waiting if c.is_open):
            if self._told(channel).baud in bauds or (full and not bauds):
                out.append(self._begun(channel, last=last))
            elif full:
                channel.drop()
        return out

    def _begun(self, channel: SignalChannel, *, last: bool) -> Sequence[Chunk]:
        return channel.begin(self._told(channel), self._given, self._glitch, last=last)

    def _need_if_asked(self, channel: SignalChannel) -> None:
        """Refuse a channel that was named and cannot be read."""
        verdict = channel.verdict
        if not channel.is_asked or verdict is None or verdict.told is not None:
            return
        if channel.count and self._wiring.baud is None and channel.count < EDGES_LEAST:
            told = "{channel}: {why}: state {baud}"
            raise InputError(Sentence(told, channel=channel.name, why=verdict.why))
        if channel.count:
            raise InputError(f"{channel.name}: {verdict.why}")
        channel.drop()

    def _need_few(self) -> None:
        """Refuse a capture of a whole chip, of which nobody said what to look at."""
        heard = sum(c.count > 0 for c in self._heard.values() if not c.is_asked)
        if heard > ACTIVE_MOST:
            told = "{heard} channels change: name those with serial bytes, {channels}"
            raise InputError(Sentence(told, heard=heard))

    def _need_any(self) -> None:
        """Refuse a capture of which nothing is read."""
        channels = self._channels.values()
        if any(channel.is_read for channel in channels):
            return
        active = [c for c in channels if c.count and c.verdict is not None]
        if not active:
            names = and_([c.name for c in channels][:SHOWN])
            raise InputError(f"no channel ({names}) changes its level: nothing to decode")
        why = "; ".join(f"{c.name}: {c.verdict.why}" for c in active[:SHOWN] if c.verdict)
        told = "no channel has serial bytes ({why}); name one to read it all the same, {channels}"
        raise InputError(Sentence(told, why=why))

    def _in_order(self, parts: list[Sequence[Chunk]], *, last: bool) -> Sequence[Chunk]:
        """Hold back, of buses with two wires, what another wire may still come before."""
        if len(parts) == 1 and not self._held and _ascends(parts[0]):
            return parts[0]
        out = [chunk for part in parts for chunk in part]
        for bus, held in self._held.items():
            of_bus = [c for c in self._heard.values() if c.bus == bus]
            held += [chunk for chunk in out if chunk.bus == bus]
            held.sort(key=_time)
            horizon = min((c.horizon for c in of_bus if not c.is_left_out), default=0)
            end_ns = self._given.zero_ns + horizon * self._tick_ns
            ready = len(held) if last else sum(_time(chunk) <= end_ns for chunk in held)
            out = [chunk for chunk in out if chunk.bus != bus] + held[:ready]
            del held[:ready]
        if len(self._channels) > 1:
            out.sort(key=_time)
        return out


def _named(names: Sequence[str], wiring: Wiring) -> Mapping[int, SignalChannel]:
    """Return the channels that are read or looked at, by their place in the capture.

    Raises:
        InputError: a channel was named that is not there.
    """
    asked = wiring.channels
    for name in asked:
        if name not in names:
            there = and_(list(names[:SHOWN]))
            raise InputError(f"there is no channel {name[:40]!r}, but {there}{nearly(name, names)}")
    return {
        row: SignalChannel(name, asked.get(name) or name, is_asked=name in asked)
        for row, name in enumerate(names)
        if not asked or name in asked
    }


def _wire(name: str) -> Direction:
    """Return which wire of a bus a channel is, by its name."""
    way = _WAY.search(name)
    if way is None:
        return Direction.UNKNOWN
    return Direction.TX if way[1] in "tT" else Direction.RX


def _time(chunk: Chunk) -> int:
    return chunk.t_ns or 0


def _ascends(chunks: Sequence[Chunk]) -> bool:
    """Tell whether these come in order of time for certain."""
    return isinstance(chunks, ChunkRun) and bool((np.diff(chunks.t_ns) >= 0).all())


def _hertz(rate: float) -> str:
    """Return a rate of samples as people say it, rounded up to three digits."""
    step = 10 ** max(math.floor(math.log10(rate)) - 2, 0)
    rate = math.ceil(rate / step - 1e-9) * step
    for unit, name in ((1e9, "GHz"), (1e6, "MHz"), (1e3, "kHz")):
        if rate >= unit:
            return f"{rate / unit:.4g} {name}"
    return f"{rate:.4g} Hz"
