"""The ports of a recording: which bus each is, how it is read, what is known about it."""

from __future__ import annotations

import contextlib
from dataclasses import dataclass, field, replace
from typing import TYPE_CHECKING, Literal

from sniffer.decoding.names import joined, protocols_named
from sniffer.decoding.pipeline import AUTO, Options
from sniffer.decoding.rates import RateSearch
from sniffer.ground.limits import FALLBACK_BAUD
from sniffer.ground.model import Direction, SnifferError
from sniffer.ground.wording import Sentence
from sniffer.merging.merger import Merger
from sniffer.messages import ANCHOR
from sniffer.ports import PortOptions, Retunable, open_port
from sniffer.tap.reader import Anchor, Listener
from sniffer.tap.tap import PortSpec, Tap
from sniffer.tap.waiting import UNSAID_NS

if TYPE_CHECKING:
    from collections.abc import Mapping, Sequence

    from sniffer.protocols.base import BusProtocol

Modem = Literal["low", "keep"]


@dataclass(frozen=True, slots=True)
class Listening:
    """How ports are listened to.

    ``modem``: RTS and DTR are put low at once, or kept as opening the port made them. ``pair``: the
    two ports are one full-duplex bus, the controller's wire first. ``shared``: also ports that
    another program has open.
    """

    modem: Modem = "low"
    pair: bool = False
    shared: bool = False


@dataclass(frozen=True, slots=True)
class Tapping:
    """Ports that are listened to, and all that the recorder and the file need to know about them.

    ``searches`` are of the buses whose rate nobody has stated: it is looked for. ``notes`` are for
    the user; ``warnings`` too, also where quiet was asked for.
    """

    listener: Listener
    taps: tuple[Tap, ...]
    anchor: Anchor
    options: Options
    facts: Mapping[str, str]
    mergers: Mapping[str, Merger]
    searches: Mapping[str, RateSearch] = field(default_factory=dict)
    notes: Sequence[str] = ()
    warnings: Sequence[str] = ()


def listen(specs: Sequence[PortSpec], options: Options, how: Listening) -> Tapping:
    """Open all ports, or none, and begin to listen.

    Raises:
        InputError: a port cannot be opened; the message says what to do.
        SnifferError: the ports are no pair where one was meant.
    """
    pair = how.pair
    specs = _paired(specs) if pair else specs
    wires = (Direction.TX, Direction.RX) if pair else (Direction.UNKNOWN,) * len(specs)
    ways = [
        PortOptions(_baud(spec, options) or FALLBACK_BAUD, how.modem, shared=how.shared)
        for spec in specs
    ]
    taps: list[Tap] = []
    with contextlib.ExitStack() as stack:
        for spec, wire, port_options in zip(specs, wires, ways, strict=True):
            port = open_port(spec.port, port_options)
            stack.callback(port.close)
            taps.append(Tap(spec, port, wire))
        stack.pop_all()
    anchor = Anchor.take()
    searches = {} if pair else _searches(taps, options)
    latencies = {tap.spec.bus: _latency(taps, tap.spec.bus, options) for tap in taps}
    told = replace(
        options,
        protocols={spec.bus: spec.protocol for spec in specs if spec.protocol is not None},
        bauds={
            tap.spec.bus: tap.port.baud
            for tap in taps
            if _has_a_rate(tap, options) and tap.spec.bus not in searches
        },
        latencies=latencies,
    )
    mergers: dict[str, Merger] = {}
    if pair:
        protocol = _spoken(specs[0], options)
        bus, baud = specs[0].bus, ways[0].baud
        lag_ns = latencies[bus] + UNSAID_NS
        mergers[bus] = Merger(bus, latency_ns=lag_ns, baud=baud, protocol=protocol)
    facts = _facts(taps, told, anchor, pair)
    listener = Listener([tap.port for tap in taps], ways, anchor)
    listener.start()
    fixed = [t for t in taps if _has_a_rate(t, options) and t.spec.bus not in searches]
    notes = [*_assumed(fixed, options), *_looked_for(searches)]
    warnings = shared(taps)
    return Tapping(listener, tuple(taps), anchor, told, facts, mergers, searches, notes, warnings)


def _assumed(taps: Sequence[Tap], options: Options) -> list[str]:
    """Tell where nobody has said how fast the line is."""
    said = {tap.spec.bus: tap.spec.port for tap in taps if _baud(tap.spec, options) is None}
    return [
        f"{bus}: listening at {FALLBACK_BAUD} bit/s; {port}@BAUD says another rate"
        for bus, port in said.items()
    ]


