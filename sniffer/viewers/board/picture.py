"""One picture of the live board: what of it fits a width and a height, line by line.

A line is a list of cells, texts with the name of a style.
"""

from __future__ import annotations

from typing import TYPE_CHECKING, Final

from sniffer.ground.model import Severity
from sniffer.ground.wording import counted, plain
from sniffer.viewers.board.cells import (
    ALARMS,
    COLUMNS,
    TITLES,
    WIDE,
    Cell,
    clock,
    fitted,
    id_column,
    size,
)
from sniffer.viewers.board.findings import FindingLines, Line, length

if TYPE_CHECKING:
    from collections.abc import Sequence

    from sniffer.decoding.called import ServoNames
    from sniffer.diagnosis.tracking import Tracked
    from sniffer.tap.status import BusStatus, Status
    from sniffer.viewers.board.cells import Column
    from sniffer.viewers.board.controls import Controls
    from sniffer.viewers.board.remembered import Remembered

STATES: Final = {"listening": "good", "silent": "doubt", "away": "alarm"}

CROWDED: Final = 70
"""Percent of its time that a line may be busy before it is worth a look; at 90 it is too much."""

BEHIND: Final = 1 << 16
"""Bytes that wait to be decoded from which on it is worth a look."""

SPARE: Final = 8
"""Lines that must be left over for two of them to stay blank."""

OVER_SHOWN: Final = 3
"""Incidents that are over and still have a line."""

LEVELS: Final = ((Severity.ERROR, "error"), (Severity.WARN, "warning"), (Severity.NOTE, "note"))


