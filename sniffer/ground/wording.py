"""Texts that come from outside, as a line for people shows them."""

from __future__ import annotations

import re
from typing import Final

WORD: Final = 300
"""A name longer than this is shown by its beginning and its end: paths in use are shorter."""

LINE: Final = 4000
"""A message is no longer than this."""

_LONG: Final = re.compile(rf"\S{{{WORD + 1},}}")


def plain(text: str) -> str:
    """Return a text from the input so that it cannot steer the terminal."""
    return text if text.isprintable() else ascii(text)[1:-1]


def short(text: str) -> str:
    """Return a text whose endless words are cut in the middle."""
    return _LONG.sub(lambda word: f"{word[0][: WORD - 60]}…{word[0][-59:]}", text)


def one_line(message: str) -> str:
    """Return a message as one line of bounded length."""
    line = short(plain(" ".join(message.split())))
    return line if len(line) <= LINE else f"{line[: LINE - 1]}…"


def and_(words: list[str]) -> str:
    """Return words as a list that people read: ``a, b and c``."""
    return ", ".join(words[:-1]) + " and " + words[-1] if len(words) > 1 else "".join(words)
