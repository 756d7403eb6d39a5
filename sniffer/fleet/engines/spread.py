"""Batches on a cluster: how many are submitted at once, and who it was when a worker died.

A cluster says how a batch is submitted and what became of it; what all clusters have in common is
here. Nothing is kept of what is done, so a run of any length takes the same memory.
"""

from __future__ import annotations

import functools
import itertools
from collections import deque
from typing import TYPE_CHECKING, Any, Final, Protocol

from sniffer.fleet.recipe import decoder_name
from sniffer.fleet.rows import CaptureRow, UndoneError, WorkerDiedError
from sniffer.ground.model import SnifferError

if TYPE_CHECKING:
    from collections.abc import Collection, Generator, Iterable, Iterator, Sequence

    from sniffer.fleet.engines import Batch, Outcome

AHEAD: Final = 2
"""Batches a core that a cluster has: one is decoded, one waits there for its turn."""


class OtherProgramError(SnifferError):
    """A worker would decode by another program than the data set is made with."""


class Cluster(Protocol):
    """What decodes batches somewhere, in any order."""

    def cores(self) -> int:
        """Return how many batches can be decoded at once, at the moment."""
        ...

    def submit(self, batch: Batch, tries: int) -> Any:
        """Have a batch decoded, ``tries`` times if it raises; return a handle that can be a key."""
        ...

    def first(self, handles: Collection[Any]) -> Any:
        """Wait until one is over, and return it."""
        ...

    def rows(self, handle: Any) -> Sequence[CaptureRow]:
        """Return what became of a batch that is over.

        Raises:
            WorkerDiedError: each worker that had it died.
            Exception: what its decoding raised, the last time it was tried.
        """
        ...

    def cancel(self, handles: Collection[Any]) -> None:
        """Let go of batches that nobody waits for any more."""
        ...


def spread(batches: Iterable[Batch], cluster: Cluster, attempts: int) -> Generator[Outcome]:
    """Yield each batch when it is over, or its captures one by one, with what became of it.

    Schedulers blame every task that a dead worker had, also those that only waited there. So a
    batch whose workers died is taken apart, and its captures are tried again at the end, one by
    one, with nothing beside them: which of them it was is certain then.

    Raises:
        OtherProgramError: the workers have another program.
    """
    waiting = iter(batches)
    again: deque[Batch] = deque()
    suspects: deque[Batch] = deque()
    running: dict[Any, Batch] = {}
    try:
        while True:
            free = max(AHEAD * cluster.cores(), 1) - len(running)
            for batch in itertools.islice(itertools.chain(_taken(again), waiting), max(free, 0)):
                running[cluster.submit(batch, attempts if len(batch) == 1 else 1)] = batch
            is_alone = not running
            if is_alone:
                if not suspects:
                    return
                batch = suspects.popleft()
                running[cluster.submit(batch, attempts)] = batch
            handle = cluster.first(running)
            batch = running.pop(handle)
            got: Sequence[CaptureRow] | BaseException
            try:
                got = cluster.rows(handle)
            except WorkerDiedError as error:
                if not is_alone:
                    suspects.extend((task,) for task in batch)
                    continue
                got = error
            except OtherProgramError:
                raise
            except Exception as error:
                if len(batch) > 1:  # one of them; the others are good
                    again.extend((task,) for task in batch)
                    continue
                told = f"{batch[0].uri}: {type(error).__name__}: {error}"
                got = error if isinstance(error, UndoneError) else UndoneError(told)
            yield batch, got
    finally:
        cluster.cancel(running)


def _taken(batches: deque[Batch]) -> Iterator[Batch]:
    while batches:
        yield batches.popleft()


def decode_there(batch: Batch) -> list[CaptureRow]:
    """Decode captures on a machine that may have another program.

    Raises:
        OtherProgramError: it has, and its files would not be what their names say.
        UndoneError: one of them was not done; those before it are.
    """
    from sniffer.fleet.task import decode_batch

    task = batch[0]
    here = _decoder(task.recipe)
    if here != task.decoder:
        raise OtherProgramError(
            f"the workers have another sniffer ({here}) than this one ({task.decoder}): "
            "install the same version, with the same plug-ins, on all machines"
        )
    return decode_batch(batch)


_decoder: Final = functools.lru_cache(maxsize=4)(decoder_name)
