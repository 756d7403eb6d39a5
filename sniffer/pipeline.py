"""Source -> decoders -> sinks: one decoder a bus, its protocol named or found from the bytes."""

from __future__ import annotations

import contextlib
import functools
from dataclasses import dataclass, field, replace
from typing import TYPE_CHECKING, Final

from sniffer.decoder import Decoder
from sniffer.detect import ENOUGH, SURE, Detection, UndecidedError, detect
from sniffer.model import Batch, Chunk, OutputError
from sniffer.protocols import protocol_named
from sniffer.summary import Summary

if TYPE_CHECKING:
    from collections.abc import Callable, Iterable, Mapping, Sequence

    from sniffer.sinks.base import Sink

AUTO: Final = "auto"

FIRST_LOOK: Final = 512
"""Bytes of a slow input after which its protocol is looked for the first time."""


@dataclass(frozen=True, slots=True)
class Options:
    """How to decode: ``protocols`` and ``bauds`` by bus, the others for all buses."""

    protocol: str = AUTO
    protocols: Mapping[str, str] = field(default_factory=dict)
    baud: int | None = None
    bauds: Mapping[str, int] = field(default_factory=dict)
    models: Mapping[int | None, str] = field(default_factory=dict)
    latency_ns: int | None = None

    def with_facts(self, facts: Mapping[str, str]) -> Options:
        """Return the options with what a recording knows about itself, where nobody said more."""
        told = self
        if self.protocol == AUTO:
            known = {k.partition(".")[2]: v for k, v in facts.items() if k.startswith("protocol.")}
            told = replace(told, protocols={**known, **self.protocols})
        if self.baud is None:
            bauds = {k: v for k, v in facts.items() if k.startswith("baud.") and v.isdecimal()}
            told = replace(
                told,
                bauds={**{k.partition(".")[2]: int(v) for k, v in bauds.items()}, **self.bauds},
            )
        if not self.models:
            models: dict[int | None, str] = {}
            for key, model in facts.items():
                name, _, servo = key.partition(".")
                if name == "model" and (not servo or servo.isdecimal()):
                    models[int(servo) if servo else None] = model
            told = replace(told, models=models)
        return told


class Pipeline:
    """Takes groups of chunks, decodes them and hands records to the sinks.

    Raises:
        UndecidedError: the protocol is to be found from the bytes and cannot be told.
    """

    def __init__(
        self,
        options: Options,
        sinks: Sequence[Sink],
        *,
        on_detection: Callable[[str, Detection], None] = lambda bus, found: None,
    ) -> None:
        if options.protocol != AUTO:
            protocol_named(options.protocol)
        self.summary = Summary()
        self._options = options
        self._sinks = list(sinks)
        self._failure: OutputError | None = None
        self._on_detection = on_detection
        self._decoders: dict[str, Decoder] = {}
        self._waiting: dict[str, list[Chunk]] = {}
        self._look_at: dict[str, int] = {}
        self._first: dict[str, list[Chunk]] = {}

    def feed(self, group: Iterable[Chunk]) -> None:
        """Decode a group; chunks of several buses may be mixed."""
        by_bus: dict[str, list[Chunk]] = {}
        for chunk in group:
            by_bus.setdefault(chunk.bus, []).append(chunk)
        for bus, chunks in by_bus.items():
            self._each(functools.partial(_raw, bus=bus, chunks=chunks))
            if bus in self._decoders:
                self._decode(bus, chunks)
                continue
            waiting = self._waiting.setdefault(bus, [])
            waiting += chunks
            if self._named(bus) != AUTO or self._enough(bus, waiting):
                self._start(bus)

    def close(self) -> None:
        """Decode what waits and finish the decoders; the sinks are closed by ``finish``.

        A bus whose protocol cannot be told does not keep the others from being decoded.
        """
        undecided: UndecidedError | None = None
        for bus in list(self._waiting):
            try:
                self._start(bus)
            except UndecidedError as error:
                undecided = undecided or error
        for bus, decoder in self._decoders.items():
            self._deliver(bus, decoder, decoder.close())
        if undecided is not None:
            raise undecided

    def mistaken(self) -> list[tuple[str, Detection]]:
        """Return the buses whose named protocol has no frame there, though another one has."""
        out = []
        for bus, chunks in self._first.items():
            totals = self.summary.buses.get(bus)
            if totals is None or totals.bytes_in_frames:
                continue
            with contextlib.suppress(UndecidedError):
                out.append((bus, detect(chunks)))
        return out

    def finish(self) -> None:
        """Close every sink, once, also if one of them fails; the first failure is raised."""
        sinks, self._sinks = self._sinks, []
        with contextlib.ExitStack() as stack:
            for sink in reversed(sinks):
                stack.callback(self._finish, sink)
        if self._failure is not None:
            raise self._failure

    def _finish(self, sink: Sink) -> None:
        try:
            sink.close()
        except OutputError as error:
            self._failure = self._failure or error

    def _each(self, act: Callable[[Sink], None]) -> None:
        """Do something with every sink; one that fails is given up, the others go on."""
        for sink in list(self._sinks):
            try:
                act(sink)
            except OutputError as error:
                self._sinks.remove(sink)
                self._failure = self._failure or error
                with contextlib.suppress(OutputError):
                    sink.close()
                if not self._sinks:
                    raise

    def _enough(self, bus: str, waiting: Sequence[Chunk]) -> bool:
        """Tell whether these bytes say which protocol it is; asked when they have doubled."""
        size = sum(len(c.data) for c in waiting)
        if size >= ENOUGH:
            return True
        if size < self._look_at.setdefault(bus, FIRST_LOOK):
            return False
        self._look_at[bus] = 2 * size
        try:
            return detect(waiting).certainty == SURE
        except UndecidedError:
            return False

    def _named(self, bus: str) -> str:
        return self._options.protocols.get(bus, self._options.protocol)

    def _start(self, bus: str) -> None:
        chunks = self._waiting.pop(bus)
        name = self._named(bus)
        if name == AUTO:
            found = detect(chunks)
            self._on_detection(bus, found)
            name = found.protocol
        else:
            self._first[bus] = chunks
        self._decoders[bus] = Decoder(
            name,
            baud=self._options.bauds.get(bus, self._options.baud),
            models=self._options.models,
            latency_ns=self._options.latency_ns,
        )
        self._decode(bus, chunks)

    def _decode(self, bus: str, chunks: Sequence[Chunk]) -> None:
        decoder = self._decoders[bus]
        self._deliver(bus, decoder, decoder.feed(*chunks))

    def _deliver(self, bus: str, decoder: Decoder, batch: Batch) -> None:
        if not batch.data:
            return
        self.summary.add(bus, decoder.protocol, batch)
        self._each(lambda sink: sink.write(bus, decoder.protocol, batch))


def _raw(sink: Sink, *, bus: str, chunks: Sequence[Chunk]) -> None:
    sink.raw(bus, chunks)
