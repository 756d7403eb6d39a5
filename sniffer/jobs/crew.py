"""Processes that do tasks, one each at a time; none outlives who started them.

The pools of the standard library do not do: ``ProcessPoolExecutor`` breaks as a whole when one
process dies and cannot say of which task, ``multiprocessing.Pool`` waits for its result for ever.
"""

from __future__ import annotations

import contextlib
import multiprocessing
import os
import pickle
import signal
import sys
import threading
import time
from multiprocessing import resource_tracker
from multiprocessing.connection import wait
from types import ModuleType
from typing import TYPE_CHECKING, Any, Final, NamedTuple, Self

from sniffer.ground.model import SnifferError

if TYPE_CHECKING:
    from collections.abc import Callable, Iterator, Mapping, Sequence
    from multiprocessing.connection import Connection

AGAIN_S: Final = (0.05, 0.5)
"""After how long it is tried once more to begin a process that could not be, in seconds: whoever
begins them may just have been killed, and Python starts another one as soon as the system says so.
"""


class LostWorkerError(SnifferError):
    """A process ended in the middle of its task: somebody killed it, or the system did.

    ``had_begun`` is false where it never came so far that it could have looked at the task.
    """

    def __init__(self, why: str, *, had_begun: bool = True) -> None:
        super().__init__(why)
        self.had_begun = had_begun


class TaskEnd(NamedTuple):
    """What became of a task: a result, or what was raised."""

    task: Any
    result: Any
    error: BaseException | None


class _CrewMember:
    """A process and the line to it; it has begun once it has said so."""

    def __init__(self, context: Any, do: Callable[[Any], Any]) -> None:
        """Begin the process.

        Raises:
            EOFError: whoever begins processes was killed meanwhile, or could not.
            OSError: the system lets no more begin.
        """
        self.line, theirs = context.Pipe()
        given = do, theirs, dict(os.environ)
        self.process = context.Process(target=_work, args=given, name="crew")
        with theirs, _without_main(), unheard():  # closed, so that the line ends with the process
            self.process.start()
        self.has_begun = False
        self.task: Any = None

    def give(self, task: Any) -> None:
        """Have a task done; if the process is dead, that shows when it is asked."""
        self.task = task
        with contextlib.suppress(OSError):
            self.line.send(task)

    def heard(self) -> TaskEnd | None:
        """Return what became of the task, None: the process is there, that is all."""
        with contextlib.suppress(EOFError, OSError):
            if self.line.poll():
                said = self.line.recv()
                if said is None:
                    self.has_begun = True
                    return None
                task, self.task = self.task, None
                return TaskEnd(task, *said)
        self.process.join()
        why = f"a process ended in the middle of its work ({_how(self.process.exitcode)})"
        return TaskEnd(self.task, None, LostWorkerError(why, had_begun=self.has_begun))

    def end(self) -> None:
        """End it at once."""
        self.line.close()
        self.process.kill()
        self.process.join()
        self.process.close()


