"""``python -m sniffer`` and the command ``sniffer``; Ctrl-C and SIGTERM from the first moment."""

from __future__ import annotations

import _signal  # type: ignore[import-not-found] # `signal` without its enumerations: 15 ms less
import _thread
import atexit
import os
import sys
import time

from sniffer.ground.collecting import collect_seldom
from sniffer.ground.loading import Loading, leave

TYPE_CHECKING = False  # of typing: nothing is loaded that can wait
if TYPE_CHECKING:
    from types import TracebackType
    from typing import Any, Final, Self

SAME_S: Final = 1.0
"""Ctrl-C within this time of the first one is the same one, in seconds: a hand that trembles, or a
terminal and a program between that both send it."""

AGAIN_S: Final = 0.01
"""After this time an interruption comes again that Python could not raise, in seconds."""


class Interruptions:
    """While the program runs, Ctrl-C raises KeyboardInterrupt once, and then lets it tidy up.

    The second one, ``SAME_S`` later, ends it at once, whatever is being tidied up. Commands that
    take interruptions otherwise take the signal over for as long. Who has the signal ignored, as
    shells do for what runs behind, keeps that. SIGTERM, as ``timeout`` and services send it, does
    what Ctrl-C does at that moment.

    Use it with ``with``, in the main thread, for all of a program: once ``end`` was called nothing
    of it is raised any more until the process is gone.
    """

    def __init__(self) -> None:
        self._since: float | None = None
        self._status: int | None = None

    def __enter__(self) -> Self:
        if _signal.getsignal(_signal.SIGINT) is _signal.default_int_handler:
            # at the very end Python takes its handlers away, but leaves ignored what is
            atexit.register(_signal.signal, _signal.SIGINT, _signal.SIG_IGN)
            self._otherwise = sys.unraisablehook
            sys.unraisablehook = self._unraisable
            _signal.signal(_signal.SIGINT, self._take)
        if _signal.getsignal(_signal.SIGTERM) is _signal.SIG_DFL:
            _signal.signal(_signal.SIGTERM, self._end)
        return self

    def __exit__(
        self, kind: type[BaseException] | None, error: object, where: TracebackType | None
    ) -> None:
        if kind is not None and issubclass(kind, KeyboardInterrupt):
            leave()  # it came before anybody looked out for it, or after

    def end(self, status: int) -> int:
        """Have Ctrl-C do nothing from now on but end the process with its status; return that."""
        self._status = status
        return status

    def be_gone(self) -> None:
        """Be gone, if the program has ended: to take 300 modules apart is a tenth of a command."""
        if self._status is None:
            return
        try:
            sys.stdout.flush()
            sys.stderr.flush()
        except (OSError, ValueError):  # Python has words for that
            return
        os._exit(self._status)

    def _take(self, number: int, frame: object) -> None:
        if self._status is not None:
            os._exit(self._status)
        now = time.monotonic()
        if self._since is None:
            self._since = now
            raise KeyboardInterrupt
        if now - self._since > SAME_S:
            leave()

    def _end(self, number: int, frame: object) -> None:
        interrupt = _signal.getsignal(_signal.SIGINT)
        (interrupt if callable(interrupt) else self._take)(_signal.SIGINT, frame)

    def _unraisable(self, told: Any) -> None:
        """Take what Python would print, and go on, as in a destructor: Ctrl-C is raised again."""
        if issubclass(told.exc_type, KeyboardInterrupt):
            self._since = None
            # here it would be lost likewise
            _thread.start_new_thread(_again, (_thread.get_ident(),))
        else:
            self._otherwise(told)


def _again(thread: int) -> None:
    """Interrupt a thread in a moment, also where it waits."""
    time.sleep(AGAIN_S)
    if hasattr(_signal, "pthread_kill"):
        _signal.pthread_kill(thread, _signal.SIGINT)
    else:
        _thread.interrupt_main()


def main() -> None:
    """Run the command line and exit with its status."""
    collect_seldom()
    interruptions = Interruptions()
    atexit.register(interruptions.be_gone)  # the first one comes last: threads have ended by then
    with interruptions:
        with Loading():
            from sniffer.cli import run
            from sniffer.ground.arrow import process_is_ours

        process_is_ours()
        status = interruptions.end(run(sys.argv[1:]))
    sys.exit(status)


if __name__ == "__main__":
    main()
