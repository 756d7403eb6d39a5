"""The signals that end or steer what is under way."""

from __future__ import annotations

import contextlib
import signal
import threading
from collections.abc import Callable, Iterator
from typing import TYPE_CHECKING

from sniffer.jobs.session import Patience

if TYPE_CHECKING:
    from types import FrameType

    from sniffer.tap.recorder import Wishes


@contextlib.contextmanager
def signals(wishes: Wishes) -> Iterator[None]:
    """Take over the signals that end or steer a recording.

    The second Ctrl-C leaves out what is not decoded yet, the third ends the program at once.
    """

    def stop(number: int, frame: object) -> None:
        if not wishes.is_heard:
            raise KeyboardInterrupt  # ports are being opened, which may take long
        again, wishes.stop = wishes.stop, wishes.stop or signal.Signals(number).name
        if again is not None and number == signal.SIGINT:
            if wishes.hurry:
                raise KeyboardInterrupt
            wishes.hurry = True

    def rotate(number: int, frame: object) -> None:
        wishes.rotate = True

    def statistics(number: int, frame: object) -> None:
        wishes.statistics = True

    handlers = {"SIGINT": stop, "SIGTERM": stop, "SIGHUP": rotate, "SIGUSR1": statistics}
    numbers = {
        n: handler for name, handler in handlers.items() if (n := getattr(signal, name, None))
    }
    before = {number: signal.signal(number, handler) for number, handler in numbers.items()}
    try:
        yield
    finally:
        for number, handler in before.items():
            signal.signal(number, handler)


@contextlib.contextmanager
def ended_by_signals(stop: Callable[[], None]) -> Iterator[None]:
    """Let Ctrl-C, a polite kill and a closed terminal end what is under way.

    Only the main thread hears them.
    """
    if threading.current_thread() is not threading.main_thread():
        yield
        return
    numbers = [getattr(signal, name, None) for name in ("SIGINT", "SIGTERM", "SIGHUP")]
    before = {n: signal.signal(n, lambda *_: stop()) for n in numbers if n is not None}
    try:
        yield
    finally:
        for number, handler in before.items():
            signal.signal(number, handler)


@contextlib.contextmanager
def patient() -> Iterator[Patience]:
    """Take Ctrl-C over for what decodes a source; in other threads it does not arrive anyway."""
    patience = Patience()

    def interrupt(number: int, frame: FrameType | None) -> None:
        try:
            patience.interrupt()
        except KeyboardInterrupt:
            if not callable(before):
                raise
            before(number, frame)  # raises it once, however often the key is pressed

    if threading.current_thread() is not threading.main_thread():
        yield patience
        return
    before = signal.signal(signal.SIGINT, interrupt)
    try:
        yield patience
    finally:
        signal.signal(signal.SIGINT, before)
