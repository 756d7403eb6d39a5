"""What stands at a byte of a capture: ``sniffer explain FILE@12175``."""

from __future__ import annotations

import contextlib
import re
from pathlib import Path
from typing import TYPE_CHECKING, Final

import numpy as np

from sniffer.anomalies.found import Anomalies
from sniffer.decoding.drawing import Drawn, draw_frame, draw_gap
from sniffer.decoding.pipeline import Options, Pipeline
from sniffer.ground.model import Clock, DamagedInputError, InputError
from sniffer.ground.wording import and_
from sniffer.jobs.asked import evidence_at, record_at
from sniffer.jobs.order import merged
from sniffer.jobs.session import undecided_of
from sniffer.jobs.telling import Teller
from sniffer.reports.words import moment
from sniffer.selection.places import END, FOUND, names_anomaly, place_in
from sniffer.sources import open_source
from sniffer.sources.several import name_of

if TYPE_CHECKING:
    from collections.abc import Sequence

    from sniffer.ground.model import Batch, Chunk
    from sniffer.protocols.base import BusProtocol
    from sniffer.selection.places import CapturePlace

FURTHER: Final = 1 << 20
"""Bytes behind a place in which it is still told what was wrong there: silence takes none."""

TOLD_MOST: Final = 6
"""Anomalies of one frame or gap that are told."""

_PLACE: Final = re.compile(r"(?P<path>.+)@(?:(?P<bus>[^@:/]+):)?(?P<offset>[0-9]{1,17})", re.DOTALL)


_TIME: Final = re.compile(r"-?[0-9.]")
"""Begins a time: no code does."""


def place_of(text: str) -> tuple[Path, CapturePlace]:
    """Return file and place of ``FILE@12175``, ``FILE@arm:12175``, ``FILE@no-response:3``.

    A time, as in ``FILE@-5s`` or ``FILE@20:35:20.5``, is the first thing said from there on.

    ``FILE@byte:12175`` is the first of them. A bus that is called like a code, or ``byte``, is
    named as in ``FILE@byte:no-response:12175``.

    Raises:
        InputError: it is nothing of the kind.
    """
    path, _, place = text.rpartition("@")
    match = _PLACE.fullmatch(text)
    if match is not None:
        bus = match["bus"] or ""
        if not (bus == "byte" or (bus and names_anomaly(bus))):
            place = f"byte:{bus}:{match['offset']}" if bus else f"byte:{match['offset']}"
    if not path:
        raise InputError(f"{text[:60]!r}: write a place in a capture as FILE@12175")
    is_time = match is None and _TIME.match(place)
    return Path(path), place_in(place if is_time else f"@{place}")


def explain_at(
    source: Path,
    place: CapturePlace,
    options: Options | None = None,
    *,
    input_format: str = "auto",
) -> tuple[bool, list[str]]:
    """Return whether a byte of a capture belongs to a frame that holds, and the drawing.

    The byte is the place, or the first one that an anomaly names. An answer is drawn behind the
    request that it answers. What was found there is told, as far as it is by ``FURTHER`` bytes on.

    Raises:
        InputError: the capture cannot be read or has no such byte, or several buses have it.
    """
    options = options or Options()
    options.check()
    bus, offset = place.bus or None, place.number
    told: list[str] = []
    of_time = place.kind != FOUND or place.sought == END or place.shift_ns != 0
    of_byte = place.sought == "byte" and not of_time
    with (
        undecided_of(name_of(source)),
        open_source(source, input_format, again=not of_byte, wiring=options.wired) as opened,
    ):
        options = options.with_facts(opened.facts(), opened.tables)
        if of_time:
            bus, offset = record_at(place, opened, options)
        elif not of_byte:
            bus, offset, *told = evidence_at(place, opened, options)
        finder = _AtByte(bus, offset)
        pipeline = Pipeline(options, [finder])
        quiet = Teller(lambda line: None, quiet=True)
        with contextlib.suppress(DamagedInputError):
            for group in merged(opened, opened, options, quiet):
                pipeline.feed(group)
                if bus is not None and finder.is_done:
                    break
        if not (bus is not None and finder.is_done):
            pipeline.close()
    if bus is None and len(finder.found) > 1:
        names = and_(list(finder.found))
        raise InputError(f"{source}: {names} have a byte {offset}: write FILE@BUS:{offset}")
    if not finder.found:
        ends = ", ".join(f"{name} {end}" for name, end in finder.ends.items())
        raise InputError(f"{source}: there is no byte {offset}: it has {ends or 'none'}")
    ((name, pieces),) = finder.found.items()
    head = f"{source}, byte {offset} of {name}"
    found = list(dict.fromkeys(finder.remarks[name]))
    if (of_byte or of_time) and found:
        more = f"; and {len(found) - TOLD_MOST} more" if len(found) > TOLD_MOST else ""
        head += f": {'; '.join(found[:TOLD_MOST])}{more}"
    out = [head, *told]
    for piece in pieces:
        out += ["", f"at byte {piece.offset}, {moment(piece.t_ns, finder.clock, 6)}", *piece.lines]
    return pieces[-1].holds, [options.called.sentence(name, line) for line in out]


