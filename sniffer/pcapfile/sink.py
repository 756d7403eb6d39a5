"""Captures for Wireshark: a packet a frame or gap, what is wrong with it as its comments.

Needs no plug-in to be looked at: the link type is that of serial lines (RTAC), which shows
directions and line errors; comments are listed among the expert information and found by
``frame.comment contains "late-response"``. A packet is stamped with its end, its head with its
start. Everything is written as it is decided, so the other end may be a pipe.
"""

from __future__ import annotations

import bisect
import contextlib
import itertools
import json
from pathlib import Path
from typing import TYPE_CHECKING, Any, BinaryIO, Final, NamedTuple

import numpy as np

from sniffer import __version__
from sniffer.decoding.options import SINCE
from sniffer.decoding.pacing import ASSUMED, STATED
from sniffer.ground.codes import REQUEST
from sniffer.ground.files import open_binary, writing
from sniffer.ground.limits import OFFSET_END, number_in
from sniffer.ground.model import NS, Clock, Direction
from sniffer.ground.timing import LATENCY_NS, byte_time_ns
from sniffer.ground.wording import counted, sums_in_words
from sniffer.messages import OFFSET, TOOL
from sniffer.pcapfile.blocks import interface, packet, section
from sniffer.pcapfile.chunkends import ChunkEnds
from sniffer.pcapfile.layout import (
    EVENTS,
    INBOUND,
    NO_TIMES,
    OUTBOUND,
    PROTOCOLS,
    RATE,
    RTAC_SERIAL,
    WITHIN,
    RtacEvent,
    RtacFooter,
    rtac,
)

if TYPE_CHECKING:
    from collections.abc import Iterator, Mapping, Sequence

    from sniffer.decoding.pacing import Pace
    from sniffer.decoding.rates import Rate
    from sniffer.decoding.sink import Part
    from sniffer.ground.model import Anomaly, Batch, Chunk, Gap, Remark
    from sniffer.protocols.base import BusProtocol

ROOM_S: Final = 86_400
"""Times before 1970 count from so many seconds before the first one: a packet's has no sign."""

_FLAGS: Final = {RtacEvent.TX_START: OUTBOUND, RtacEvent.RX_START: INBOUND}


class _PacketRow(NamedTuple):
    """A packet to be: its place in the order of the stream, its bytes, when it is, what it says.

    ``event`` is None where the wire that its bytes came on is to tell it.
    """

    order: float
    begin: int
    end: int
    t_start: int
    t_end: int
    event: RtacEvent | None
    protocol: int
    comments: list[str]

    @property
    def is_frame(self) -> bool:
        """Whether it holds; a gap says why it is none in its first comment."""
        return self.event is not None


class _Face:
    """A bus; ``number`` is that of its interface, which it has from its first packet on."""

    def __init__(self, first: int) -> None:
        self.number = -1
        self.ends = ChunkEnds(first)
        self.since_s = 0
        self.last = _PacketRow(0, first, first, 0, 0, RtacEvent.COMPLETE, 0, [])
        """Where the last packet ends."""


