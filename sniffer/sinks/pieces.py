"""Outputs of which parts are written elsewhere, by another process, and joined in order.

A sink that can tell how its records are written elsewhere saves the time: what it is given then is
finished (``Joining``). Any other is given the batches themselves.
"""

from __future__ import annotations

import pickle
from dataclasses import dataclass, replace
from typing import TYPE_CHECKING, NamedTuple, Protocol, runtime_checkable

from sniffer.decoding.sink import over, taken, written
from sniffer.ground.files import open_binary, writing
from sniffer.ground.pickling import write_pickle

if TYPE_CHECKING:
    from collections.abc import Callable, Collection, Sequence
    from pathlib import Path

    from sniffer.decoding.sink import Part, Sink
    from sniffer.decoding.summary import Summary
    from sniffer.ground.model import Batch, Chunk
    from sniffer.protocols.base import BusProtocol


_TAKEN, _WRITTEN, _OVER = "taken", "written", "over"
"""What a sink was told, in the file of a piece."""


class PieceMaker(Protocol):
    """How a part of a capture is written elsewhere; it can be pickled."""

    def open(self, path: Path) -> Sink:
        """Return a sink that writes a part to ``path``, and to files beside it."""
        ...


class WrittenElsewhere(NamedTuple):
    """A part of a capture that was written elsewhere, but for the records themselves."""

    totals: Summary
    given: Callable[[str, Sequence[tuple[str, Batch]]], Sequence[Part]]
    """Returns batches, by the name of their protocol, as sinks are given them."""


@runtime_checkable
class Joining(Protocol):
    """A sink that takes parts that were written elsewhere."""

    def pieces(self) -> PieceMaker:
        """Return how a part is written elsewhere."""
        ...

    def join(self, piece: Path, told: WrittenElsewhere) -> None:
        """Write a part, which follows all that was written before."""
        ...


@runtime_checkable
class Packing(Protocol):
    """A sink that takes so long to join what others have written that these save no time."""

    def advice(self) -> str:
        """Return what is sooner done, in a line; empty: nothing is known."""
        ...


@runtime_checkable
class Turning(Protocol):
    """A sink that writes each stretch of a capture to a file of its own."""

    def turn(self) -> None:
        """Go on with the next file: a stretch is over, or the last one."""
        ...


def advice_of(sinks: Sequence[Sink]) -> list[str]:
    """Return what is sooner done than these by several processes."""
    told = [sink.advice() for sink in sinks if isinstance(sink, Packing)]
    return [line for line in told if line]


def turn(sinks: Sequence[Sink]) -> None:
    """Tell sinks that a stretch is over."""
    for sink in sinks:
        if isinstance(sink, Turning):
            sink.turn()


def pieces_of(sink: Sink) -> PieceMaker:
    """Return how a part of what a sink writes is written elsewhere."""
    return sink.pieces() if isinstance(sink, Joining) else BatchPieces()


def join(sink: Sink, piece: Path, told: WrittenElsewhere) -> None:
    """Have a sink write a part."""
    if isinstance(sink, Joining):
        sink.join(piece, told)
        return
    with piece.open("rb") as file:
        while True:
            try:
                what, *told_then = pickle.load(file)
            except EOFError:
                return
            if what == _OVER:
                over(sink, until_ns=told_then[0], open_buses=told_then[1])
            elif what == _TAKEN:
                taken(sink, bus=told_then[0], chunks=told_then[1])
            else:
                bus, said = told_then
                written(sink, bus=bus, parts=told.given(bus, said))


@dataclass(frozen=True, slots=True)
class BatchPieces:
    """Parts of a capture as the batches themselves, for sinks that know no other way."""

    def open(self, path: Path) -> BatchPiece:
        """Return what writes one."""
        return BatchPiece(path)


class BatchPiece:
    """Writes what a sink would be given, call by call."""

    def __init__(self, path: Path) -> None:
        self._path = path
        self._file = open_binary(path)

    def raw(self, bus: str, chunks: Sequence[Chunk]) -> None:
        """Write chunks."""
        self._write(_TAKEN, bus, chunks)

    def write(self, bus: str, protocol: BusProtocol, batch: Batch) -> None:
        """Write a batch."""
        self.write_together(bus, [(protocol, batch)])

    def write_together(self, bus: str, parts: Sequence[Part]) -> None:
        """Write what several protocols said in one pass; which rows are shown is found out anew."""
        self._write(_WRITTEN, bus, [(p.name, replace(batch, chosen=None)) for p, batch in parts])

    def passed(self, until_ns: int | None, open_buses: Collection[str]) -> None:
        """Write that a pass is over."""
        self._write(_OVER, until_ns, open_buses)

    def _write(self, what: str, *told: object) -> None:
        with writing(self._path):
            write_pickle((what, *told), self._file)

    def close(self) -> None:
        """Finish the file."""
        with writing(self._path):
            self._file.close()
