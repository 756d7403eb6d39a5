"""pyarrow without pandas, in processes that are this program's own."""

from __future__ import annotations

import importlib
import sys
from typing import Final

_OURS: Final[list[bool]] = []


def process_is_ours() -> None:
    """Say that nobody else's code gives pyarrow anything in this process."""
    _OURS.append(True)


def leave_pandas_out() -> None:
    """Have pyarrow not look for pandas, if this process is the program's own.

    It asks of all that it is given whether that is of pandas, and loads pandas to ask where that is
    installed: two fifths of the time that a small table takes. In other people's programs it is
    left to do so: without, it would read their missing values as numbers. To be called before
    pyarrow was given anything; who loads pandas later, as a plug-in may, finds it.

    Raises:
        ImportError: pyarrow is not installed.
    """
    pyarrow = importlib.import_module("pyarrow")

    if not _OURS or "pandas" in sys.modules:
        return
    sys.meta_path.insert(0, _WithoutPandas)
    try:
        pyarrow.array([])  # it looks once
    finally:
        sys.meta_path.remove(_WithoutPandas)


class _WithoutPandas:
    """Finds modules, and of pandas that it is not there."""

    @staticmethod
    def find_spec(name: str, path: object = None, target: object = None) -> None:
        if name == "pandas":
            raise ModuleNotFoundError("nobody uses it here", name=name)
