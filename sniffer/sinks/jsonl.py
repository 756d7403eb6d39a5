"""JSON lines: one object a record, in wire order, a summary last. The keys are a contract."""

from __future__ import annotations

import contextlib
import json
from pathlib import Path
from typing import TYPE_CHECKING, Any, TextIO

from sniffer.decoding.rows import as_dict, rows_of
from sniffer.decoding.summary import Summary
from sniffer.ground.files import open_text, writing

if TYPE_CHECKING:
    from collections.abc import Mapping, Sequence

    from sniffer.decoding.pacing import Pace
    from sniffer.ground.model import Batch, Chunk
    from sniffer.protocols.base import BusProtocol

_encode = json.JSONEncoder(separators=(",", ":"), ensure_ascii=False, allow_nan=False).encode


class JsonlSink:
    """Writes to a path, or to a stream that stays open."""

    def __init__(self, target: Path | TextIO) -> None:
        self._path = target if isinstance(target, Path) else None
        self._file = open_text(target) if isinstance(target, Path) else target
        self._summary = Summary()

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
                self._file.write(_encode({"type": "selection", **told}) + "\n")

    def write(self, bus: str, protocol: BusProtocol, batch: Batch) -> None:
        """Write the batch's records."""
        self.write_together(bus, [(protocol, batch)])

    def write_together(self, bus: str, parts: Sequence[tuple[BusProtocol, Batch]]) -> None:
        """Write what several protocols said in one pass, in wire order."""
        for protocol, batch in parts:
            self._summary.add(bus, protocol, batch)
        lines = [_encode(as_dict(row)) for row in rows_of(parts, bus)]
        if lines:
            with self._guard():
                self._file.write("\n".join(lines) + "\n")

    def close(self) -> None:
        """Write the summary."""
        with self._guard():
            try:
                if self._summary.buses:
                    self._file.write(_encode(self._summary.as_dict()) + "\n")
                self._file.flush()
            finally:
                if self._path is not None:
                    self._file.close()

    def _guard(self) -> contextlib.AbstractContextManager[None]:
        return writing(self._path) if self._path is not None else contextlib.nullcontext()
