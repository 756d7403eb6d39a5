"""The list: as many lines are made as the screen shows."""

from __future__ import annotations

from typing import TYPE_CHECKING, ClassVar, Final

from rich.cells import cell_len, set_cell_size
from rich.segment import Segment
from rich.style import Style
from textual.binding import Binding
from textual.geometry import Size
from textual.message import Message
from textual.scroll_view import ScrollView
from textual.strip import Strip

from sniffer.ground.moments import of_day
from sniffer.inside.words import DELTA, TIMES, LineWords, line_words, since
from sniffer.sinks.words import fit, told_apart

if TYPE_CHECKING:
    from textual import events

    from sniffer.inside.view import LineView

WIDE: Final = 120
"""From this width on there are columns for the bus and the offset, and microseconds."""

NAMES: Final = 24
"""Columns that ids with names have at most, where there are wide ones: the field pane has all."""

SHORT_NAMES: Final = 14
"""Columns of these in a narrow terminal, where the bus has none of its own beside them."""

WORDS_KEPT: Final = 512
"""Lines whose words are kept: some screens."""

SEVERITIES: Final = ("", "cyan", "yellow", "red")
"""Colours by severity + 1."""

_ANSWER: Final = Style(color="green")
_PLAIN: Final = Style()
_MARK: Final = Style(color="magenta", bold=True)


