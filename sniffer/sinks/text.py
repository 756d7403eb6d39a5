"""The table for people: a line a frame or gap, then the summary. Nothing is cut in a pipe."""

from __future__ import annotations

import textwrap
from typing import TYPE_CHECKING, Any, Final, NamedTuple, TextIO

import numpy as np
from rich.cells import cell_len, set_cell_size
from rich.style import Style

from sniffer.decoding.narrowing import meant
from sniffer.decoding.summary import Summary
from sniffer.diagnosis import Diagnosis
from sniffer.ground.codes import RESPONSE
from sniffer.ground.heard import SteadyTime
from sniffer.ground.limits import DATED_NS
from sniffer.ground.model import GAP_MAX, NS, Anomaly, Batch, Chunk, Clock
from sniffer.ground.moments import DAY_NS, date_of, of_day
from sniffer.ground.wording import plain, short, sums_in_words
from sniffer.sinks.consoles import console_for, room_in, unfold
from sniffer.sinks.intime import FIRST_NS, READ, InTime
from sniffer.sinks.report import print_summary, selected
from sniffer.sinks.verdicts import verdicts_of
from sniffer.sinks.words import FrameWords, laid_out, selected_in_words, told_apart

if TYPE_CHECKING:
    from collections.abc import Collection, Iterable, Iterator, Mapping, Sequence

    from rich.console import Console

    from sniffer.decoding.called import ServoNames
    from sniffer.ground.model import Mask
    from sniffer.protocols.base import BusProtocol
    from sniffer.sinks.intime import WaitTimes

WIDE: Final = 120
"""From this width on the table has microseconds and a column for the bus."""

VALUES: Final = 76
"""Room that values want: a read of all measured values. What the terminal has beyond it shows the
bytes, if that is enough for ``BYTES``."""

BYTES: Final = 41
"""Room for the bytes of a frame of fourteen bytes."""

IDS: Final = 3
NAMES: Final = 24
"""Columns that ids have, and at most with names beside them on a terminal."""

WIDTHS: Final = (15, 5, IDS, 1, 19, 12)
"""Widths on a wide terminal: time, bus, id, kind, command; verdict."""

UNCUT: Final = sum(WIDTHS) + len(WIDTHS) + VALUES + BYTES + 1
"""The width from which on all columns are there; a line that is not cut has at least that."""

NARROW: Final = (12, IDS, 1, 15, 12)
"""Widths on a narrow one: time, id, kind, command; verdict. Several buses have a column, too."""

BUS: Final = 3, 5
"""Columns that names of buses have on a narrow terminal, at least and at most."""

BUS_WIDE: Final = 5, 12
"""The same on a wide one."""

_STYLES: Final = {
    "error": Style(color="red"),
    "warn": Style(color="yellow"),
    "note": Style(color="cyan"),
    "request": Style(),
    "response": Style(color="green"),
    "head": Style(bold=True),
    "beside": Style(dim=True),
}

MARK, LEFT_OUT = "*", "--"
"""What stands before a line that is selected, where others stand around it, and between such
stretches."""

ABSOLUTE, RELATIVE, DELTA = "abs", "rel", "delta"
"""What the time of a line counts from: the clock's own zero, the first line of the capture, the
line before of the same bus."""


class _Laid(NamedTuple):
    """A line before it is laid out; the cells are those behind the time and the bus."""

    start: int
    t_ns: int
    clock: Clock
    style: str
    cells: tuple[str, str, str, str, str]
    raw: bytes
    end: int = -1
    """Where what it is of ends in the stream, -1 of a line that is of no bytes of its own."""
    is_meant: bool = True
    """Whether it is selected: others stand around such lines."""
    is_apart: bool = False
    """Whether lines were left out between it and the one before of its bus."""


