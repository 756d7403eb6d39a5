"""Regular expressions, compiled when they are first used: most are for inputs that do not come.

A command that reads a small capture would spend a twentieth of its time on those of the formats
that it is not in.
"""

from __future__ import annotations

import re
from typing import TYPE_CHECKING, Any, AnyStr

_METHODS = ("match", "fullmatch", "search", "finditer", "findall", "sub", "split", "pattern")


class _Later:
    """Has the methods of the compiled expression as its own from the first look on."""

    def __init__(self, pattern: Any, flags: int = 0) -> None:
        self._of = (pattern, flags)

    def __getattr__(self, name: str) -> Any:
        if name not in _METHODS:
            raise AttributeError(name)
        compiled = re.compile(*self._of)
        for each in _METHODS:
            setattr(self, each, getattr(compiled, each))
        return getattr(compiled, name)


if TYPE_CHECKING:

    def later(pattern: AnyStr, flags: int = 0) -> re.Pattern[AnyStr]:
        """Return the expression, compiled when it is first used."""
else:
    later = _Later
