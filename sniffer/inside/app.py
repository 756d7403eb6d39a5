"""The screen of ``sniffer open``: keys and clicks to what is shown, and nothing that takes long.

What takes long is done in steps between two pictures (``_tick``): filtering, searching. The capture
is read and decoded in threads of its own (``reading.py``).
"""

from __future__ import annotations

from functools import partial
from typing import TYPE_CHECKING, ClassVar, Final

from textual.app import App, ComposeResult
from textual.binding import Binding
from textual.containers import Horizontal
from textual.widgets import ContentSwitcher, Input, OptionList, Static

from sniffer.ground.model import InputError, OutputError, SnifferError
from sniffer.ground.wording import plain
from sniffer.inside.chrome import CSS, NONE_SO, HelpPage, Prompt, StatusLine, exits_on_signals
from sniffer.inside.columns import ERROR, WARN
from sniffer.inside.detail import detail_of
from sniffer.inside.filters import completions, filter_of
from sniffer.inside.keys import KEYS
from sniffer.inside.moment import moment_of
from sniffer.inside.notes import Notes
from sniffer.inside.panes import FieldPane, FiguresPane, TextPane, bytes_text, moment_table
from sniffer.inside.places import line_of
from sniffer.inside.search import Search
from sniffer.inside.table import FrameList
from sniffer.inside.view import FOLLOWS_S, SETTLES_S, LineView
from sniffer.inside.words import TIMES
from sniffer.selection.selection import complaint

if TYPE_CHECKING:
    from pathlib import Path

    from textual.events import Resize

    from sniffer.inside.reading import Reading
    from sniffer.inside.recorder import BesideRecorder

TICK_S: Final = 0.05
"""How often it is looked for what has come, in seconds."""


