"""Processes of this machine, each with a batch at a time; one that dies is replaced."""

from __future__ import annotations

import contextlib
import multiprocessing
import os
import signal
import sys
import threading
from collections import Counter, deque
from multiprocessing import connection
from types import ModuleType
from typing import TYPE_CHECKING, Any, Final, Self

from sniffer.fleet.rows import UndoneError, WorkerDiedError

if TYPE_CHECKING:
    from collections.abc import Iterable, Iterator, Mapping
    from types import TracebackType

    from sniffer.fleet.engines import Batch, Outcome

ATTEMPTS: Final = 3
"""How often a capture may end its process before it is given up."""

READY: Final = True
"""What a worker says first."""

PRELOADED: Final = ("sniffer.fleet.task", "pyarrow.parquet")
"""What workers find loaded: they begin at once, and share the memory of it."""


class LocalEngine:
    """Decodes in processes of this machine, as many as ``workers``.

    A process that dies, of a capture or because somebody killed it, takes nothing along: its
    captures are tried again, each alone; one that ends its process ``ATTEMPTS`` times is given up.
    """

    def __init__(self, workers: int) -> None:
        method = (
            "forkserver" if "forkserver" in multiprocessing.get_all_start_methods() else "spawn"
        )
        self._context: Any = multiprocessing.get_context(method)
        if method == "forkserver":
            self._context.set_forkserver_preload(list(PRELOADED))
        self._most = workers
        self._idle: list[_Worker] = []
        self._busy: list[_Worker] = []
        self._again: deque[Batch] = deque()
        self._deaths: Counter[str] = Counter()
        self._stillborn = 0

    def __enter__(self) -> Self:
        return self

    def __exit__(
        self,
        kind: type[BaseException] | None,
        error: BaseException | None,
        trace: TracebackType | None,
        /,
    ) -> None:
        for worker in (*self._busy, *self._idle):
            worker.kill()
        self._busy, self._idle = [], []

    def run(self, batches: Iterable[Batch]) -> Iterator[Outcome]:
        """Yield each batch, or parts of it, with what became of it.

        Raises:
            UndoneError: no process can be begun.
        """
        waiting = iter(batches)
        while True:
            while len(self._busy) < self._most:
                batch = self._again.popleft() if self._again else next(waiting, None)
                if batch is None:
                    break
                worker = self._idle.pop() if self._idle else _Worker(self._context)
                self._busy.append(worker)
                worker.give(batch)
            if not self._busy:
                return
            for worker in _heard_from(self._busy):
                got = worker.answer()
                if got is READY:
                    worker.is_there = True
                    continue
                self._busy.remove(worker)
                if got is None:
                    worker.kill()
                    got = self._death(worker)
                else:
                    self._idle.append(worker)
                alone = isinstance(got, UndoneError) and len(worker.batch) == 1
                if got is None or (isinstance(got, UndoneError) and not alone):
                    self._again.extend((task,) for task in worker.batch)
                else:
                    yield worker.batch, got

    def _death(self, worker: _Worker) -> WorkerDiedError | None:
        """Return what a worker's death means for its captures, None: they are tried again."""
        if not worker.is_there:
            self._stillborn += 1
            if self._stillborn == ATTEMPTS:
                raise UndoneError("worker processes end here before they begin")
            return None
        self._deaths.update(task.fingerprint for task in worker.batch)
        if len(worker.batch) > 1 or self._deaths[worker.batch[0].fingerprint] < ATTEMPTS:
            return None
        return WorkerDiedError(f"its process died {ATTEMPTS} times")


class _Worker:
    """A process that decodes batches, and the pipe to it; it is there once it has said so."""

    def __init__(self, context: Any) -> None:
        self.pipe, other = context.Pipe()
        given = other, dict(os.environ)
        self.process = context.Process(target=_work, args=given, name="fleet")
        with _without_main():
            self.process.start()
        self.is_there = False
        other.close()  # so that the pipe ends where the process does
        self.batch: Batch = ()

    def give(self, batch: Batch) -> None:
        """Let it decode a batch; if it is dead, that shows when it is asked."""
        self.batch = batch
        with contextlib.suppress(OSError):
            self.pipe.send(batch)

    def answer(self) -> Any:
        """Return rows, or an exception; None: it died."""
        with contextlib.suppress(EOFError, OSError):
            if self.pipe.poll():
                return self.pipe.recv()
        return None

    def kill(self) -> None:
        """End it at once; what it has finished is committed."""
        self.pipe.close()
        self.process.kill()
        self.process.join()
        self.process.close()


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


def _heard_from(workers: list[_Worker]) -> list[_Worker]:
    """Wait for workers that have an answer, or are dead."""
    # a process that a dead worker has begun may keep its pipe open
    ready = connection.wait([end for w in workers for end in (w.pipe, w.process.sentinel)])
    return [w for w in workers if w.pipe in ready or w.process.sentinel in ready]


def _work(pipe: connection.Connection, environment: Mapping[str, str]) -> None:
    """Decode batches until the pipe ends."""
    # a fork server keeps that of its begin: where a store is, and who we are, may be said since
    os.environ.clear()
    os.environ.update(environment)
    signal.signal(signal.SIGINT, signal.SIG_IGN)  # Ctrl-C reaches all processes; one decides
    threading.Thread(target=_leave_with_parent, daemon=True).start()
    import pyarrow as pa

    from sniffer.fleet.task import decode_batch

    pa.set_cpu_count(1)  # the cores have a worker each
    with contextlib.suppress(EOFError, OSError):
        pipe.send(READY)
        while True:
            batch = pipe.recv()
            answer: Any
            try:
                answer = decode_batch(batch)
            except UndoneError as error:
                answer = error
            except Exception as error:
                answer = UndoneError(f"{batch[0].uri}: {type(error).__name__}: {error}")
            pipe.send(answer)


def _leave_with_parent() -> None:
    """End this process with the one that began it, however that ended."""
    parent = multiprocessing.parent_process()
    if parent is not None:
        parent.join()
        os._exit(1)
