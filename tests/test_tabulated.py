"""Tables of figures: where all has room their lines are those that Rich makes, without its time."""

from __future__ import annotations

import io
import re

from hypothesis import given
from hypothesis import strategies as st
from rich.table import Table
from rich.text import Text

from sniffer.sinks.consoles import console_for, unpadded
from sniffer.sinks.tabulated import Tabulated

CELL = st.text("ab1:[]/肩é ", max_size=9).map(str.strip)
ROWS = st.lists(st.tuples(CELL, CELL, CELL), max_size=4)


def printed(table: Table | Text, *, color: bool) -> str:
    out = io.StringIO()
    console = console_for(out, color=color, width=140)
    with unpadded(console):
        console.print(table)
    return out.getvalue()


def words(shown: str) -> list[str]:
    """Return lines without colours; Rich leaves blanks in some that are all blank."""
    return [re.sub(r"\x1b\[[\d;]*m", "", line).rstrip() for line in shown.splitlines()]


@given(ROWS, st.booleans(), st.sampled_from([60, 140]))
def test_where_all_has_room_lines_are_those_of_a_table_of_rich(
    rows: list[tuple[str, str, str]], color: bool, width: int
) -> None:
    apart = 2 if width == 140 else 1
    expected = Table(box=None, pad_edge=True, padding=(0, 0, 0, apart))
    expected.add_column("who")
    expected.add_column("count", justify="right")
    expected.add_column("what")
    mine = Tabulated("who", "count", "what", left=("what",), whole=("who",))
    for who, count, what in rows:
        cells = who, count, Text(what, style="red")
        expected.add_row(*cells)
        mine.add_row(*cells)
    shown = printed(mine.table(None, width), color=color)
    assert words(shown) == words(printed(expected, color=color))
    assert not color or shown.startswith(" " * apart + "\x1b[1mwho\x1b[0m ")
    reds = sum(bool(what) for _, _, what in rows)
    assert shown.count("\x1b[31m") == (reds if color else 0)
