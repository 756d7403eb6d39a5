"""A recording against itself: its raw bytes decoded today, and the frames recorded at the time."""

from __future__ import annotations

import array
from dataclasses import dataclass, field
from typing import TYPE_CHECKING

import numpy as np

from sniffer.decoding.pipeline import Options, Pipeline
from sniffer.ground.codes import KINDS
from sniffer.ground.model import DamagedInputError, InputError
from sniffer.mcapfile.given import open_recording, refuse_no_file
from sniffer.mcapfile.source import recorded
from sniffer.messages import MAGIC
from sniffer.sources import open_source

if TYPE_CHECKING:
    from collections.abc import Callable, Sequence
    from pathlib import Path

    from sniffer.ground.model import I64, Batch, Chunk
    from sniffer.protocols.base import BusProtocol


class _Frames:
    """Frames of one bus as five numbers each: they may be millions."""

    def __init__(self) -> None:
        self.rows = array.array("q")

    def add(self, offset: int, length: int, kind: int, servo_id: int, op: int) -> None:
        self.rows.extend((offset, length, kind, servo_id, op))

    def table(self) -> I64:
        rows = np.frombuffer(self.rows, np.int64) if self.rows else np.empty(0, np.int64)
        return rows.reshape(-1, 5)


class _Names:
    """Command names as numbers, the same for both sides."""

    def __init__(self) -> None:
        self._of: dict[str, int] = {}

    def number(self, name: str) -> int:
        return self._of.setdefault(name, len(self._of))


@dataclass(slots=True)
class Difference:
    """What differs on one bus, counted in frames; ``first`` is where, in bytes."""

    bus: str
    same: int
    only_recorded: int
    only_now: int
    otherwise: int
    first: int | None


@dataclass(slots=True)
class Comparison:
    """The comparison of all buses."""

    buses: list[Difference] = field(default_factory=list)

    @property
    def equal(self) -> bool:
        """Tell whether nothing differs."""
        return all(b.first is None for b in self.buses)

    def __str__(self) -> str:
        lines = []
        for b in self.buses:
            if b.first is None:
                lines.append(f"{b.bus}: {b.same} frames, the same as recorded")
                continue
            lines.append(
                f"{b.bus}: {b.same} frames the same, {b.otherwise} read otherwise, "
                f"{b.only_recorded} only in the recording, {b.only_now} only now; "
                f"first difference at byte {b.first}"
            )
        return "\n".join(lines)


class _Collect:
    """A sink that keeps what is compared."""

    def __init__(self, names: _Names) -> None:
        self.buses: dict[str, _Frames] = {}
        self._names = names

    def raw(self, bus: str, chunks: Sequence[Chunk]) -> None:
        """Take nothing."""

    def write(self, bus: str, protocol: BusProtocol, batch: Batch) -> None:
        """Keep the frames' numbers."""
        f = batch.frames
        kept = self.buses.setdefault(bus, _Frames())
        columns = (f.start + batch.base, f.length, f.kind, f.servo_id, f.op)
        for offset, length, kind, servo, op in zip(*(c.tolist() for c in columns), strict=True):
            kept.add(offset, length, kind, servo, self._names.number(protocol.op_name(op)))

    def close(self) -> None:
        """Do nothing."""


def compare(path: Path, options: Options, *, say: Callable[[str], None]) -> Comparison:
    """Decode a recording's raw bytes again and compare frame by frame.

    Raises:
        InputError: it is no recording of this tool, or holds no frames.
    """
    refuse_no_file(path)
    source = open_source(path)
    if source.format != "mcap":
        raise InputError(f"{path} is no recording: only an .mcap holds what was decoded before")
    with open_recording(path) as stream:
        if stream.read(len(MAGIC)) != MAGIC:
            raise InputError(
                f"{path} is packed: unpack it first (gunzip, unzstd); its frames are read in place"
            )
    names = _Names()
    now = _Collect(names)
    pipeline = Pipeline(options.with_facts(source.facts(), source.tables), [now])
    then: dict[str, _Frames] = {}
    try:
        for group in source:
            pipeline.feed(group)
    except DamagedInputError as error:
        say(f"{error}: compared as far as it goes")
    pipeline.close()
    cut = False
    try:
        for f in recorded(path):
            if f.offset < 0:  # its bytes stand in the file before
                continue
            servo = -1 if f.servo_id is None else f.servo_id
            kind = KINDS.index(f.kind) if f.kind in KINDS else -1
            then.setdefault(f.bus, _Frames()).add(
                f.offset, f.length, kind, servo, names.number(f.op)
            )
    except DamagedInputError:
        cut = True  # that was said above already; a recovered file has nothing more to say
    if not then:
        raise InputError(f"{path} holds no decoded frames to compare with")
    none = _Frames()
    return Comparison(
        [
            _difference(bus, then.get(bus, none).table(), now.buses.get(bus, none).table(), cut)
            for bus in dict.fromkeys([*then, *now.buses])
        ]
    )


def _difference(bus: str, then: I64, now: I64, cut: bool) -> Difference:
    if cut:  # raw bytes are written first: of the last ones no frame was recorded any more
        now = now[now[:, 0] <= then[:, 0].max(initial=-1)]
    _, a, b = np.intersect1d(then[:, 0], now[:, 0], return_indices=True)
    alike = (then[a] == now[b]).all(axis=1)
    lost = np.delete(then[:, 0], a)
    new = np.delete(now[:, 0], b)
    apart = then[a][~alike, 0]
    places = np.concatenate([lost, new, apart])
    return Difference(
        bus,
        int(alike.sum()),
        len(lost),
        len(new),
        len(apart),
        int(places.min()) if len(places) else None,
    )
