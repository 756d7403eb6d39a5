"""Files that people write: their text, and register tables as they are usually written.

Tables are read line by line; anything else in them is left to tomllib. A command that tells the
protocol from the bytes reads a dozen tables, 4,800 lines. The standard library's reader takes
thrice as long for them as Python to start; this one a fifth of that, for a line of a table is a key
and a plain value. A test holds that both read all tables alike.
"""

from __future__ import annotations

import re
from typing import TYPE_CHECKING, Any, Final

from sniffer.ground.model import SnifferError

if TYPE_CHECKING:
    from pathlib import Path

_TEXT: Final = r'"[^"\\\x00-\x08\x0a-\x1f\x7f]*"'
_NUMBER: Final = r"0x[0-9A-Fa-f]+|-?(?:0|[1-9]\d*)(?:\.\d+)?(?:e-?\d+)?"
_SCALAR: Final = rf"(?:{_TEXT}|{_NUMBER}|true|false)"
_LIST: Final = rf"\[(?:{_SCALAR}(?:, {_SCALAR})*)?\]"
_SET: Final = rf"(?:{_TEXT}|[a-z_]+) = (?:{_SCALAR}|{_LIST})"

_PLAIN: Final = re.compile(rf"([a-z_]+) = ({_SCALAR})")
_LINE: Final = re.compile(
    rf"([a-z_]+)(?:\.([a-z_]+))? = (?:({_SCALAR}|{_LIST})|\{{ ?((?:{_SET}(?:, {_SET})*)?) ?\}})"
    r" *(?:#.*)?"
)
_ITEM: Final = re.compile(_SCALAR)
_PAIR: Final = re.compile(rf"({_TEXT}|[a-z_]+) = ({_SCALAR}|{_LIST})")

ENTRY: Final = "[[register]]"
"""The line that begins each register."""


def text_of(path: Path, what: str) -> str:
    """Return the text of a file that somebody wrote; ``what`` is what it holds, as "rules are".

    Raises:
        SnifferError: it cannot be read, or is no text.
    """
    try:
        return path.read_bytes().decode("utf-8")
    except IsADirectoryError:
        raise SnifferError(f"{path} is a directory: give the file in it") from None
    except OSError as error:
        raise SnifferError(f"{path}: cannot be read ({error.strerror})") from None
    except UnicodeDecodeError:
        raise SnifferError(f"{path}: {what} text in UTF-8") from None


def quick(text: str) -> dict[str, Any] | None:
    """Return what a table says, as ``tomllib.loads`` does; None: it needs that."""
    out: dict[str, Any] = {}
    here = out
    for line in text.split("\n"):
        if not line or line[0] == "#":
            continue
        if line == ENTRY:
            here = {}
            out.setdefault("register", []).append(here)
            continue
        plain = _PLAIN.fullmatch(line)
        if plain is not None:
            into, name, value = here, plain[1], _value(plain[2])
        else:
            found = _LINE.fullmatch(line)
            if found is None:
                return None
            key, within, one, table = found.groups()
            into = here if within is None else here.setdefault(key, {})
            name = within or key
            if table is None:
                value = _value(one)
            else:
                value = {k.strip('"'): _value(v) for k, v in _PAIR.findall(table)}
        if not isinstance(into, dict) or name in into:
            return None
        into[name] = value
    return out


def _value(text: str) -> Any:
    if text[0] == "[":
        return [_value(item) for item in _ITEM.findall(text)]
    if text[0] == '"':
        return text[1:-1]
    if text in ("true", "false"):
        return text == "true"
    if text[:2] == "0x":
        return int(text, 16)
    return float(text) if "." in text or "e" in text else int(text)
