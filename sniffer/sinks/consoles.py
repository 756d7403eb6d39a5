"""The console that text for people is printed on: in colour or not, and how wide."""

from __future__ import annotations

import contextlib
import re
import textwrap
from typing import TYPE_CHECKING, Any, Final

from rich.console import Console, ConsoleDimensions

from sniffer.ground.streams import UNFOLDED, stated_columns

if TYPE_CHECKING:
    from collections.abc import Iterable, Iterator, Mapping
    from typing import TextIO

WIDE: Final = 140
"""Columns that tables and curves have where what is printed goes into a pipe or a file, unless
``COLUMNS`` says otherwise; sentences are lines there."""

NARROWEST: Final = 66
"""Columns that tables of figures have at least: a line that a terminal breaks can be read, a number
that is cut off is a wrong one."""

GLUE: Final = "\u2800"
"""Stands for a blank at which no line is broken, until all is laid out."""

_PADDING: Final = re.compile(r" +((?:\x1b\[[\d;]*m)*) *$", re.MULTILINE)


def console_for(
    stream: TextIO | None = None, *, color: bool | None = None, width: int | None = None
) -> Console:
    """Return a console on a stream (None: standard output), as wide as its terminal.

    ``color`` None: on a terminal, unless ``NO_COLOR`` is set, or wherever ``FORCE_COLOR`` asks for
    it. True and False win over both.
    """
    # a name that has brackets or colons is no markup and no picture
    plain: dict[str, Any] = {
        "file": stream,
        "width": width,
        "highlight": False,
        "markup": False,
        "emoji": False,
    }
    if color is None:
        return Console(**plain)
    if not color:
        return Console(**plain, color_system=None)
    console = Console(**plain, force_terminal=True, no_color=False)
    if console.color_system is None:  # TERM=dumb, or none: sixteen colours are what all have
        console = Console(**plain, force_terminal=True, no_color=False, color_system="standard")
    return console


def glued(words: str) -> str:
    """Return words that stay in one line where there is room for them in one."""
    return words.replace(" ", GLUE)


@contextlib.contextmanager
def unpadded(console: Console, instead: Mapping[int, int] | None = None) -> Iterator[None]:
    """Print without the blanks that fill what stands in columns up to their width.

    ``instead`` are characters in place of others, as ``str.translate`` takes them.
    """
    with console.capture() as printed:
        yield
    text = _PADDING.sub(r"\1", printed.get().replace(GLUE, " "))
    console.file.write(text.translate(instead) if instead else text)


def room_in(console: Console) -> int | None:
    """Return how many columns a line may have; None: any, for nobody looks at a screen.

    What ``COLUMNS`` states holds for pipes, too.
    """
    return console.width if stated_columns() or console.file.isatty() else None


def folded(lines: Iterable[str], room: int | None) -> Iterator[str]:
    """Yield lines, broken between words where one is too long; what goes on stands further in."""
    for line in lines:
        if not room or len(line) <= room:
            yield line
            continue
        deeper = " " * (len(line) - len(line.lstrip(" ")) + 2)
        yield from textwrap.wrap(
            line,
            room,
            subsequent_indent=deeper,
            break_on_hyphens=False,
            break_long_words=False,
        )


def unfold(console: Console) -> None:
    """Let sentences be lines where no screen is: what reads a pipe finds a sentence in one line."""
    if room_in(console) is None:
        # both: a width alone does not count where TERM is dumb
        console.size = ConsoleDimensions(UNFOLDED, console.height)


def tables_in(console: Console) -> int:
    """Have tables laid out as wide as there is room, sentences as lines; return how wide."""
    room = room_in(console)
    width = WIDE if room is None else max(room, NARROWEST)
    console.width = width
    unfold(console)
    return width
