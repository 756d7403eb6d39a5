"""The tool's own recordings: the raw bytes as they came, for decoding them again.

Only the raw topics are read, and only from front to end, so a recording that was cut off by a crash
reads up to the cut.
"""

from __future__ import annotations

import contextlib
from itertools import chain
from pathlib import Path
from typing import TYPE_CHECKING, Any, Final, NamedTuple, TypeVar

import numpy as np
from google.protobuf.message import DecodeError
from mcap.records import Attachment, Header, Metadata

from sniffer.ground.codes import KINDS
from sniffer.ground.limits import GROUP, GROUP_CHUNKS, OFFSET_END, is_mark, is_time, number_in
from sniffer.ground.model import (
    Chunk,
    Clock,
    DamagedInputError,
    Direction,
    InputError,
    Mark,
    MarkKind,
    SnifferError,
)
from sniffer.ground.registers import RegisterMap
from sniffer.mcapfile.ends import End, ends
from sniffer.mcapfile.packed import BrokenError
from sniffer.mcapfile.records import NotMcapError, Piece, Records
from sniffer.messages import BUS, OFFSET, RECOVERED, SESSION, TABLES, TOOL
from sniffer.messages.recording_pb2 import Frame, RawChunk

if TYPE_CHECKING:
    from collections.abc import Iterator, Mapping

    from sniffer.ground.files import Stream

HEAD: Final = 4 << 20
"""How far into a recording the facts about it may stand, in bytes."""


_STEP: Final = 1 << 12
"""Messages that are copied out of a piece at a time."""

_CLOCKS: Final[dict[int, Clock]] = {c.value: c for c in Clock}
_DIRECTIONS: Final[dict[int, Direction]] = {d.value: d for d in Direction}
_KINDS: Final[dict[int, MarkKind]] = {k.value: k for k in MarkKind}
_Message = TypeVar("_Message", RawChunk, Frame)


class RecordedFrame(NamedTuple):
    """A frame as it was decoded while recording.

    ``offset`` counts from the first byte of its bus in this file, as decoding it again does; it is
    negative for a frame whose bytes stand in the file before.
    """

    bus: str
    offset: int
    length: int
    kind: str
    servo_id: int | None
    op: str
    t_end_ns: int


def chunks(source: Path | str | Stream) -> Iterator[Chunk]:
    """Yield the chunks of a recording as they came; see :func:`groups`."""
    return chain.from_iterable(groups(source))


def groups(source: Path | str | Stream, *, hasty: bool = False) -> Iterator[list[Chunk]]:
    """Yield the chunks of a recording, all buses, in groups of about 256 KiB.

    The chunks of a bus come in their order, and those of several by the time of arrival. What lies
    behind the end of a file's part is left out: the next file has it. ``hasty``: nothing is held
    back to make a group, for a file that is being written.

    Raises:
        InputError: this is no recording of this tool.
        DamagedInputError: it was cut off or is damaged; all that comes before has been yielded.
    """
    with _opened(source) as (stream, name, size):
        until = ends(stream)
        records = Records(stream)
        raw = BusChannels(records, RawChunk)
        group: list[Chunk] = []
        held = 0
        ours = False
        offsets: dict[str, int] = {}
        broken: BrokenError | DamagedInputError | None = None
        try:
            for record in records:
                if isinstance(record, Header):
                    ours = record.library.startswith(TOOL)
                elif isinstance(record, Metadata):
                    ours |= record.name == SESSION
                if not isinstance(record, Piece):
                    continue
                for chunk in raw_chunks(raw, record, offsets, until):
                    group.append(chunk)
                    held += len(chunk.data)
                    if held >= GROUP or len(group) >= GROUP_CHUNKS:
                        yield group
                        group, held = [], 0
                if hasty and group:
                    yield group
                    group, held = [], 0
        except NotMcapError as error:
            raise InputError(f"{name}: {error}") from None
        except (BrokenError, DamagedInputError) as error:  # of the recording, or of what packed it
            broken = error
        if group:
            yield group
        if not ours and records.channels and not raw.buses():
            raise InputError(_foreign(name, records))
        if isinstance(broken, BrokenError):
            raise _damage(name, records, size, broken)
        if broken is not None:
            raise broken