class Picture:
    """Decides what fits, and writes it down.

    Args:
        board: what is remembered.
        status: the recording at the moment of the picture.
        width: of the terminal, in cells.
        height: how many lines there may be.
        hint: the end of the last line.
        controls: what keys have asked for.
    """

    def __init__(
        self,
        board: Remembered,
        status: Status,
        width: int,
        height: int,
        hint: str = "Ctrl-C stops",
        controls: Controls | None = None,
    ) -> None:
        self._controls = controls
        self._board = board
        self._status = status
        self._width = width
        self._height = height
        self._hint = hint
        self._wide = width >= WIDE
        self._columns = columns(width, board.names)
        self._rows = [board.rows(bus.bus, status) for bus in status.buses]
        end_ns = board.end_ns(status)
        self._loads = [board.load(bus, end_ns) for bus in status.buses]
        self._names = [fitted(plain(b.bus), min(len(plain(b.bus)), 12)) for b in status.buses]
        self._name = max(map(len, self._names), default=0)
        spoken = max((len(b.protocol) for b in status.buses if b.protocol), default=0)
        self._tails = [_tail(bus, spoken) for bus in status.buses]
        self._tail = max((length(tail) for tail in self._tails), default=0)
        self._incidents = self._watched(shown(board.incidents))
        self._troubles = board.troubles if board.watched is None else board.watched.troubles

    def lines(self) -> list[Line]:
        """Return the lines, the most important ones where not all fit."""
        buses = range(len(self._rows))
        servos = [(nth, row) for nth in buses for row in self._servos(nth)]
        wanted = min(len(self._incidents) + len(self._troubles), 3)
        asked = self._asked()
        room = self._height - 3 - len(asked)  # titles, the head of the anomalies, the footer
        heads = 2
        if 2 * len(buses) + len(servos) + wanted > room:
            heads = 1
        if heads * len(buses) + len(servos) + wanted <= room:
            body = self._table(buses, servos, heads)
        else:
            body = self._cut(room - wanted, servos)
        left = max(room - len(body), 0)
        blank: list[Line] = [[]] if left >= SPARE else []
        room = left - 2 * len(blank)
        lines = FindingLines(
            self._status.now_ns,
            self._width,
            self._name if len(self._names) > 1 else 0,
            self._board.names,
        )
        told = [lines.incident(one) for one in self._incidents[: max(room, 0)]]
        told += lines.anomalies(self._troubles, self._incidents, room - len(told))
        out = [self._titles(), *body, *asked, *blank, self._levels(), *told, *blank]
        return [*out[: self._height - 1], self.footer()] if self._height > 0 else []

    def _cut(self, room: int, servos: list[tuple[int, int]]) -> list[Line]:
        """Return a table of so many lines, the last of which says what is not in it.

        Servos in trouble are kept, or those that come first in the order somebody asks for.
        """
        buses = sorted(range(len(self._rows)), key=lambda nth: not self._is_trouble(nth))
        buses = sorted(buses[: max(room - 1, 0)])
        ranked: list[tuple[bool, bool, int, int, int]] = []
        rank: dict[tuple[int, bool, bool], int] = {}
        for nth, row in servos:
            rows = self._rows[nth]
            if nth in buses and rows is not None:
                worth = not rows.troubled(row), not rows.heard(row)
                if self._controls is not None and self._controls.is_sorted:
                    worth = False, False  # who asks for the greatest wants to see the greatest
                place = rank[nth, *worth] = rank.get((nth, *worth), 0) + 1
                ranked.append((*worth, place, nth, row))
        kept = {e[-2:] for e in sorted(ranked)[: max(room - 1 - len(buses), 0)]}
        body = self._table(buses, [e for e in servos if e in kept], 1)
        gone = [e for e in servos if e not in kept]
        told = [counted(len(gone), "more servo")] if gone else []
        if len(buses) < len(self._rows):
            told.append(f"{len(self._rows) - len(buses)} more buses")
        bad = sum(1 for nth, row in gone if (r := self._rows[nth]) and r.troubled(row))
        text = f"... and {', '.join(told)}"
        more: Line = [(text, "dim")]
        if bad:
            more.append((f", {bad} of them in trouble", "bad"))
        return [*body, more][: max(room, 0)]

    def _servos(self, nth: int) -> list[int]:
        """Return the rows of a bus's servos that are shown, in the order that is asked for."""
        rows, controls = self._rows[nth], self._controls
        if rows is None:
            return []
        order: list[int] = rows.order
        if controls is not None:
            order = rows.sorted(controls.sort, falls=controls.falls)
        watched = self._board.watched
        if watched is None:
            return order
        return [row for row in order if (self._bus(nth), rows.id(row)) in watched.servos]

    def _bus(self, nth: int) -> str:
        return self._status.buses[nth].bus

    def _watched(self, incidents: list[Tracked]) -> list[Tracked]:
        """Return the incidents of servos that are shown, and those of whole buses."""
        watched = self._board.watched
        if watched is None:
            return incidents
        return [
            one
            for one in incidents
            if not one.incident.servo_ids
            or any((one.incident.bus, who) in watched.servos for who in one.incident.servo_ids)
        ]

    def _is_trouble(self, nth: int) -> bool:
        bus, rows = self._status.buses[nth], self._rows[nth]
        ill = bus.state != "listening" or bus.lost > 0 or bool(bus.line_errors)
        return ill or (rows is not None and any(map(rows.troubled, rows.order)))

    def _table(self, buses: Sequence[int], servos: list[tuple[int, int]], heads: int) -> list[Line]:
        keys = [column.key for column in self._columns]
        out: list[Line] = []
        drawn: list[tuple[str, int]] = []
        for nth in buses:
            out += self._head(nth) if heads == 2 else [self._short_head(nth)]
            rows = self._rows[nth]
            if rows is not None:
                for which, row in servos:
                    if which == nth:
                        drawn.append((self._bus(nth), rows.id(row)))
                        out.append(self._line(self._marked(rows.cells(row, keys), drawn[-1])))
        if self._controls is not None:
            self._controls.rows = drawn
        return out

    def _marked(self, cells: list[Cell], who: tuple[str, int]) -> list[Cell]:
        """Return the cells of a servo with its name; the id of the chosen one is lit up."""
        if (name := self._board.names.of(*who)) is not None:
            text = f"{cells[0][0]:>{COLUMNS[0].widths[0]}} {plain(name)}"
            cells = [(text, cells[0][1]), *cells[1:]]
        if self._controls is None or self._controls.cursor != who:
            return cells
        return [(cells[0][0], "cursor"), *cells[1:]]

    def _line(self, cells: list[Cell]) -> Line:
        out: Line = []
        for (text, style), column in zip(cells, self._columns, strict=False):
            width = self._width_of(column)
            if column.key == "id" and width > COLUMNS[0].widths[0]:  # names are words
                out += [(fitted(f"{text:>{COLUMNS[0].widths[0]}}", width), style), (" ", "")]
            else:
                out += [(fitted(text, width, right=True), style), (" ", "")]
        text, style = cells[-1]
        room = self._width - sum(self._width_of(c) + 1 for c in self._columns)
        return [*out, (fitted(text, room).rstrip(), style)] if room > 0 else out

    def _width_of(self, column: Column) -> int:
        return column.widths[self._wide]

    def _titles(self) -> Line:
        by = "" if self._controls is None else self._controls.sort
        out: Line = []
        for c in self._columns:
            is_mark = c.key == by and by != "id"
            is_named = c.key == "id" and self._width_of(c) > COLUMNS[0].widths[0]
            title = fitted(c.titles[self._wide], self._width_of(c), right=not is_named)
            out += [(title, "sorted" if is_mark else "title"), (" ", "title")]
        return [*out, (fitted("alarms", max(self._width - length(out), 0)), "title")]

    def _head(self, nth: int) -> list[Line]:
        """Return two lines: who it is and how it goes; where its bytes are."""
        bus = self._status.buses[nth]
        told = max(len(str(b.baud)) for b in self._status.buses)
        speed = f"{bus.baud:>{told}} baud"
        taken = self._name + 2 + len(speed) + 2 + len("load 100 %") + 2 + self._tail
        ports = max(len(plain(b.port)) for b in self._status.buses)
        room = max(min(ports, self._width - taken - 2), 8)
        first: Line = [
            (f"{self._names[nth]:{self._name}}  ", "bus"),
            (_port(bus.port, room) + "  ", ""),
            (speed + "  ", ""),
            *self._load(nth, "load "),
            *self._tails[nth],
        ]
        second: Line = [("  ", ""), *self._bytes(nth)]
        second += [(f", lost {bus.lost}", "bad" if bus.lost else "dim")]
        errors = "unknown" if bus.line_errors is None else str(bus.line_errors)
        text = f", line errors {errors}"
        if length(second) + len(text) > self._width:
            text = f", errors {errors}"
        return [first, [*second, (text, "bad" if bus.line_errors else "dim")]]

    def _short_head(self, nth: int) -> Line:
        """Return one line: what is least of all known otherwise comes last and may be cut."""
        bus = self._status.buses[nth]
        told = max(len(str(b.baud)) for b in self._status.buses)
        ports = max(len(plain(b.port).rpartition("/")[2]) for b in self._status.buses)
        out: Line = [
            (f"{self._names[nth]:{self._name}}  ", "bus"),
            (_port(bus.port.rpartition("/")[2], min(ports, 32 if self._wide else 10)) + "  ", ""),
            (f"{bus.baud:>{told}}  ", ""),
            *self._load(nth, ""),
            *self._tails[nth],
            (" " * (self._tail - length(self._tails[nth]) + 2), ""),
        ]
        for word, count in (("lost", bus.lost), ("errors", bus.line_errors)):
            if count:
                out.append((f"{word} {count}  ", "bad"))
        if self._wide:
            return [*out, *self._bytes(nth)]
        tally = self._board.buses.get(bus.bus)
        if tally is None:
            return [*out, (f"{size(bus.bytes):>8} read", "dim")]
        return [
            *out,
            (f"{size(tally.size):>8} ", ""),
            (f"{size(tally.in_gaps)} in gaps", "doubt" if tally.in_gaps else "dim"),
        ]

    def _load(self, nth: int, word: str) -> Line:
        load = self._loads[nth]
        style = "bad" if load >= 90 else "doubt" if load >= CROWDED else ""
        told = f"{load:3.0f} %" if round(load) <= 100 else ">100%"
        return [(f"{word}{told}  ", style)]

    def _bytes(self, nth: int) -> Line:
        """Say where the bytes of a bus are: each is in a frame, in a gap, or was left out."""
        bus = self._status.buses[nth]
        tally = self._board.buses.get(bus.bus)
        if tally is None:
            return [(f"{counted(bus.bytes, 'byte')} read, none decoded yet", "dim")]
        out: Line = [
            (f"{counted(tally.size, 'byte')} = {tally.in_frames} in frames + ", ""),
            (f"{tally.in_gaps} in gaps", "doubt" if tally.in_gaps else ""),
        ]
        if tally.left_out:
            out.append((f" + {tally.left_out} left out", "bad"))
        return out

    def _levels(self) -> Line:
        found = self._board.troubles.severities
        if not found:
            out: Line = [("no anomalies", "dim")]
        else:
            out = [("anomalies", "bus")]
            for level, noun in LEVELS:
                style = level.name.lower() if found[level] else "dim"
                out.append((f"  {counted(found[level], noun)}", style))
        still = sum(not one.is_over for one in self._board.incidents)
        if self._board.incidents:
            out.append((f"  {counted(still, 'open incident')}", "bad" if still else "dim"))
        hint = "reply times: last 10 s"
        room = self._width - length(out) - len(hint)
        return [*out, (" " * room + hint, "dim")] if room > 1 else out

    def _asked(self) -> list[Line]:
        """Return a line on what is shown, none where that is all in the usual order."""
        if self._controls is not None and self._controls.complaint:
            return [[(fitted(plain(self._controls.complaint), self._width).rstrip(), "bad")]]
        told = []
        if self._board.watched is not None:
            told.append(f"only {plain(self._board.watched.selection.text)}")
        if self._controls is not None and (self._controls.sort != "id" or self._controls.turned):
            by = TITLES[self._controls.sort]
            told.append(f"by {by}, {'greatest' if self._controls.falls else 'least'} first")
        return [[(fitted("; ".join(told), self._width).rstrip(), "note")]] if told else []

    def footer(self) -> Line:
        """Return the last line; two cells stay free, for the terminal's echo of Ctrl-C."""
        s = self._status
        if self._controls is not None and self._controls.asking is not None:
            return self._prompt(self._controls)
        late = s.waiting > BEHIND
        tail: Line = [
            (f"  {size(s.size):>8}" if s.file else "", ""),
            (f"  {counted(s.waiting, 'byte')} waiting", "doubt" if late else "dim"),
        ]
        if self._board.left_out:
            tail.append((f"  {counted(self._board.left_out, 'frame')} not shown", "doubt"))
        tail.append((f"  {self._hint}" if self._hint else "", "dim"))
        if self._controls is not None and self._controls.held:
            tail[-1:] = [("  held, Space goes on", "doubt")]
        time = f"{clock(s.elapsed_s)}  "
        name = plain(s.file) or "not recorded"
        room = self._width - 2 - len(time) - length(tail)
        return _shortened([(time, "bus"), (_port(name, max(room, 0)), ""), *tail], self._width - 2)

    def _prompt(self, controls: Controls) -> Line:
        """Return the line in which a filter is typed; its end is seen."""
        typed = plain(controls.asking or "")
        room = max(self._width - len("only: ") - 3, 8)
        return _shortened([("only: ", "bus"), (typed[-room:] + "_", "")], self._width - 2)