def _searches(taps: Sequence[Tap], options: Options) -> dict[str, RateSearch]:
    """Return a search for each bus whose rate nobody stated, and whose port can be tuned."""
    out: dict[str, RateSearch] = {}
    for tap in taps:
        stated = tap.spec.baud or options.baud
        if stated is None and not tap.port.is_virtual and isinstance(tap.port, Retunable):
            named = tap.spec.protocol or options.protocol
            spoken = () if named == AUTO else options.all_spoken(named)
            out[tap.spec.bus] = RateSearch(spoken, tap.port.baud)
    return out


def _looked_for(searches: Mapping[str, RateSearch]) -> list[str]:
    return [
        f"{bus}: no rate is stated: listening at {search.baud} bit/s, and at others where nothing "
        "holds"
        for bus, search in searches.items()
    ]


def shared(taps: Sequence[Tap]) -> list[str]:
    """Tell of ports that another program has open without a lock."""
    others = [(tap.spec, tap.port.facts().get("also_open_in", "none")) for tap in taps]
    return [
        f"{spec.bus}: {spec.port} is also open in {who}: of what is said there each of us gets a "
        "part only; end the other one"
        for spec, who in others
        if who not in ("none", "not known")
    ]


def _paired(specs: Sequence[PortSpec]) -> tuple[PortSpec, ...]:
    """Return two ports as one bus: what is said of the first holds for the second."""
    if len(specs) != 2:
        told = "{pair:True} takes two ports: the controller's wire, then the servos'"
        raise SnifferError(Sentence(told))
    tx, rx = specs
    for what, one, other in (
        ("protocol", tx.protocol, rx.protocol),
        ("baud rate", tx.baud, rx.baud),
    ):
        if None not in (one, other) and one != other:
            told = "{pair:True} is one bus: its two ports have one {what}"
            raise SnifferError(Sentence(told, what=what))
    protocol, baud = tx.protocol or rx.protocol, tx.baud or rx.baud
    return tuple(PortSpec(tx.bus, s.port, protocol, baud) for s in specs)


def _baud(spec: PortSpec, options: Options) -> int | None:
    if (baud := spec.baud or options.baud) is not None:
        return baud
    protocol = _spoken(spec, options)
    return None if protocol is None else protocol.baud


def _spoken(spec: PortSpec, options: Options) -> BusProtocol | None:
    """Return what was said to be spoken at a port; None for two protocols, which are not merged."""
    named = spec.protocol or options.protocol
    spoken = () if named == AUTO else options.all_spoken(named)
    return spoken[0] if len(spoken) == 1 else None


def _has_a_rate(tap: Tap, options: Options) -> bool:
    """Tell whether a rate was named, or is that of a line; else it follows from the protocol."""
    return _baud(tap.spec, options) is not None or not tap.port.is_virtual


def _latency(taps: Sequence[Tap], bus: str, options: Options) -> int:
    """Return how long bytes may be held back between the wire and their stamp."""
    if options.latency_ns is not None:
        return options.latency_ns
    return max(tap.latency_ns for tap in taps if tap.spec.bus == bus)


def _facts(taps: Sequence[Tap], options: Options, anchor: Anchor, pair: bool) -> dict[str, str]:
    """Return what the recording's metadata says about ports and clock."""
    facts = {
        "clock": "monotonic, anchored to the wall clock at the start",
        **dict(zip(ANCHOR, map(str, (anchor.wall_ns, anchor.monotonic_ns)), strict=True)),
    }
    for tap in taps:
        bus = tap.spec.bus
        place = f"port.{bus}.{tap.direction.name.lower()}" if pair else f"port.{bus}"
        if bus in options.bauds:
            facts[f"baud.{bus}"] = str(tap.port.baud)
        facts[f"latency_ns.{bus}"] = str(options.latencies[bus])
        if (name := tap.spec.protocol) is not None and name != AUTO:
            facts[f"protocol.{bus}"] = joined(protocols_named(name))
        if pair:
            facts[f"pair.{bus}"] = "two taps, merged by time and by cause and effect"
        facts[place] = tap.spec.port
        facts.update((f"{place}.{key}", value) for key, value in tap.port.facts().items())
    return facts