class PcapngSink:
    """Writes to a path, or to a stream that stays open and is flushed after each pass."""

    def __init__(self, target: Path | BinaryIO, session: Mapping[str, str]) -> None:
        self._path = target if isinstance(target, Path) else None
        self._file = open_binary(target) if isinstance(target, Path) else target
        self._session = dict(session)
        self._paces: dict[str, Pace] = {}
        self._rates: dict[str, int] = {}
        self._buses: dict[str, _Face] = {}
        self._is_whole = True
        self._begun = False

    def begin(self) -> None:
        """Write what every capture begins with, once: who reads a pipe may wait for it."""
        if self._begun:
            return
        self._begun = True
        kept = {
            k: v for k, v in self._session.items() if k.partition(".")[0] not in _SAID_ELSEWHERE
        }
        told = f"servo bus traffic, decoded from {self._session.get('source', 'a capture')}"
        self._write([section(f"{TOOL} {__version__}", _facts(kept), told)])

    def raw(self, bus: str, chunks: Sequence[Chunk]) -> None:
        """Remember which chunks there are; their bytes come with the frames."""
        if self._is_whole:
            self._bus(bus).ends.add(chunks)

    def pace(self, bus: str, told: Pace) -> None:
        """Take what a bus is timed by."""
        self._paces[bus] = told

    def tuned(self, bus: str, rate: Rate) -> None:
        """Take the rate that a recorder has found."""
        self._rates[bus] = rate.baud

    def narrow(self, told: Mapping[str, Any]) -> None:
        """Learn that not every packet is written, so that chunks could not be put together."""
        self._is_whole = self._is_whole and "where" not in told

    def write(self, bus: str, protocol: BusProtocol, batch: Batch) -> None:
        """Write the batch's frames and gaps."""
        self.write_together(bus, [(protocol, batch)])

    def write_together(self, bus: str, parts: Sequence[Part]) -> None:
        """Write the frames and gaps of several protocols of one pass, in wire order."""
        self.begin()
        own = self._bus(bus)
        out: list[bytes] = []
        own.ends.tell(_remarks(parts))
        rows = self._rows(bus, parts)
        if own.number < 0 and rows:
            first = min(row.t_end for row in rows)
            own.since_s = first // NS - ROOM_S if first < 0 else 0
            out.append(self._interface(bus, parts, own))
            if parts[0][1].clock == Clock.NONE:
                rows[0].comments.append(
                    "no-times: the input has none; these count from its first byte, "
                    f"at {self._baud(bus, parts)} baud"
                )
        base, data = parts[0][1].base, parts[0][1].data
        out += [self._packet(own, row, data[row.begin - base : row.end - base]) for row in rows]
        self._write(out)

    def close(self) -> None:
        """Write what the tap told behind the last byte, and finish the file."""
        try:
            self.begin()
            told = (b for b in self._buses.values() if b.number >= 0 and b.ends.has_marks)
            ends = ((b, b.last._replace(event=RtacEvent.COMPLETE, comments=[])) for b in told)
            self._write([self._packet(bus, end, b"") for bus, end in ends])
        finally:
            if self._path is not None:
                with writing(self._path):
                    self._file.close()

    def _bus(self, bus: str) -> _Face:
        if bus not in self._buses:
            first = number_in(self._session.get(f"{OFFSET}.{bus}", ""), 0, OFFSET_END)
            self._buses[bus] = _Face(first or 0)
        return self._buses[bus]

    def _baud(self, bus: str, parts: Sequence[Part]) -> int:
        pace = self._paces.get(bus)
        return self._rates.get(bus) or (pace.baud if pace else parts[0][0].baud)

    def _interface(self, bus: str, parts: Sequence[Part], own: _Face) -> bytes:
        """Return the description of a bus, which gets the next number."""
        own.number = sum(other.number >= 0 for other in self._buses.values())
        baud, pace = self._baud(bus, parts), self._paces.get(bus)
        name = "+".join(protocol.name for protocol, _ in parts)
        how = pace.rate if pace and bus not in self._rates else STATED
        told = f"{name} servo bus, {baud} baud, 8N1"
        told += f"{RATE}{how}" if how != STATED else ""
        told += self._stamps(bus, parts[0][1].clock)
        facts = {f"protocol.{bus}": name}
        if self._session.get("rate") != ASSUMED or f"{SINCE}.{bus}" in self._session:
            facts[f"baud.{bus}"] = str(baud)
        return interface(
            RTAC_SERIAL, bus, told, speed=baud, since_s=own.since_s, facts=_facts(facts)
        )

    def _stamps(self, bus: str, clock: Clock) -> str:
        """Return how late the stamps of a bus may be, in words that the dissector reads."""
        if clock == Clock.NONE:
            return NO_TIMES
        known = self._session.get(f"latency_ns.{bus}", self._session.get("latency_ns", ""))
        late = number_in(known, 0, NS)
        return f"{WITHIN}{(LATENCY_NS[clock] if late is None else late) / 1e6:g} ms"

    def _rows(self, bus: str, parts: Sequence[Part]) -> list[_PacketRow]:
        """Return the packets of a pass, in the order of the stream, with their comments."""
        byte_ns = byte_time_ns(self._baud(bus, parts))
        base, number = parts[0][1].base, _number(parts[0][0])
        rows: list[tuple[_PacketRow, bool]] = []
        found: list[Anomaly] = []
        for protocol, batch in parts:
            laid = [*_frames(batch, _number(protocol)), *_gaps(batch, _number(protocol), byte_ns)]
            shown = np.concatenate(
                [batch.shows(name, len(getattr(batch, name))) for name in ("frames", "gaps")]
            )
            rows += zip(laid, shown.tolist(), strict=True)
            told = batch.shows("anomalies", len(batch.anomalies)).tolist()
            found += itertools.compress(batch.anomalies, told)
        rows.sort(key=lambda row: row[0].begin)
        starts = [row.begin for row, _ in rows]
        events = [_remarked(r, number) for r in _remarks(parts) if r.kind in EVENTS]
        for a in found:
            at = bisect.bisect_right(starts, a.known_at) - 1
            text = f"{a.code}: {a.detail}"
            if at >= 0:
                rows[at][0].comments.append(text)
            else:  # it is about what is in no packet of this pass
                event = _event(RtacEvent.STATUS_CHANGE, base, a.t_ns, number)
                events.append(event._replace(comments=[text]))
        kept = (row for row, is_shown in rows if is_shown or len(row.comments) > (not row.is_frame))
        return sorted([*kept, *events], key=lambda row: row.order)

    def _packet(self, own: _Face, row: _PacketRow, data: bytes) -> bytes:
        since_ns = own.since_s * NS
        t_ns = max(row.t_end - since_ns, 0)
        event, flags = row.event, 0
        if event is None:
            wire = own.ends.direction_at(row.end)
            event = RtacEvent.TX_START if wire == Direction.TX else RtacEvent.RX_START
            flags = _FLAGS[event] if wire else 0
        elif data:
            flags = _FLAGS[event]
        if data or event == RtacEvent.COMPLETE:
            ends = own.ends.of(row.begin, row.end, since_ns + t_ns)
        else:  # its mark is told with the chunk that it stands at
            ends = [b""] if own.ends.is_told else []
        own.last = row._replace(begin=row.end, t_start=row.t_end) if data else own.last
        head = rtac(row.t_start, event, RtacFooter(own.number, row.protocol), data)
        return packet(own.number, t_ns, head, flags=flags, comments=row.comments, ends=ends)

    def _write(self, blocks: Sequence[bytes]) -> None:
        guard = writing(self._path) if self._path is not None else contextlib.nullcontext()
        with guard:
            self._file.write(b"".join(blocks))
            self._file.flush()


