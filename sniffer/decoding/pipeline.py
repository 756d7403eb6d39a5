"""Source -> decoders -> sinks: one decoder a bus, its protocol named or found from the bytes."""

from __future__ import annotations

import contextlib
import functools
from dataclasses import replace
from typing import TYPE_CHECKING, Final

from sniffer.decoding.detect import (
    ENOUGH,
    SURE,
    Detection,
    Mistake,
    UndecidedError,
    detect,
    latest,
    told_of,
)
from sniffer.decoding.first import FirstBytes
from sniffer.decoding.mixed import decoder_of, leading, parts_of
from sniffer.decoding.options import AUTO, Options
from sniffer.decoding.pacing import Pace, pace
from sniffer.decoding.rates import Late
from sniffer.decoding.sink import Paced, Tuned, act, closed, introduced, over, taken, written
from sniffer.decoding.summary import Summary
from sniffer.decoding.unmet import unmet
from sniffer.ground.model import Chunk, Clock, Mark, MarkKind, OutputError
from sniffer.ground.runs import ChunkRun, by_bus
from sniffer.ground.timing import LATENCY_NS

if TYPE_CHECKING:
    from collections.abc import Callable, Iterable, Mapping, Sequence

    from sniffer.decoding.decoder import Decoder
    from sniffer.decoding.mixed import MixedDecoder
    from sniffer.decoding.rates import Rate
    from sniffer.decoding.sink import Part, Sink
    from sniffer.decoding.slicing import Narrowing
    from sniffer.protocols.base import BusProtocol

FIRST_LOOK: Final = 512
"""Bytes of a slow input after which its protocol is looked for the first time."""

UNDECIDED_MOST: Final = 1 << 20
"""Bytes of a live bus that are kept for decoding while its protocol is not known."""

AFTER_NS: Final = LATENCY_NS[Clock.READ]
"""By how much the stamps of one bus may lag behind those of another."""


