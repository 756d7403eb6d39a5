"""Several protocols on one wire, decoded side by side: ``mightyzap+dynamixel1``.

Each protocol has a decoder of its own, with its own silences, pairs, models and rules, so that a
stream of one of them alone is decoded as if nobody else were named. They take each pass in step:

    block      the same bytes for all
    divide     each byte is claimed once (``dividing.py`` has the rule)
    meet       each describes and pairs its own frames, as if the others' were not there
    cut        one for all: where nothing is open in any of them
    tell       a batch each; bytes that nobody claims stand in one of them

Whose are the bytes that nobody claims? They are explained by who makes most of them: damaged and
cut frames count, noise does not. Where that tells nothing they belong to who spoke last. Who has
not spoken yet is not asked, unless nobody has.
"""

from __future__ import annotations

from dataclasses import replace
from typing import TYPE_CHECKING, NamedTuple, TypedDict, Unpack

import numpy as np

from sniffer.anomalies import WireRules
from sniffer.decoding.decoder import Decoder
from sniffer.decoding.detect import Scores
from sniffer.decoding.dividing import divide
from sniffer.decoding.holes import holes_of, mark_tail
from sniffer.decoding.names import joined
from sniffer.decoding.pairing import CHAIN
from sniffer.decoding.state import DecoderState
from sniffer.ground.distinct import numbers
from sniffer.ground.framing import Block
from sniffer.ground.limits import chunks_of
from sniffer.ground.memory import Remembering
from sniffer.ground.model import GAP_MAX, I64, Anomaly, Batch, Chunk, Frames, Gap, SnifferError
from sniffer.ground.wording import offered

if TYPE_CHECKING:
    from collections.abc import Iterable, Mapping, Sequence

    from sniffer.anomalies.alarms import Alarm
    from sniffer.decoding.met import Met
    from sniffer.decoding.sink import Part
    from sniffer.ground.runs import ChunkRun
    from sniffer.protocols.base import BusProtocol


def leading(protocols: Sequence[BusProtocol], chunks: Iterable[Chunk]) -> BusProtocol:
    """Return which of some protocols explains most of the first chunks: what it tells counts."""
    if len(protocols) == 1:
        return protocols[0]
    shares = Scores(list(chunks), None, protocols).shares
    return max(protocols, key=lambda p: shares.get(p.name, 0.0))


