"""A capture to hand on: without the day it was made, names, ports and serial numbers."""

from __future__ import annotations

import contextlib
from dataclasses import replace
from typing import TYPE_CHECKING, Final, TypeVar

import numpy as np

from sniffer.anomalies.alarms import on_bus
from sniffer.decoding.detect import UndecidedError
from sniffer.decoding.options import SINCE, alarm_facts
from sniffer.decoding.pipeline import Pipeline
from sniffer.ground.codes import REQUEST
from sniffer.ground.limits import OF_BUS
from sniffer.ground.model import Clock, DamagedInputError
from sniffer.jobs.derived import Derived
from sniffer.jobs.order import merged
from sniffer.messages import OFFSET

if TYPE_CHECKING:
    from collections.abc import Iterable, Iterator, Mapping, Sequence

    from sniffer.anomalies.alarms import Alarm
    from sniffer.decoding.pipeline import Options
    from sniffer.ground.model import Batch, Chunk
    from sniffer.jobs.telling import Teller
    from sniffer.protocols.base import BusProtocol
    from sniffer.sources import Source

T = TypeVar("T")

SERIAL: Final = "serial_number"
"""What registers and commands are called, or end in, that say which one of many a device is."""

_BY_BUS: Final = frozenset({"baud", "latency_ns", "protocol", OFFSET, SINCE})
"""Facts that are kept, those of a bus under its new name."""

_KEPT: Final = frozenset({"rate", "model", "clock"})
"""Facts that are kept as they are."""


class _Serials:
    """A sink that finds serial numbers: their bytes, and what to write in their place.

    It keeps when the first frame had come, too.
    """

    def __init__(self) -> None:
        self.first_ns: int | None = None
        self.found: dict[str, list[tuple[int, bytes]]] = {}
        """By bus: offset in the stream, and its bytes from there on without the number."""
        self._asked: dict[tuple[str, str], bytes] = {}
        """By bus and protocol (a wire may have two): the last request, where it asks for a serial
        number, else nothing."""

    def raw(self, bus: str, chunks: Sequence[Chunk]) -> None:
        """Take nothing."""

    def write(self, bus: str, protocol: BusProtocol, batch: Batch) -> None:
        """Look for frames that state a serial number, and for what stands behind its request."""
        f, v = batch.frames, batch.values
        if len(f) and batch.clock != Clock.NONE:
            earliest = int(f.t_end.min())
            self.first_ns = earliest if self.first_ns is None else min(self.first_ns, earliest)
        named = [k for k, r in enumerate(protocol.registers) if r.name.endswith(SERIAL)]
        registers = [protocol.registers[k] for k in named]
        places = [r.address for r in registers]
        words = {word for r in registers for word in (r.word, *r.queries)}
        called = {op: protocol.op_name(op) for op in np.unique(f.op).tolist()}
        ops = [op for op, name in called.items() if name.endswith(SERIAL) or name in words]
        states = np.isin(f.op, ops)
        states[v.row[np.isin(v.register, named)]] = True
        requests = np.flatnonzero(f.kind == REQUEST)
        asks = states[requests] | (
            (f.address[requests] >= 0) & np.isin(f.address[requests], places)
        )
        starts = f.start[requests]
        frames = (
            batch.data[at : at + length] if asked else b""
            for at, length, asked in zip(starts, f.length[requests], asks, strict=True)
        )
        whose = bus, protocol.name
        said = [self._asked.get(whose, b""), *frames]
        self._asked[whose] = said[-1]

        def behind(start: int) -> bytes:
            """Return the request for a serial number that bytes stand behind, or nothing."""
            return said[int(np.searchsorted(starts, start, "right"))]

        found = [
            (batch.base + gap.start, _blank(batch.data[gap.start :][: gap.length], request))
            for gap in batch.gaps
            if (request := behind(gap.start))
        ]
        for row in range(len(f)):
            start, length = int(f.start[row]), int(f.length[row])
            at, size = int(f.data_start[row]) - start, int(f.data_length[row])
            # whatever is answered: a letter of it may be another one
            if size > 0 and (states[row] or (f.kind[row] != REQUEST and behind(start))):
                told = without(batch.data[start : start + length], at, size, protocol)
                found.append((batch.base + start, told))
        if found:
            self.found.setdefault(bus, []).extend(found)

    def close(self) -> None:
        """Do nothing."""


def _blank(torn: bytes, request: bytes) -> bytes:
    """Return bytes that no frame claims without what they may have of a serial number.

    Text keeps all but its digits, as its request shows that it is text, and of these the ones that
    the request has, too: an answer says again who was asked.
    """
    if not request.isascii():
        return bytes(len(torn))
    before, again, rest = torn.partition(request[1:-1])
    return _digitless(before) + again + _digitless(rest)


def _digitless(text: bytes) -> bytes:
    """Return a text with each digit a ``0``."""
    return bytes(0x30 if 0x30 <= byte < 0x3A else byte for byte in text)


def without(frame: bytes, at: int, size: int, protocol: BusProtocol) -> bytes:
    """Return a frame whose data are zeros, with a checksum that holds if it had one.

    Text keeps its length: each digit becomes a ``0``.
    """
    data = frame[at : at + size]
    is_text = all(32 <= byte < 127 for byte in data)
    zeros = _digitless(data) if is_text else bytes(size)
    blank = frame[:at] + zeros + frame[at + size :]
    sums = protocol.checksum_of(blank)
    if sums is None:
        return blank
    checksum, body, _ = sums
    end = blank.rindex(body) + len(body)
    return blank[:end] + checksum(body).to_bytes(len(blank) - end, "little")


