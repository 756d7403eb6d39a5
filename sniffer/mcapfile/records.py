"""An MCAP file read from front to end, and never further than it holds.

The mcap library's readers want the summary at the end, or raise whatever the damage happens to
cause. Here a file may break off or be damaged anywhere: what comes before is returned, checked
against its checksums, then `BrokenError` tells where and why. Of a chunk that breaks off the
messages that are whole are returned too, unchecked. One chunk is in memory at a time.
"""

from __future__ import annotations

import io
import struct
import zlib
from dataclasses import dataclass
from typing import TYPE_CHECKING, Any, Final

import numpy as np
import zstandard
from mcap.data_stream import ReadDataStream
from mcap.exceptions import McapError
from mcap.opcode import Opcode
from mcap.records import Attachment, Channel, DataEnd, Header, Metadata, Schema

from sniffer.mcapfile.packed import UNPACKED, BrokenError, begin_of, chunk_head, unpack
from sniffer.mcapfile.structs import HEAD, MESSAGE, whole_until
from sniffer.messages import MAGIC, TOOL

if TYPE_CHECKING:
    from collections.abc import Iterator

    import numpy.typing as npt

    from sniffer.ground.files import Stream
    from sniffer.ground.model import I64

LONGEST: Final = 1 << 28
"""A longer record is taken for damage, in bytes: it bounds memory."""

TOLD: Final = 1 << 22
"""The same for what is said beside the messages (header, schemas, channels, metadata), which is a
few kB: parsed it takes ten times as much."""

_MESSAGE: Final = MESSAGE.size - HEAD.size
"""What stands in a message record before its data, in bytes, without the record's head."""

_PARSED: Final[dict[int, Any]] = {
    Opcode.HEADER: Header,
    Opcode.SCHEMA: Schema,
    Opcode.CHANNEL: Channel,
    Opcode.ATTACHMENT: Attachment,
    Opcode.METADATA: Metadata,
    Opcode.DATA_END: DataEnd,
}
_TOLD: Final = (Opcode.HEADER, Opcode.SCHEMA, Opcode.CHANNEL, Opcode.METADATA, Opcode.DATA_END)
_BESIDE: Final = (Opcode.ATTACHMENT, Opcode.METADATA)
"""What is damaged of these is left out: the messages do not depend on it."""


class _TornError(BrokenError):
    """The file ends within a record; ``data`` is what there is of it."""

    def __init__(self, data: bytes) -> None:
        super().__init__("it breaks off")
        self.data = data


class NotMcapError(BrokenError):
    """The file does not begin as an MCAP does."""


@dataclass(frozen=True, slots=True)
class Piece:
    """A chunk that holds: packed as it was, and its messages.

    ``at`` is where in ``data`` each message record begins; ``indexed``: the file tells that
    of all of them, too.
    """

    compression: str
    packed: bytes
    crc: int
    data: bytes
    at: I64
    channel: npt.NDArray[np.uint16]
    log: I64
    indexed: bool = True

    def messages(self, at: I64) -> list[bytes]:
        """Return the data of the messages whose records begin at ``at``."""
        start = at + HEAD.size + _MESSAGE
        end = at + HEAD.size + _gather(self.data, at, 1, "<i8")
        return [self.data[a:b] for a, b in zip(start.tolist(), end.tolist(), strict=True)]


