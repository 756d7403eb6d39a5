"""Captures that are merged: what is added to the times of each, so that they have one clock."""

from __future__ import annotations

from dataclasses import dataclass, replace
from pathlib import Path
from typing import TYPE_CHECKING, NamedTuple

from sniffer.decoding.detect import UndecidedError, detect
from sniffer.decoding.names import protocols_named
from sniffer.decoding.options import AUTO
from sniffer.ground.model import NEVER_NS, NS, Chunk, Clock, Direction, InputError, SnifferError
from sniffer.ground.timing import LATENCY_NS, byte_time_ns
from sniffer.ground.wording import Sentence
from sniffer.jobs.order import merged
from sniffer.merging.aligning import MOST, Alignment, aligned
from sniffer.merging.answering import WireHeard, answered, are_swapped, are_taps
from sniffer.merging.merger import Merger
from sniffer.tap.waiting import UNSAID_NS

if TYPE_CHECKING:
    from collections.abc import Iterator, Mapping, Sequence

    from sniffer.decoding.options import Options
    from sniffer.jobs.telling import Teller
    from sniffer.protocols.base import BusProtocol
    from sniffer.sources import Source


@dataclass(slots=True)
class Input:
    """A capture that is merged: ``shift_ns`` is added to its times, ``names`` are its buses'."""

    path: str
    source: Source
    options: Options
    facts: Mapping[str, str]
    buses: dict[str, tuple[int, int]]
    names: dict[str, str]
    shift_ns: int = 0
    wire: Direction | None = None

    def chunks(self, tell: Teller) -> Iterator[tuple[int, Chunk]]:
        """Yield chunks on the common clock, under the common names, each with its place in time."""
        t = 0
        for group in merged(self.source, self.source, self.options, tell.quieter()):
            for chunk in group:
                at = None if chunk.t_ns is None else chunk.t_ns + self.shift_ns
                t = t if at is None else max(t, at)
                wire = chunk.direction if self.wire is None else self.wire
                yield t, replace(chunk, t_ns=at, bus=self.names[chunk.bus], direction=wire)


def named(inputs: Sequence[Input], name: str) -> Input:
    """Return the input of a path, of a file's name or of that without its suffix."""
    for told in (lambda p: str(p), lambda p: p.name, lambda p: p.stem):
        found = [one for one in inputs if told(Path(one.path)) == name]
        if len(found) == 1:
            return found[0]
    known = ", ".join(one.path for one in inputs)
    raise SnifferError(f"{name!r} is none of the captures: {known}")


def times_of(source: Source) -> dict[str, tuple[int, int]]:
    """Return when each bus of a capture is first and last heard.

    Raises:
        InputError: it has no times.
    """
    out: dict[str, tuple[int, int]] = {}
    for group in source:
        for chunk in group:
            if chunk.t_ns is None or chunk.clock == Clock.NONE:
                raise InputError(f"{source.name} has no times: it cannot be merged by them")
            first, last = out.get(chunk.bus, (chunk.t_ns, chunk.t_ns))
            out[chunk.bus] = min(first, chunk.t_ns), max(last, chunk.t_ns)
    if not out:
        raise InputError(f"{source.name} is empty: nothing to merge")
    return out


def align_taps(inputs: Sequence[Input], given: set[str], tell: Teller) -> None:
    """Find what is to be added to the times of each to be on the clock of the first.

    Raises:
        InputError: no traffic tells.
    """
    base = inputs[0]
    for one in inputs[1:]:
        if one.path in given:
            by = f"{one.shift_ns / NS:+.6f} s to its times, as was told"
            tell.talk(f"{one.path}: {by}: nothing was looked for")
            continue
        found = aligned(_head(base), _head(one), byte_ns=(_byte_ns(base), _byte_ns(one)))
        if found is None:
            told = (
                "{one} and {base} have no traffic in common that tells their clocks apart: give "
                "{offsets}"
            )
            raise InputError(Sentence(told, one=one.path, base=base.path))
        by = "runs of bytes that both heard, half of them within"
        _shift(one, base, found, f"{by} {found.spread_ns / 1e6:.3f} ms", tell)


def _shift(one: Input, base: Input, found: Alignment, by: str, tell: Teller) -> None:
    """Put a capture on the clock of another one; tell it, and ``by`` how many of what."""
    one.shift_ns = base.shift_ns - found.offset_ns
    tell.talk(f"{one.path}: {one.shift_ns / NS:+.6f} s to its times, by {found.runs} {by}")


def _byte_ns(one: Input) -> int:
    """Return how long a byte takes on the bus that speaks first; 0 where nobody said its rate."""
    baud = one.options.bauds.get(next(iter(one.buses)), one.options.baud)
    return 0 if baud is None else byte_time_ns(baud)


