"""Processes that do tasks, one each at a time; none outlives who started them."""

from __future__ import annotations

import multiprocessing
import signal
from multiprocessing.connection import wait
from typing import TYPE_CHECKING, Any, NamedTuple

from sniffer.ground.model import SnifferError

if TYPE_CHECKING:
    from collections.abc import Callable
    from multiprocessing.connection import Connection
    from multiprocessing.process import BaseProcess


class LostWorkerError(SnifferError):
    """A process ended in the middle of its task: somebody killed it, or the system did."""


class TaskEnd(NamedTuple):
    """What became of a task: a result, or what was raised."""

    task: Any
    result: Any
    error: BaseException | None


class _CrewMember:
    def __init__(self, do: Callable[[Any], Any]) -> None:
        context = multiprocessing.get_context("spawn")  # threads of ours would not survive a fork
        self.line, theirs = context.Pipe()
        self.process: BaseProcess = context.Process(target=_work, args=(do, theirs), daemon=True)
        self.process.start()
        theirs.close()
        self.task: Any = None


class Crew:
    """So many processes, started when there is something to do; use it as a context.

    Args:
        count: how many.
        do: a function of a module, given each task; tasks and results can be pickled.
    """

    def __init__(self, count: int, do: Callable[[Any], Any]) -> None:
        self._count = count
        self._do = do
        self._workers: list[_CrewMember] = []

    @property
    def has_room(self) -> bool:
        """Whether a task that is given now is begun now."""
        return sum(w.task is not None for w in self._workers) < self._count

    @property
    def is_busy(self) -> bool:
        """Whether a task is under way."""
        return any(w.task is not None for w in self._workers)

    def give(self, task: Any) -> None:
        """Have a task done; there must be room."""
        worker = next((w for w in self._workers if w.task is None), None)
        if worker is None:
            worker = _CrewMember(self._do)
            self._workers.append(worker)
        worker.task = task
        try:
            worker.line.send(task)
        except OSError:
            return  # it is gone: that is told when somebody waits

    def wait(self, seconds: float) -> list[TaskEnd]:
        """Return what has become of tasks by now, or within so many seconds."""
        busy = {w.line: w for w in self._workers if w.task is not None}
        out = []
        for line in wait(list(busy), seconds):
            worker = busy[line]  # type: ignore[index]
            task, worker.task = worker.task, None
            try:
                result, error = worker.line.recv()
                out.append(TaskEnd(task, result, error))
            except (EOFError, OSError):
                self._workers.remove(worker)
                worker.process.join()
                why = f"a process that decodes a part ended ({_how(worker.process.exitcode)})"
                out.append(TaskEnd(task, None, LostWorkerError(why)))
        return out

    def __enter__(self) -> Crew:
        return self

    def __exit__(self, *_: object) -> None:
        for worker in self._workers:
            worker.process.terminate()
        for worker in self._workers:
            worker.process.join()
            worker.line.close()


def _how(status: int | None) -> str:
    if status is None or status >= 0:
        return f"status {status}"
    return f"killed by {signal.Signals(-status).name}: is there memory enough?"


def _work(do: Callable[[Any], Any], line: Connection) -> None:
    """Do tasks until nobody gives any more; end with whoever gave them."""
    signal.signal(signal.SIGINT, signal.SIG_IGN)  # who started it decides what an interruption ends
    parent = multiprocessing.parent_process()
    assert parent is not None
    while line in wait([line, parent.sentinel]):
        try:
            task = line.recv()
        except EOFError:
            return
        try:
            told: tuple[Any, BaseException | None] = (do(task), None)
        except Exception as error:
            told = (None, error)
        try:
            line.send(told)
        except OSError:
            return


def is_orphan() -> bool:
    """Tell whether who gave this process its task is gone: then nobody wants the result."""
    parent = multiprocessing.parent_process()
    return parent is not None and not parent.is_alive()
