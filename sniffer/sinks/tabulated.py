"""Tables of figures in a terminal."""

from __future__ import annotations

import math
from itertools import zip_longest
from typing import TYPE_CHECKING, Final, NamedTuple

from rich.table import Table
from rich.text import Text

from sniffer.sinks.consoles import GLUE, glued

if TYPE_CHECKING:
    from collections.abc import Iterable, Mapping, Sequence

ROOMY: Final = 100
"""From so many columns on there are two blanks between those of a table, and bars over time."""


class ServoCell(NamedTuple):
    """Whose a row is, and that with what servos are called, for tables that have the room."""

    who: str
    named: str

    def __str__(self) -> str:
        return self.named


class Tabulated:
    """Rows under headings: what is a word stands left and is folded, numbers stand right.

    ``whole`` are columns of words that are not folded, unless they take more than half of the
    width: what is looked for by its name.
    """

    def __init__(self, *columns: str, left: Iterable[str] = (), whole: Iterable[str] = ()) -> None:
        self._columns = [*columns]
        self._left = frozenset(left)
        self._whole = frozenset(whole)
        self.rows: list[tuple[Text | str | ServoCell, ...]] = []

    def add_column(self, name: str, *, left: bool = False) -> None:
        """Add a column behind the others."""
        self._columns.append(name)
        self._left |= {name} if left else set()

    def add_row(self, *cells: Text | str | ServoCell) -> None:
        """Add a row, a cell for each column."""
        self.rows.append(cells)

    def lacks_names(self, most: int | None, width: int) -> bool:
        """Tell whether the first rows have no room for names of servos: no word would be whole."""
        rows = self.rows[:most]
        if not any(isinstance(cell, ServoCell) for row in rows for cell in row):
            return False
        return not self._has_room(rows, width)

    def _has_room(self, rows: Sequence[Sequence[Text | str | ServoCell]], width: int) -> bool:
        """Tell whether no word of these rows has to be broken."""
        cells = [*zip_longest(*rows, fillvalue=""), *([()] * len(self._columns))]
        least = map(self._least, self._columns, cells)
        return sum(least) + _apart(width) * len(self._columns) <= width

    def _folded(self, rows: Sequence[Sequence[Text | str]], width: int) -> dict[int, int]:
        """Return how wide each column that is folded is, so that none of the others is cut.

        What no word needs goes to the first of them, as far as they can use it.
        """
        cells = [*zip_longest(*rows, fillvalue=""), *([()] * len(self._columns))]
        least = [*map(self._least, self._columns, cells)]
        left = width - sum(least) - _apart(width) * len(self._columns)
        out = {}
        for k, (name, each) in enumerate(zip(self._columns, cells, strict=False)):
            if name in self._left - self._whole:
                whole = max(len(name), *(len(str(cell)) for cell in each), least[k])
                out[k] = min(whole, least[k] + left)
                left -= out[k] - least[k]
        return out

    def _least(self, name: str, cells: Sequence[Text | str | ServoCell]) -> int:
        """Return how narrow a column may be."""
        texts = [name, *(cell.plain if isinstance(cell, Text) else str(cell) for cell in cells)]
        if name in self._left - self._whole:
            texts = [word for text in texts for word in text.split(" ")]
        return max(map(len, texts))

    def _is_crowding(self, cells: Sequence[Text | str | ServoCell], width: int) -> bool:
        """Tell whether a column that is not folded would leave no room for others."""
        return max((len(str(cell)) for cell in cells), default=0) > width // 2

    def table(self, most: int | None, width: int) -> Table:
        """Return the first rows; where these have no room for names of servos they have ids."""
        out = Table(box=None, pad_edge=True, padding=(0, 0, 0, _apart(width)))
        bare = self.lacks_names(most, width)
        named = {
            k for row in self.rows[:most] for k, c in enumerate(row) if isinstance(c, ServoCell)
        }
        rows = [
            [c if not isinstance(c, ServoCell) else c.who if bare else str(c) for c in row]
            for row in self.rows[:most]
        ]
        is_roomy = self._has_room(rows, width)
        if not is_roomy:  # better between a number and its unit than within one of them
            rows = [[c.replace(GLUE, " ") if isinstance(c, str) else c for c in r] for r in rows]
            is_roomy = self._has_room(rows, width)
        folded = self._folded(rows, width) if is_roomy else {}
        for k, column in enumerate(self._columns):
            if column in self._left - self._whole:  # no word is broken where all have room
                out.add_column(column, overflow="fold", width=folded.get(k))
            elif column in self._whole and self._is_crowding([r[k] for r in rows], width):
                out.add_column(column, overflow="fold", max_width=width // 2)
            elif column in self._whole or k in named:
                out.add_column(column, no_wrap=True)
            else:
                out.add_column(column, justify="right", no_wrap=True)
        for row in rows:
            out.add_row(*row)
        return out


def _apart(width: int) -> int:
    """Return how many blanks stand between columns."""
    return 2 if width >= ROOMY else 1


def called(known: Mapping[int, str]) -> str:
    """Return what servos are called, for tables that have no room for their names."""
    return "servos: " + ", ".join(glued(f"{servo} {known[servo]}") for servo in sorted(known))


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
