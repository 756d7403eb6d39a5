"""Processes of this machine, each with a batch at a time; one that dies is replaced."""

from __future__ import annotations

from collections import Counter, deque
from typing import TYPE_CHECKING, Final, Self

from sniffer.fleet.rows import UndoneError, WorkerDiedError
from sniffer.jobs.crew import Crew, LostWorkerError

if TYPE_CHECKING:
    from collections.abc import Iterable, Iterator

    from sniffer.fleet.engines import Batch, Outcome
    from sniffer.fleet.rows import CaptureRow

ATTEMPTS: Final = 3
"""How often a capture may end its process before it is given up."""

PRELOADED: Final = ("sniffer.fleet.task", "pyarrow.parquet")
"""What workers find loaded."""


class LocalEngine:
    """Decodes in processes of this machine, as many as ``workers``.

    A process that dies, of a capture or because somebody killed it, takes nothing along: its
    captures are tried again, each alone; one that ends its process ``ATTEMPTS`` times is given up.
    """

    def __init__(self, workers: int) -> None:
        self._crew = Crew(workers, decode_here, preload=PRELOADED)
        self._deaths: Counter[str] = Counter()
        self._stillborn = 0

    def __enter__(self) -> Self:
        self._crew.__enter__()
        return self

    def __exit__(self, *error: object) -> None:
        """End the processes at once; what they have finished is committed."""
        self._crew.__exit__(*error)

    def run(self, batches: Iterable[Batch]) -> Iterator[Outcome]:
        """Yield each batch, or parts of it, with what became of it.

        Raises:
            UndoneError: no process can be begun.
        """
        waiting = iter(batches)
        again: deque[Batch] = deque()
        while True:
            while self._crew.has_room:
                batch = again.popleft() if again else next(waiting, None)
                if batch is None:
                    break
                self._crew.give(batch)
            if not self._crew.is_busy:
                return
            for batch, rows, error in self._crew.wait():
                got = rows if error is None else self._failure(batch, error)
                if got is None:
                    again.extend((task,) for task in batch)
                else:
                    yield batch, got

    def _failure(self, batch: Batch, error: BaseException) -> BaseException | None:
        """Return why a batch is not done, None: its captures are tried again, each alone."""
        if isinstance(error, LostWorkerError):
            return self._death(batch, error)
        if len(batch) > 1:
            return None
        if isinstance(error, UndoneError):
            return error
        return UndoneError(f"{batch[0].uri}: {type(error).__name__}: {error}")

    def _death(self, batch: Batch, error: LostWorkerError) -> WorkerDiedError | None:
        """Return what a worker's death means for its captures."""
        if not error.had_begun:
            self._stillborn += 1
            if self._stillborn == ATTEMPTS:
                raise UndoneError("worker processes end here before they begin")
            return None
        self._deaths.update(task.fingerprint for task in batch)
        if len(batch) > 1 or self._deaths[batch[0].fingerprint] < ATTEMPTS:
            return None
        return WorkerDiedError(f"its process died {ATTEMPTS} times")


def decode_here(batch: Batch) -> list[CaptureRow]:
    """Decode captures by one thread: the cores have a process each.

    Raises:
        UndoneError: one of them was not done; those before it are.
    """
    import pyarrow as pa

    from sniffer.fleet.task import decode_batch

    pa.set_cpu_count(1)
    return decode_batch(batch)
