"""Dask: a scheduler and its workers, on this machine or on many."""

from __future__ import annotations

import contextlib
import time
from typing import TYPE_CHECKING, Any, Final, Self

from sniffer.fleet.engines.local import ATTEMPTS
from sniffer.fleet.engines.spread import decode_there, spread
from sniffer.fleet.rows import WorkerDiedError
from sniffer.ground.model import InputError
from sniffer.ground.needs import need_dask
from sniffer.jobs.crew import unheard

if TYPE_CHECKING:
    from collections.abc import Collection, Iterable, Iterator, Sequence

    from sniffer.fleet.engines import Batch, Outcome
    from sniffer.fleet.rows import CaptureRow

ANSWERS_S: Final = 10
"""How long a scheduler may take to answer, in seconds; Dask's own patience is 30 s."""

ASKS_S: Final = 0.5
"""How often the scheduler is asked who is there, in seconds: of 1000 workers it names each."""

SILENT: Final = 50
"""``logging.CRITICAL``: of workers that die, and what that costs, we tell ourselves."""


class DaskEngine:
    """Decodes on the workers of a scheduler; on ``workers`` processes of its own without one.

    Trying again and cancelling are the scheduler's. What its workers decode when a run is broken
    off they finish, and commit.
    """

    def __init__(self, workers: int, scheduler: str | None = None) -> None:
        """Take what is asked for.

        Raises:
            OutputError: Dask is not installed.
        """
        need_dask()
        self._workers = workers
        self._scheduler = scheduler
        self._client: Any = None
        self._over: Any = None
        self._cores = 0
        self._asked = -ASKS_S
        self._held = contextlib.ExitStack()

    def __enter__(self) -> Self:
        """Find the scheduler, or start one.

        Raises:
            InputError: no scheduler answers.
        """
        import dask
        from distributed import Client, LocalCluster, as_completed

        with contextlib.ExitStack() as held:
            at: Any = self._scheduler
            if at is None:
                tries = {"distributed.scheduler.allowed-failures": ATTEMPTS - 1}
                held.enter_context(dask.config.set(tries))
                with unheard():  # who runs it here decides what an interruption ends
                    cluster = LocalCluster(
                        n_workers=self._workers,
                        threads_per_worker=1,  # decoding holds Python's lock
                        dashboard_address="127.0.0.1:0",  # None takes 8787, ":0" serves the world
                        silence_logs=SILENT,
                    )
                at = held.enter_context(cluster)
            try:
                client = Client(at, timeout=ANSWERS_S, set_as_default=False)
            except (OSError, ValueError) as error:
                raise InputError(
                    f"no Dask scheduler answers at {self._scheduler} ({error}): start one with "
                    "`dask scheduler`, and workers with `dask worker`"
                ) from None
            self._client = held.enter_context(client)
            self._over = as_completed(loop=self._client.loop)
            self._held = held.pop_all()
        return self

    def __exit__(self, *_: object) -> None:
        """Leave the scheduler, or end the own one."""
        self._held.close()

    def run(self, batches: Iterable[Batch]) -> Iterator[Outcome]:
        """Yield each batch, or parts of it, with what became of it."""
        return spread(batches, self, ATTEMPTS)

    def cores(self) -> int:
        """Return how many threads the workers have: they come and go."""
        now = time.monotonic()
        if now >= self._asked + ASKS_S:
            self._cores, self._asked = sum(self._client.nthreads().values()), now
        return self._cores

    def submit(self, batch: Batch, tries: int) -> Any:
        """Have a batch decoded."""
        future = self._client.submit(decode_there, batch, pure=False, retries=tries - 1)
        self._over.add(future)
        return future

    def first(self, handles: Collection[Any]) -> Any:
        """Wait until one is over."""
        return next(self._over)

    def rows(self, handle: Any) -> Sequence[CaptureRow]:
        """Return what became of a batch."""
        from distributed.scheduler import KilledWorker

        try:
            rows: Sequence[CaptureRow] = handle.result()
        except KilledWorker as error:
            raise WorkerDiedError(f"its worker died {error.allowed_failures + 1} times") from None
        return rows

    def cancel(self, handles: Collection[Any]) -> None:
        """Have those that wait forgotten."""
        self._client.cancel(list(handles))