class Crew:
    """So many processes, started when there is something to do; use it as a context.

    Args:
        count: how many.
        do: a function of a module, given each task; tasks and results can be pickled.
        preload: modules that processes find loaded, where the system can fork: they begin at once,
            and share the memory of them.
    """

    def __init__(
        self, count: int, do: Callable[[Any], Any], *, preload: Sequence[str] = ()
    ) -> None:
        # threads of ours would not survive a plain fork
        forks = "forkserver" in multiprocessing.get_all_start_methods()
        self._context: Any = multiprocessing.get_context("forkserver" if forks else "spawn")
        if forks:
            self._context.set_forkserver_preload(list(preload))
        self._count = count
        self._do = do
        self._members: list[_CrewMember] = []
        self._unbegun: list[TaskEnd] = []

    @property
    def _busy(self) -> list[_CrewMember]:
        return [member for member in self._members if member.task is not None]

    @property
    def has_room(self) -> bool:
        """Whether a task that is given now is begun now."""
        return len(self._busy) < self._count

    @property
    def is_busy(self) -> bool:
        """Whether it is still to be said of a task what became of it."""
        return bool(self._busy or self._unbegun)

    def give(self, task: Any) -> None:
        """Have a task done; there must be room."""
        member = next((m for m in self._members if m.task is None), None)
        if member is None:
            try:
                member = self._begun()
            except LostWorkerError as error:
                self._unbegun.append(TaskEnd(task, None, error))
                return
            self._members.append(member)
        member.give(task)

    def _begun(self) -> _CrewMember:
        for waits in AGAIN_S:
            with contextlib.suppress(EOFError, OSError):
                return _CrewMember(self._context, self._do)
            time.sleep(waits)
        try:
            return _CrewMember(self._context, self._do)
        except (EOFError, OSError) as error:
            told = f"no process can be begun ({error})"
            raise LostWorkerError(told, had_begun=False) from error

    def wait(self, seconds: float | None = None) -> list[TaskEnd]:
        """Return what has become of tasks by now, or within so many seconds; maybe nothing."""
        if self._unbegun:
            out, self._unbegun = self._unbegun, []
            return out
        busy, out = self._busy, []
        # a process that a dead member has begun may keep its line open
        ready = wait([end for m in busy for end in (m.line, m.process.sentinel)], seconds)
        for member in busy:
            if member.line in ready or member.process.sentinel in ready:
                told = member.heard()
                if told is not None:
                    out.append(told)
                    if isinstance(told.error, LostWorkerError):
                        self._members.remove(member)
                        member.end()
        return out

    def __enter__(self) -> Self:
        return self

    def __exit__(self, *_: object) -> None:
        for member in self._members:
            member.end()
        self._members = []


@contextlib.contextmanager
def unheard() -> Iterator[None]:
    """Have Ctrl-C not come to the processes that are begun meanwhile, nor to those that they begin.

    A terminal sends it to all of them, also before they could say that they ignore it.
    """
    if not hasattr(signal, "pthread_sigmask"):
        yield
        return
    resource_tracker.ensure_running()  # beginning it would let the signal through again
    before = signal.pthread_sigmask(signal.SIG_BLOCK, {signal.SIGINT})
    try:
        yield
    finally:
        signal.pthread_sigmask(signal.SIG_SETMASK, before)


@contextlib.contextmanager
def _without_main() -> Iterator[None]:
    """Have new processes load nothing of the program that begins them.

    They need none of it, and a script that was not written to be loaded would run again in each.
    """
    main = sys.modules["__main__"]
    sys.modules["__main__"] = ModuleType("__main__")
    try:
        yield
    finally:
        sys.modules["__main__"] = main


def _how(status: int | None) -> str:
    if status is None or status >= 0:
        return f"status {status}"
    return f"killed by {signal.Signals(-status).name}: is there memory enough?"


def _work(do: Callable[[Any], Any], line: Connection, environment: Mapping[str, str]) -> None:
    """Do tasks until nobody gives any more; end with whoever gave them."""
    # a fork server keeps that of its begin: where a store is, and who we are, may be said since
    os.environ.clear()
    os.environ.update(environment)
    signal.signal(signal.SIGINT, signal.SIG_IGN)  # who started it decides what an interruption ends
    threading.Thread(target=_leave_with_parent, daemon=True).start()
    with contextlib.suppress(EOFError, OSError):
        line.send(None)
        while True:
            line.send(_done(do, line.recv_bytes()))


def _done(do: Callable[[Any], Any], task: bytes) -> tuple[Any, BaseException | None]:
    try:
        return do(pickle.loads(task)), None
    except Exception as error:
        return None, error


def _leave_with_parent() -> None:
    """End this process with the one that began it, however that ended."""
    parent = multiprocessing.parent_process()
    if parent is not None:
        parent.join()
        os._exit(1)
