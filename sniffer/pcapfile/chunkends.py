"""Which chunks the bytes of a packet came in: what makes a capture read back what it was.

Packets are frames and gaps, chunks are reads or lines, and either may be cut within the other.
Times and their uncertainty are reckoned from chunks. So a packet carries where chunks end in it,
and what each of them said. A packet that is just one chunk, of a time stamp as a text file has
them, needs to say nothing; one within a longer chunk says that none ends there.
"""

from __future__ import annotations

import struct
from collections import deque
from typing import TYPE_CHECKING, Final, NamedTuple

from sniffer.ground.limits import is_mark, is_time
from sniffer.ground.model import Chunk, Clock, Direction, Mark, MarkKind
from sniffer.pcapfile.blocks import OPTION_MOST

if TYPE_CHECKING:
    from collections.abc import Iterable, Iterator, Sequence

    from sniffer.ground.model import Remark

_SPAN: Final = struct.Struct("<IBBHq")  # end in the packet, clock, direction, marks, time
_MARK: Final = struct.Struct("<Bqqq")  # kind, start from the end of the chunk, length, count
_NO_TIME: Final = -(1 << 63)
_MARKS_MOST: Final = (OPTION_MOST - _SPAN.size) // _MARK.size

WAITING_MOST: Final = 1 << 17
"""Chunks that wait for their packets at most: of a bus whose protocol is not found the first ones
are forgotten, and their bytes are read back as parts of a later one."""

_CLOCKS: Final = {clock.value: clock for clock in Clock}
_DIRECTIONS: Final = {direction.value: direction for direction in Direction}
_KINDS: Final = {kind.value: kind for kind in MarkKind}

_DECODERS: Final = frozenset({MarkKind.TUNED, MarkKind.SKIPPED})
"""Kinds of marks that the pipeline sets, beside those of the tap."""


class ChunkEnd(NamedTuple):
    """Where a chunk ends, and what it said beside its bytes; marks count from its end."""

    end: int
    t_ns: int | None
    clock: Clock
    direction: Direction
    marks: tuple[Mark, ...] = ()
    size: int = 0


class ChunkEnds:
    """The chunks of a bus whose bytes are not all in packets yet; ends count from the first byte.

    ``first`` is where in the stream the first byte stands that is told.
    """

    def __init__(self, first: int) -> None:
        self._end = first
        self._waiting: deque[ChunkEnd] = deque(maxlen=WAITING_MOST)
        self._is_open = False
        self._told: set[tuple[MarkKind, int]] = set()
        self.is_told = False

    def add(self, chunks: Sequence[Chunk]) -> None:
        """Take chunks as they came."""
        self.is_told = True
        for k in chunks:
            size = len(k.data)
            self._end += size
            marks = tuple(m._replace(start=m.start - size) for m in k.marks)
            self._waiting.append(ChunkEnd(self._end, k.t_ns, k.clock, k.direction, marks, size))
            self._told |= {(m.kind, self._end + m.start) for m in marks if m.kind in _DECODERS}

    def tell(self, remarks: Iterable[Remark]) -> None:
        """Take what the pipeline has remarked, which is in no chunk as it came."""
        for r in remarks:
            if r.kind in _DECODERS and (r.kind, r.start) not in self._told and self.is_told:
                mark = Mark(r.kind, 0, 0, r.count)
                span = ChunkEnd(r.start, r.t_ns, Clock.READ, Direction.UNKNOWN, (mark,))
                behind = sum(1 for waiting in self._waiting if waiting.end <= r.start)
                if len(self._waiting) < WAITING_MOST:
                    self._waiting.insert(behind, span)
            self._told.discard((r.kind, r.start))

    def direction_at(self, offset: int) -> Direction:
        """Return which wire the byte before ``offset`` was heard on."""
        at = (span.direction for span in self._waiting if span.end >= offset and span.size)
        return next(at, Direction.UNKNOWN)

    def of(self, begin: int, end: int, t_ns: int) -> list[bytes]:
        """Return what a packet of these bytes and this time says of chunks, as options."""
        if not self.is_told:
            return []
        ended: list[ChunkEnd] = []
        while self._waiting and self._waiting[0].end <= end:
            span = self._waiting.popleft()
            # what was left out of the decoding is in no packet, but for what was told of it
            if span.end > begin or not span.size:
                ended.append(span._replace(end=max(span.end - begin, 0)))
        was_open, self._is_open = self._is_open, not ended or ended[-1].end < end - begin
        if not was_open and len(ended) == 1 and _is_plain(ended[0], end - begin, t_ns):
            return []
        return list(_packed(ended))

    @property
    def has_marks(self) -> bool:
        """Whether marks wait, as they do behind the last byte."""
        return any(span.marks for span in self._waiting)


def _is_plain(span: ChunkEnd, size: int, t_ns: int) -> bool:
    """Tell whether a chunk is what a packet without a word about chunks is read as."""
    return span._replace(size=0) == ChunkEnd(size, t_ns, Clock.FILE, Direction.UNKNOWN)


def _packed(spans: Sequence[ChunkEnd]) -> Iterator[bytes]:
    """Yield options that hold all spans, at least one."""
    out = b""
    for span in spans:
        parts = [span.marks[i : i + _MARKS_MOST] for i in range(0, len(span.marks), _MARKS_MOST)]
        for nth, marks in enumerate(parts or [()]):
            is_last = nth >= len(parts) - 1
            # more marks than an option holds stand at chunks without bytes before it
            end = span.end if is_last else max(span.end - span.size, 0)
            shift = 0 if is_last else span.end - end
            told = _SPAN.pack(
                end,
                span.clock,
                span.direction,
                len(marks),
                _NO_TIME if span.t_ns is None else span.t_ns,
            )
            told += b"".join(_MARK.pack(m.kind, m.start + shift, m.length, m.count) for m in marks)
            if len(out) + len(told) > OPTION_MOST:
                yield out
                out = b""
            out += told
    yield out


def unpacked(option: bytes) -> list[ChunkEnd]:
    """Return what an option says.

    Raises:
        ValueError: it makes no sense.
    """
    out: list[ChunkEnd] = []
    at = 0
    while at < len(option):
        if at + _SPAN.size > len(option):
            raise ValueError("a span of a chunk is cut")
        end, clock, direction, count, t_ns = _SPAN.unpack_from(option, at)
        at += _SPAN.size
        if at + count * _MARK.size > len(option):
            raise ValueError("a mark of a chunk is cut")
        marks = [
            Mark(_KINDS[kind], *numbers)
            for kind, *numbers in _MARK.iter_unpack(option[at : at + count * _MARK.size])
            if kind in _KINDS
        ]
        at += count * _MARK.size
        told = None if t_ns == _NO_TIME else t_ns
        sound = clock in _CLOCKS and direction in _DIRECTIONS and all(map(is_mark, marks))
        if not sound or (told is not None and not is_time(told)):
            raise ValueError("a chunk has a clock, a wire, a time or a mark that cannot be")
        out.append(ChunkEnd(end, told, _CLOCKS[clock], _DIRECTIONS[direction], tuple(marks)))
    return out
