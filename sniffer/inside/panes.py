"""What stands below the list: fields, bytes, servos, figures."""

from __future__ import annotations

import math
import time
from typing import TYPE_CHECKING, Final

from rich.cells import cell_len, set_cell_size
from rich.table import Table
from rich.text import Text
from textual.containers import VerticalScroll
from textual.widgets import OptionList, Static
from textual.widgets.option_list import Option

from sniffer.ground.wording import plain
from sniffer.inside.figures import figures_of
from sniffer.inside.moment import SHOWN, TITLES
from sniffer.inside.table import SEVERITIES

if TYPE_CHECKING:
    from rich.console import JustifyMethod

    from sniffer.inside.detail import Detail, DetailField, DetailPart
    from sniffer.inside.figures import ShownCode, ShownFigures, ShownServo
    from sniffer.inside.moment import MomentRow
    from sniffer.inside.view import LineView

LIT: Final = "reverse bold"
CHANGED: Final = "magenta bold underline"
"""How the bytes of the selected field look, and those that the last like frame had not."""

AGAIN_S: Final = 1.0
AGAIN: Final = 10.0
"""Lines that come are counted anew after so long at the soonest, or so many times what it took."""

SPARED: Final = ("speed", "current", "age", "temp", "load", "error", "voltage", "goal")
"""Columns of servos that are left out where there is no room, these first."""

ROWS_MOST: Final = 400
"""Lines of bytes that are drawn of one frame: no frame has more."""


class FieldPane(OptionList):
    """The fields of a line; moving in it lights their bytes."""

    def __init__(self) -> None:
        super().__init__(id="fields", markup=False)
        self.detail: Detail | None = None

    def show(self, detail: Detail | None) -> None:
        """Show the fields of a line."""
        same = self.detail is not None and detail is not None and _alike(self.detail, detail)
        at = self.highlighted if same else None
        self.detail = detail
        self.clear_options()
        if detail is not None:
            self.add_options([Option(_field(f)) for f in detail.fields])
            self.highlighted = at if at is not None else 0

    @property
    def chosen(self) -> DetailField | None:
        """The field under the cursor."""
        if self.detail is None or self.highlighted is None:
            return None
        fields = self.detail.fields
        return fields[self.highlighted] if self.highlighted < len(fields) else None


class TextPane(VerticalScroll):
    """A pane of text that scrolls."""

    def __init__(self, name: str) -> None:
        self._text = Static(id=f"{name}-text", markup=False)  # it is asked while all is closed, too
        super().__init__(self._text, id=name)

    def show(self, what: Text | Table | str) -> None:
        """Show this."""
        self._text.update(what)


class FiguresPane(TextPane):
    """What is counted of the lines that are shown, by a thread of its own."""

    def __init__(self, name: str) -> None:
        super().__init__(name)
        self._counted: object = None
        self._rests_until = 0.0

    def keep_up(self, view: LineView) -> None:
        """If it is looked at, count the lines shown where others were counted last."""
        of = view.filter, view.exchanges, view.count
        if not self.display or of == self._counted or time.monotonic() < self._rests_until:
            return
        if self._counted is None:
            self.show("counting …")
        self._counted = of
        index, numbers = view.index, view.frames()
        self._rests_until = math.inf

        def counted() -> None:
            began = time.monotonic()
            text = figures_text(figures_of(index, numbers))
            took = time.monotonic() - began
            self.app.call_from_thread(self._told, text, max(AGAIN_S, AGAIN * took))

        self.run_worker(counted, thread=True, exclusive=True, group="figures")

    def _told(self, text: Text, rest_s: float) -> None:
        self.show(text)
        self._rests_until = time.monotonic() + rest_s


def bytes_text(detail: Detail | None, chosen: DetailField | None, width: int) -> Text:
    """Return the bytes of a line, with those of a field lit, and those that changed."""
    out = Text()
    if detail is None:
        return out
    per_row = 16 if width >= 6 + 16 * 4 else 8
    for i, part in enumerate(detail.parts):
        if len(detail.parts) > 1:
            out.append(f"{part.drawn.title}\n", "bold")
        lit = range(0)
        if chosen is not None and chosen.part == i and not chosen.is_title:
            lit = range(chosen.offset, chosen.offset + chosen.length)
        _dump(out, part, lit, per_row)
        if part.like >= 0:
            n = len(part.changed)
            told = f"{n} byte{'s' * (n != 1)} changed" if n else "no byte changed"
            out.append(f"{told} since the last like frame, {part.like_ns / 1e6:.1f} ms\n", "dim")
    return out


