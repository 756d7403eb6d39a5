"""What of the board is shown, and how keys change it."""

from __future__ import annotations

from dataclasses import dataclass, field
from typing import TYPE_CHECKING, Final

from sniffer.ground.model import InputError
from sniffer.ground.wording import one_line
from sniffer.selection.selection import complaint
from sniffer.viewers.board.watched import selection_in

if TYPE_CHECKING:
    from sniffer.viewers.board.remembered import Remembered

HELP: Final = (
    ("Space", "hold the picture; listening and recording go on"),
    ("s  S", "sort by the next column, by the one before; r: other way round"),
    ("f", "show some servos and anomalies only: servo=3,5 code=no-response,"),
    ("", "or an expression such as value > 60 AND quantity = 'temperature';"),
    ("", "empty: all again"),
    ("↑ ↓  k j", "choose a servo"),
    ("Enter", "all its registers, and what was wrong with it; Esc: back"),
    ("?", "these keys, and back"),
    ("Ctrl-C", "end the recording"),
)
"""Keys and what they do."""

SORTED: Final = ("id", "error", "missing", "p99", "temperature", "load", "voltage", "rate")
"""By what servos are sorted, one after the other."""

PROMPT_MOST: Final = 400
"""Signs of a filter line at most."""


@dataclass(slots=True)
class Controls:
    """What keys have asked for; changed by ``press`` only, and read by whoever draws."""

    sort: str = "id"
    turned: bool = False
    held: bool = False
    """The picture stands still."""
    helps: bool = False
    asking: str | None = None
    """What stands in the prompt; None: there is none."""
    complaint: str = ""
    cursor: tuple[str, int] | None = None
    """Bus and id of the chosen servo."""
    opened: tuple[str, int] | None = None
    """Of the servo whose page is shown."""
    rows: list[tuple[str, int]] = field(default_factory=list)
    """The servos of the last picture, from above; whoever draws sets it."""

    @property
    def is_sorted(self) -> bool:
        """Whether somebody asks for an order."""
        return self.sort != "id" or self.turned

    @property
    def falls(self) -> bool:
        """Whether the greatest stands first, which is usual for all but ids."""
        return (self.sort != "id") != self.turned

    def press(self, key: str, board: Remembered) -> None:
        """Do what a key says; keys that say nothing are left out."""
        self.complaint = ""
        if self.asking is not None:
            self._type(key, board)
            return
        match key:
            case "space":
                self.held = not self.held
            case "s" | "S":
                by = 1 if key == "s" else -1
                self.sort = SORTED[(SORTED.index(self.sort) + by) % len(SORTED)]
                self.turned = False
            case "r":
                self.turned = not self.turned
            case "f" | "/":
                self.asking = "" if board.watched is None else board.watched.selection.text
            case "up" | "k" | "down" | "j":
                self._move(-1 if key in ("up", "k") else 1)
            case "enter" if self.cursor is not None:
                self.opened = self.cursor
            case "esc":
                self.helps, self.opened = False, None
            case "?":
                self.helps = not self.helps

    def _move(self, by: int) -> None:
        """Choose another servo; on a servo's page that of the next one is shown."""
        if not self.rows:
            return
        at = self.rows.index(self.cursor) + by if self.cursor in self.rows else 0
        self.cursor = self.rows[at % len(self.rows)]
        if self.opened is not None:
            self.opened = self.cursor

    def _type(self, key: str, board: Remembered) -> None:
        text = self.asking or ""
        match key:
            case "esc":
                self.asking = None
            case "backspace":
                self.asking = text[:-1]
            case "clear":
                self.asking = ""
            case "enter":
                try:
                    board.watch(selection_in(text, board.names))
                    self.asking, self.held = None, False  # it is about what comes
                except InputError as error:
                    self.complaint = one_line(complaint(error))
            case "space":
                self.asking = text + " "
            case _ if len(key) == 1:
                self.asking = (text + key)[:PROMPT_MOST]
