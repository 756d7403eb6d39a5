"""The live board: what is on every bus now, within the height and the width of a terminal.

A line is a list of cells, texts with the name of a style: rich is handed segments and lays nothing
out, so a picture takes a few milliseconds.
"""

from __future__ import annotations

from typing import TYPE_CHECKING, Final

from rich.segment import Segment
from rich.style import Style

from sniffer.viewers.board.pages import picture
from sniffer.viewers.board.remembered import Remembered

if TYPE_CHECKING:
    from collections.abc import Sequence

    from rich.console import Console, ConsoleOptions, RenderResult

    from sniffer.tap.status import Status
    from sniffer.viewers.board.controls import Controls
    from sniffer.viewers.board.findings import Line

STYLES: Final = {
    "": Style.null(),
    "dim": Style(dim=True),
    "id": Style(bold=True),
    "title": Style(dim=True, underline=True),
    "sorted": Style(bold=True, underline=True),
    "cursor": Style(reverse=True),
    "lit": Style(bold=True),
    "bus": Style(bold=True),
    "good": Style(color="green"),
    "doubt": Style(color="yellow"),
    "bad": Style(color="red"),
    "alarm": Style(color="red", bold=True),
    "dim alarm": Style(color="red", dim=True),
    "error": Style(color="red"),
    "warn": Style(color="yellow"),
    "note": Style(color="cyan"),
}
"""Green is in order, yellow is doubtful or long past, red is wrong now; dim is old or nothing.

Black and white are the terminal's own, whichever of them is its ground.
"""


class BoardLines:
    """Lines of cells for rich: cut at a width, never wrapped."""

    def __init__(self, lines: Sequence[Line], width: int) -> None:
        self.lines = lines
        self._width = width

    def __rich_console__(self, console: Console, options: ConsoleOptions) -> RenderResult:
        for line in self.lines:
            cells = [Segment(text, STYLES[style]) for text, style in line]
            yield from Segment.adjust_line_length(cells, self._width, pad=False)
            yield Segment.line()


class Board(Remembered):
    """A sink that remembers what is now, and shows it when it is asked to."""

    controls: Controls | None = None
    """What keys have asked for; None: there are no keys."""

    def still(self) -> Board:
        """Return all that is remembered now, with the same keys."""
        out = super().still()
        out.controls = self.controls
        return out

    def render(self, status: Status, width: int, height: int) -> BoardLines:
        """Return the picture: at most ``height`` lines of at most ``width`` cells."""
        return BoardLines(picture(self, self.apart(status), width, height, self.controls), width)