def shown(incidents: Sequence[Tracked]) -> list[Tracked]:
    """Return the incidents worth a line: those that are open, then those that were not long ago."""
    still = [one for one in incidents if not one.is_over]
    over = [one for one in incidents if one.is_over]
    return [*reversed(still), *list(reversed(over))[:OVER_SHOWN]]


def columns(width: int, names: ServoNames) -> list[Column]:
    """Return the columns that a terminal of that width has room for."""
    wide = width >= WIDE
    kept = [id_column(names), *(c for c in COLUMNS[1:] if c.widths[wide])]
    for rank in range(1, max(c.drop for c in COLUMNS) + 1):
        if sum(c.widths[wide] + 1 for c in kept) + ALARMS <= width:
            break
        kept = [c for c in kept if c.drop != rank]
    return kept


def _tail(bus: BusStatus, room: int) -> Line:
    """Say what a bus speaks, in so many cells, and what state it is in."""
    state = plain(bus.state), STATES.get(bus.state, "")
    if bus.protocol is not None:
        return [(f"{plain(bus.protocol):{room}}  ", ""), state]
    if bus.state == "listening":
        return [("listening for the protocol", "doubt")]
    return [state, (", protocol not known yet", "dim")]


def _port(port: str, width: int) -> str:
    """Return a path in its place: where it is too long, its end says more than its beginning."""
    text = plain(port)
    return fitted("…" + text[len(text) - width + 1 :] if len(text) > width > 0 else text, width)


def _shortened(line: Line, width: int) -> Line:
    out: Line = []
    for text, style in line:
        out.append((text[: max(width, 0)], style))
        width -= len(text)
    return out
