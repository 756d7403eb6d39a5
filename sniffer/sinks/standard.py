"""The sink on standard output, or another stream that somebody else reads."""

from __future__ import annotations

import contextlib
from typing import TYPE_CHECKING

from sniffer.decoding.sink import Calling, Narrowed, Paced, Part, Sink, over, written
from sniffer.ground.model import Batch, Chunk, OutputError
from sniffer.ground.streams import silence
from sniffer.sinks.pieces import join, pieces_of

if TYPE_CHECKING:
    from collections.abc import Collection, Iterator, Mapping, Sequence
    from pathlib import Path
    from typing import Any, TextIO

    from sniffer.decoding.called import ServoNames
    from sniffer.decoding.pacing import Pace
    from sniffer.protocols.base import BusProtocol
    from sniffer.sinks.pieces import PieceMaker, WrittenElsewhere


class Standard:
    """A sink on a stream: when its reader goes away, it falls silent.

    The pipe's end is nobody's fault; decoding goes on if there are other outputs.

    Args:
        sink: writes to the stream.
        stream: standard output.
        alone: there are no other outputs, so that BrokenPipeError goes on to the caller.
    """

    def __init__(self, sink: Sink, stream: TextIO, *, alone: bool) -> None:
        self._sink = sink
        self._stream = stream
        self._alone = alone
        self._open = True

    def raw(self, bus: str, chunks: Sequence[Chunk]) -> None:
        """Pass chunks on."""
        self._sink.raw(bus, chunks)

    def pace(self, bus: str, told: Pace) -> None:
        """Pass on what a bus is timed by."""
        if isinstance(self._sink, Paced):
            self._sink.pace(bus, told)

    def narrow(self, told: Mapping[str, Any]) -> None:
        """Pass on what of it is written."""
        if isinstance(self._sink, Narrowed):
            self._sink.narrow(told)

    def call(self, names: ServoNames) -> None:
        """Pass on what servos are called."""
        if isinstance(self._sink, Calling):
            self._sink.call(names)

    def write(self, bus: str, protocol: BusProtocol, batch: Batch) -> None:
        """Pass a batch on while somebody listens."""
        self.write_together(bus, [(protocol, batch)])

    def write_together(self, bus: str, parts: Sequence[Part]) -> None:
        """Pass on what several protocols said in one pass."""
        with self._listening():
            if self._open:
                written(self._sink, bus=bus, parts=parts)
                self._stream.flush()

    def passed(self, until_ns: int | None, open_buses: Collection[str]) -> None:
        """Pass on that a pass is over."""
        with self._listening():
            if self._open:
                over(self._sink, until_ns=until_ns, open_buses=open_buses)
                self._stream.flush()

    def pieces(self) -> PieceMaker:
        """Return how a part of a capture is written elsewhere."""
        return pieces_of(self._sink)

    def join(self, piece: Path, told: WrittenElsewhere) -> None:
        """Pass on what was written elsewhere."""
        with self._listening():
            if self._open:
                join(self._sink, piece, told)
                self._stream.flush()

    def close(self) -> None:
        """End the output while somebody listens."""
        with self._listening():
            if self._open:
                self._sink.close()

    @contextlib.contextmanager
    def _listening(self) -> Iterator[None]:
        try:
            yield
        except BrokenPipeError:
            self._open = False
            silence(self._stream)
            if self._alone:
                raise
        except OSError as error:
            self._open = False
            silence(self._stream)
            why = error.strerror or error
            raise OutputError(f"standard output: cannot be written ({why})") from None
