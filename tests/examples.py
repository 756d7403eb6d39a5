"""Worked examples in comments and docstrings: their tables, and what the code has in its hands."""

from __future__ import annotations

import inspect
import re
import sys
from typing import TYPE_CHECKING, Any, Final

import numpy as np

if TYPE_CHECKING:
    from collections.abc import Callable, Iterable
    from types import FrameType

_ROW: Final = re.compile(r"^ *(?:# {5}|    )(?P<label>[A-Za-z_][\w. ]*?) {2,}(?P<cells>\S.*)$")
_ANY: Final = ("-", "?")
"""Cells of rows that hold nothing that means something."""


def tables(function: Callable[..., Any]) -> dict[str, list[list[str]]]:
    """Return the rows of a function's worked examples by label: the cells of each, as written.

    A label stands in several tables at times, so it has a list of rows. What is said behind the
    cells of a row is split like cells: a row is read as far as there are values to compare.
    """
    out: dict[str, list[list[str]]] = {}
    for line in inspect.getsource(function).splitlines():
        if found := _ROW.match(line):
            out.setdefault(found["label"], []).append(found["cells"].split())
    return out


def held(function: Callable[..., Any], run: Callable[[], object]) -> dict[str, list[list[str]]]:
    """Run something and return each column that a function's variables held, in turn, by name."""
    code = inspect.unwrap(function).__code__
    out: dict[str, list[list[str]]] = {}

    def look(frame: FrameType, event: str, _: object) -> Any:
        if frame.f_code is not code:
            return None
        if event != "call":
            for name, value in frame.f_locals.items():
                if isinstance(value, np.ndarray) and value.dtype.kind in "biu" and value.ndim == 1:
                    seen, column = out.setdefault(name, []), shown(value)
                    if not seen or seen[-1] != column:
                        seen.append(column)
        return look

    before = sys.gettrace()
    sys.settrace(look)
    try:
        run()
    finally:
        sys.settrace(before)
    assert out, f"{function.__qualname__} was not called"
    return out


def shown(column: Iterable[Any]) -> list[str]:
    """Return a column as a comment writes it: whole numbers, and 0 and 1 for no and yes."""
    return [str(int(v)) for v in column]


def agree(cells: list[str], column: list[str]) -> bool:
    """Tell whether a row of a table begins with a column's values."""
    return len(cells) >= len(column) > 0 and all(
        c in (*_ANY, v) for c, v in zip(cells, column, strict=False)
    )


def check(function: Callable[..., Any], run: Callable[[], object], *names: str) -> None:
    """Hold the rows of a worked example to the variables of these names.

    Raises:
        AssertionError: the comment has no such row, or the variable never held it.
    """
    written, were = tables(function), held(function, run)
    for name in names:
        assert name in written, f"{function.__qualname__}: the example has no row {name}"
        for cells in written[name]:
            assert any(agree(cells, c) for c in were.get(name, [])), (
                f"{function.__qualname__}: the example says {name} {cells}, it was {were.get(name)}"
            )