class TextSink:
    """Writes to a stream, as wide as its terminal; elsewhere nothing is cut.

    ``color`` None asks the stream whether it is a terminal; ``times`` is ``ABSOLUTE``,
    ``RELATIVE`` or ``DELTA``; ``waits`` is how long a line waits for those that other buses may
    have before it; ``buses`` are those of which something will come, as far as that is known.
    """

    def __init__(
        self,
        stream: TextIO,
        *,
        width: int | None = None,
        color: bool | None = None,
        times: str = ABSOLUTE,
        waits: WaitTimes = READ,
        buses: Iterable[str] = (),
    ) -> None:
        self._console = console_for(stream, color=color, width=width)
        self._stream = stream
        self._color = self._console.color_system is not None and not self._console.no_color
        self._is_cut = width is not None or room_in(self._console) is not None
        self._width = self._console.width if self._is_cut else UNCUT
        self._times = times
        self._first_ns: int | None = None
        self._last_ns: dict[str, int] = {}
        self._steady: dict[str, SteadyTime] = {}
        self._second = -1, ""
        """The second that was told last, in words."""
        self._day: int | None = None
        self._more = 0
        self._summary = Summary()
        self._diagnosis = Diagnosis()
        self._wide = self._width >= WIDE
        self._ids = IDS
        self._lines = InTime[_Laid](waits)
        self._expected = frozenset(buses)
        self._widths: list[int] = []
        """Of the columns, once there is a line."""
        self._with_bytes = self._with_bus = self._with_mark = False
        self._shown_until: dict[str, int] = {}
        """Up to which byte of each bus there are lines."""
        self._shown: dict[str, str] = {}
        """Buses as lines name them."""

    def raw(self, bus: str, chunks: Sequence[Chunk]) -> None:
        """Take nothing."""

    def call(self, names: ServoNames) -> None:
        """Take what servos are called; where lines are wide, ids have their names beside them."""
        self._summary.names = names
        if names and self._wide:
            ids = IDS + 1 + max(map(cell_len, names.known))
            self._ids = min(ids, NAMES) if self._is_cut else ids

    def _lay_out(self, buses: Iterable[str]) -> None:
        """Say how wide the columns are, where these buses are heard."""
        shown = {bus: short(plain(bus)) for bus in buses}
        self._with_bus = self._wide or len(shown) > 1
        least, most = BUS_WIDE if self._wide else BUS
        room = max(least, *map(len, shown.values()))
        room = min(room, most) if self._is_cut else room
        self._shown.update(told_apart(shown, room))
        time, *_, kind, command, verdict = WIDTHS if self._wide else NARROW
        before = [time + self._more, *[room] * self._with_bus, self._ids, kind, command]
        marked = 2 * self._with_mark
        left = max(self._width - marked - sum(n + 1 for n in (*before, verdict)), 12)
        left = left if self._is_cut else VALUES + BYTES + 1
        self._with_bytes = self._wide and left > VALUES + BYTES
        values = [VALUES, left - VALUES - 1] if self._with_bytes else [left]
        self._widths = [*before, *values, verdict]

    def narrow(self, told: Mapping[str, Any]) -> None:
        """Take what of it is written: instead of a summary of all, that is told at the end."""
        self._summary.narrow(told)
        self._with_mark = self._with_mark or "context" in told
        if "part" in told and self._times == RELATIVE:
            self._first_ns = told["first_ns"] or 0

    def write(self, bus: str, protocol: BusProtocol, batch: Batch) -> None:
        """Take a line for each frame and gap of the batch, in wire order."""
        self.write_together(bus, [(protocol, batch)])

    def write_together(self, bus: str, parts: Sequence[tuple[BusProtocol, Batch]]) -> None:
        """Do that for what several protocols said in one pass; each line tells whose it is."""
        lines: list[_Laid] = []
        for protocol, batch in parts:
            self._summary.add(bus, protocol, batch)
            self._diagnosis.write(bus, protocol, batch)
            lines += self._lines_of(bus, protocol, batch)
        if not self._widths:  # nothing is printed yet: of a selection the first frame counts
            begun = [int(b.frames.t_end[0]) for _, b in parts if len(b.frames) and b.chosen]
            known = () if self._first_ns is None else (self._first_ns,)
            self._first_ns = min((*begun, *known), default=None)
        lines.sort(key=lambda line: line.start)
        if self._with_mark:
            lines = self._parted(bus, parts[0][1].base, lines)
        if lines:
            self._lines.add(bus, [(line.t_ns, line) for line in lines])

    def _parted(self, bus: str, base: int, lines: Iterable[_Laid]) -> list[_Laid]:
        """Return lines that say where others were left out before them."""
        out = []
        for line in lines:
            until = self._shown_until.get(bus)
            if line.end >= 0:
                is_apart = until is not None and base + line.start > until
                line = line._replace(is_apart=is_apart)
                self._shown_until[bus] = base + line.end
            out.append(line)
        return out

    def passed(self, until_ns: int | None, open_buses: Collection[str]) -> None:
        """Write the lines that are due: those of all buses in the order of time."""
        if until_ns is None:
            self._print(self._lines.as_told())
        else:
            self._print(self._lines.until(until_ns, open_buses))

    def _print(self, due: Sequence[tuple[str, _Laid]]) -> None:
        if not due:
            return
        told = []
        if not self._widths:
            if self._first_ns is not None:
                self._day = _day_of(self._first_ns)
            begun = due[0][1].t_ns + FIRST_NS
            # of a clock that counts from when it was switched on hours may have more digits
            self._more = len(of_day(begun, 0)) - len("00:00:00")
            heard = {bus for bus, line in due if line.t_ns < begun}
            self._lay_out(sorted(heard | self._expected))
            told.append(self._head())
        for bus, line in due:
            if bus not in self._shown and not self._with_bus:
                self._lay_out([*self._shown, bus])
                told.append(self._head())
            day = _day_of(line.t_ns)
            if self._times == ABSOLUTE and self._day not in (None, day):
                told.append(self._paint("head", date_of(line.t_ns)))
            self._day = day
            if line.is_apart:
                told.append(self._paint("beside", LEFT_OUT))
            told.append(self._laid_out(line, bus))
        self._stream.write("\n".join(told) + "\n")

    def _head(self) -> str:
        return self._paint("head", self._line(HEAD, bus="bus"))

    def _lines_of(self, bus: str, protocol: BusProtocol, batch: Batch) -> Iterator[_Laid]:
        f = batch.frames
        verdicts = verdicts_of(batch)
        is_meant, (frames, gaps) = meant(batch), _with_lines(batch)
        rows = np.flatnonzero(frames).tolist()
        words = FrameWords.of(protocol).told(batch, rows)
        asked = selected_in_words(protocol, batch)
        whose = f"{protocol.name}: " * batch.is_shared
        ops: dict[int, str] = {}
        columns = (c[rows].tolist() for c in (f.start, f.end, f.t_end, f.kind, f.servo_id, f.op))
        for i, told, start, end, t_ns, kind, servo, op in zip(rows, words, *columns, strict=True):
            response = kind == RESPONSE
            command = ops.get(op) or ops.setdefault(op, protocol.op_name(op))
            word, style = verdicts[i]
            cells = (
                str(servo) if servo >= 0 else "-",
                "<" if response else ">",
                command,
                whose + asked.get(i, told),
                word,
            )
            style = style or ("response" if response else "request")
            raw = batch.data[start:end]
            yield _Laid(start, t_ns, batch.clock, style, cells, raw, end, bool(is_meant[i]))
        is_meant = batch.shows("gaps", len(batch.gaps))
        for i in np.flatnonzero(gaps).tolist():
            g = batch.gaps[i]
            raw = batch.data[g.start : g.start + g.length]
            line = self._gap(batch, g.start, g.t_ns, g.reason, raw, g.detail)
            yield line._replace(end=g.start + g.length, is_meant=bool(is_meant[i]))
        if batch.chosen is not None:
            for i in np.flatnonzero(batch.chosen("anomalies")).tolist():
                yield self._anomaly(batch, self._summary.names.on(bus, batch.anomalies[i]))

    def close(self) -> None:
        """Write what waits, and the summary."""
        self._print(self._lines.rest())
        if self._widths:
            self._stream.write("\n")
            self._stream.flush()  # a reader who is gone is told here, and not to the console
        narrowed = self._summary.narrowed if self._summary.buses else {}
        if "where" not in narrowed:
            if not self._is_cut:
                unfold(self._console)
            print_summary(self._summary, self._console, self._diagnosis.incidents())
            if narrowed:
                self._stream.write("\n")
        if narrowed:
            told = selected(self._summary)
            self._stream.write(textwrap.fill(told, self._width, subsequent_indent="  ") + "\n")
        self._stream.flush()

    def _gap(
        self, batch: Batch, start: int, t_ns: int, reason: str, raw: bytes, detail: Any
    ) -> _Laid:
        told, shown = [], [] if self._with_bytes else [raw.hex(" ").upper()]
        if detail.get("blank"):
            word, style = "", "request"
        elif "checksum_expected" in detail:
            word, style = "bad checksum", "error"
            sums = sums_in_words(detail["checksum_got"], detail["checksum_expected"])
            told = [f"sum {sums}"]
        else:
            word, style = reason.replace("_", " "), "warn" if reason == "noise" else "error"
            if "expected" in detail:
                told = [f"column {detail['column']}: expected {detail['expected']}"]
        values = ": ".join(told + shown)
        cells = ("", "!", "no frame", values, word)
        return _Laid(start, t_ns, batch.clock, style, cells, raw)

    def _laid_out(self, line: _Laid, bus: str) -> str:
        cells = (self._time(line, bus), *line.cells)
        mark, style = (MARK, line.style) if line.is_meant else ("", "beside")
        return self._paint(style, self._line(cells, bus=bus, raw=line.raw, mark=mark))

    def _anomaly(self, batch: Batch, found: Anomaly) -> _Laid:
        level = found.severity.name.lower()
        who = "" if found.servo_id is None else str(found.servo_id)
        cells = (who, "!", found.code, found.detail, level)
        start = found.known_at - batch.base
        (at, length), *_ = found.evidence or ((0, 0),)
        at -= batch.base
        is_here = at >= 0 and at + length <= len(batch.data) and length <= GAP_MAX
        raw = batch.data[at : at + length] if is_here else b""
        return _Laid(start, found.t_ns, batch.clock, level, cells, raw)

    def _time(self, line: _Laid, bus: str) -> str:
        """Return a line's time; a difference is to the line above it, of the same bus."""
        digits = 6 if self._wide else 3
        t_ns = line.t_ns
        if self._first_ns is None:
            self._first_ns = t_ns
        if self._times != ABSOLUTE:
            now = self._steady.setdefault(bus, SteadyTime()).at(t_ns)
            before, self._last_ns[bus] = self._last_ns.get(bus, now), now
            passed = now - (before if self._times == DELTA else self._first_ns)
            return f"{passed / NS:.{digits}f}".rjust(9 + digits)
        if line.clock == Clock.NONE:
            return f"{t_ns / NS:.6f}".rjust(9 + digits)
        if t_ns // NS != self._second[0]:
            self._second = t_ns // NS, of_day(t_ns, 0)
        return f"{self._second[1]}.{t_ns % NS // 10 ** (9 - digits):0{digits}d}"

    def _line(
        self, cells: Sequence[str], *, bus: str, raw: bytes | None = None, mark: str = ""
    ) -> str:
        time, servo, kind, op, values, verdict = cells
        row = [time, servo.rjust(IDS), kind, op, values, verdict]
        if self._ids > IDS and servo.isdecimal():
            name, room = self._summary.names.of(bus, int(servo)) or "", self._ids
            row[1] = f"{row[1]} {plain(name)}".rstrip()
            if cell_len(row[1]) > room:
                row[1] = f"{set_cell_size(row[1], room - 1)}…"
        if self._with_bus:
            row.insert(1, self._shown.get(bus) or self._shown.setdefault(bus, short(plain(bus))))
        if self._with_bytes:
            row.insert(-1, raw.hex(" ").upper() if raw is not None else "bytes")
        widths = self._widths
        if not (row[1].isascii() and row[2].isascii()):  # names may have signs of two cells
            row_widths = zip(row, widths, strict=True)
            widths = [room + len(cell) - cell_len(cell) for cell, room in row_widths]
        whole = 3 + self._with_bus if kind == "!" else None  # a code can be asked for as it is
        told = laid_out(row, widths, whole, is_cut=self._is_cut)
        return f"{f'{mark:2}' * self._with_mark}{told}".rstrip()

    def _paint(self, style: str, text: str) -> str:
        if not self._color:
            return text
        return _STYLES[style].render(
            text, color_system=None if not self._color else _system(self._console)
        )


HEAD: Final = ("time", "id", " ", "command", "values", "verdict")
"""Titles of the columns."""


def _with_lines(batch: Batch) -> tuple[Mask, Mask]:
    """Return which frames and which gaps have a line."""
    if batch.around is not None:
        return batch.around
    return meant(batch), batch.shows("gaps", len(batch.gaps))


def _day_of(t_ns: int) -> int | None:
    """Return the number of a time's day, None of one that tells no day."""
    return None if t_ns < DATED_NS else t_ns // DAY_NS


def _system(console: Console) -> Any:
    return console._color_system
