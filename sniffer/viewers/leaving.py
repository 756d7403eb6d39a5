"""Keys that stop the program while the board is on the terminal."""

from __future__ import annotations

import contextlib
import os
import signal
import time
from typing import TYPE_CHECKING, Final

if TYPE_CHECKING:
    from collections.abc import Iterator

    from sniffer.viewers.screen import Screen

STOOD_S: Final = 0.5
"""A standstill of the program that is worth a word, in seconds."""


@contextlib.contextmanager
def leaving(screen: Screen | None) -> Iterator[None]:
    """Give the terminal back before a key stops the program (Ctrl-Z), or breaks it off."""

    def leave(number: int, frame: object) -> None:
        assert screen is not None
        began = time.monotonic()
        with screen.left():
            signal.signal(number, signal.SIG_DFL)
            os.kill(os.getpid(), number)  # comes back when the program goes on
        signal.signal(number, leave)
        if (stood_s := time.monotonic() - began) > STOOD_S:
            screen.say(
                f"the program was stopped for {stood_s:.1f} s (Ctrl-Z): what the ports could not "
                "keep meanwhile is not recorded"
            )

    wanted = () if screen is None else ("SIGTSTP", "SIGQUIT")
    numbers = [number for name in wanted if (number := getattr(signal, name, None))]
    mine = [number for number in numbers if signal.getsignal(number) == signal.SIG_DFL]
    for number in mine:
        signal.signal(number, leave)
    try:
        yield
    finally:
        for number in mine:
            signal.signal(number, signal.SIG_DFL)