def recorded(source: Path | str | Stream) -> Iterator[RecordedFrame]:
    """Yield the frames that were decoded while recording, in order.

    Raises:
        InputError: this is no recording of this tool.
        DamagedInputError: it was cut off or is damaged, or it was before it was recovered: raw
            bytes may go further than frames, all of which have been yielded.
    """
    with _opened(source) as (stream, name, size):
        records = Records(stream)
        raw, frames = BusChannels(records, RawChunk), BusChannels(records, Frame)
        starts: dict[str, int] = {}
        recovered = False
        try:
            for record in records:
                if isinstance(record, Metadata):
                    recovered |= record.name == RECOVERED
                    starts.update(_starts(record))
                if not isinstance(record, Piece):
                    continue
                for bus, data in _of(record, raw.buses(), first=True):
                    starts.setdefault(bus, _decoded(RawChunk, data).offset)
                for bus, data in _of(record, frames.buses()):
                    f = _decoded(Frame, data)
                    servo = f.servo_id if f.HasField("servo_id") else None
                    kind = KINDS[f.kind] if f.kind < len(KINDS) else str(f.kind)
                    at = f.offset - starts.get(bus, 0)
                    yield RecordedFrame(bus, at, f.length, kind, servo, f.op, f.t_end_ns)
        except NotMcapError as error:
            raise InputError(f"{name}: {error}") from None
        except BrokenError as error:
            raise _damage(name, records, size, error) from None
        if recovered:
            raise DamagedInputError(f"{name}: it had been cut off before it was recovered")


def _starts(record: Metadata) -> dict[str, int]:
    """Return where in the stream a file begins, by bus, as far as a metadata record tells."""
    if record.name != SESSION:
        return {}
    told = ((key.partition("."), value) for key, value in record.metadata.items())
    starts = {b: number_in(at, 0, OFFSET_END) for (what, _, b), at in told if what == OFFSET}
    return {bus: at for bus, at in starts.items() if at is not None}


def session(source: Path | str | Stream) -> dict[str, str]:
    """Return the facts of a recording; ``protocol.<bus>`` and ``baud.<bus>`` as far as known.

    Raises:
        InputError: the file cannot be read, or is no MCAP.
    """
    facts: dict[str, str] = {}
    for record in _head(source):
        if isinstance(record, Metadata) and record.name == SESSION:
            for key, value in record.metadata.items():
                facts.setdefault(key, value)
        elif isinstance(record, Metadata) and record.name.startswith(f"{BUS}."):
            told = dict(record.metadata)
            bus = told.pop("bus", "")
            facts.update((f"{key}.{bus}", value) for key, value in told.items())
    return facts


def tables(source: Path | str | Stream) -> list[RegisterMap]:
    """Return the register tables that are attached near a recording's beginning.

    Those of a bus stand before its first frames; what is no table is left out.

    Raises:
        InputError: the file cannot be read, or is no MCAP.
    """
    out: list[RegisterMap] = []
    for record in _head(source, attachments=True):
        if isinstance(record, Attachment) and record.name.startswith(TABLES):
            with contextlib.suppress(SnifferError, UnicodeDecodeError):
                out.append(RegisterMap.from_text(record.data.decode(), record.name))
    return out


def _head(source: Path | str | Stream, *, attachments: bool = False) -> Iterator[Any]:
    """Yield the records near a recording's beginning, as far as they are whole."""
    with _opened(source) as (stream, name, _):
        records = Records(stream, attachments=attachments)
        try:
            for record in records:
                yield record
                if records.position > HEAD:
                    break
        except NotMcapError as error:
            raise InputError(f"{name}: {error}") from None
        except BrokenError:
            pass  # what it says first is all that is asked for


@contextlib.contextmanager
def _opened(source: Path | str | Stream) -> Iterator[tuple[Stream, str, int | None]]:
    """Open a path; say its name and size."""
    if not isinstance(source, Path | str):
        yield source, "the recording", None
        return
    path = Path(source)
    try:
        stream = path.open("rb")
    except OSError as error:
        raise InputError(f"{path}: cannot be read ({error.strerror})") from None
    with stream:
        try:
            yield stream, str(path), path.stat().st_size
        except OSError as error:
            raise DamagedInputError(f"{path}: cannot be read on ({error.strerror})") from None


