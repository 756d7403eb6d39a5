"""Tables of Saleae with something else between their cells than commas.

A spreadsheet saves semicolons where numbers have a decimal comma; Logic 1 exports tabs if asked.
"""

from __future__ import annotations

from typing import TYPE_CHECKING, Final

from sniffer.ground.patterns import later
from sniffer.sources.text import LineBlock

if TYPE_CHECKING:
    from collections.abc import Iterable, Iterator

_HEAD: Final = later(rb'\s*"?(?:Time ?[\[(](?:s|ms|us|\xc2\xb5s|ns)[\])]|name)"? ?[;\t]')
_POINTS: Final = bytes.maketrans(b";\t,", b",,.")


def with_points(table: bytes) -> bytes:
    """Return a table of Saleae's with commas between cells, whatever it has."""
    return table.translate(_POINTS) if _HEAD.match(table) else table


def blocks_with_points(blocks: Iterable[LineBlock | None]) -> Iterator[LineBlock | None]:
    """Yield the blocks of a table of Saleae's with commas between cells, whatever it has."""
    is_first, is_local = True, False
    for block in blocks:
        if block is not None and is_first:
            is_first, is_local = False, _HEAD.match(block.text) is not None
        if block is None or not is_local:
            yield block
        else:
            text = block.text.translate(_POINTS)
            yield LineBlock(text, block.number, block.column, block.cut_off)
