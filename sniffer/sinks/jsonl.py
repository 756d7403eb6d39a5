"""JSON lines: one object a record, in wire order, a summary last. The keys are a contract."""

from __future__ import annotations

import contextlib
from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING, Any, TextIO

from sniffer.decoding.called import ServoNames
from sniffer.decoding.summary import Summary
from sniffer.decoding.totals import add_totals
from sniffer.ground.files import open_text, writing
from sniffer.sinks.lines import lines
from sniffer.sinks.pieced import encode

if TYPE_CHECKING:
    from collections.abc import Mapping, Sequence

    from sniffer.decoding.pacing import Pace
    from sniffer.decoding.sink import Part
    from sniffer.ground.model import Batch, Chunk
    from sniffer.protocols.base import BusProtocol
    from sniffer.sinks.pieces import WrittenElsewhere


class JsonlSink:
    """Writes to a path, or to a stream that stays open."""

    def __init__(self, target: Path | TextIO) -> None:
        self._path = target if isinstance(target, Path) else None
        self._file = open_text(target) if isinstance(target, Path) else target
        self._summary = Summary()
        self._names = ServoNames()

    def call(self, names: ServoNames) -> None:
        """Take what servos are called."""
        self._names = names

    def raw(self, bus: str, chunks: Sequence[Chunk]) -> None:
        """Take nothing: the records hold every byte."""

    def pace(self, bus: str, told: Pace) -> None:
        """Take what a bus is timed by, for the summary."""
        self._summary.paces[bus] = told

    def narrow(self, told: Mapping[str, Any]) -> None:
        """Take what of it is written, for the summary; a selection says in front that it is one.

        Its bytes are not those of the bus: whoever reads the lines as a capture must know it
        before.
        """
        self._summary.narrow(told)
        if "where" in told:
            with self._guard():
                self._file.write(encode({"type": "selection", **told}) + "\n")

    def write(self, bus: str, protocol: BusProtocol, batch: Batch) -> None:
        """Write the batch's records."""
        self.write_together(bus, [(protocol, batch)])

    def write_together(self, bus: str, parts: Sequence[Part]) -> None:
        """Write what several protocols said in one pass, in wire order."""
        for protocol, batch in parts:
            self._summary.add(bus, protocol, batch)
        with self._guard():
            self._file.write(lines(bus, parts, self._names))

    def pieces(self) -> LinePieces:
        """Return how a part of a capture is written elsewhere."""
        return LinePieces()

    def join(self, piece: Path, told: WrittenElsewhere) -> None:
        """Write what was written elsewhere."""
        import shutil  # loads what packs files, and most captures have no parts

        add_totals(self._summary, told.totals)
        with piece.open(encoding="utf-8", newline="") as told_there, self._guard():
            shutil.copyfileobj(told_there, self._file, 1 << 20)

    def close(self) -> None:
        """Write the summary."""
        with self._guard():
            try:
                if self._summary.buses:
                    self._file.write(encode(self._summary.as_dict()) + "\n")
                self._file.flush()
            finally:
                if self._path is not None:
                    self._file.close()

    def _guard(self) -> contextlib.AbstractContextManager[None]:
        return writing(self._path) if self._path is not None else contextlib.nullcontext()


@dataclass(frozen=True, slots=True)
class LinePieces:
    """Parts of a capture as JSON lines without a summary."""

    def open(self, path: Path) -> LinePiece:
        """Return what writes one."""
        return LinePiece(path)


class LinePiece:
    """Writes the lines of a part."""

    def __init__(self, path: Path) -> None:
        self._path = path
        self._file = open_text(path)
        self._names = ServoNames()

    def call(self, names: ServoNames) -> None:
        """Take what servos are called."""
        self._names = names

    def raw(self, bus: str, chunks: Sequence[Chunk]) -> None:
        """Take nothing."""

    def write(self, bus: str, protocol: BusProtocol, batch: Batch) -> None:
        """Write the batch's records."""
        self.write_together(bus, [(protocol, batch)])

    def write_together(self, bus: str, parts: Sequence[Part]) -> None:
        """Write what several protocols said in one pass, in wire order."""
        with writing(self._path):
            self._file.write(lines(bus, parts, self._names))

    def close(self) -> None:
        """Finish the file."""
        with writing(self._path):
            self._file.close()