def _head(one: Input, since_ns: int = -NEVER_NS) -> Iterator[Chunk]:
    """Yield the chunks of the bus that speaks first, as many as are compared, from a time on."""
    bus = next(iter(one.buses))
    size = 0
    for group in one.source:
        for chunk in group:
            if chunk.bus == bus and chunk.t_ns is not None and chunk.t_ns >= since_ns:
                yield chunk
                size += len(chunk.data)
        if size >= MOST:
            return


class Wires(NamedTuple):
    """What is spoken on two wires of one bus, and by how much their stamps may lag.

    ``late_ns`` is by how much more a recorder came late that did not say so.
    """

    protocol: BusProtocol
    baud: int
    latency_ns: int
    late_ns: int

    def merger(self, bus: str) -> Merger:
        """Return what puts their chunks in order."""
        lag_ns = self.latency_ns + self.late_ns
        return Merger(bus, latency_ns=lag_ns, baud=self.baud, protocol=self.protocol)


def wires_of(asks: Input, says: Input, options: Options) -> Wires:
    """Return what two captures tell of their bus: of the controller's wire, and of the servos'.

    Raises:
        InputError: nothing tells which protocol it is.
        SnifferError: it speaks two.
    """
    named = next(iter(asks.options.protocols.values()), options.protocol)
    if named == AUTO:
        try:
            named = detect(list(_head(asks)), options.baud).protocol
        except UndecidedError:
            named = detect(list(_head(says)), options.baud).protocol
    spoken = protocols_named(named)
    if len(spoken) > 1:
        raise SnifferError("two wires on which two protocols are spoken cannot be put in order")
    both = asks.options, says.options
    bauds = [baud for one in both for baud in one.bauds.values()]
    baud = options.baud or next(iter(bauds), spoken[0].baud)
    recorded = [v for one in both for v in one.latencies.values()]
    latency = options.latency_ns
    if latency is None:
        latency = max(recorded, default=LATENCY_NS[Clock.READ])
    return Wires(spoken[0], baud, latency, UNSAID_NS if recorded else 0)


def put_on_one_clock(asks: Input, says: Input, wires: Wires, tell: Teller, *, align: bool) -> None:
    """Find how the clocks of two wires differ, by who answers what.

    ``align``: what is found is added to the times of the servos' wire. Else it is told, where the
    clocks seem to differ by more than their stamps may lag.

    Raises:
        InputError: no exchange tells what is to be added.
        SnifferError: the first is the servos' wire, or they are no two wires.
    """
    asked, heard = _heads(asks, says, wires)
    if are_swapped(asked, heard):
        raise SnifferError(
            f"{asks.path} heard only answers, and {says.path} only requests: name the controller's "
            "wire first"
        )
    if are_taps(asked, heard):
        raise SnifferError(
            Sentence(
                "{asks} and {says} each heard requests and answers: two taps of the whole bus, and "
                "not its two wires; leave out {pair}",
                asks=asks.path,
                says=says.path,
            )
        )
    found = answered(asked, heard)
    if align:
        _align_answers(asks, says, found, tell)
    elif found is not None:
        _tell_difference(asks, says, found, wires.latency_ns, tell)


def _align_answers(asks: Input, says: Input, found: Alignment | None, tell: Teller) -> None:
    if found is None:
        told = (
            "no answers of {says} tell its clock from that of {asks}: too few fit a request, or as "
            "many with several differences; give {offsets}"
        )
        raise InputError(Sentence(told, says=says.path, asks=asks.path))
    by = (
        "answers and the requests that they fit: the fastest counts as one that came at once, the "
        "others within"
    )
    _shift(says, asks, found, f"{by} {found.spread_ns / 1e6:.1f} ms", tell)


def _tell_difference(
    asks: Input, says: Input, found: Alignment, latency_ns: int, tell: Teller
) -> None:
    ahead_ns = found.offset_ns + says.shift_ns - asks.shift_ns
    if -latency_ns <= ahead_ns <= latency_ns + found.spread_ns:
        return
    told = (
        "the clock of {says} seems to be {ahead} s {side} that of {asks}, by {runs} answers and "
        "the requests that they fit: say {align}, or what to add by {offsets}"
    )
    side = "ahead of" if ahead_ns > 0 else "behind"
    ahead, runs = f"{abs(ahead_ns) / NS:.3f}", found.runs
    tell.warn(Sentence(told, says=says.path, asks=asks.path, ahead=ahead, side=side, runs=runs))


def _heads(asks: Input, says: Input, wires: Wires) -> tuple[WireHeard, WireHeard]:
    """Return what each of two wires carried, as much as is compared.

    Where both were heard at one time by their clocks, what came before is not compared: one of the
    taps may have been started an hour earlier.
    """
    (from_, to), (began, ended) = (
        (first + one.shift_ns, last + one.shift_ns)
        for one in (asks, says)
        for first, last in one.buses.values()
    )
    since = max(from_, began) if max(from_, began) < min(to, ended) else min(from_, began)
    asked, heard = (
        WireHeard.of(_head(one, since - one.shift_ns), protocol=wires.protocol, baud=wires.baud)
        for one in (asks, says)
    )
    return asked, heard
