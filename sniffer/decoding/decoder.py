"""The whole core behind three calls: ``feed(*chunks)``, ``idle(now_ns)``, ``close()``.

Bytes and times in, records out; no port, file, clock, thread or log in here. A block is cut where
nothing is open: before the last request that may still be answered, or the last undecided bytes.
The rest is framed again next time. Beside these bytes only the arrival stamps, the mode registers
and what the rules of anomalies remember about each servo are carried over.
"""

from __future__ import annotations

import itertools
from dataclasses import replace
from typing import TYPE_CHECKING, Any

import numpy as np

from sniffer.anomalies import AnomalyRules
from sniffer.decoding.edges import LeftOpen
from sniffer.decoding.expectations import Expectations
from sniffer.decoding.holes import holes_of, mark_tail, surveyed
from sniffer.decoding.met import Met, described, empty_batch
from sniffer.decoding.pairing import Pairing
from sniffer.decoding.state import DecoderState
from sniffer.decoding.values import Scaling
from sniffer.ground.codes import NEVER, REQUEST
from sniffer.ground.framing import Block
from sniffer.ground.gaps import Gaps
from sniffer.ground.limits import (
    BAUDS,
    DURATION_MOST_NS,
    OFFSET_END,
    TIME_END_NS,
    TIME_LEAST_NS,
    chunks_of,
    model_ids,
    whole,
)
from sniffer.ground.memory import Remembering
from sniffer.ground.model import (
    GAP_MAX,
    I64,
    Batch,
    Chunk,
    Frames,
    Gap,
    Samples,
    SnifferError,
    Spans,
    Transactions,
)
from sniffer.ground.remarks import Remarks
from sniffer.ground.runs import ChunkRun, bytes_of, has_marks, with_bytes
from sniffer.ground.timing import Stamps, byte_time_ns
from sniffer.ground.wording import offered
from sniffer.protocols import protocol_named
from sniffer.protocols.explaining import Surveyor

if TYPE_CHECKING:
    from collections.abc import Mapping, Sequence

    from sniffer.anomalies.alarms import Alarm
    from sniffer.decoding.pairing import Paired
    from sniffer.protocols.base import BusProtocol


