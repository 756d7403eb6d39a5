"""Chunks on their way to another process: parcels of bytes, cheap to make.

Both ends are the same program on the same machine: the byte order is its own. A parcel holds the
chunks of one bus as columns, for a loop over single chunks would cost the sender ten times as much.
"""

from __future__ import annotations

import pickle
import struct
from array import array
from dataclasses import dataclass
from typing import TYPE_CHECKING, Final, NamedTuple

from sniffer.ground.model import Chunk, Clock, Direction, Mark, MarkKind

if TYPE_CHECKING:
    from collections.abc import Iterator, Sequence

    from sniffer.decoding.pipeline import Options

WINDOW: Final = "window"
WEB: Final = "web"
CONNECT: Final = "connect"
"""Where a recording is shown live: a window, a browser, a viewer that is there already."""

READY: Final = "ready"
SAY: Final = "say"
GONE: Final = "gone"
DONE: Final = "done"
"""What the other process tells: that the viewer is there, a line for people, why it ends, that all
has been shown."""

NO_TIME: Final = -(1 << 63)
"""Stands for a chunk without a time."""

_SIZE: Final = struct.Struct("=I")
_HEAD: Final = struct.Struct("=IIIQq")  # of the name, chunks, numbers in marks, missing, now_ns
_MARK: Final = 1 + len(Mark._fields)

_CLOCKS: Final = {int(clock): clock for clock in Clock}
_DIRECTIONS: Final = {int(direction): direction for direction in Direction}
_MARKS: Final = {int(kind): kind for kind in MarkKind}


@dataclass(frozen=True, slots=True)
class Setup:
    """What the process that shows a recording is told first.

    ``address`` is the viewer's in the mode ``CONNECT``; ``arguments`` are for the viewer's program
    in the others.
    """

    mode: str
    name: str
    options: Options
    window_s: float
    address: str = ""
    arguments: tuple[str, ...] = ()

    def packed(self) -> bytes:
        """Return it as bytes."""
        data = pickle.dumps(self)
        return _SIZE.pack(len(data)) + data


class Parcel(NamedTuple):
    """Chunks of one bus, ``missing`` bytes behind those before; or only what time it is."""

    bus: str
    missing: int
    chunks: Sequence[Chunk]
    now_ns: int = 0


def packed(bus: str, chunks: Sequence[Chunk], missing: int = 0, now_ns: int = 0) -> bytes:
    """Return a parcel as bytes."""
    name = bus.encode()
    times = array("q", [NO_TIME if c.t_ns is None else c.t_ns for c in chunks])
    sizes = array("I", [len(c.data) for c in chunks])
    marks = array("q", [n for k, c in enumerate(chunks) for m in c.marks for n in (k, *m)])
    body = b"".join(
        (
            _HEAD.pack(len(name), len(chunks), len(marks), missing, now_ns),
            name,
            times.tobytes(),
            sizes.tobytes(),
            bytes([c.clock for c in chunks]),
            bytes([c.direction for c in chunks]),
            marks.tobytes(),
            *[c.data for c in chunks],
        )
    )
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
    n_name, n, n_marks, missing, now_ns = _HEAD.unpack_from(body)
    at = _HEAD.size

    def take(size: int) -> bytes:
        nonlocal at
        at += size
        return body[at - size : at]

    bus = take(n_name).decode()
    times, sizes, numbers = array("q"), array("I"), array("q")
    times.frombytes(take(n * times.itemsize))
    sizes.frombytes(take(n * sizes.itemsize))
    clocks, directions = take(n), take(n)
    numbers.frombytes(take(n_marks * numbers.itemsize))
    marks: dict[int, list[Mark]] = {}
    for k in range(0, n_marks, _MARK):
        row, kind, *rest = numbers[k : k + _MARK]
        marks.setdefault(row, []).append(Mark(_MARKS[kind], *rest))
    chunks = [
        Chunk(
            take(sizes[k]),
            None if times[k] == NO_TIME else times[k],
            _CLOCKS[clocks[k]],
            bus,
            _DIRECTIONS[directions[k]],
            tuple(marks.get(k, ())),
        )
        for k in range(n)
    ]
    return Parcel(bus, missing, chunks, now_ns)
