"""The words of an expression: how a text falls apart, and what its outermost ANDs join."""

from __future__ import annotations

import re
from typing import TYPE_CHECKING, Final, NamedTuple

from sniffer.ground.amounts import time_in
from sniffer.ground.model import InputError
from sniffer.ground.wording import Sentence, one_line

if TYPE_CHECKING:
    from collections.abc import Sequence

SHOWN: Final = 20
"""Characters that are shown from the place of a mistake on."""

_TOKEN: Final = re.compile(
    r"""\s*(?:
    (?P<number>(?:\d+\.?\d*|\.\d+)(?:[eE][+-]?\d+)?(?![\w.]))
    |(?P<text>'(?:[^']|'')*')
    |(?P<quoted>"(?:[^"]|"")+")
    |(?P<word>[A-Za-z_]\w*)
    |(?P<sign><=|>=|<>|!=|==|[=<>(),+-])
    |(?P<end>$)
    )""",
    re.VERBOSE,
)


_WITH_UNIT: Final = re.compile(r"[\d.]+[A-Za-z]+")


class Token(NamedTuple):
    """A word, a number, a text or a sign of an expression, or its end."""

    kind: str
    text: str
    at: int

    @property
    def lower(self) -> str:
        """What it is called where case does not count; empty for what is no word."""
        return self.text.lower() if self.kind == "word" else ""


def tokens_of(text: str) -> list[Token]:
    """Return what a text consists of, its end behind it.

    Raises:
        InputError: something in it can be in no expression; in one line, with the place.
    """
    out: list[Token] = []
    at = 0
    while not out or out[-1].kind != "end":
        match = _TOKEN.match(text, at)
        if match is None or match.lastgroup is None:
            at += len(text[at:]) - len(text[at:].lstrip())
            raise wrong(text, at, _unread(text[at:]))
        out.append(Token(match.lastgroup, match[match.lastgroup], match.start(match.lastgroup)))
        at = match.end()
    return out


def _unread(rest: str) -> str:
    if rest[0] in "'\"":
        return "a quote that is opened here is not closed"
    if rest[0].isdigit():
        time = _WITH_UNIT.match(rest)
        ns = time_in(time[0], bare=False) if time else None
        return "this is no number" + (f": in ns it is {ns}" if ns is not None else "")
    if rest[0] in "*/%|":
        return "there is no arithmetic: compare columns with numbers, texts or each other"
    return f"{rest[0]!r} is nothing that an expression can have"


def wrong(text: str, at: int, why: str) -> InputError:
    """Return what is wrong at a place of an expression."""
    rest = one_line(text[at : at + SHOWN].strip())
    there = f"at {rest!r} (character {at + 1})" if rest else "at its end"
    return InputError(Sentence("{where}, {there}: {why}", there=there, why=why))


def conjuncts(text: str, tokens: Sequence[Token]) -> tuple[str, ...]:
    """Return what the outermost ANDs of an expression join; all of it where there is an OR."""
    begins, ends, depth, is_between = [0], [], 0, False
    for token in tokens:
        depth += (token.text == "(") - (token.text == ")") if token.kind == "sign" else 0
        if depth:
            continue
        if token.lower == "or":
            return (text.strip(),)
        if token.lower == "between":
            is_between = True
        elif token.lower == "and" and is_between:  # it joins the bounds
            is_between = False
        elif token.lower == "and":
            ends.append(token.at)
            begins.append(token.at + len(token.text))
    return tuple(text[a:b].strip() for a, b in zip(begins, [*ends, len(text)], strict=True))
