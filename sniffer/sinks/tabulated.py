"""Tables of figures in a terminal."""

from __future__ import annotations

import math
from typing import TYPE_CHECKING, Final

from rich.table import Table

if TYPE_CHECKING:
    from collections.abc import Iterable

    from rich.text import Text

ROOMY: Final = 100
"""From so many columns on there are two blanks between those of a table, and bars over time."""


class Tabulated:
    """Rows under headings: what is a word stands left and is folded, numbers stand right.

    ``whole`` are columns of words that are not folded: what is looked for by its name.
    """

    def __init__(self, *columns: str, left: Iterable[str] = (), whole: Iterable[str] = ()) -> None:
        self._columns = [*columns]
        self._left = frozenset(left)
        self._whole = frozenset(whole)
        self.rows: list[tuple[Text | str, ...]] = []

    def add_column(self, name: str, *, left: bool = False) -> None:
        """Add a column behind the others."""
        self._columns.append(name)
        self._left |= {name} if left else set()

    def add_row(self, *cells: Text | str) -> None:
        """Add a row, a cell for each column."""
        self.rows.append(cells)

    def table(self, most: int | None, width: int) -> Table:
        """Return the first rows."""
        out = Table(box=None, pad_edge=True, padding=(0, 0, 0, 2 if width >= ROOMY else 1))
        for column in self._columns:
            if column in self._whole:
                out.add_column(column, no_wrap=True)
            elif column in self._left:
                out.add_column(column, overflow="fold")
            else:
                out.add_column(column, justify="right", no_wrap=True)
        for row in self.rows[:most]:
            out.add_row(*row)
        return out


def percent(share: float) -> str:
    """Return a share in percent."""
    return f"{number(100 * share)} %"


def number(value: float) -> str:
    """Return a number with three digits, more where it is longer."""
    if value == 0:
        return "0"
    digits = max(0, 2 - math.floor(math.log10(abs(value))))
    shown = f"{value:.{min(digits, 6)}f}"
    return shown.rstrip("0").rstrip(".") if "." in shown else shown