class Decoder(Remembering):
    """Decodes one bus.

    A pass has four steps: ``block``, ``meet``, where to cut, ``tell``; ``mixed.py`` takes several
    decoders through them side by side.

    Args:
        protocol: a name of ``PROTOCOLS``, a file that defines one, or the protocol itself.
        baud: bits per second; the protocol's default where None.
        models: servo id (None: all) -> model name, for register tables other than the default.
        latency_ns: how long the adapter may hold bytes back; by kind of clock where None.
        base: offset in the stream of the first byte that it will be fed.
        slowest: the slowest rate that the line may have, where nobody stated it: no silence and no
            late answer is told that it would explain. As ``baud`` where None.
        doubtful: the line may well be as slow as that: uncertainties cover it.
        alarms: rules of the user's own that are judged.
        is_alone: no other decoder is on this wire: what concerns the wire is told here.
        state: what another decoder, made with the same arguments, knew: this one goes on there.

    Raises:
        SnifferError: unknown protocol or model, or a number that cannot be; its calls raise it
            too, before they have taken anything.
    """

    PASSING = ("_buffer", "_base", "_now_ns", "_barriers", "_asked_until")
    PARTS = ("_remarks", "_stamps", "_pairing", "_expectations", "_scaling", "_anomaly_rules")

    def __init__(
        self,
        protocol: str | BusProtocol,
        *,
        baud: int | None = None,
        models: Mapping[int | None, str] | None = None,
        latency_ns: int | None = None,
        base: int = 0,
        slowest: int | None = None,
        doubtful: bool = False,
        alarms: Sequence[Alarm] = (),
        is_alone: bool = True,
        state: DecoderState | None = None,
    ) -> None:
        self.protocol = protocol_named(protocol)
        self._surveyor = self.protocol if isinstance(self.protocol, Surveyor) else None
        known = [m.model for m in self.protocol.models]
        models = model_ids(models or {})
        for model in models.values():
            if model not in known:
                what = f"{self.protocol.name} has no model {str(model)[:40]!r}"
                raise SnifferError(f"{what}: {offered(str(model), known)}")
        self.baud = self.protocol.baud if baud is None else whole("baud", baud, *BAUDS)
        if latency_ns is not None:
            latency_ns = whole("latency_ns", latency_ns, 0, DURATION_MOST_NS)
        if slowest is not None:
            slowest = whole("slowest", slowest, BAUDS[0], self.baud)
        base = whole("base", base, 0, OFFSET_END - 1)
        self._buffer = bytearray()
        self._base = base
        self._now_ns = 0
        self._barriers: list[int] = []
        self._remarks = Remarks()
        self._asked_until = -1  # end of the last frame, if it is a request that has an answer
        self._slower_ns = byte_time_ns(slowest or self.baud) - byte_time_ns(self.baud)
        self._stamps = Stamps(
            self.baud,
            self.protocol.tail_ns,
            latency_ns,
            base,
            slowest=slowest or self.baud,
            doubtful=doubtful,
        )
        self._pairing = Pairing(self.protocol)
        self._expectations = Expectations()
        self._scaling = Scaling(self.protocol, models)
        self._anomaly_rules = AnomalyRules(self.protocol, alarms=alarms, is_alone=is_alone)
        if state is not None:
            self.remember(state.of(self.name))

    def state(self) -> DecoderState:
        """Return all that is known here: ``Decoder(..., state=...)`` goes on with it, anywhere."""
        return DecoderState(self.name, self.memory(), self.observable(self._base))

    def matters(self, at: int) -> Mapping[str, Any]:
        """Return the bytes that wait, and what stands right before or in them."""
        return {
            "at": at,
            "buffer": self._buffer,
            "now_ns": self._now_ns,
            "barriers": sorted({b for b in self._barriers if b >= at}),
            "asked": self._asked_until == at,
        }

    def feed(self, *chunks: Chunk | ChunkRun | bytes | bytearray | memoryview) -> Batch:
        """Decode chunks, each with its own time, in one pass: group them, a pass costs ~500 us.

        Plain bytes are a chunk without a time. A run of chunks is handed in alone.
        """
        return self._decode(final=False) if self.take(chunks_of(chunks)) else self.nothing()

    def take(self, told: Sequence[Chunk]) -> bool:
        """Take chunks in without decoding them; tell whether there were any bytes."""
        timed = with_bytes(told)
        if timed:
            self._now_ns = 0  # how late it was before these bytes says nothing of what follows them
        if has_marks(told):
            behind = itertools.takewhile(lambda k: not k.data, reversed(told))
            self._now_ns = max(self._now_ns, *(k.t_ns or 0 for k in behind), 0)
            torn = self._remarks.add(told, self.position + self.pending, self._stamps.last_ns)
            self._barriers += (at for at in torn if at > self._base)
        if timed:
            self._barriers += self._stamps.add(timed).tolist()
            self._buffer += bytes_of(timed)
        return bool(timed)

    def idle(self, now_ns: int) -> Batch:
        """Declare what the clock says: after the tail time, what waits will not be completed."""
        if not self.silent_at(now_ns):
            return self.nothing()
        batch = self._decode(final=True)
        self.bar()
        return batch

    def silent_at(self, now_ns: int) -> bool:
        """Take the time; tell whether what waits for bytes has waited for the tail time."""
        now_ns = whole("now_ns", now_ns, TIME_LEAST_NS, TIME_END_NS - 1)
        self._now_ns = max(self._now_ns, now_ns)
        return bool(self._buffer) and self._stamps.silent_since(now_ns)

    def bar(self) -> None:
        """Let nothing cross this place, also if the next bytes say that there was no pause."""
        self._barriers.append(self._base)

    def close(self) -> Batch:
        """Decode what is left; the decoder may be fed again afterwards.

        What nobody knows to have been silent behind the last byte is cut there, not over.
        """
        return self.finish(self._decode(final=True, is_cut=self.is_cut))

    @property
    def name(self) -> str:
        """The protocol's name."""
        return self.protocol.name

    @property
    def protocols(self) -> tuple[BusProtocol, ...]:
        """The protocol: one, unlike those of a mixed decoder."""
        return (self.protocol,)

    @property
    def is_cut(self) -> bool:
        """Whether a capture that ends here is cut: nobody knows of a silence behind it."""
        return not self._stamps.silent_since(self._now_ns)

    def finish(self, batch: Batch) -> Batch:
        """Return the last batch with what the rules of anomalies held back until the end."""
        return self._anomaly_rules.finish(batch)

    @property
    def pending(self) -> int:
        """Bytes held back because their fate is not decided."""
        return len(self._buffer)

    @property
    def heard_ns(self) -> int:
        """The latest stamp; 0 where there is none."""
        return self._stamps.last_ns

    @property
    def position(self) -> int:
        """Offset in the stream up to which everything is decided."""
        return self._base

    def models(self) -> dict[str, Mapping[int, tuple[str, int]]]:
        """Return, by protocol, model and grounds of the servos whose model is not just assumed."""
        return {self.protocol.name: self._scaling.models()}

    def nothing(self) -> Batch:
        """Return no bytes, with what has been remarked between those before and those to come."""
        batch = empty_batch(self._base, self._stamps.clock, self._remarks.until(self._base))
        return self._anomaly_rules.judge(batch) if batch.remarks else batch

    def _decode(self, *, final: bool, is_cut: bool = False) -> Batch:
        if not self._buffer:
            return self.nothing()
        block = self.block(final=final)
        met = self.meet(block, *self.protocol.frame(block))
        cut, kept = self._cut(met.frames, met.partner, met.decided, block)
        gaps = self._gaps(bytes(self._buffer), met.frames.take(slice(0, kept)), cut, block)
        open_from = None
        if is_cut:
            _, open_from = self.protocol.frame(Block(block.data, block.barriers, False))
        return self.tell(met, cut, gaps, open_from=open_from)

    def block(self, *, final: bool) -> Block:
        """Return the bytes that wait, with the silences in them."""
        data, base = bytes(self._buffer), self._base
        barriers = sorted({b - base for b in self._barriers if 0 < b - base < len(data)})
        return Block(np.frombuffer(data, np.uint8), np.array(barriers, np.int64), final)

    def meet(self, block: Block, spans: Spans, decided: int) -> Met:
        """Describe the frames of a block, and give each answer its request."""
        frames = described(self.protocol, block, spans, self._base)
        silent = self._base in self._barriers
        frames, partner = self._pairing.match(frames, block, decided, self._base, silent=silent)
        return Met(block, frames, partner, decided)

    def open_from(self, met: Met) -> int | None:
        """Return where the first request of a block begins that is still open; None: none is."""
        row = self._pairing.cut(met.frames, met.partner, met.decided, met.block)
        return None if row is None else int(met.frames.start[row])

    def clear_at(self, met: Met, cut: int) -> int:
        """Return the last place up to a cut that no exchange leads across, if there is one near."""
        return self._pairing.clear_at(met.frames, met.partner, cut)

    def awaits(self, met: Met, at: int) -> bool:
        """Tell whether a request that has an answer ends right before an offset of a block."""
        if self._base + at in self._barriers:
            return False
        if not at:
            return self._asked_until == self._base
        f = met.frames
        row = int(np.searchsorted(f.start, at)) - 1
        ends = row >= 0 and f.end[row] == at
        return bool(ends and f.kind[row] == REQUEST and f.reply[row] != NEVER)

    def dated(self, gaps: list[Gap]) -> tuple[Gap, ...]:
        """Add to gaps when they ended, and the line errors that were told in them."""
        ends = np.array([g.start + g.length for g in gaps], np.int64) + self._base
        times: I64 = self._stamps.at(ends)
        gaps = self._remarks.explain(gaps, self._base)
        return tuple(Gap(*g[:-1], t) for g, t in zip(gaps, times.tolist(), strict=True))

    def tell(self, met: Met, cut: int, gaps: Sequence[Gap], *, open_from: int | None) -> Batch:
        """Return what the bytes before a cut say, and go on behind it.

        Args:
            met: the block.
            cut: an offset in it; nothing before it is open.
            gaps: the bytes before it that no frame claims, explained.
            open_from: where the capture ends with the block, from where on its bytes have no fate.
        """
        block, whole, partner, decided = met
        base, kept = self._base, int(np.searchsorted(whole.start, cut))
        self._pairing.forget(whole, block, kept, cut)
        frames = self._stamps.time(whole.take(slice(0, kept)), base)
        paired = self._pairing.pair(frames, whole, partner, block, decided, base)
        left = None
        if open_from is not None:
            rows = self._pairing.open_rows(frames, partner, open_from, block)
            known = self.protocol, frames, rows, open_from, max(self.heard_ns, self._now_ns)
            left = LeftOpen(*known).cut(paired.by_own_rows, self._base, len(block.data))
        batch = Batch(
            base,
            bytes(self._buffer[:cut]),
            self._stamps.clock,
            frames,
            gaps,
            Transactions.empty(),
            Samples.empty(),
            remarks=self._remarks.until(base + cut),
            cut=left,
            before=paired.before if len(paired.before) else None,
            slower_ns=self._slower_ns,
            is_shared=block.foreign is not None,
        )
        batch = self._records(block, batch, paired)
        del self._buffer[:cut]
        self._base += cut
        self._barriers = [b for b in self._barriers if b >= self._base]
        if len(frames):
            waits = frames.kind[-1] == REQUEST and frames.reply[-1] != NEVER
            self._asked_until = base + int(frames.start[-1] + frames.length[-1]) if waits else -1
        self._stamps.forget(self._base)
        return batch

    def _records(self, block: Block, batch: Batch, paired: Paired) -> Batch:
        """Add what follows from the frames: transactions, values, anomalies."""
        meaning = self._scaling.decode(block, paired, batch.base)
        transactions = paired.told(self._expectations.judge(paired, meaning.feedback))
        batch = replace(
            batch,
            frames=paired.frames,
            transactions=transactions,
            values=meaning.samples,
            models=self._scaling.models(paired.frames),
        )
        return self._anomaly_rules.judge(batch, meaning, self._remarks.take_losses())

    def _cut(self, frames: Frames, partner: I64, decided: int, block: Block) -> tuple[int, int]:
        """Return where this batch ends, and how many frames that are: nothing before it is open."""
        if block.final:
            return decided, len(frames)
        row = self._pairing.cut(frames, partner, decided, block)
        if row is not None:
            return int(frames.start[row]), row
        # An undecided gap is cut at whole pieces counted from its start, else chunking would show.
        last = int(frames.start[-1] + frames.length[-1]) if len(frames) else 0
        edge = max(last, int(block.barriers[-1]) if len(block.barriers) else 0)
        return edge + (decided - edge) // GAP_MAX * GAP_MAX, len(frames)

    def _gaps(self, data: bytes, frames: Frames, cut: int, block: Block) -> Sequence[Gap]:
        """Explain the bytes no frame claims, in pieces counted from where each run begins."""
        end = frames.end
        edges_from, edges_to = np.append(0, end), np.append(frames.start, cut)
        holes = np.flatnonzero(edges_to > edges_from)
        if not len(holes):
            return ()
        runs = holes_of(edges_from[holes], edges_to[holes], block)
        before = holes[holes > 0] - 1
        asks = (frames.kind[before] == REQUEST) & (frames.reply[before] != NEVER)
        asked = end[before[asks]]
        if not holes[0] and self._asked_until == self._base:
            asked = np.append(asked, 0)
        if self._barriers:
            asked = asked[~np.isin(asked, np.array(self._barriers, np.int64) - self._base)]
        awaited = np.zeros(len(runs.start), bool)
        awaited[np.searchsorted(runs.start, asked)] = True

        def explain(i: int) -> list[Gap]:
            s, e = int(runs.start[i]), int(runs.end[i])
            return self.protocol.explain(data[s:e], s, awaited=bool(awaited[i]))

        if self._surveyor is not None and not self._remarks.doubts:
            found, kind = surveyed(self._surveyor, block, runs)
            times = self._stamps.at(found.end + self._base)
            says = found.servo_id, (found.expected, found.got), times
            return Gaps(found.start, found.end - found.start, kind, *says, found.run, explain)
        out: list[Gap] = []
        for i, closed in enumerate(runs.closed.tolist()):
            told = explain(i)
            if closed:
                mark_tail(told)
            out += told
        return Gaps.of(self.dated(out))