class BusChannels:
    """The channels of a message type, with their bus; looked for again where there are more."""

    def __init__(self, records: Records, message: type[RawChunk | Frame]) -> None:
        self._records = records
        self._name = message.DESCRIPTOR.full_name
        self._learnt = 0
        self._buses: dict[int, str] = {}

    def buses(self) -> dict[int, str]:
        """Return the bus of each channel by the channel's id."""
        r = self._records
        if self._learnt != r.learnt:
            self._learnt = r.learnt
            self._buses = {
                c.id: c.metadata.get("bus", c.topic.strip("/").rpartition("/")[0])
                for c in r.channels.values()
                if c.schema_id in r.schemas and r.schemas[c.schema_id].name == self._name
            }
        return self._buses


def _of(piece: Piece, buses: dict[int, str], *, first: bool = False) -> Iterator[tuple[str, bytes]]:
    """Yield the messages of some channels, each with its bus; ``first``: one of each channel."""
    mine = np.flatnonzero(np.isin(piece.channel, list(buses)))
    if first:
        mine = mine[np.sort(np.unique(piece.channel[mine], return_index=True)[1])]
    for begin in range(0, len(mine), _STEP):
        some = mine[begin : begin + _STEP]
        channels = piece.channel[some].tolist()
        for channel, data in zip(channels, piece.messages(piece.at[some]), strict=True):
            yield buses[channel], data


def raw_chunks(
    channels: BusChannels, piece: Piece, offsets: dict[str, int], until: Mapping[str, End]
) -> Iterator[Chunk]:
    """Yield a piece's chunks, as far as they lie before the ends.

    ``offsets`` tells for each bus where the next one must begin.
    """
    for bus, message in _of(piece, channels.buses()):
        raw = _decoded(RawChunk, message)
        at, data = raw.offset, raw.data
        if at != offsets.get(bus, at):
            raise BrokenError(f"bytes {offsets[bus]} to {at} of {bus} are missing")
        offsets[bus] = at + len(data)
        clock, direction = _CLOCKS.get(raw.clock), _DIRECTIONS.get(raw.direction)
        if clock is None or direction is None:
            raise BrokenError("a chunk has a clock or direction that is not known here")
        t_ns = raw.t_ns if raw.HasField("t_ns") else None
        if t_ns is not None and not is_time(t_ns):
            raise BrokenError("a chunk has a time that cannot be reckoned with")
        chunk = Chunk(data, t_ns, clock, bus, direction, _marks(raw) if raw.marks else ())
        end = until.get(bus)
        mine = chunk if end is None else end.of(chunk, at)
        if mine is not None:
            yield mine


def _marks(raw: RawChunk) -> tuple[Mark, ...]:
    """Return a chunk's marks; a kind that only later versions know tells nothing here."""
    marks = tuple(
        Mark(_KINDS[m.kind], m.start, m.length, m.count) for m in raw.marks if m.kind in _KINDS
    )
    if not all(map(is_mark, marks)):
        raise BrokenError("a chunk has a mark that cannot be reckoned with")
    return marks


def _decoded(message: type[_Message], data: bytes) -> _Message:
    try:
        return message.FromString(data)
    except DecodeError:
        raise BrokenError("a message makes no sense") from None


def _damage(
    name: str, records: Records, size: int | None, broken: BrokenError
) -> DamagedInputError:
    if size is not None and records.position > size:  # more than it had when it was opened
        told = f"it is being written, {records.position} bytes read"
        return DamagedInputError(f"{name}: {told}; `sniffer open --follow` reads on")
    of = "" if size is None else f" of {size}"
    return DamagedInputError(f"{name}: cut recording, {records.position}{of} bytes read ({broken})")


def _foreign(name: str, records: Records) -> str:
    topics = sorted({c.topic[:40] for c in records.channels.values()})
    more = f" and {len(topics) - 5} more" if len(topics) > 5 else ""
    shown = ", ".join(topics[:5]) + more
    return f"{name}: an MCAP, but no recording of this tool: it has the topics {shown}"
