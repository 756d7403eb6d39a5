"""Elements of a page whose texts cannot become markup: what is no ``Markup`` is escaped.

Texts come from captures, and a capture comes from anybody.
"""

from __future__ import annotations

import html
import re
from typing import TYPE_CHECKING, Final

from sniffer.ground.wording import plain, short

if TYPE_CHECKING:
    from collections.abc import Iterable

VOID: Final = frozenset({"br", "hr", "line", "meta", "path", "rect", "col"})
"""Elements without content."""


class Markup(str):
    """A text that is markup already."""

    __slots__ = ()


Content = str | int | float


def text(content: Content) -> Markup:
    """Return a content as it may stand in a page.

    What steers a terminal or a line is written out, newlines aside, and endless words are cut. An
    arrow of two signs would be broken between them at the end of a line.
    """
    if isinstance(content, Markup):
        return content
    lines = str(content).split("\n")
    escaped = html.escape("\n".join(short(plain(line)) for line in lines))
    return Markup(escaped.replace(" -&gt; ", " → "))


def tag(name: str, /, *content: Content, **attributes: Content | None) -> Markup:
    """Return an element; ``cls`` is its class, ``data_x`` its ``data-x``, None leaves one out."""
    told = "".join(
        f' {_spelled(key)}="{html.escape(plain(str(value)))}"'
        for key, value in attributes.items()
        if value is not None
    )
    if name in VOID:
        return Markup(f"<{name}{told}>" if name not in _CLOSED else f"<{name}{told}/>")
    return Markup(f"<{name}{told}>{''.join(map(text, content))}</{name}>")


def sentence(content: Content) -> Markup:
    """Return a sentence in which what stands between backticks is code."""
    return Markup(_CODE.sub(r"<code>\1</code>", text(content)))


def joined(parts: Iterable[Content]) -> Markup:
    """Return contents one behind the other."""
    return Markup("".join(map(text, parts)))


_CODE: Final = re.compile("`([^`]+)`")
_CLOSED: Final = frozenset({"line", "path", "rect"})


def _spelled(key: str) -> str:
    if key == "cls":
        return "class"
    if key == "view_box":
        return "viewBox"
    if key == "preserve_aspect_ratio":
        return "preserveAspectRatio"
    return key.rstrip("_").replace("_", "-")
