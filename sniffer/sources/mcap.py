"""The tool's own recordings: the raw bytes as they came, for decoding them again.

Only the raw topics are read, and only from front to end, so a recording that was cut off by a crash
reads up to the cut.
"""

from __future__ import annotations

import contextlib
from itertools import chain
from pathlib import Path
from typing import TYPE_CHECKING, Final, NamedTuple, TypeVar

import numpy as np
from google.protobuf.message import DecodeError
from mcap.records import Header, Metadata

from sniffer.messages import BUS, SESSION, TOOL
from sniffer.messages.recording_pb2 import Frame, RawChunk
from sniffer.model import KINDS, Chunk, Clock, DamagedInputError, Direction, InputError
from sniffer.sources.mcap_records import BrokenError, NotMcapError, Piece, Records

if TYPE_CHECKING:
    from collections.abc import Iterator

    from sniffer.sources.text import Stream

GROUP: Final = 1 << 18
"""Payload of a group, in bytes."""

GROUP_CHUNKS: Final = 1 << 15
"""Chunks of a group at most."""

HEAD: Final = 4 << 20
"""How far into a recording the facts about it may stand, in bytes."""


_CLOCKS: Final[dict[int, Clock]] = {c.value: c for c in Clock}
_DIRECTIONS: Final[dict[int, Direction]] = {d.value: d for d in Direction}
_Message = TypeVar("_Message", RawChunk, Frame)


class RecordedFrame(NamedTuple):
    """A frame as it was decoded while recording."""

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


def groups(source: Path | str | Stream) -> Iterator[list[Chunk]]:
    """Yield the chunks of a recording, all buses, in groups of about 256 KiB.

    The chunks of a bus come in their order, and those of several by the time of arrival.

    Raises:
        InputError: this is no recording of this tool.
        DamagedInputError: it was cut off or is damaged; all that comes before has been yielded.
    """
    with _opened(source) as (stream, name, size):
        records = Records(stream)
        group: list[Chunk] = []
        held = 0
        ours = False
        offsets: dict[str, int] = {}
        broken: BrokenError | None = None
        try:
            for record in records:
                if isinstance(record, Header):
                    ours = record.library.startswith(TOOL)
                elif isinstance(record, Metadata):
                    ours |= record.name == SESSION
                if not isinstance(record, Piece):
                    continue
                for chunk in _raw(records, record, offsets):
                    group.append(chunk)
                    held += len(chunk.data)
                    if held >= GROUP or len(group) >= GROUP_CHUNKS:
                        yield group
                        group, held = [], 0
        except NotMcapError as error:
            raise InputError(f"{name}: {error}") from None
        except BrokenError as error:
            broken = error
        if group:
            yield group
        if not ours and records.channels and not _channels(records, RawChunk):
            raise InputError(_foreign(name, records))
        if broken is not None:
            raise _damage(name, records, size, broken)


def recorded(source: Path | str | Stream) -> Iterator[RecordedFrame]:
    """Yield the frames that were decoded while recording, in order; raises as :func:`groups`."""
    with _opened(source) as (stream, name, size):
        records = Records(stream)
        try:
            for record in records:
                if not isinstance(record, Piece):
                    continue
                buses = _channels(records, Frame)
                for bus, data in _of(record, buses):
                    f = _decoded(Frame, data)
                    servo = f.servo_id if f.HasField("servo_id") else None
                    kind = KINDS[f.kind] if f.kind < len(KINDS) else str(f.kind)
                    yield RecordedFrame(bus, f.offset, f.length, kind, servo, f.op, f.t_end_ns)
        except NotMcapError as error:
            raise InputError(f"{name}: {error}") from None
        except BrokenError as error:
            raise _damage(name, records, size, error) from None


def session(source: Path | str | Stream) -> dict[str, str]:
    """Return the facts of a recording; ``protocol.<bus>`` and ``baud.<bus>`` as far as known.

    Raises:
        InputError: the file cannot be read, or is no MCAP.
    """
    facts: dict[str, str] = {}
    with _opened(source) as (stream, name, _):
        records = Records(stream)
        try:
            for record in records:
                if isinstance(record, Metadata) and record.name == SESSION:
                    facts = {**record.metadata, **facts}
                elif isinstance(record, Metadata) and record.name.startswith(f"{BUS}."):
                    told = dict(record.metadata)
                    bus = told.pop("bus", "")
                    facts.update((f"{key}.{bus}", value) for key, value in told.items())
                if records.position > HEAD:
                    break
        except NotMcapError as error:
            raise InputError(f"{name}: {error}") from None
        except BrokenError:
            pass  # what it says first is all that is asked for
    return facts


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


def _channels(records: Records, message: type[RawChunk | Frame]) -> dict[int, str]:
    """Return the channels of a message type, with their bus."""
    name = message.DESCRIPTOR.full_name
    return {
        c.id: c.metadata.get("bus", c.topic.strip("/").rpartition("/")[0])
        for c in records.channels.values()
        if c.schema_id in records.schemas and records.schemas[c.schema_id].name == name
    }


def _of(piece: Piece, buses: dict[int, str]) -> Iterator[tuple[str, bytes]]:
    """Yield the messages of some channels, each with its bus."""
    mine = np.flatnonzero(np.isin(piece.channel, list(buses)))
    channels = piece.channel[mine].tolist()
    for channel, data in zip(channels, piece.messages(piece.at[mine]), strict=True):
        yield buses[channel], data


def _raw(records: Records, piece: Piece, offsets: dict[str, int]) -> Iterator[Chunk]:
    """Yield a piece's chunks; ``offsets`` tells for each bus where the next one must begin."""
    for bus, message in _of(piece, _channels(records, RawChunk)):
        raw = _decoded(RawChunk, message)
        at, data = raw.offset, raw.data
        if at != offsets.get(bus, at):
            raise BrokenError(f"bytes {offsets[bus]} to {at} of {bus} are missing")
        offsets[bus] = at + len(data)
        clock, direction = _CLOCKS.get(raw.clock), _DIRECTIONS.get(raw.direction)
        if clock is None or direction is None:
            raise BrokenError("a chunk has a clock or direction that is not known here")
        yield Chunk(data, raw.t_ns if raw.HasField("t_ns") else None, clock, bus, direction)


def _decoded(message: type[_Message], data: bytes) -> _Message:
    try:
        return message.FromString(data)
    except DecodeError:
        raise BrokenError("a message makes no sense") from None


def _damage(
    name: str, records: Records, size: int | None, broken: BrokenError
) -> DamagedInputError:
    of = "" if size is None else f" of {size}"
    return DamagedInputError(f"{name}: cut recording, {records.position}{of} bytes read ({broken})")


def _foreign(name: str, records: Records) -> str:
    topics = sorted({c.topic for c in records.channels.values()})
    more = f" and {len(topics) - 5} more" if len(topics) > 5 else ""
    shown = ", ".join(topics[:5]) + more
    return f"{name}: an MCAP, but no recording of this tool: it has the topics {shown}"
