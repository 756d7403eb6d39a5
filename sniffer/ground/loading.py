"""While libraries and plug-ins are loaded: what Ctrl-C does then, and what is left out."""

from __future__ import annotations

import _signal  # type: ignore[import-not-found] # `signal` without its enumerations: 15 ms less
import os

TYPE_CHECKING = False  # of typing: nothing is loaded that can wait
if TYPE_CHECKING:
    from typing import Final, NoReturn

INTERRUPTED: Final = 130
"""The exit status, as in ``cli/statuses.py``, which stands above."""


class PluginWarning(UserWarning):
    """A plug-in is left out; the message names it and says why."""


class Loading:
    """While libraries are loaded, Ctrl-C ends the program at once: they may make anything of it.

    Nothing has begun by then, and nothing is to be kept. Use it with ``with``; in a thread other
    than the main one, to which no signal comes, it does nothing.
    """

    def __enter__(self) -> None:
        try:
            self._before = _signal.signal(_signal.SIGINT, _heard)
        except ValueError:
            self._before = None

    def __exit__(self, *_: object) -> None:
        if self._before is not None:
            _signal.signal(_signal.SIGINT, self._before)


def _heard(number: int, frame: object) -> NoReturn:
    leave()


def leave() -> NoReturn:
    """End at once, with one line."""
    try:
        os.write(2, b"sniffer: interrupted\n")
    finally:
        os._exit(INTERRUPTED)