class Records:
    """Reads a stream: iterate it for its records and, of the chunks, pieces, in order.

    ``schemas`` and ``channels`` hold those met so far, inside the chunks too; ``position`` is where
    the last record that holds ends. A message outside of any chunk is a piece of its own.
    """

    def __init__(self, stream: Stream, *, attachments: bool = False) -> None:
        self.schemas: dict[int, Schema] = {}
        self.channels: dict[int, Channel] = {}
        self.learnt = 0
        """How many schemas and channels were met, repeated ones too."""
        self.position = 0
        self._stream = stream
        self._attachments = attachments
        self._own = False
        self._crc = 0
        self._taken = 0
        self._opcode = 0

    def __iter__(self) -> Iterator[Header | Metadata | Attachment | Schema | Channel | Piece]:
        """Read up to the end of the data.

        Raises:
            BrokenError: the file breaks off or is damaged.
        """
        magic = self._take(len(MAGIC), partly=True)
        if magic != MAGIC:
            begins = MAGIC.startswith(magic) or magic[:5] == MAGIC[:5]
            raise (BrokenError if begins else NotMcapError)("its first bytes are not those of MCAP")
        self.position = self._taken
        chunk: bytes | None = None
        index: list[bytes] = []
        behind = 0
        while True:
            crc = self._crc
            try:
                opcode, body = self._record()
                if opcode == Opcode.MESSAGE_INDEX and int.from_bytes(
                    body[2:6], "little"
                ) + 6 != len(body):
                    raise BrokenError("a message index makes no sense")
            except BrokenError as error:
                if chunk is not None:  # its index is torn, it is not
                    piece = self._piece(chunk, [])
                    self.position = behind
                    yield piece
                if isinstance(error, _TornError) and self._opcode == Opcode.CHUNK:
                    yield from self._torn(error.data)
                raise
            if opcode == Opcode.MESSAGE_INDEX and chunk is not None:
                index.append(body)
                behind = self._taken
                continue
            if chunk is not None:
                piece = self._piece(chunk, index)
                self.position = behind
                yield piece
                chunk, index = None, []
            if opcode == Opcode.CHUNK:
                chunk, behind = body, self._taken
                continue
            if opcode == Opcode.MESSAGE and not self._own:
                record = HEAD.pack(opcode, len(body)) + body
                piece = self._messages("", record, zlib.crc32(record), record, [])
                self.position = self._taken
                yield piece
            elif opcode in _PARSED:
                parsed = self._parsed(opcode, body)
                if isinstance(parsed, DataEnd):
                    if parsed.data_section_crc not in (0, crc):
                        raise BrokenError("its checksum over everything does not match")
                    self.position = self._taken
                    return
                if parsed is not None:
                    self.position = self._taken
                    yield parsed
            elif opcode <= Opcode.DATA_END or self._own:
                raise BrokenError("there is a record of a kind that cannot be there")
            self.position = self._taken

    def _parsed(self, opcode: int, body: bytes) -> Any:
        """Return a record, None where it is left out."""
        if opcode == Opcode.ATTACHMENT and not self._attachments:
            return None
        try:
            record = parse(opcode, body, own=self._own)
        except BrokenError:
            if opcode in _BESIDE:
                return None
            raise
        if isinstance(record, Header):
            self._own = record.library.startswith(TOOL)
        self._learn(record)
        return record

    def _learn(self, record: Any) -> None:
        self.learnt += 1
        if isinstance(record, Schema):
            self.schemas[record.id] = record
        elif isinstance(record, Channel):
            self.channels[record.id] = record

    def _take(self, size: int, *, partly: bool = False) -> bytes:
        """Read exactly ``size`` bytes."""
        parts: list[bytes] = []
        left = size
        while left:
            part = self._stream.read(min(left, 1 << 20))
            if not part:
                break
            parts.append(part)
            left -= len(part)
        data = b"".join(parts)
        self._crc = zlib.crc32(data, self._crc)
        self._taken += len(data)
        if left and not partly:
            raise _TornError(data)
        return data

    def _record(self) -> tuple[int, bytes]:
        """Read a record; what nobody wants comes without its body."""
        self._opcode = 0
        opcode, size = HEAD.unpack(self._take(HEAD.size))
        self._opcode = opcode
        if not opcode:  # no record has it, but the tail of a file after a power failure
            raise BrokenError("there are zeros where a record should begin")
        wanted = opcode in _PARSED or opcode in (
            Opcode.CHUNK,
            Opcode.MESSAGE,
            Opcode.MESSAGE_INDEX,
        )
        if wanted and (opcode != Opcode.ATTACHMENT or self._attachments):
            if size <= (TOLD if opcode in _TOLD else LONGEST):
                return opcode, self._take(size)
            if opcode not in _BESIDE or size > LONGEST:
                raise BrokenError(f"a record claims to have {size} bytes")
        while size:
            size -= len(self._take(min(size, 1 << 20)))
        return opcode, b""

    def _torn(self, body: bytes) -> Iterator[Piece]:
        """Yield, as a chunk of its own, the whole messages that a chunk begins with."""
        try:
            size, _, compression, length, packed = chunk_head(body)
            if compression == "zstd" and len(packed) < length:
                begin = begin_of(packed, min(size, UNPACKED))
                data = begin[: whole_until(begin)]
                packed = zstandard.ZstdCompressor().compress(data)
                piece = self._messages("zstd", packed, zlib.crc32(data), data, [])
                if len(piece.at):
                    yield piece
        except (BrokenError, zstandard.ZstdError):
            return  # nothing of it can be read

    def _piece(self, body: bytes, index: list[bytes]) -> Piece:
        size, crc, compression, length, packed = chunk_head(body)
        if len(packed) != length:
            raise BrokenError("the head of a chunk makes no sense")
        data = unpack(compression, packed, size)
        if len(data) != size or (crc and zlib.crc32(data) != crc):
            raise BrokenError("a chunk's checksum does not match")
        return self._messages(compression, packed, crc, data, index)

    def _messages(
        self, compression: str, packed: bytes, crc: int, data: bytes, index: list[bytes]
    ) -> Piece:
        """Find the messages: by the index or by their heads, if these agree with the data.

        Else record by record, which takes a hundred times as long. Their heads are looked at only
        where the index does not fit: that takes longer than all else that is done with a chunk.
        """
        at = _indexed(index)
        told = len(at)
        if not self._holds(data, at):
            at = _likely(data)
            if not self._holds(data, at):
                at = np.array(self._walk(data, len(data))[0], np.int64)
        channel = _gather(data, at, 9, "<u2")
        if not set(np.unique(channel).tolist()) <= self.channels.keys():
            raise BrokenError("a message belongs to no channel")
        log = _gather(data, at, 15, "<i8")
        ids = channel.astype(np.uint16)
        return Piece(compression, packed, crc, data, at, ids, log, indexed=told == len(at))

    def _holds(self, data: bytes, at: I64) -> bool:
        """Tell whether these are the places of all messages, with none in what is before them."""
        return _tiles(data, at) and self._walk(data, int(at[0])) == ([], int(at[0]))

    def _walk(self, data: bytes, until: int) -> tuple[list[int], int]:
        """Go through a chunk's records; return where the messages begin, and where it ended."""
        start = 0
        found: list[int] = []
        while start < until:
            try:
                opcode, size = HEAD.unpack_from(data, start)
            except struct.error:
                raise BrokenError("a chunk ends within a record") from None
            end = start + HEAD.size + size
            if end > len(data) or (opcode == Opcode.MESSAGE and size < _MESSAGE):
                raise BrokenError("a chunk ends within a record")
            if not opcode:
                raise BrokenError("there are zeros where a record should begin")
            if opcode == Opcode.MESSAGE:
                found.append(start)
            elif opcode in (Opcode.SCHEMA, Opcode.CHANNEL):
                if size > TOLD:
                    raise BrokenError(f"a record claims to have {size} bytes")
                self._learn(parse(opcode, data[start + HEAD.size : end], own=self._own))
            start = end
        return found, start