class MixedDecoder(Remembering):
    """Decodes one bus on which several protocols are spoken.

    Its calls are those of ``Decoder``; they return a batch for each of ``protocols``, of the same
    bytes. Every byte is in a frame or a gap of one of them.

    Args:
        protocols: what is spoken; their order does not matter.
        baud: bits per second; the default of the first protocol by name where None.
        models: servo id (None: all) -> model name; each protocol takes those that are its own.
        latency_ns: as for ``Decoder``, like all that follows.
        base: offset of the first byte.
        slowest: the slowest rate that the line may have.
        doubtful: the line may well be as slow as that.
        alarms: each protocol takes those that its servos can meet.
        state: as for ``Decoder``.

    Raises:
        SnifferError: as ``Decoder`` does, and where a model is none of these protocols'.
    """

    LASTING = ("_heard",)
    PASSING = ("_speaker",)
    PARTS = ("_parts", "_wire")

    def __init__(
        self,
        protocols: Sequence[BusProtocol],
        *,
        baud: int | None = None,
        models: Mapping[int | None, str] | None = None,
        latency_ns: int | None = None,
        base: int = 0,
        slowest: int | None = None,
        doubtful: bool = False,
        alarms: Sequence[Alarm] = (),
        state: DecoderState | None = None,
    ) -> None:
        self.protocols = tuple(sorted(protocols, key=lambda p: p.name))
        self.name = joined(self.protocols)
        self.baud = self.protocols[0].baud if baud is None else baud
        each = [{m.model for m in p.models} for p in self.protocols]
        told = models or {}
        for model in told.values():
            if not any(model in known for known in each):
                what = f"{self.name} has no model {str(model)[:40]!r}"
                known = sorted(set().union(*each))
                raise SnifferError(f"{what}: {offered(str(model), known)}")
        self._parts = [
            Decoder(
                protocol,
                baud=self.baud,
                models={servo: model for servo, model in told.items() if model in known},
                latency_ns=latency_ns,
                base=base,
                slowest=slowest,
                doubtful=doubtful,
                alarms=alarms,
                is_alone=False,
            )
            for protocol, known in zip(self.protocols, each, strict=True)
        ]
        self._wire = WireRules()
        self._speaker = 0  # who spoke last
        self._heard = np.zeros(len(self._parts), bool)
        if state is not None:
            self.remember(state.of(self.name))

    def state(self) -> DecoderState:
        """Return all that is known here, as ``Decoder.state`` does."""
        return DecoderState(self.name, self.memory(), self.observable(self.position))

    def feed(self, *chunks: Chunk | ChunkRun | bytes | bytearray | memoryview) -> tuple[Batch, ...]:
        """Decode chunks, as ``Decoder.feed`` does."""
        return self._decode(final=False) if self.take(chunks_of(chunks)) else self._nothing()

    def take(self, told: Sequence[Chunk]) -> bool:
        """Take chunks in, as ``Decoder.take`` does."""
        some = [part.take(told) for part in self._parts]  # all of them take them
        return some[0]

    def idle(self, now_ns: int) -> tuple[Batch, ...]:
        """Declare what the clock says: nothing is waited for once all are silent."""
        silent = [part.silent_at(now_ns) for part in self._parts]
        if not all(silent):
            return self._nothing()
        batches = self._decode(final=True)
        for part in self._parts:
            part.bar()
        return batches

    def close(self) -> tuple[Batch, ...]:
        """Decode what is left, as ``Decoder.close`` does."""
        batches = self._decode(final=True, ends=True) if self.pending else self._nothing()
        ended = [part.finish(b) for part, b in zip(self._parts, batches, strict=True)]
        if found := self._wire.finish():
            last = ended[self._speaker]
            ended[self._speaker] = replace(last, anomalies=(*last.anomalies, *found))
        return tuple(ended)

    @property
    def pending(self) -> int:
        """Bytes held back because their fate is not decided."""
        return self._parts[0].pending

    @property
    def heard_ns(self) -> int:
        """The latest stamp; 0 where there is none."""
        return self._parts[0].heard_ns

    @property
    def position(self) -> int:
        """Offset in the stream up to which everything is decided."""
        return self._parts[0].position

    def models(self) -> dict[str, Mapping[int, tuple[str, int]]]:
        """Return, by protocol, model and grounds of the servos whose model is not just assumed."""
        return {name: told for part in self._parts for name, told in part.models().items()}

    def _nothing(self) -> tuple[Batch, ...]:
        return self._judged([replace(part.nothing(), is_shared=True) for part in self._parts])

    def _decode(self, *, final: bool, ends: bool = False) -> tuple[Batch, ...]:
        blocks = [part.block(final=final) for part in self._parts]
        spans, decided, _ = divide(self.protocols, blocks)
        mets = []
        for k, (part, block) in enumerate(zip(self._parts, blocks, strict=True)):
            others = np.concatenate([s.start for i, s in enumerate(spans) if i != k])
            mets.append(part.meet(replace(block, foreign=np.sort(others)), spans[k], decided))
        cut = decided if final else self._cut(mets)
        gaps = self._gaps(mets, cut)
        open_from: list[int | None] = [None for _ in mets]
        if ends:
            more = divide(self.protocols, [Block(b.data, b.barriers, False) for b in blocks])
            for k, part in enumerate(self._parts):
                open_from[k] = more.each[k] if part.is_cut else None
        each = zip(self._parts, mets, gaps, open_from, strict=True)
        return self._judged([p.tell(m, cut, told, open_from=o) for p, m, told, o in each])

    def _cut(self, mets: Sequence[Met]) -> int:
        """Return where this pass ends: nothing before it is open, in none of the protocols."""
        both = list(zip(self._parts, mets, strict=True))
        found = [part.open_from(met) for part, met in both]
        first = min((at for at in found if at is not None), default=None)
        if first is None:
            return self._edge(mets)
        # An exchange of one may lead across that place, and before that one of another.
        cut, before = first, -1
        while cut != before and first - cut <= CHAIN:
            before = cut
            cut = min(part.clear_at(met, before) for part, met in both)
        return cut if first - cut <= CHAIN else first

    def _edge(self, mets: Sequence[Met]) -> int:
        """Return the last place where an explanation of bytes that nobody claims may end."""
        decided = mets[0].decided
        rows = _Wire.of([met.frames for met in mets])
        last, speaker = 0, self._speaker
        if len(rows.end):
            last, speaker = int(rows.end[-1]), int(rows.owner[-1])
        silences = mets[speaker].block.barriers
        edge = max(last, int(silences[silences <= decided].max(initial=0)))
        return edge + (decided - edge) // GAP_MAX * GAP_MAX

    def _gaps(self, mets: Sequence[Met], cut: int) -> list[tuple[Gap, ...]]:
        """Explain the bytes before a cut that nobody claims, each by one of the protocols."""
        rows = _Wire.of([met.frames for met in mets], cut)
        edges_from = np.concatenate([[0], rows.end])
        edges_to = np.concatenate([rows.start, [cut]])
        speakers = np.concatenate([[self._speaker], rows.owner])
        since = np.where(self._heard, 0, len(edges_to))  # from which of these places on
        for k in numbers(rows.owner).tolist():
            since[k] = min(int(since[k]), 1 + int(np.argmax(rows.owner == k)))
        out: list[list[Gap]] = [[] for _ in mets]
        for hole in np.flatnonzero(edges_to > edges_from).tolist():
            asked = np.flatnonzero(since <= hole)
            asked = asked[np.argsort(asked != speakers[hole], kind="stable")]
            place = int(edges_from[hole]), int(edges_to[hole])
            self._explain(mets, place, asked.tolist() or [*range(len(mets))], out)
        self._speaker = int(speakers[-1])
        self._heard[rows.owner] = True
        return [part.dated(g) if g else () for part, g in zip(self._parts, out, strict=True)]

    def _explain(
        self,
        mets: Sequence[Met],
        place: tuple[int, int],
        asked: Sequence[int],
        out: list[list[Gap]],
    ) -> None:
        """Add the explanation of some bytes to who makes most of them; the first wins a tie."""
        block = mets[asked[0]].block
        runs = holes_of(np.array([place[0]]), np.array([place[1]]), block)
        for s, e, closed in zip(*(column.tolist() for column in runs), strict=True):
            run, is_first = block.data[s:e].tobytes(), s == place[0]
            told = [
                self.protocols[k].explain(
                    run, s, awaited=is_first and self._parts[k].awaits(mets[k], s)
                )
                for k in asked
            ]
            best = max(range(len(asked)), key=lambda i: _explained(told[i]))
            if closed:
                mark_tail(told[best])
            out[asked[best]] += told[best]

    def _judged(self, batches: list[Batch]) -> tuple[Batch, ...]:
        """Add what is wrong with the wire, where the one speaks whose bytes show it."""
        rows = _Wire.of([b.frames for b in batches])
        frames = Frames.concat([b.frames for b in batches]).take(rows.order)
        found = self._wire.judge(replace(batches[0], frames=frames, anomalies=()))
        if found:
            each: list[list[Anomaly]] = [[] for _ in batches]
            for a in found:
                row = int(np.searchsorted(rows.start, a.known_at - batches[0].base, "right")) - 1
                each[int(rows.owner[row]) if row >= 0 else self._speaker].append(a)
            batches = [
                replace(b, anomalies=tuple(sorted([*b.anomalies, *more], key=lambda a: a.known_at)))
                if more
                else b
                for b, more in zip(batches, each, strict=True)
            ]
        return tuple(batches)


