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
import zlib
from typing import TYPE_CHECKING, Any

from mcap.data_stream import ReadDataStream
from mcap.opcode import Opcode
from mcap.records import DataEnd, Metadata, MetadataIndex, Statistics, SummaryOffset

from sniffer.ground.files import writing
from sniffer.ground.model import OutputError
from sniffer.mcapfile.ends import facts_named
from sniffer.mcapfile.index import as_bytes
from sniffer.mcapfile.structs import DATA_END, FOOT, HEAD, ended, foot, whole, whole_until
from sniffer.messages import MARKS

if TYPE_CHECKING:
    from collections.abc import Sequence
    from pathlib import Path


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
        at = start - DATA_END.size
        file.seek(at)
        opcode, length, crc = DATA_END.unpack(file.read(DATA_END.size))
        if (opcode, length) != (Opcode.DATA_END, DATA_END.size - HEAD.size):
            raise _unknown(path)
        crc = crc and zlib.crc32(record, crc)
        index = MetadataIndex(at, len(record), MARKS)
        fresh = record + as_bytes(DataEnd(crc))
        fresh += _with_index(summary, at + len(fresh), index)
        file.seek(at)
        file.write(fresh)
        file.truncate()
        file.flush()
        os.fsync(file.fileno())


def _summary(file: io.BufferedRandom, size: int, path: Path) -> tuple[bytes, int]:
    """Return the records of the summary, and where they begin."""
    at = size - FOOT
    file.seek(max(at, 0))
    told = foot(file.read())
    if told is None:
        raise OutputError(f"{path} has no end: is it being written, or was it cut off?")
    if not DATA_END.size < told.summary <= told.offsets <= at:
        raise _unknown(path)
    file.seek(told.summary)
    summary = file.read(told.offsets - told.summary)
    if whole_until(summary) != len(summary):
        raise _unknown(path)
    return summary, told.summary


def _unknown(path: Path) -> OutputError:
    return OutputError(f"{path} ends in a way that is not known here: it is left as it is")


def _with_index(summary: bytes, here: int, index: MetadataIndex) -> bytes:
    """Return a summary with an entry more, for data that end at ``here``, and all behind it."""
    groups: dict[int, list[bytes]] = {}
    for opcode, body, end in whole(summary):
        record = summary[body - HEAD.size : end]
        if opcode == Opcode.STATISTICS:
            told = Statistics.read(ReadDataStream(io.BytesIO(summary[body:end])))
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
    return out + ended(here, at, offsets, zlib.crc32(out))


def _parsed(text: str) -> Any:
    """Return what a text says, None where it makes no sense."""
    try:
        return json.loads(text)
    except ValueError:
        return None
