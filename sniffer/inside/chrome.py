"""What stands around the list and its panes: the layout, the prompt, the page of the keys."""

from __future__ import annotations

import asyncio
import signal
from typing import TYPE_CHECKING, Final

from textual.screen import ModalScreen
from textual.suggester import Suggester
from textual.widgets import Input, Static

from sniffer.ground.wording import plain
from sniffer.inside.filters import completed
from sniffer.inside.keys import KEYS, help_text

if TYPE_CHECKING:
    from collections.abc import Callable

    from textual.app import ComposeResult
    from textual.events import Key

CSS: Final = """
#top, #head, #status { height: 1; width: 100%; }
#top { background: $primary-darken-2; color: $text; text-style: bold;
       text-wrap: nowrap; text-overflow: ellipsis; }
#head { color: $text-muted; }
#list { height: 1fr; min-height: 3; overflow-x: hidden; scrollbar-size-vertical: 1; }
#below { height: 40%; min-height: 6; border-top: solid $primary; }
#detail { height: 100%; }
#fields { width: 1fr; height: 100%; border: none; padding: 0; background: $background; }
#bytes { width: 42; height: 100%; border-left: solid $primary-darken-2; padding: 0 0 0 1; }
#board, #figures { height: 100%; }
.wide #bytes { width: 74; }
#prompt { height: 1; border: none; padding: 0; display: none; }
#status { color: $text-muted; }
#status.bad { color: $error; text-style: bold; height: auto; max-height: 3; }
HelpPage { align: center middle; }
#help { width: auto; max-width: 100%; height: auto; max-height: 100%; padding: 0 1;
        background: $surface; border: round $primary; overflow-y: auto; }
"""

ASKED: Final = {
    "find": "find text, or bytes (FF 01)",
    "go": "go to: 12.5, 10min, 20:35:20.5, @12175 (byte), #300 (line), @first-error",
    "filter": "filter: servo=3,5 kind=response op=… code=no-response",
    "mark": "note for this mark",
}
"""What the prompt asks for, by action."""


NONE_SO: Final = "no line is so: f and an empty line show all again"
"""What is said of a filter that leaves nothing."""


class LineSuggester(Suggester):
    """Completes the last word of a filter line."""

    def __init__(self, known: Callable[[], dict[str, list[str]] | None]) -> None:
        """Take what returns the values by word, None while something else is asked for."""
        super().__init__(use_cache=False, case_sensitive=True)
        self._known = known

    async def get_suggestion(self, value: str) -> str | None:
        """Return the line as it would be."""
        known = self._known()
        return None if known is None else completed(value, known)


class Prompt(Input):
    """The line in which somebody says what a key has asked for."""

    def __init__(self, known: Callable[[], dict[str, list[str]] | None]) -> None:
        super().__init__(id="prompt", compact=True, suggester=LineSuggester(known))

    def open(self, what: str, text: str) -> None:
        """Ask for something; ``text`` is there already."""
        self.placeholder = ASKED[what]
        self.value = text
        self.cursor_position = len(text)
        self.display = True
        self.focus()


class StatusLine(Static):
    """The last line: what was said to who looks on, else what is wrong, else the keys."""

    def __init__(self) -> None:
        super().__init__(id="status", markup=False)
        self.said, self._is_bad = "", False
        self._drawn = "", False

    def say(self, text: str, *, bad: bool = False) -> None:
        """Say something until something else is said; empty: nothing any more."""
        self.said, self._is_bad = text, bad

    def show(self, wrong: str) -> None:
        """Draw it; ``wrong`` is what is wrong meanwhile, if anything is."""
        told, bad = (self.said, self._is_bad) if self.said else (wrong, bool(wrong))
        now = plain(told) or "  ".join(f"{k.shown} {k.word}" for k in KEYS if k.word), bad
        if now != self._drawn:
            self._drawn = now
            self.set_class(bad, "bad")
            self.update(now[0])


class HelpPage(ModalScreen[None]):
    """The keys."""

    def compose(self) -> ComposeResult:
        """Show them."""
        yield Static(help_text(), id="help", markup=False)

    def on_key(self, event: Key) -> None:
        """Close; the key does nothing else."""
        event.stop()
        event.prevent_default()
        self._close()

    def on_click(self) -> None:
        """Close."""
        self._close()

    def _close(self) -> None:
        """Close, once: keys that came together with the one that did it are for nobody."""
        if self.is_current:
            self.dismiss()


def exits_on_signals(leave: Callable[[], None]) -> None:
    """Have the system's polite requests to end be answered by the screen that runs."""
    loop = asyncio.get_running_loop()
    for name in ("SIGTERM", "SIGHUP", "SIGINT"):
        number = getattr(signal, name, None)
        if number is not None:
            try:
                loop.add_signal_handler(number, leave)
            except (NotImplementedError, RuntimeError):
                # loops have no handlers on Windows (the first), nor in any thread but the main one
                # (the second): there the system ends the program in its own way
                return