class _AtByte:
    """A sink that draws what has a byte of a bus: by name or, where it has none, of each."""

    def __init__(self, bus: str | None, offset: int) -> None:
        self._bus, self._offset = bus, offset
        self.found: dict[str, list[Drawn]] = {}
        self.remarks: dict[str, list[str]] = {}
        """By bus what was found in what has the byte."""
        self.ends: dict[str, int] = {}
        self.clock = Clock.NONE
        """What the times of what was found are of."""
        self._spans: dict[str, tuple[int, int]] = {}

    @property
    def is_done(self) -> bool:
        """Whether the byte is found, and what comes is too far off to be about it."""
        return bool(self._spans) and all(
            self.ends[bus] > end + FURTHER for bus, (_, end) in self._spans.items()
        )

    def raw(self, bus: str, chunks: Sequence[Chunk]) -> None:
        """Take nothing."""

    def write(self, bus: str, protocol: BusProtocol, batch: Batch) -> None:
        """Look for the byte."""
        self.ends[bus] = max(self.ends.get(bus, 0), batch.base + len(batch.data))
        at = self._offset - batch.base
        if self._bus not in (None, bus):
            return
        if 0 <= at < len(batch.data):
            self._draw(bus, protocol, batch, at)
        start, end = self._spans.get(bus, (0, 0))
        found = Anomalies.of(batch.anomalies)
        for nth in np.flatnonzero((found.at < end) & (start < found.at + found.length)).tolist():
            self.remarks[bus].append(f"{found[nth].code}: {found[nth].detail}")

    def _draw(self, bus: str, protocol: BusProtocol, batch: Batch, at: int) -> None:
        """Draw what has a byte of a batch."""
        self.clock = batch.clock
        f = batch.frames
        rows = np.flatnonzero((f.start <= at) & (at < f.end)).tolist()
        if rows:
            asked = batch.transactions.request[batch.transactions.response == rows[0]]
            before = [row for row in np.unique(batch.rows_of(asked)).tolist() if row >= 0]
            pieces = [draw_frame(batch, protocol, i) for i in (*before, rows[0])]
            self._find(bus, pieces, batch.base + int(f.start[rows[0]]), int(f.length[rows[0]]))
            return
        for gap in batch.gaps:
            if gap.start <= at < gap.start + gap.length:
                pieces = [draw_gap(batch, protocol, gap)]
                self._find(bus, pieces, batch.base + gap.start, gap.length)

    def _find(self, bus: str, pieces: list[Drawn], start: int, length: int) -> None:
        self.found[bus], self.remarks[bus] = pieces, []
        self._spans[bus] = start, start + length

    def close(self) -> None:
        """Do nothing."""
