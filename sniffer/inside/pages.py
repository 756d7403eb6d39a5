"""Decoded batches put away: compressed in a temporary file, a few of them in memory.

What a line of the list needs is in columns (``index.py``); the rest is fetched for the lines that
somebody looks at. The file has no name, so nothing is left behind.
"""

from __future__ import annotations

import io
import pickle
import tempfile
import threading
from collections import OrderedDict
from dataclasses import dataclass
from typing import TYPE_CHECKING, Final, NamedTuple

import zstandard

from sniffer.ground.pickling import write_pickle

if TYPE_CHECKING:
    from sniffer.ground.model import Batch
    from sniffer.protocols.base import BusProtocol

KEPT: Final = 24
"""Pages in memory: more than two screens of lines and a search beside them touch."""

LEVEL: Final = 1
"""Of zstd: columns shrink to a fifth with it, faster than they are decoded."""


class LastValue(NamedTuple):
    """The last value of a register of a servo; ``value`` is NaN where none is stated in units."""

    t_ns: int
    raw: int
    value: float
    part: int


Board = dict[tuple[int, int], LastValue]
"""The last values by servo id and register."""


@dataclass(frozen=True, slots=True)
class Page:
    """A batch with whose it is, and what its bus had told before it."""

    bus: int
    protocol: BusProtocol
    batch: Batch
    before: Board


class _Place(NamedTuple):
    offset: int
    size: int
    bus: int
    protocol: BusProtocol


class Pages:
    """Takes pages, and gives them back by number; one thread puts, any may get.

    Raises:
        OSError: there is no room for the temporary file.
    """

    def __init__(self) -> None:
        self._file = tempfile.TemporaryFile(prefix="sniffer-")  # noqa: SIM115 - as long as this
        self._places: list[_Place] = []
        self._kept: OrderedDict[int, Page] = OrderedDict()
        self._lock = threading.Lock()
        self._packer = zstandard.ZstdCompressor(level=LEVEL)
        self._unpacker = zstandard.ZstdDecompressor()
        self._end = 0

    def __len__(self) -> int:
        return len(self._places)

    def put(self, page: Page) -> int:
        """Put a page away; return its number."""
        packed = self._packer.compress(_pickled(page.batch, page.before))
        with self._lock:
            self._file.seek(self._end)
            self._file.write(packed)
            self._places.append(_Place(self._end, len(packed), page.bus, page.protocol))
            self._end += len(packed)
            return len(self._places) - 1

    def get(self, number: int) -> Page:
        """Return a page."""
        with self._lock:
            if number in self._kept:
                self._kept.move_to_end(number)
                return self._kept[number]
            place = self._places[number]
            self._file.seek(place.offset)
            packed = self._file.read(place.size)
            batch, before = pickle.loads(self._unpacker.decompress(packed))
            page = Page(place.bus, place.protocol, batch, before)
            self._kept[number] = page
            if len(self._kept) > KEPT:
                self._kept.popitem(last=False)
            return page

    def protocol_of(self, number: int) -> BusProtocol:
        """Return whose words a page has, without fetching it."""
        return self._places[number].protocol

    def close(self) -> None:
        """Give the room back."""
        with self._lock:
            self._file.close()


def _pickled(batch: Batch, before: Board) -> bytes:
    out = io.BytesIO()
    write_pickle((batch, before), out)
    return out.getvalue()