class Pipeline:
    """Takes groups of chunks, decodes them and hands records to the sinks.

    Args:
        options: how to decode.
        sinks: what takes the records.
        on_detection: is told which protocol a bus was found to speak.
        on_pace: is told by what a bus is timed, before its first record.
        ahead: the first chunks of an input that is fed piece by piece: what they tell about rate
            and latency counts, not how they are grouped.
        live: more bytes may come for ever: a bus whose protocol cannot be told yet is waited for.
        starts: offset of each bus's first byte, where that is not 0.

    Raises:
        UndecidedError: the protocol is to be found from the bytes and cannot be told.
    """

    def __init__(
        self,
        options: Options,
        sinks: Sequence[Sink],
        *,
        on_detection: Callable[[str, Detection], None] = lambda bus, found: None,
        on_pace: Callable[[str, Pace], None] = lambda bus, told: None,
        ahead: Iterable[Chunk] = (),
        live: bool = False,
        starts: Mapping[str, int] | None = None,
    ) -> None:
        if options.protocol != AUTO:
            options.all_spoken(options.protocol)
        self.summary = Summary(options.called)
        self._options = options
        self._sinks = introduced(sinks, options.called, options.alarms)
        self.narrowing: Narrowing | None = None
        """What goes to summary and sinks, and which rows are shown; None: everything."""
        self._failure: OutputError | None = None
        self._on_detection = on_detection
        self._on_pace = on_pace
        self._ahead: dict[str, list[Chunk]] = {}
        for chunk in ahead:
            self._ahead.setdefault(chunk.bus, []).append(chunk)
        self._live = live
        self.paces: dict[str, Pace] = {}
        """By what each bus is timed, once it is decoded."""
        self._decoders: dict[str, Decoder | MixedDecoder] = {}
        self._found: dict[str, Detection] = {}
        self._waiting: dict[str, list[Chunk]] = {}
        self._look_at: dict[str, int] = {}
        self.first = FirstBytes()
        self._begin: dict[str, int] = dict(starts or {})
        self._late = {bus: Late(size) for bus, size in options.begins.items() if size}
        self._tuned: dict[str, int] = {}
        self._torn: set[str] = set()
        """Buses of which something was left out: what was known of their servos is forgotten."""

    def add(self, sink: Sink) -> None:
        """Take another sink; it gets what comes from now on."""
        self._sinks += introduced([sink], self._options.called, self._options.alarms)

    def feed(self, group: Iterable[Chunk]) -> None:
        """Decode a group; chunks of several buses may be mixed."""
        for bus, chunks in by_bus(group).items():
            self.record(bus, chunks)
            self.decode(bus, chunks)
        heard_ns = max((d.heard_ns for d in self._decoders.values()), default=0)
        self._pass(heard_ns - AFTER_NS if heard_ns > 0 else None)

    def record(self, bus: str, chunks: Sequence[Chunk]) -> None:
        """Hand chunks to the sinks as they came, before they are decoded."""
        self._begin.setdefault(bus, 0)
        if self.narrowing is not None:
            self.narrowing.hear(bus, chunks)
        self._each(functools.partial(taken, bus=bus, chunks=chunks))

    def tune(self, bus: str, rate: Rate) -> None:
        """Learn at which rate a bus is listened to, before anything of it is decoded.

        What is decoded next begins where that rate holds. A latency that was stated stays.
        """
        o = self._options
        if o.latency_ns is not None:
            rate = rate._replace(latency_ns=o.latency_ns)
        self._options = replace(
            o,
            bauds={**o.bauds, bus: rate.baud},
            latencies={**o.latencies, bus: rate.latency_ns},
        )
        self._begin[bus] = rate.since
        if rate.since:
            self._tuned[bus] = rate.baud
        for sink in self._sinks:
            if isinstance(sink, Tuned):
                sink.tuned(bus, rate)

    def decode(self, bus: str, chunks: Sequence[Chunk]) -> None:
        """Decode chunks of one bus that have been recorded."""
        if bus in self._late:
            chunks = self._late[bus].of(chunks)
            if not chunks:
                return
            self._begin[bus] = self._begin.get(bus, 0) + self._late.pop(bus).size
            self._tuned[bus] = self._options.bauds[bus]
        if bus in self._tuned and chunks:
            mark = Mark(MarkKind.TUNED, 0, count=self._tuned.pop(bus))
            # Where the first frame begins with the rate, the tap's own mark stands there, too.
            marks = (m for m in chunks[0].marks if m.kind != MarkKind.TUNED)
            chunks = [replace(chunks[0], marks=(mark, *marks)), *chunks[1:]]
        if bus in self._decoders:
            self._decode(bus, chunks)
            return
        waiting = self._waiting.setdefault(bus, [])
        waiting += chunks
        if self._named(bus) != AUTO or self._enough(bus, waiting):
            self._start(bus)

    def idle(self, now_ns: int) -> None:
        """Tell all decoders how late it is.

        Where one ends what was open, that is recorded: bytes that an adapter held for longer than
        it should may say later that there was no pause, and decoding again must not believe them.
        """
        for bus, decoder in self._decoders.items():
            if not decoder.pending:
                continue
            parts = parts_of(decoder, decoder.idle(now_ns))
            if parts[0][1].data:
                silent = Chunk(b"", now_ns, Clock.READ, bus, marks=(Mark(MarkKind.SILENT, 0),))
                self.record(bus, [silent])
            self._deliver(bus, parts)
        self._pass(now_ns)

    def skip(self, bus: str, count: int, chunk: Chunk) -> None:
        """Leave out ``count`` bytes that nobody had time to decode, and go on with ``chunk``.

        What was begun before them is ended there.
        """
        decoder = self._decoders.get(bus)
        mark = Mark(MarkKind.SKIPPED, 0, count=count)
        if decoder is not None:
            torn = replace(chunk, data=b"", marks=(mark,))
            self._deliver(bus, parts_of(decoder, decoder.feed(torn)))
            self._deliver(bus, parts_of(decoder, decoder.close()))
            self._begin[bus] = decoder.position + count
            self._decoders[bus] = self._decoder(bus, decoder.protocols)
            self._torn.add(bus)
        else:
            count += sum(len(c.data) for c in self._waiting.pop(bus, ()))
            self._begin[bus] = self._begin.get(bus, 0) + count
            chunk = replace(chunk, marks=(mark._replace(count=count), *chunk.marks))
        self.decode(bus, [chunk])

    def decided(self) -> dict[str, int]:
        """Return the offset up to which each bus is decoded: what waits for its protocol is not."""
        return self._begin | {bus: decoder.position for bus, decoder in self._decoders.items()}

    def speaks(self, bus: str) -> str | None:
        """Return the protocol of a bus (``a+b``: two of them), None while it is not known."""
        decoder = self._decoders.get(bus)
        return None if decoder is None else decoder.name

    def protocol_of(self, bus: str) -> BusProtocol | None:
        """Return that protocol itself, None where there are two."""
        decoder = self._decoders.get(bus)
        several = decoder is None or len(decoder.protocols) > 1
        return None if several or decoder is None else decoder.protocols[0]

    def baud_of(self, bus: str) -> int | None:
        """Return the rate by which a bus is decoded, None while its protocol is not known."""
        decoder = self._decoders.get(bus)
        return None if decoder is None else decoder.baud

    def has(self, sink: Sink) -> bool:
        """Tell whether a sink still takes records: one that fails is given up."""
        return any(s is sink for s in self._sinks)

    @property
    def failure(self) -> OutputError | None:
        """The first failure of a sink, if there was one."""
        return self._failure

    def close(self) -> None:
        """Decode what waits and finish the decoders; the sinks are closed by ``finish``.

        A bus whose protocol cannot be told does not keep the others from being decoded.
        """
        undecided: dict[str, UndecidedError] = {}
        for bus in list(self._waiting):
            if not any(chunk.data for chunk in self._waiting[bus]):
                continue  # a bus on which nothing was said
            try:
                self._start(bus)
            except UndecidedError as error:
                undecided[bus] = error
        # Where one bus goes on, the end of another is a silence, not a cut.
        self.idle(max((d.heard_ns for d in self._decoders.values()), default=0) - AFTER_NS)
        for bus, decoder in self._decoders.items():
            self._deliver(bus, parts_of(decoder, decoder.close()))
        for bus, parts in self.narrowing.rest() if self.narrowing is not None else ():
            self._write(bus, parts)
        for mistake in self.mistaken():
            self.summary.buses[mistake.bus].looks_like = mistake.found.protocol
        for bus, decoder in self._decoders.items():
            if bus in self.summary.buses and bus not in self._torn:
                self.summary.know(bus, decoder.models())
        if undecided:
            raise told_of(undecided, others=bool(self._decoders))

    def mistaken(self) -> list[Mistake]:
        """Return the buses whose named protocol explains little, though another one does."""
        return self.first.mistaken(self.summary, self._stated)

    def unmet(self, *, is_over: bool = False) -> list[str]:
        """Tell of rules that no servo of any bus can meet; ``is_over``: no other one will come."""
        return unmet(self._options, self._decoders, self.summary if is_over else None)

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
            act(closed, sink)
        except OutputError as error:
            self._failure = self._failure or error

    def _each(self, what: Callable[[Sink], None]) -> None:
        """Do something with every sink; one that fails is given up, the others go on."""
        for sink in list(self._sinks):
            try:
                act(what, sink)
            except OutputError as error:
                self._sinks.remove(sink)
                self._failure = self._failure or error
                with contextlib.suppress(OutputError):
                    act(closed, sink)
                if not self._sinks:
                    raise

    def _enough(self, bus: str, waiting: list[Chunk]) -> bool:
        """Tell whether these bytes say which protocol it is; asked when they have doubled."""
        size = sum(len(c.data) for c in waiting)
        if size >= ENOUGH and not self._live:
            return True
        if size < self._look_at.setdefault(bus, FIRST_LOOK):
            return False
        self._look_at[bus] = 2 * size
        try:
            found = detect(latest(waiting, ENOUGH), self._stated(bus))
        except UndecidedError:
            if size > UNDECIDED_MOST:
                self._forget(bus, waiting)
            return False
        if found.certainty != SURE and size < ENOUGH:
            return False
        self._found[bus] = found
        return True

    def _forget(self, bus: str, waiting: list[Chunk]) -> None:
        """Keep the latest bytes only of a bus that says nothing we know."""
        kept = latest(waiting, ENOUGH)
        left_out = sum(len(c.data) for c in waiting) - sum(len(c.data) for c in kept)
        before = self._begin.get(bus, 0)
        self._begin[bus] = before + left_out
        # the mark of an earlier time stood on a chunk that is left out now
        mark = Mark(MarkKind.SKIPPED, 0, count=self._begin[bus])
        marks = tuple(m for m in kept[0].marks if m.kind != MarkKind.SKIPPED)
        waiting[:] = [replace(kept[0], marks=(mark, *marks)), *kept[1:]]
        self._look_at[bus] = 2 * ENOUGH

    def _named(self, bus: str) -> str | BusProtocol:
        return self._options.protocols.get(bus, self._options.protocol)

    def _start(self, bus: str) -> None:
        chunks = self._waiting[bus]
        named = self._named(bus)
        if named == AUTO:
            found = self._found.pop(bus, None)
            if found is None:
                found = detect(latest(chunks, ENOUGH) if self._live else chunks, self._stated(bus))
            self._on_detection(bus, found)
            named = found.protocol
        else:
            self.first.want(bus)
        o = self._options
        protocols, first = o.all_spoken(named), self._ahead.pop(bus, chunks)
        told = self.paces[bus] = self.summary.paces[bus] = pace(
            leading(protocols, first),
            first,
            baud=self._stated(bus),
            latency_ns=o.latencies.get(bus) if o.latency_ns is None else o.latency_ns,
        )
        self._on_pace(bus, told)
        for sink in self._sinks:
            if isinstance(sink, Paced):
                sink.pace(bus, told)
        self._decoders[bus] = self._decoder(bus, protocols)
        self._decode(bus, self._waiting.pop(bus))

    def _stated(self, bus: str) -> int | None:
        """Return the rate of a bus that somebody stated; what is assumed is none."""
        return self._options.bauds.get(bus, self._options.baud)

    def _decoder(self, bus: str, protocols: Sequence[BusProtocol]) -> Decoder | MixedDecoder:
        models, told = self._options.models, self.paces[bus]
        if self._live:  # they were named for all buses, which may speak different protocols
            known = {m.model for p in protocols for m in p.models}
            models = {servo: model for servo, model in models.items() if model in known}
        return decoder_of(
            protocols,
            baud=told.baud,
            models=models,
            latency_ns=told.latency_ns,
            slowest=told.slowest,
            doubtful=told.doubtful,
            alarms=self._options.alarms_on(bus),
            base=self._begin.get(bus, 0),
        )

    def _pass(self, until_ns: int | None) -> None:
        """Tell the sinks that a pass is over, and what of it is not decided."""
        waits = {bus for bus, decoder in self._decoders.items() if decoder.pending}
        waits |= {bus for bus, chunks in self._waiting.items() if any(c.data for c in chunks)}
        waits |= self.narrowing.open_buses if self.narrowing is not None else set()
        self._each(functools.partial(over, until_ns=until_ns, open_buses=waits))

    def _decode(self, bus: str, chunks: Sequence[Chunk]) -> None:
        self.first.keep(bus, chunks)
        decoder, runs = self._decoders[bus], [chunks] if isinstance(chunks, ChunkRun) else chunks
        self._deliver(bus, parts_of(decoder, decoder.feed(*runs)))

    def _deliver(self, bus: str, parts: Sequence[Part]) -> None:
        if not any(b.data or b.remarks or b.anomalies for _, b in parts):
            return
        self.summary.begin(parts)
        for some in [parts] if self.narrowing is None else self.narrowing.passes(bus, parts):
            self._write(bus, some)

    def _write(self, bus: str, parts: Sequence[Part]) -> None:
        for protocol, batch in parts:
            self.summary.add(bus, protocol, batch)
        self._each(functools.partial(written, bus=bus, parts=parts))


__all__ = ["AFTER_NS", "AUTO", "FIRST_LOOK", "UNDECIDED_MOST", "Options", "Pipeline"]