def _dump(out: Text, part: DetailPart, lit: range, per_row: int) -> None:
    raw = part.drawn.raw
    for begin in range(0, min(len(raw), ROWS_MOST * per_row), per_row):
        row = raw[begin : begin + per_row]
        out.append(f"{begin:04X} ", "dim")
        for k in range(per_row):
            if k < len(row):
                style = _style(begin + k, part, lit)
                # the blank between two bytes of one field is lit, too
                out.append(" ", style if begin + k - 1 in lit and begin + k in lit and k else "")
                out.append(f"{row[k]:02X}", style)
            else:
                out.append("   ")
        out.append("  ")
        for k, byte in enumerate(row):
            out.append(chr(byte) if 32 <= byte < 127 else "·", _style(begin + k, part, lit))
        out.append("\n")


def _style(at: int, part: DetailPart, lit: range) -> str:
    changed = CHANGED if at in part.changed else ""
    return f"{changed} {LIT}".strip() if at in lit else changed


def _field(field: DetailField) -> Text:
    style = "bold" if field.is_title else SEVERITIES[field.severity]
    return Text(plain(field.text), style=style)


def _alike(before: Detail, now: Detail) -> bool:
    """Tell whether a place among the fields of one means the same among those of the other."""

    def names(detail: Detail) -> list[tuple[int, int, int]]:
        return [(f.part, f.offset, f.length) for f in detail.fields]

    return names(before) == names(now)


def moment_table(rows: list[MomentRow], width: int) -> Table | str:
    """Return the servos of a moment; what has no room is left out, for a cut number is a wrong one.

    Without room for all columns, those of ``SPARED`` go one after the other.
    """
    if not rows:
        return "No servo has told a value yet."
    titles = [TITLES.get(q, q) for q in SHOWN]
    titles.insert(titles.index("goal") + 1, "error")
    named = any(row.who != str(row.servo) for row in rows if row.servo >= 0)
    columns = {
        "bus": [plain(row.bus) for row in rows],
        "servo": [plain(row.who) if row.servo >= 0 else "-" for row in rows],
        **{title: [row.cells.get(title, "") for row in rows] for title in titles},
        "age": [_age(row.age_s) for row in rows],
    }
    columns = {title: cells for title, cells in columns.items() if any(cells)}
    if len(set(columns["bus"])) < 2:
        del columns["bus"]
    for title in ("", *SPARED):
        columns.pop(title, None)
        if sum(max(map(cell_len, (t, *cells))) + 1 for t, cells in columns.items()) - 1 <= width:
            break
    out = Table(box=None, pad_edge=False, padding=(0, 1, 0, 0))
    for title in columns:
        is_word = title == "bus" or (named and title == "servo")
        side: JustifyMethod = "left" if is_word else "right"
        out.add_column(title, justify=side, no_wrap=True)
    for cells in zip(*columns.values(), strict=True):
        out.add_row(*cells)
    return out


def _age(seconds: float) -> str:
    return f"{seconds * 1000:.0f} ms" if seconds < 10 else f"{seconds:.0f} s"


def figures_text(figures: ShownFigures) -> Text:
    """Return what was counted."""
    out = Text()
    out.append(
        f"{figures.frames} frames, {figures.gaps} gaps, {figures.span_s:.3f} s; "
        f"{figures.bytes} bytes, {figures.bytes_in_gaps} in no frame\n"
    )
    told: list[ShownServo | ShownCode] = [*figures.servos, *figures.codes]
    buses = {plain(one.bus) for one in told}
    bus_room = max(3, *map(cell_len, buses)) + 2 if len(buses) > 1 else 0
    room = max((cell_len(plain(one.who)) for one in told if " " in one.who), default=5)

    def whose(bus: str, who: str) -> str:
        name = set_cell_size(who, room) if room > len("servo") else f"{who:>5}"
        return f"{set_cell_size(bus, bus_room)}{name}"

    title = whose("bus", "servo")
    out.append(f"{title}  requests answers  missing  median    worst\n", "bold")
    for s in figures.servos:
        who = whose(plain(s.bus), plain(s.who))
        style = "red" if s.missing else ""
        out.append(
            f"{who}  {s.requests:<7}  {s.answers:<7}  {s.missing:<7}  {s.median:<8}  {s.worst}\n",
            style,
        )
    if figures.codes:
        out.append(f"{'found':<29}  {title}  times   first in line\n", "bold")
    for c in figures.codes:
        who = whose(plain(c.bus), plain(c.who))
        out.append(f"{c.code:<29}  {who}  {c.count:<6}  #{c.line + 1}\n", SEVERITIES[c.severity])
    return out