def anonymous(
    opened: Source, given: Options, tell: Teller, named: dict[str, str] | None = None
) -> tuple[Derived, Options]:
    """Return a source that is read from zero on and names nobody, and how it is decoded.

    It is read twice. Buses become ``bus0``, ``bus1`` in the order in which they speak; ``named``
    are those that have a name already, and gets the others. Of what a recording says of itself
    rates, latencies, protocols, models and rules stay.
    """
    options = given.with_facts(opened.facts(), opened.tables)
    serials = _Serials()
    names = {} if named is None else named
    first: list[int] = []
    """When the first bytes were handed over, if there was a clock: others may have come before."""

    def heard(groups: Iterable[Sequence[Chunk]]) -> Iterator[Sequence[Chunk]]:
        for group in groups:
            for chunk in group:
                names.setdefault(chunk.bus, f"bus{len(names)}")
                if chunk.t_ns is not None:
                    first[:] = [min(chunk.t_ns, *first)] if first else [chunk.t_ns]
            yield group

    pipeline = Pipeline(options, [serials])
    with contextlib.suppress(DamagedInputError):  # it comes again when it is read to be written
        for group in merged(opened, heard(opened), options, tell.quieter()):
            with contextlib.suppress(UndecidedError):
                pipeline.feed(group)
    try:
        pipeline.close()
    except UndecidedError:
        tell.warn("serial numbers on the bus are not looked for: its protocol cannot be told")
    if serials.first_ns is not None:  # a host may have held frames back that came long before
        first.append(serials.first_ns)
    began = min(first, default=0)

    def made(groups: Iterable[Sequence[Chunk]]) -> Iterator[list[Chunk]]:
        blanks = {bus: Blanks(sorted(found)) for bus, found in serials.found.items()}
        for group in groups:
            out = []
            for chunk in group:
                data = blanks[chunk.bus].of(chunk.data) if chunk.bus in blanks else chunk.data
                t_ns = None if chunk.t_ns is None else chunk.t_ns - began
                bus = names.setdefault(chunk.bus, f"bus{len(names)}")
                out.append(replace(chunk, data=data, t_ns=t_ns, bus=bus))
            yield out

    unnamed = _unnamed(options, names)
    facts = nameless(opened.facts(), names) | alarm_facts(unnamed.alarms)
    return _Nameless(opened, made, facts), replace(_unnamed(given, names), alarms=unnamed.alarms)


class _Nameless(Derived):
    """A capture of which nobody is to know whose it was, and when."""

    def origin(self, path: str) -> None:
        """Name nobody."""


def _renamed(told: Mapping[str, T], names: Mapping[str, str]) -> dict[str, T]:
    return {names[bus]: value for bus, value in told.items() if bus in names}


def _unnamed(options: Options, names: Mapping[str, str]) -> Options:
    """Return the same options for buses with other names, and servos without any."""
    return replace(
        options,
        protocols=_renamed(options.protocols, names),
        bauds=_renamed(options.bauds, names),
        latencies=_renamed(options.latencies, names),
        begins=_renamed(options.begins, names),
        names={},
        alarms=tuple(_rules_unnamed(options, names)),
    )


def _rules_unnamed(options: Options, names: Mapping[str, str]) -> Iterator[Alarm]:
    """Return the rules of the options; a servo that has more than an id, by id and bus."""
    yield from (alarm for alarm in options.alarms if not alarm.called)
    named = [alarm for alarm in options.alarms if alarm.called]
    for bus, unnamed in names.items():
        for one in on_bus(named, bus, options.called.ids):
            yield replace(one, servo_id=None, called=f"{unnamed}{OF_BUS}{one.servo_id}")


def nameless(facts: Mapping[str, str], names: Mapping[str, str]) -> dict[str, str]:
    """Return what a recording may say of itself without telling whose it is."""
    out: dict[str, str] = {}
    for key, value in facts.items():
        what, dot, bus = key.partition(".")
        if what in _KEPT or (what in _BY_BUS and not dot):
            out[key] = value
        elif what in _BY_BUS and bus in names:
            out[f"{what}.{names[bus]}"] = value
    return out


class Blanks:
    """Writes frames over those of a stream that is handed through in pieces.

    Args:
        found: (offset, bytes), in order of the stream.
    """

    def __init__(self, found: Sequence[tuple[int, bytes]]) -> None:
        self._found = list(found)
        self._at = 0
        self._next = 0

    def of(self, data: bytes) -> bytes:
        """Return the next bytes of the stream, with what stands over them."""
        begin, end = self._at, self._at + len(data)
        self._at = end
        out = bytearray(data)
        for k in range(self._next, len(self._found)):
            start, told = self._found[k]
            if start >= end:
                break
            low, high = max(start, begin), min(start + len(told), end)
            if low < high:
                out[low - begin : high - begin] = told[low - start : high - start]
            # one that goes on keeps its turn: others may end within it
            self._next += k == self._next and start + len(told) <= end
        return bytes(out)
