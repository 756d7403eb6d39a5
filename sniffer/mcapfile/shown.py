"""The layout of a recording: as it is attached, or made anew of one that was cut off."""

from __future__ import annotations

import json
import struct
from typing import TYPE_CHECKING, Any

import numpy as np
from google.protobuf.message import DecodeError
from mcap.exceptions import McapError
from mcap.reader import make_reader
from mcap.records import Header, Metadata

from sniffer.decoding.called import names_in
from sniffer.ground.model import InputError
from sniffer.mcapfile.given import open_recording, unreadable
from sniffer.mcapfile.layout import ATTACHED, layout
from sniffer.mcapfile.packed import BrokenError
from sniffer.mcapfile.records import NotMcapError, Piece, Records
from sniffer.mcapfile.states import kind_of
from sniffer.messages import BULK, SESSION, TOOL
from sniffer.messages.servo_state_pb2 import ServoState

if TYPE_CHECKING:
    from io import BufferedReader
    from pathlib import Path

    from sniffer.decoding.called import Named


def layout_of(path: Path) -> dict[str, Any]:
    """Return the layout of a recording; one that was not finished is gone through.

    Raises:
        InputError: it is no recording, or has nothing to show.
    """
    with open_recording(path) as stream:
        try:
            made = _attached(stream)
            if made is None:
                stream.seek(0)
                made = _made(stream, path)
        except OSError as error:
            raise unreadable(path, error) from None
    if made is None and not path.stat().st_size:
        raise InputError(f"{path} is empty: there is nothing to show")
    if made is None:
        raise InputError(
            f"{path} has nothing that viewers show: `sniffer convert {path} whole.mcap` writes a "
            "recording with everything"
        )
    return made


def _attached(stream: BufferedReader) -> dict[str, Any] | None:
    """Return the layout that is attached, found by the index at the end of the file."""
    try:
        for attachment in make_reader(stream).iter_attachments():
            if attachment.name == ATTACHED:
                made = json.loads(attachment.data)
                return made if isinstance(made, dict) else None
    except (McapError, ValueError, struct.error):
        return None  # it has no end, or no sense: what it holds is looked through
    return None


def _made(stream: BufferedReader, path: Path) -> dict[str, Any] | None:
    """Return the layout for what a recording holds, as far as it can be read."""
    records = Records(stream)
    topics: set[str] = set()
    unfound: set[str] = set()
    fields: dict[str, set[str]] = {}
    names: dict[Named, str] = {}
    is_ours = False
    try:
        for record in records:
            if isinstance(record, Header):
                is_ours = record.library.startswith(TOOL)
            elif isinstance(record, Metadata) and record.name == SESSION:
                is_ours = True
                names |= names_in(record.metadata)
            elif isinstance(record, Piece):
                for channel in np.unique(record.channel).tolist():
                    known = records.channels[channel]
                    topics.add(known.topic)
                    if not record.indexed and kind_of(known.topic) in ("raw", *BULK):
                        unfound.add(known.topic)  # viewers find next to nothing of it
                    if records.schemas[known.schema_id].name == ServoState.DESCRIPTOR.full_name:
                        fields.setdefault(known.topic, set()).update(_told(record, channel))
    except NotMcapError:
        raise InputError(
            f"{path} is no recording: `sniffer convert {path} run.mcap` makes one of it"
        ) from None
    except (BrokenError, DecodeError):
        pass  # what comes before is shown
    if topics and not is_ours:
        raise InputError(f"{path} is an MCAP, but no recording of this tool")
    return layout(topics - unfound, fields, names)


def _told(piece: Piece, channel: int) -> set[str]:
    """Return which fields the states of a channel have somewhere in a chunk."""
    said = piece.messages(piece.at[piece.channel == channel])
    return {field.name for data in said for field, _ in ServoState.FromString(data).ListFields()}