_SAID_ELSEWHERE: Final = frozenset({SINCE, OFFSET, "rate"})
"""Facts of a session that are not true of what is written, or are told with each bus."""


def _facts(facts: Mapping[str, str]) -> bytes:
    return json.dumps(facts, separators=(",", ":")).encode()


def _number(protocol: BusProtocol) -> int:
    return PROTOCOLS.get(protocol.name, 0)


def _remarks(parts: Sequence[Part]) -> list[Remark]:
    """Return what a tap has remarked; protocols of one wire may say it both."""
    return list(dict.fromkeys(remark for _, batch in parts for remark in batch.remarks))


def _frames(batch: Batch, protocol: int) -> Iterator[_PacketRow]:
    f = batch.frames
    begin = f.start + batch.base
    columns = (begin, begin + f.length, f.t_start, f.t_end, f.kind)
    for at, end, t_start, t_end, kind in zip(*(c.tolist() for c in columns), strict=True):
        event = RtacEvent.TX_START if kind == REQUEST else RtacEvent.RX_START
        yield _PacketRow(at, at, end, t_start, t_end, event, protocol, [])


def _gaps(batch: Batch, protocol: int, byte_ns: int) -> Iterator[_PacketRow]:
    for g in batch.gaps:
        at = batch.base + g.start
        t_start = g.t_ns - g.length * byte_ns
        yield _PacketRow(at, at, at + g.length, t_start, g.t_ns, None, protocol, [_in_words(g)])


def _in_words(gap: Gap) -> str:
    """Return why bytes are in no frame, as a comment."""
    told, detail = f"gap: {gap.reason}, {counted(gap.length, 'byte')} in no frame", gap.detail
    if "checksum_expected" in detail:
        sums = sums_in_words(detail["checksum_got"], detail["checksum_expected"])
        return f"{told}, checksum {sums}"
    if "need" in detail and "have" in detail:
        return f"{told}, {detail['have']} of {detail['need']}"
    return told


def _event(event: RtacEvent, at: int, t_ns: int, protocol: int) -> _PacketRow:
    """Return a packet without bytes, behind the one that has the byte before ``at``."""
    return _PacketRow(at - 0.5, at, at, t_ns, t_ns, event, protocol, [])


def _remarked(remark: Remark, protocol: int) -> _PacketRow:
    row = _event(EVENTS[remark.kind], remark.end, remark.t_ns, protocol)
    word = remark.kind.name.lower()
    many = f", {remark.count} told" if remark.count > 1 else ""
    where = f" within {counted(remark.length, 'byte')}" if remark.length else ""
    return row._replace(comments=[f"tap: {word}{where}{many}"])
