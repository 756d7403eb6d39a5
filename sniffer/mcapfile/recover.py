"""A recording that was cut off, made whole again: what holds is kept, the summary written anew."""

from __future__ import annotations

import contextlib
import os
import shutil
import time
from dataclasses import dataclass
from typing import TYPE_CHECKING, Final

import numpy as np
from mcap.records import Attachment, Channel, Header, Metadata, Schema

from sniffer.ground.files import writing
from sniffer.ground.model import InputError, OutputError
from sniffer.mcapfile.container import Container
from sniffer.mcapfile.ends import end_facts
from sniffer.mcapfile.given import open_recording, refuse_no_file
from sniffer.mcapfile.packed import BrokenError
from sniffer.mcapfile.packing import ChunkContents
from sniffer.mcapfile.records import NotMcapError, Piece, Records
from sniffer.mcapfile.states import kind_of
from sniffer.mcapfile.tail import Tail
from sniffer.messages import BULK, END, RECOVERED, TOOL

if TYPE_CHECKING:
    from pathlib import Path

STILL_S: Final = 0.3
"""For so long a file must not have grown: of a bus that speaks its raw bytes are written sooner."""


@dataclass(frozen=True, slots=True)
class Recovered:
    """What was recovered; ``why`` says what is wrong where the readable part ends.

    ``messages`` counts all that the file has now, ``derived`` those among them that were made anew
    from raw bytes at the end: the recorder had no time for them.
    """

    path: Path
    messages: int
    bytes_kept: int
    bytes_lost: int
    why: str = ""
    derived: int = 0

    def __str__(self) -> str:
        """Say it in a sentence."""
        kept = f"{self.path}: {self.messages - self.derived} messages kept"
        if self.derived:
            kept += f", {self.derived} made anew from its last bytes"
        if not self.why:
            return f"{kept}, nothing was lost"
        if not self.bytes_lost:
            return f"{kept}, no byte was lost: only the end of the file is missing ({self.why})"
        were = "byte was" if self.bytes_lost == 1 else f"{self.bytes_lost} bytes were"
        return f"{kept}, the file's last {were} lost ({self.why})"


def recover(path: Path, out: Path) -> Recovered:
    """Write what can be read of ``path`` to ``out``, which may be the same file.

    Chunks are copied as they are, up to the first damage, and of one that breaks off the messages
    that are whole. What a recorder that was killed had no time to make of its last bytes is made of
    them now, as far as its session asked for it. ``out``, or the file that it leads to as a link,
    is replaced at the end.

    Raises:
        InputError: there is nothing to recover.
        OutputError: ``out`` cannot be written, or is no file, or is still being written itself.
    """
    refuse_no_file(path)  # before ``out``, which may be the same
    if out.exists() and not out.is_file():
        what = "a directory" if out.is_dir() else "a device or a pipe"
        raise OutputError(f"{out} is {what}: give a file name")
    stream = open_recording(path)
    begun = path.stat().st_size
    # a link stays what it is, and leads to what was mended
    target = out.resolve()
    temporary = target.with_name(f".{target.name[:200]}.{os.getpid()}.part")
    file: Container | None = None
    tail: Tail | None = None
    messages, why, ours = 0, "", False
    with stream:
        end = end_facts(stream)  # it is kept also where it stands behind the damage
        records = Records(stream, attachments=True)
        try:
            try:
                for record in records:
                    if isinstance(record, Header):
                        file = Container(temporary, record.library)
                        tail, ours = Tail(file), record.library.startswith(TOOL)
                    elif isinstance(record, Metadata) and record.name == END:
                        continue
                    elif file is not None and tail is not None:
                        messages += _copy(record, records, file, tail)
            except NotMcapError as error:
                raise InputError(
                    f"{path} is no recording ({error}): only an .mcap can be mended; "
                    "`sniffer decode` reads other captures"
                ) from None
            except BrokenError as error:
                why = str(error)
            if file is None:
                raise InputError(f"{path}: nothing of it can be read ({why})")
            derived = tail.derive(path) if why and ours and tail is not None else 0
            messages += derived
            if end:
                file.metadata(END, end)
            if why:
                file.metadata(RECOVERED, {"why": why})
            file.finish()
            with temporary.open("rb") as written:
                os.fsync(written.fileno())
            size = path.stat().st_size
            if why and path.resolve() == target:
                _refuse_growing(path, begun, size)
            with contextlib.suppress(OSError):
                shutil.copymode(target, temporary)
            with writing(out):
                temporary.replace(target)
        finally:
            if file is not None:
                file.abandon()
            with contextlib.suppress(FileNotFoundError):
                temporary.unlink()
    lost = size - records.position if why else 0
    return Recovered(out, messages, size - lost, lost, why, derived)


def _refuse_growing(path: Path, begun: int, size: int) -> None:
    """Refuse to replace a file that is still being written: its recorder would go on elsewhere.

    Raises:
        OutputError: it is longer than it was.
    """
    written_s = time.time() - path.stat().st_mtime
    if size == begun and written_s < STILL_S:
        time.sleep(STILL_S - max(written_s, 0.0))
    if path.stat().st_size != begun:
        raise OutputError(
            f"{path} is being written: end its recorder first, or give another output"
        )


def _copy(
    record: Attachment | Metadata | Schema | Channel | Piece,
    records: Records,
    file: Container,
    tail: Tail,
) -> int:
    """Copy a record; return how many messages it holds."""
    if isinstance(record, Metadata):
        file.metadata(record.name, record.metadata)
    elif isinstance(record, Attachment):
        file.attach(record)
    elif isinstance(record, Piece):
        file.know(*records.schemas.values(), *records.channels.values())
        p = record
        if len(p.at):
            topics = {kind_of(records.channels[c].topic) for c in np.unique(p.channel).tolist()}
            indexed = p.indexed or not topics <= {"raw", *BULK}
            listed = np.full(len(p.at), indexed)
            contents = ChunkContents(p.data, p.log, p.channel, p.at, listed)
            file.chunk(p.compression, p.packed, p.crc, contents)
            tail.look(p)
        return len(p.at)
    else:
        file.append(record)
    return 0