class LookingGlass(App[None]):
    """A capture on the screen.

    Args:
        reading: what is shown; it is begun already.
        name: of the capture.
        marks: the file that marks are kept in.
        follow: stay at the last line from the beginning.
        recorder: what writes the capture, where a port is shown.
        wanted: which lines are shown from the beginning, as the filter line has it.
        start: where the cursor begins, as ``g`` takes it; it goes there once that was read.
    """

    CSS = CSS
    ENABLE_COMMAND_PALETTE = False
    BINDINGS: ClassVar = [
        Binding(k, key.action, key.word, show=False, priority=k.startswith("ctrl+"))
        for key in KEYS
        for k in key.keys.split(",")
    ]

    def __init__(
        self,
        reading: Reading,
        *,
        name: str,
        marks: Path | None = None,
        follow: bool = False,
        recorder: BesideRecorder | None = None,
        wanted: str = "",
        start: str = "",
    ) -> None:
        super().__init__()
        self.reading = reading
        self.index = reading.index
        self.view = LineView(self.index)
        self.asking = ""  # what the prompt asks for; empty: it is not there
        self.notes = Notes(marks)
        # kept by name: another screen may stand above theirs
        self.top, self.head = Static(id="top", markup=False), Static(id="head", markup=False)
        self.list, self.fields, self.bytes = FrameList(self.view), FieldPane(), TextPane("bytes")
        self.board, self.figures = TextPane("board"), FiguresPane("figures")
        self.below = ContentSwitcher(initial="detail", id="below")
        self.prompt = Prompt(self._known)
        self.status = StatusLine()
        self._title = plain(name)
        self.title = f"sniffer open {self._title}"
        self._follow, self._recorder = follow, recorder
        self._wanted: int | None = None
        self._search: Search | None = None
        self._found_last, self._filter_text, self._start = "", wanted, start
        self._topped, self._is_due = ("", ""), False

    def compose(self) -> ComposeResult:
        """Lay out the screen."""
        yield self.top
        yield self.head
        yield self.list
        with self.below:
            with Horizontal(id="detail"):
                yield self.fields
                yield self.bytes
            yield self.board
            yield self.figures
        yield self.prompt
        yield self.status

    def on_mount(self) -> None:
        """Begin to look for what comes; end politely where the system asks for it."""
        exits_on_signals(self.exit)
        self.list.focus()
        if self._filter_text:
            self._choose(self._filter_text)
        try:
            self.notes.load()
        except SnifferError as error:
            self.say(str(error), bad=True)
        self.set_interval(TICK_S, self._tick)
        self._tick()

    def _known(self) -> dict[str, list[str]] | None:
        return completions(self.index) if self.asking == "filter" else None

    def say(self, text: str, *, bad: bool = False) -> None:
        """Say something in the last line, in place of the keys."""
        self.status.say(text, bad=bad)
        self._status()

    def _tick(self) -> None:
        """Show what has come since; go on with what takes long."""
        line = self.list.line
        self.view.steps()
        if self._wanted is None and line not in (-1, self.list.line) and not self._follow:
            self._wanted = line  # one before it came or went
        before = self.list.virtual_size.height
        self.list.grown()
        if self._wanted is not None and self.view.knows(self._wanted):
            wanted, self._wanted = self._wanted, None
            self.list.go(self.view.position(wanted), by_hand=False, middle=True)
        elif self.view.count != before and (self._follow or not before):
            self.list.go(self.view.count - 1 if self._follow else self.list.cursor, by_hand=False)
        if self._start:
            self._begin_there()
        if self._search is not None:
            self._look_on()
        self.list.marked = self.notes.lines(self.index)
        self.list.marks_ns = [mark.t_ns for mark in self.notes.marks]
        if count := len(self.index.lines):
            self.reading.go_on()
        if self.reading.failure is not None and not count:
            self.exit()
            return
        self.figures.keep_up(self.view)
        self._top()
        self._status()

    def _top(self) -> None:
        r, count = self.reading, self.view.count
        spoken = "+".join(dict.fromkeys(p.name for p in self.index.protocols)) or "?"
        shown = f"{count} of {len(self.index.lines)}" if not self.view.is_whole else f"{count}"
        told = [self._title, spoken, f"line {self.list.cursor + 1 if count else 0} of {shown}"]
        if self._filter_text:
            told.append(f"filter {self._filter_text}")
        if not r.done:
            told.append("following" if self._follow else "live" if r.growing else "reading …")
        if self.view.is_behind:
            told.append("filtering …")
        if self.view.held is not None:
            told.append("PAUSED")
        drawn = "  ".join(told), self.list.heading(self.list.size.width or 80)
        if drawn != self._topped:  # each is laid out anew: for nothing where nothing has come
            self._topped = drawn
            self.top.update(drawn[0], layout=False)
            self.head.update(drawn[1], layout=False)

    def _status(self) -> None:
        wrong = self.reading.problem or ""
        if self._recorder is not None and self._recorder.has_ended:
            wrong = f"the recording has ended: {self._recorder.said}"
        is_empty = self._filter_text and not self.view.count and not self.view.is_behind
        self.status.show(wrong or (NONE_SO if is_empty else ""))

    def on_frame_list_moved(self, event: FrameList.Moved) -> None:
        """Have the panes follow the cursor."""
        if event.by_hand:
            self._start = ""
            self.status.say("")
            self._follow = self._follow and self.list.cursor >= self.view.count - 1
        if not self._is_due:
            self._is_due = True
            self.set_timer(FOLLOWS_S if self._follow else SETTLES_S, self._show)

    def _show(self) -> None:
        """Show what is under the cursor in the pane that is open."""
        self._is_due = False
        line, pane = self.list.line, self.below.current
        if line < 0:
            return
        self._top()
        if pane == "detail":
            detail = detail_of(self.index, line, exchange=self.view.exchanges)
            self.fields.show(detail)
            self._light()
        elif pane == "board":
            room = self.board.scrollable_content_region.width or self.size.width
            self.board.show(moment_table(moment_of(self.index, line), room))

    def _light(self) -> None:
        fields, pane = self.fields, self.bytes
        pane.show(bytes_text(fields.detail, fields.chosen, pane.size.width))

    def on_option_list_option_highlighted(self, event: OptionList.OptionHighlighted) -> None:
        """Light the bytes of the field."""
        self._light()

    def on_resize(self, event: Resize) -> None:
        """Give the bytes room where there is some; the size of the app is still the one before."""
        self.set_class(event.size.width >= 120, "wide")
        self.screen.set_class(event.size.width >= 120, "wide")
        self._top()
        self.call_after_refresh(self._show)

    def action_help(self) -> None:
        """Show the keys."""
        self.push_screen(HelpPage())

    def action_wrong(self, by: int, least: int = 0) -> None:
        """Go to the next or previous finding: errors, or warnings where there is no error."""
        back = by < 0
        for severity in [least] if least else [ERROR, WARN]:
            at = self.view.next_wrong(self.list.cursor, severity, back=back)
            if at >= 0:
                self.list.go(at, middle=True)
                return
            if self.view.next_wrong(self.list.cursor, severity, back=not back) >= 0:
                break  # there are some on the other side
        self.say(f"nothing more is wrong {'before' if back else 'behind'} this line")

    def action_ask(self, what: str) -> None:
        """Open the prompt; a mark that is there is taken away instead."""
        if what == "mark":
            if self.list.line < 0:
                return
            if self.list.line in self.list.marked:
                self._noted(partial(self.notes.remove, self.index, self.list.line))
                return
        self.asking = what
        known = {"filter": self._filter_text, "find": self._found_last}
        self.status.display = False
        self.prompt.open(what, known.get(what, ""))

    def on_input_submitted(self, event: Input.Submitted) -> None:
        """Do what was asked for."""
        asked, text = self.asking, event.value
        self._close_prompt()
        try:
            if asked == "filter":
                self._choose(text)
            elif asked == "go":
                self._go(line_of(text, self.index, self._bus, self.view))
            elif asked == "find":
                self._find(text)
            else:
                self._noted(partial(self.notes.add, self.index, self.list.line, text.strip()))
        except InputError as error:
            self.say(complaint(error), bad=True)

    @property
    def _bus(self) -> int:
        return int(self.index.lines["bus"][self.list.line]) if self.list.line >= 0 else 0

    def _close_prompt(self) -> None:
        self.asking = ""
        self.prompt.display = False
        self.status.display = True
        self.list.focus()

    def _choose(self, text: str | None = None, *, exchanges: bool | None = None) -> None:
        """Show other lines, and stay where we are.

        Raises:
            InputError: that is no filter.
        """
        chosen = self.view.filter if text is None else filter_of(text, self.index.names)
        kept = max(self.list.line, 0)
        if text is not None:
            self._filter_text = plain(text.strip())
        self._search = None  # it was one of other lines
        self.view.choose(chosen, exchanges=self.view.exchanges if exchanges is None else exchanges)
        self.status.say("")
        self._wanted, self.list.cursor = kept, 0
        self.view.steps()
        self.list.afresh()
        self._tick()

    def _begin_there(self) -> None:
        """Go where the cursor is to begin, as soon as that was read."""
        is_read = self.reading.done
        try:
            line = line_of(self._start, self.index, view=self.view, is_read=is_read)
        except InputError as error:
            if is_read and not self.view.is_behind:
                self._start = ""
                self.say(complaint(error), bad=True)
            else:
                self.say(f"looking for {self._start} …")
            return
        if self.view.knows(line):
            self._start = ""
            self.status.say("")
            self._go(line)

    def _go(self, line: int) -> None:
        self._follow = False
        self.list.go(self.view.position(line), middle=True)

    def _find(self, text: str) -> None:
        self._found_last = text
        if text.strip():
            self._search = Search(self.view, self.list.cursor, text)

    def _look_on(self) -> None:
        """Search for a while; go where something was found."""
        assert self._search is not None
        at = self._search.steps()
        if at is None:
            self.say(f"searching … {self._search.done:.0%}, Esc stops it")
            return
        text, self._search = self._search.text, None
        self.status.say("")
        if at < 0:
            self.say(f"{plain(text)!r} is nowhere in the lines shown")
        else:
            self.list.go(at, middle=True)

    def _noted(self, change: partial[None]) -> None:
        try:
            change()
        except OutputError as error:
            self.say(str(error), bad=True)
        self.list.marked = self.notes.lines(self.index)
        self.list.refresh()

    def action_next_mark(self) -> None:
        """Go to the next mark, the first one behind the last."""
        lines = sorted(self.list.marked)
        if not lines:
            self.say("there is no mark yet: m sets one")
            return
        after = [line for line in lines if line > self.list.line]
        line = after[0] if after else lines[0]
        self._go(line)
        self.call_after_refresh(self.say, f"◆ {self.list.marked[line]}")

    def action_exchanges(self) -> None:
        """Show frames, or exchanges."""
        self._choose(exchanges=not self.view.exchanges)

    def action_times(self) -> None:
        """Tell times in the next way."""
        self.list.times = (self.list.times + 1) % len(TIMES)
        self.list.refresh()
        self._top()

    def action_pane(self, name: str) -> None:
        """Show a pane, or the fields again."""
        below = self.below
        below.current = "detail" if below.current == name else name
        self._show()

    def action_follow(self) -> None:
        """Stay at the last line, or no more."""
        self._follow = not self._follow
        if self._follow:
            self.view.pause(False)
            self.list.go(self.view.count - 1, by_hand=False)
        self._top()

    def action_pause(self) -> None:
        """Hold the list, or let it go on."""
        self.view.pause(self.view.held is None)
        self._top()

    def action_away(self) -> None:
        """Close the prompt, stop the search, or show the fields."""
        if self.asking:
            self._close_prompt()
        elif self._search is not None:
            self._search = None
            self.say("the search was stopped")
        else:
            self.below.current = "detail"
            self.status.say("")
            self._show()
            self.list.focus()
