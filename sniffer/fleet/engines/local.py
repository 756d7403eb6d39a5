"""Processes of this machine, each with a batch at a time; one that dies is replaced.

Where a capture is so large that the others would wait for whoever has it, all of them decode it.
"""

from __future__ import annotations

import heapq
from collections import Counter, deque
from dataclasses import dataclass
from typing import TYPE_CHECKING, Final, Self

from sniffer.fleet.rows import CaptureTask, UndividedError, UndoneError, WorkerDiedError
from sniffer.jobs.crew import Crew, LostWorkerError

if TYPE_CHECKING:
    from collections.abc import Iterable, Iterator, Sequence

    from sniffer.fleet.engines import Batch, Outcome
    from sniffer.fleet.rows import CaptureRow

ATTEMPTS: Final = 3
"""How often a capture may end its process before it is given up."""

PRELOADED: Final = ("sniffer.fleet.engines.preloaded",)
"""What workers find loaded."""


@dataclass(frozen=True, slots=True)
class SharedCapture:
    """A capture that so many processes decode together."""

    task: CaptureTask
    jobs: int


class LocalEngine:
    """Decodes in processes of this machine, as many as ``workers``.

    Captures that are large beside the rest come first, one after the other, each decoded by all of
    them (``shared``): a process of its own sees to it, and to those that decode. If one of these is
    lost that often, or the capture is such that it cannot be divided, it is decoded by one process
    as all others.

    A process that dies, of a capture or because somebody killed it, takes nothing along: its
    captures are tried again, each alone; one that ends its process ``ATTEMPTS`` times is given up.
    """

    def __init__(self, workers: int) -> None:
        self._workers = workers
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
        given = deque(batches)
        alone: list[Batch] = []
        for _ in range(shared(given, self._workers)):
            huge = given.popleft()
            rows, error = self._together(*huge)
            got = rows if error is None else self._failure(huge, error)
            if got is None:
                alone.append(huge)
            else:
                yield huge, got
        waiting: Iterator[Batch] = iter((*alone, *given))
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

    def _together(
        self, task: CaptureTask
    ) -> tuple[Sequence[CaptureRow] | None, BaseException | None]:
        """Have a capture decoded by all; return its row, or why there is none, or neither."""
        self._crew.give(SharedCapture(task, self._workers))
        while not (ended := self._crew.wait()):
            continue
        ((_, rows, error),) = ended
        return rows, error

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


def shared(batches: Sequence[Batch], workers: int) -> int:
    """Return how many of the first captures, the biggest, all workers had better decode together.

    It is reckoned in bytes how long all of it takes, for each number of them. Together they take a
    share each, and the time of two parts at most in which processes begin, or only the last part
    is not done. The others go to whoever is free, the biggest first.
    """
    sizes = [sum(task.size for task in batch) for batch in batches]
    most = 0
    while most < min(len(batches), workers) and _can_be_shared(batches[most]):
        most += 1
    if workers == 1 or not most:
        return 0
    took = 0
    best = _apart(sizes, workers), 0
    for nth, size in enumerate(sizes[:most], 1):
        took += size // workers + 2 * batches[nth - 1][0].sizes.least
        best = min(best, (took + _apart(sizes[nth:], workers), nth))
    return best[1]


def _can_be_shared(batch: Batch) -> bool:
    """Tell whether a batch is one huge capture that lies here: a copy is made by one process."""
    return len(batch) == 1 and batch[0].is_huge and "://" not in batch[0].uri


def _apart(sizes: Sequence[int], workers: int) -> int:
    """Return how many bytes one worker has at most, if who is free takes the next capture."""
    loads = [0] * workers
    for size in sizes:
        heapq.heapreplace(loads, loads[0] + size)
    return max(loads)


def decode_here(given: Batch | SharedCapture) -> list[CaptureRow] | None:
    """Decode captures by one thread, or one by several processes: the cores have one each.

    Returns:
        The rows; None for a capture that several processes cannot decode.

    Raises:
        UndoneError: one of them was not done; those before it are.
        LostWorkerError: a process was lost that had part of a capture.
    """
    import pyarrow as pa

    from sniffer.fleet.task import decode_batch, decode_capture

    pa.set_cpu_count(1)
    if not isinstance(given, SharedCapture):
        return decode_batch(given)
    try:
        return [decode_capture(given.task, given.jobs)]
    except UndividedError:
        return None