class How(TypedDict, total=False):
    """How a bus is decoded; see ``Decoder``."""

    baud: int | None
    models: Mapping[int | None, str] | None
    latency_ns: int | None
    base: int
    slowest: int | None
    doubtful: bool
    alarms: Sequence[Alarm]
    state: DecoderState | None


def decoder_of(protocols: Sequence[BusProtocol], **how: Unpack[How]) -> Decoder | MixedDecoder:
    """Return what decodes a bus on which one or several protocols are spoken."""
    return Decoder(protocols[0], **how) if len(protocols) == 1 else MixedDecoder(protocols, **how)


def parts_of(decoder: Decoder | MixedDecoder, told: Batch | tuple[Batch, ...]) -> Sequence[Part]:
    """Return what a pass decided, by protocol."""
    return list(zip(decoder.protocols, told if isinstance(told, tuple) else (told,), strict=True))


class _Wire(NamedTuple):
    """Whose frame is where on the wire, in order."""

    start: I64
    end: I64
    owner: I64
    order: I64

    @classmethod
    def of(cls, each: Sequence[Frames], cut: int | None = None) -> _Wire:
        """Return the frames of all, those that begin before a cut."""
        start = np.concatenate([f.start for f in each])
        owner = np.repeat(np.arange(len(each)), [len(f) for f in each])
        order = np.argsort(start, kind="stable")
        order = order if cut is None else order[start[order] < cut]
        end = np.concatenate([f.end for f in each])
        return cls(start[order], end[order], owner[order], order)


def _explained(gaps: Sequence[Gap]) -> int:
    """Return of how many bytes it is told what they are."""
    return sum(g.length for g in gaps if g.reason != "noise")
