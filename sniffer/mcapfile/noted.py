"""Marks that somebody set in a finished recording: a metadata record behind its data.

Nothing that is there is changed but the end of the file, which is written anew behind the record:
the data go on by it, and the index has one entry more. Of several such records the last one holds.
A crash in between leaves a file without its end, as a killed recorder does: it is read, and
``sniffer recover`` mends it.

    before    ... chunks DataEnd | summary offsets Footer
    behind    ... chunks MARKS DataEnd | summary' offsets' Footer
"""

from __future__ import annotations

import io
import json
import os
import struct
import zlib
from typing import TYPE_CHECKING, Any, Final

from mcap.data_stream import ReadDataStream
from mcap.opcode import Opcode
from mcap.records import DataEnd, Footer, Metadata, MetadataIndex, Statistics, SummaryOffset

from sniffer.ground.files import writing
from sniffer.ground.model import OutputError
from sniffer.mcapfile.ends import facts_named
from sniffer.mcapfile.index import as_bytes
from sniffer.messages import MAGIC, MARKS

if TYPE_CHECKING:
    from collections.abc import Iterator, Sequence
    from pathlib import Path

_HEAD: Final = struct.Struct("<BQ")
_FOOTER: Final = struct.Struct("<BQQQI")
_DATA_END: Final = _HEAD.size + 4
"""Length of the record that ends the data, in bytes."""


def read_notes(path: Path) -> list[dict[str, Any]]:
    """Return the marks of a recording, none where there are none or the file has no index."""
    with path.open("rb") as stream:
        facts = facts_named(stream, MARKS)
    told = (facts[key] for key in sorted(facts, key=lambda key: (len(key), key)))
    return [note for text in told if isinstance(note := _parsed(text), dict)]


def write_notes(path: Path, notes: Sequence[dict[str, Any]]) -> None:
    """Put marks into a finished recording, in place of those it has.

    Raises:
        OutputError: it has no end, because it is being written or was cut off; or it cannot be
            written.
    """
    told = {str(i): json.dumps(note, ensure_ascii=False) for i, note in enumerate(notes)}
    record = as_bytes(Metadata(MARKS, told))
    with writing(path), path.open("r+b") as file:
        size = file.seek(0, io.SEEK_END)
        summary, start = _summary(file, size, path)
        at = start - _DATA_END
        file.seek(at)
        end = DataEnd.read(_body(file.read(_DATA_END), Opcode.DATA_END, path))
        crc = zlib.crc32(record, end.data_section_crc) if end.data_section_crc else 0
        index = MetadataIndex(at, len(record), MARKS)
        fresh = record + as_bytes(DataEnd(crc))
        fresh += _ended(summary, at + len(fresh), index)
        file.seek(at)
        file.write(fresh)
        file.truncate()
        file.flush()
        os.fsync(file.fileno())


def _summary(file: io.BufferedRandom, size: int, path: Path) -> tuple[bytes, int]:
    """Return the records of the summary, and where they begin."""
    at = size - len(MAGIC) - _FOOTER.size
    file.seek(max(at, 0))
    foot = file.read()
    if at < 0 or foot[_FOOTER.size :] != MAGIC:
        raise OutputError(f"{path} has no end: is it being written, or was it cut off?")
    opcode, length, start, offsets, _ = _FOOTER.unpack(foot[: _FOOTER.size])
    if opcode != Opcode.FOOTER or length != 20 or not _DATA_END < start <= offsets <= at:
        raise OutputError(f"{path} ends in a way that is not known here: it is left as it is")
    file.seek(start)
    return file.read(offsets - start), start


def _ended(summary: bytes, here: int, index: MetadataIndex) -> bytes:
    """Return a summary with an entry more, for data that end at ``here``, and all behind it."""
    groups: dict[int, list[bytes]] = {}
    for opcode, record in _records(summary):
        if opcode == Opcode.STATISTICS:
            told = Statistics.read(ReadDataStream(io.BytesIO(record[_HEAD.size :])))
            told.metadata_count += 1
            record = as_bytes(told)
        groups.setdefault(opcode, []).append(record)
    groups.setdefault(Opcode.METADATA_INDEX, []).append(as_bytes(index))
    out, offsets = b"", b""
    for opcode, records in groups.items():
        part = b"".join(records)
        offsets += as_bytes(SummaryOffset(Opcode(opcode), here + len(out), len(part)))
        out += part
    at = here + len(out)
    head = struct.pack("<BQQQ", Opcode.FOOTER, 20, here, at)
    crc = zlib.crc32(out + offsets + head)
    return out + offsets + as_bytes(Footer(here, at, crc)) + MAGIC


def _records(data: bytes) -> Iterator[tuple[int, bytes]]:
    """Yield records that stand side by side, with their opcodes."""
    at = 0
    while at < len(data):
        opcode, size = _HEAD.unpack_from(data, at)
        end = at + _HEAD.size + size
        yield opcode, data[at:end]
        at = end


def _body(record: bytes, opcode: int, path: Path) -> ReadDataStream:
    """Return the body of the one record that must be there."""
    if _HEAD.unpack_from(record) != (opcode, len(record) - _HEAD.size):
        raise OutputError(f"{path} ends in a way that is not known here: it is left as it is")
    return ReadDataStream(io.BytesIO(record[_HEAD.size :]))


def _parsed(text: str) -> Any:
    """Return what a text says, None where it makes no sense."""
    try:
        return json.loads(text)
    except ValueError:
        return None