class FrameList(ScrollView, can_focus=True):
    """Lines of a view; ``cursor`` is a position in it."""

    BINDINGS: ClassVar = [
        Binding("up,k", "move(-1)", show=False),
        Binding("down,j", "move(1)", show=False),
        Binding("pageup", "page(-1)", show=False),
        Binding("pagedown", "page(1)", show=False),
        Binding("home", "edge(0)", show=False),
        Binding("end,G", "edge(1)", show=False),
        Binding("left", "sideways(-8)", show=False),
        Binding("right", "sideways(8)", show=False),
    ]

    class Moved(Message):
        """The cursor stands elsewhere; ``by_hand``: somebody moved it."""

        def __init__(self, *, by_hand: bool) -> None:
            super().__init__()
            self.by_hand = by_hand

    def __init__(self, view: LineView) -> None:
        super().__init__(id="list")
        self.view = view
        self.cursor = 0
        self.times = 0
        """How times are told: a number of ``words.TIMES``."""
        self.marked: dict[int, str] = {}
        """Notes by line."""
        self.marks_ns: list[int] = []
        self._shift = 0
        self._words: dict[tuple[int, bool], LineWords] = {}
        self._known = -1

    @property
    def line(self) -> int:
        """The number of the line under the cursor, -1 where there is none."""
        return self.view.line(self.cursor) if 0 <= self.cursor < self.view.count else -1

    def heading(self, width: int) -> str:
        """Return the titles of the columns."""
        titles = (" ", "", "id", " ", "command", "values", "verdict", "offset")
        if not self._has_names(width):
            titles = (" ", "bus", *titles[2:])
        return self._laid(titles, TIMES[self.times], width, shift=0)

    def grown(self) -> None:
        """Show what has come, or what is shown now."""
        count = self.view.count
        if count != self._known:
            self._known = count
            self.virtual_size = Size(self.size.width, count)
            self.refresh()

    def afresh(self) -> None:
        """Forget what lines looked like."""
        self._words.clear()
        self._known = -1
        self.grown()

    def go(self, position: int, *, by_hand: bool = True, middle: bool = False) -> None:
        """Put the cursor somewhere, and have it in sight."""
        if not self.view.count:
            return
        self.grown()
        self.cursor = min(max(position, 0), self.view.count - 1)
        top, height = self.scroll_offset.y, max(self.size.height, 1)
        if not top <= self.cursor < top + height:
            step = abs(self.cursor - (top if self.cursor < top else top + height - 1))
            first = self.cursor if self.cursor < top else self.cursor - height + 1
            if middle or step > 1:
                first = self.cursor - height // 2 if step > height or middle else first
            self.scroll_to(y=max(first, 0), animate=False, force=True)
        self.refresh()
        self.post_message(self.Moved(by_hand=by_hand))

    def action_move(self, by: int) -> None:
        """Go some lines on."""
        self.go(self.cursor + by)

    def action_page(self, by: int) -> None:
        """Go a screen on."""
        height = max(self.size.height - 1, 1)
        self.scroll_to(y=self.scroll_offset.y + by * height, animate=False, force=True)
        self.go(self.cursor + by * height)

    def action_edge(self, last: int) -> None:
        """Go to the first or the last line."""
        self.go(self.view.count - 1 if last else 0)

    def action_sideways(self, by: int) -> None:
        """Show what the values column has no room for."""
        self._shift = max(self._shift + by, 0)
        self.refresh()

    def on_click(self, event: events.Click) -> None:
        """Put the cursor under the mouse."""
        position = event.y + self.scroll_offset.y
        if 0 <= position < self.view.count:
            self.go(position)

    def on_resize(self) -> None:
        """Have the cursor in sight."""
        self._known = -1
        self.grown()
        if self.view.count:
            self.go(self.cursor, by_hand=False)

    def render_line(self, y: int) -> Strip:
        """Return one line of the screen."""
        width = self.size.width
        position = y + self.scroll_offset.y
        if position >= self.view.count:
            return Strip.blank(width, self.rich_style)
        number = self.view.line(position)
        words = self._of(number)
        text = self._laid(
            (
                "◆" if number in self.marked else " ",
                words.bus,
                words.servo,
                words.kind,
                words.op,
                words.values,
                words.verdict,
                str(words.offset),
            ),
            self._time(position, words),
            width,
            shift=self._shift,
        )
        style = _PLAIN
        if words.severity:
            style = Style(color=SEVERITIES[words.severity])
        elif words.kind == "<":
            style = _ANSWER
        if position == self.cursor:
            style += Style(reverse=True, bold=self.has_focus)
        first = Segment(text[:1], style + _MARK if number in self.marked else style)
        return Strip([first, Segment(text[1:], style)], width).apply_style(self.rich_style)

    def _of(self, number: int) -> LineWords:
        key = number, self.view.exchanges
        found = self._words.get(key)
        # what is found later colours a line, and answers come behind requests
        is_late = number > len(self.view.index.lines) - WORDS_KEPT
        if found is None or is_late:
            if len(self._words) > WORDS_KEPT:
                self._words.clear()
            exchange = self.view.exchanges
            found = self._words[key] = line_words(self.view.index, number, exchange=exchange)
        return found

    def _time(self, position: int, words: LineWords) -> str:
        if self.times == DELTA:
            if not position:
                return since(0)
            before = self.view.index.lines["t"][self.view.line(position - 1)]
            return since(words.t_ns - int(before))
        if self.times:
            earlier = [t for t in self.marks_ns if t <= words.t_ns]
            first = max(earlier, default=int(self.view.index.lines["t"][0]))
            return since(words.t_ns - first)
        if not self.view.index.has_clock:
            return since(words.t_ns)
        return of_day(words.t_ns, 6 if self.size.width >= WIDE else 3)

    def _has_names(self, width: int) -> bool:
        """Tell whether names stand in place of the bus: a narrow terminal has no room for both."""
        return width < WIDE and bool(self.view.index.names)

    def _who(self, servo: str, bus: str, *, wide: bool) -> str:
        """Return an id in its column, with its name where servos have names.

        In a narrow terminal who has none is told by the bus, where there are several.
        """
        buses = self.view.index.buses
        names = [*self.view.index.names.known, *([] if wide or len(buses) < 2 else buses)]
        number, _, name = servo.partition(" ")
        if not self.view.index.names:
            return number.rjust(3)
        room = min(max(map(cell_len, names)), (NAMES if wide else SHORT_NAMES) - 4)
        told = told_apart({name: name for name in names}, room)
        name = name or ("" if wide else bus)
        return set_cell_size(f"{number:>3} {told.get(name, name)}", room + 4)

    def _laid(self, cells: tuple[str, ...], time: str, width: int, *, shift: int) -> str:
        """Lay cells out; the values get what is left of the width."""
        mark, bus, servo, kind, op, values, verdict, offset = cells
        several = len(self.view.index.buses) > 1
        wide = width >= WIDE
        before = [mark + time.rjust(15 if wide else 12)]
        if several and not self._has_names(width):
            before.append(fit(bus, 8 if wide else 5))
        if wide:
            before.append(offset.rjust(10))
        before += [
            self._who(servo, bus if several else "", wide=wide),
            kind,
            fit(op, 19 if wide else 15),
        ]
        head, tail = " ".join(before), fit(verdict, 18 if wide else 13)
        room = max(width - cell_len(head) - cell_len(tail) - 2, 8)
        return set_cell_size(f"{head} {fit(values[shift:], room)} {tail}", width)