def parse(opcode: int, body: bytes, *, own: bool) -> Any:
    """Parse a record with the library, which reads no further than the body has bytes.

    Records of others may have more at their end than is known here, our ``own`` have not.
    """
    stream = ReadDataStream(io.BytesIO(body))
    try:
        record = _PARSED[opcode].read(stream)
    except (McapError, struct.error, UnicodeDecodeError):
        record = None
    if record is None or (own and stream.count != len(body)):
        raise BrokenError(f"a {Opcode(opcode).name.lower()} record makes no sense")
    return record


def _indexed(index: list[bytes]) -> I64:
    """Return the places that the message indexes name, in order."""
    parts = [np.frombuffer(b, "<i8", (len(b) - 6) // 16 * 2, 6)[1::2] for b in index]
    return np.sort(np.concatenate(parts)) if parts else np.empty(0, np.int64)


def _likely(data: bytes) -> I64:
    """Return where messages begin, by their looks: the opcode, and a length below 64 KiB.

    Inside of messages other places look the same. So from the first place on, each message is
    where the one before it ends, as long as such a place is there.
    """
    octets = np.frombuffer(data, np.uint8)
    at = np.flatnonzero(octets[: max(0, len(data) - HEAD.size - _MESSAGE + 1)] == Opcode.MESSAGE)
    at = at[_gather(data, at, 1, "<u8") < 1 << 16]
    if not len(at):
        return at
    end = at + HEAD.size + _gather(data, at, 1, "<i8")
    # Leaving out all places where none ends, again and again, takes a round for each link of a
    # chain within messages, and what is regular has chains of hundreds.
    row = np.searchsorted(at, end)
    follows = np.where(at[np.minimum(row, len(at) - 1)] == end, row, -1).tolist()
    rows: list[int] = []
    k = 0
    while k >= 0:
        rows.append(k)
        k = follows[k]
    return at[rows]


def _tiles(data: bytes, at: I64) -> bool:
    """Tell whether from the first place on there is nothing but messages at these places."""
    if not len(at) or at[0] < 0 or at[-1] > len(data) - HEAD.size - _MESSAGE:
        return False
    size = _gather(data, at, 1, "<i8")
    end = at + HEAD.size + size
    return bool(
        (size >= _MESSAGE).all()
        and (size <= len(data)).all()
        and (_gather(data, at, 0, "u1") == Opcode.MESSAGE).all()
        and (end[:-1] == at[1:]).all()
        and end[-1] == len(data)
    )


def _gather(data: bytes, at: I64, shift: int, dtype: str) -> npt.NDArray[Any]:
    """Return the number that stands ``shift`` bytes behind each place."""
    if not len(at):
        return np.empty(0, dtype)
    width = np.dtype(dtype).itemsize
    return np.ndarray((len(data) - width + 1,), dtype, data, 0, (1,))[at + shift]
