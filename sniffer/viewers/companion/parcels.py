"""Chunks on their way to another process: parcels of bytes, cheap to make.

Both ends are the same program on the same machine, so a parcel is pickled. It holds the chunks of
one bus as columns: chunk by chunk, pickling costs the sender ten times as much.
"""

from __future__ import annotations

import pickle
import struct
from dataclasses import dataclass
from typing import TYPE_CHECKING, Final, NamedTuple

from sniffer.ground.limits import number_in
from sniffer.ground.model import Chunk, OutputError

if TYPE_CHECKING:
    from collections.abc import Iterator, Sequence

    from sniffer.decoding.pipeline import Options
    from sniffer.ground.model import Severity

WINDOW: Final = "window"
WEB: Final = "web"
CONNECT: Final = "connect"
FOXGLOVE: Final = "foxglove"
"""Where a recording is shown live: a window, a browser, a viewer that is there already, Foxglove.
"""

READY: Final = "ready"
SAY: Final = "say"
GONE: Final = "gone"
DONE: Final = "done"
"""What the other process tells: that the viewer is there, a line for people, why it ends, that all
has been shown."""

PORT_MOST: Final = 65535
"""The last port there is."""

_SIZE: Final = struct.Struct("=I")


@dataclass(frozen=True, slots=True)
class Setup:
    """What the process that shows a recording is told first.

    ``address`` is the viewer's in the mode ``CONNECT``, and where to listen (``HOST:PORT``) in the
    mode ``FOXGLOVE``; ``arguments`` are for the viewer's program in the others. ``buses`` are those
    that are heard.
    """

    mode: str
    name: str
    options: Options
    window_s: float
    address: str = ""
    arguments: tuple[str, ...] = ()
    buses: tuple[str, ...] = ()

    def packed(self) -> bytes:
        """Return it as bytes."""
        data = pickle.dumps(self)
        return _SIZE.pack(len(data)) + data


def address_in(text: str) -> tuple[str, int]:
    """Read ``HOST:PORT``.

    Raises:
        OutputError: it is none.
    """
    host, colon, port = text.rpartition(":")
    number = number_in(port, 0, PORT_MOST)
    if not colon or not host or number is None:
        raise OutputError(f"{text[:60]!r} is no address: write HOST:PORT, as in 127.0.0.1:8765")
    return host.strip("[]"), number


class IncidentWord(NamedTuple):
    """A line about an incident of a bus and some of its servos."""

    t_ns: int
    severity: Severity
    servo_ids: tuple[int, ...]
    text: str


class Parcel(NamedTuple):
    """Chunks of one bus, ``missing`` bytes behind those before.

    Or only words about the bus, or its rate, before its first chunk.
    """

    bus: str
    missing: int
    chunks: Sequence[Chunk]
    words: Sequence[IncidentWord] = ()
    baud: int = 0


def packed(
    bus: str,
    chunks: Sequence[Chunk],
    missing: int = 0,
    words: Sequence[IncidentWord] = (),
    baud: int = 0,
) -> bytes:
    """Return a parcel as bytes."""
    columns = (
        [c.data for c in chunks],
        [c.t_ns for c in chunks],
        [c.clock for c in chunks],
        [c.direction for c in chunks],
        [c.marks for c in chunks],
    )
    body = pickle.dumps((bus, missing, columns, list(map(tuple, words)), baud))
    return _SIZE.pack(len(body)) + body


class Unpacker:
    """Takes bytes as a pipe delivers them, in pieces of any size."""

    def __init__(self) -> None:
        self._buffer = bytearray()

    def feed(self, data: bytes) -> None:
        """Take a piece."""
        self._buffer += data

    def setup(self) -> Setup | None:
        """Return the setup, which comes first, once it is complete."""
        for body in self._bodies():
            setup = pickle.loads(body)  # from the process that started this one
            assert isinstance(setup, Setup)
            return setup
        return None

    def parcels(self) -> Iterator[Parcel]:
        """Yield the parcels that are complete."""
        return map(_unpacked, self._bodies())

    def _bodies(self) -> Iterator[bytes]:
        head = _SIZE.size
        while len(self._buffer) >= head:
            end = head + _SIZE.unpack_from(self._buffer)[0]
            if len(self._buffer) < end:
                return
            body = bytes(self._buffer[head:end])
            del self._buffer[:end]
            yield body


def _unpacked(body: bytes) -> Parcel:
    # from the process that started this one
    bus, missing, columns, words, baud = pickle.loads(body)
    chunks = [
        Chunk(data, t_ns, clock, bus, direction, marks)
        for data, t_ns, clock, direction, marks in zip(*columns, strict=True)
    ]
    return Parcel(bus, missing, chunks, tuple(IncidentWord(*word) for word in words), baud)
