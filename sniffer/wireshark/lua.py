"""Values as Lua writes them."""

from __future__ import annotations

import re
from collections.abc import Mapping, Sequence
from typing import Any, Final

_NAME: Final = re.compile(r"[A-Za-z_][A-Za-z0-9_]*")
_KEYWORDS: Final = re.compile(
    "and|break|do|else|elseif|end|false|for|function|goto|if|in|local|nil|not|or|repeat|return|"
    "then|true|until|while"
)
_WIDTH: Final = 96


def lua(value: Any, indent: int = 0) -> str:
    """Return a value as a Lua expression; entries that are None are left out.

    Bytes become strings of escapes, sequences tables that count from 1. What fits a line is one.

    Raises:
        TypeError: Lua has no such value.
    """
    match value:
        case bool():
            return "true" if value else "false"
        case int() | float():
            return repr(value)
        case str():
            return '"' + value.replace("\\", "\\\\").replace('"', '\\"').replace("\n", "\\n") + '"'
        case bytes():
            return '"' + "".join(f"\\{byte:03d}" for byte in value) + '"'
        case Mapping():
            items = [f"{_key(k)} = {lua(v, indent + 1)}" for k, v in value.items() if v is not None]
        case Sequence():
            items = [lua(v, indent + 1) for v in value]
        case _:
            raise TypeError(f"no Lua for {value!r:.40}")
    line = "{" + ", ".join(items) + "}"
    if len(line) + 2 * indent < _WIDTH and "\n" not in line:
        return line
    inner = "  " * (indent + 1)
    return "{\n" + "".join(f"{inner}{item},\n" for item in items) + "  " * indent + "}"


def _key(key: object) -> str:
    if isinstance(key, str) and _NAME.fullmatch(key) and not _KEYWORDS.fullmatch(key):
        return key
    return f"[{lua(key)}]"
