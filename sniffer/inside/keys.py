"""The keys, written once: they are bound, shown in the last line, and told on ``?``."""

from __future__ import annotations

from typing import Final, NamedTuple


class Key(NamedTuple):
    """A key: what it is called on the screen, what it does, in a word and in a sentence."""

    keys: str
    shown: str
    action: str
    word: str
    told: str


KEYS: Final = (
    Key("question_mark", "?", "help", "help", "this page; any key closes it"),
    Key(
        "slash", "/", "ask('find')", "find", "find text or bytes (FF 01): Enter again for the next"
    ),
    Key(
        "n", "n", "wrong(1)", "error", "the next line with an error (warnings where there is none)"
    ),
    Key("p", "p", "wrong(-1)", "", "the one before it"),
    Key("N", "N", "wrong(1, 1)", "", "the next finding of any severity"),
    Key("P", "P", "wrong(-1, 1)", "", "the one before it"),
    Key("g", "g", "ask('go')", "go", "go to a time (12.5, 20:35:20.5), @12175 (byte), #300 (line)"),
    Key(
        "f", "f", "ask('filter')", "filter", "only some lines: servo=3,5 kind=response (empty: all)"
    ),
    Key("x", "x", "exchanges", "", "single frames, or requests with their answers"),
    Key("t", "t", "times", "", "times: of the day, since the line above, since the last mark"),
    Key("b", "b", "pane('board')", "servos", "the servos as they were known at this line"),
    Key("s", "s", "pane('figures')", "stats", "what can be counted of the lines shown"),
    Key("m", "m", "ask('mark')", "mark", "mark this line with a note, or take its mark away"),
    Key("apostrophe", "'", "next_mark", "", "the next mark"),
    Key("F", "F", "follow", "", "follow: stay at the last line while more come"),
    Key("space", "Space", "pause", "", "show nothing new; reading and recording go on"),
    Key("escape", "Esc", "away", "", "close what is open, stop a search, show the fields again"),
    Key("q,ctrl+c,ctrl+q", "q", "quit", "quit", "quit; so does Ctrl-C"),
)

MOVING: Final = (
    ("↑ ↓ PgUp PgDn", "move; Home and End: the first and the last line"),
    ("← →", "the rest of long values"),
    ("Tab", "to the fields, which light their bytes; the mouse works, too"),
)
"""Keys of the list itself."""


def help_text() -> str:
    """Return what ``?`` shows."""
    width = max(len(shown) for shown, _ in MOVING)
    lines = [f"{shown:>{width}}  {told}" for shown, told in MOVING]
    lines += [f"{key.shown:>{width}}  {key.told}" for key in KEYS]
    colours = "red error  yellow warning  cyan note  green answer  magenta changed byte"
    return "\n".join([*lines, colours])  # no more than 24 lines with their frame
