"""Ray: where a cluster of it is there already."""

from __future__ import annotations

import os
from typing import TYPE_CHECKING, Any, Final, Self

from sniffer.fleet.engines.local import ATTEMPTS
from sniffer.fleet.engines.spread import decode_there, spread
from sniffer.fleet.rows import WorkerDiedError
from sniffer.ground.model import InputError
from sniffer.ground.needs import need_ray

if TYPE_CHECKING:
    from collections.abc import Collection, Iterable, Iterator, Sequence

    from sniffer.fleet.engines import Batch, Outcome
    from sniffer.fleet.rows import CaptureRow

SILENT: Final = 50
"""``logging.CRITICAL``: what Ray tells of itself below that, we tell, or nobody asked."""


class RayEngine:
    """Decodes on a Ray cluster (``ray://HOST:10001``, ``auto``); on one of its own without."""

    def __init__(self, workers: int, scheduler: str | None = None) -> None:
        """Take what is asked for.

        Raises:
            OutputError: Ray is not installed.
        """
        need_ray()
        self._workers = workers
        self._scheduler = scheduler
        self._task: Any = None

    def __enter__(self) -> Self:
        """Find the cluster, or start one.

        Raises:
            InputError: no cluster answers.
        """
        os.environ.setdefault(
            "RAY_USAGE_STATS_ENABLED", "0"
        )  # a cluster of ours tells its makers nothing
        import ray

        own = {} if self._scheduler else {"num_cpus": self._workers, "include_dashboard": False}
        try:
            ray.init(self._scheduler or "local", log_to_driver=False, logging_level=SILENT, **own)
        except (ConnectionError, ValueError, RuntimeError) as error:
            raise InputError(
                f"no Ray cluster answers at {self._scheduler} ({error}): start one with "
                "`ray start --head`"
            ) from None
        self._task = ray.remote(num_cpus=1)(decode_there)
        return self

    def __exit__(self, *_: object) -> None:
        """Leave the cluster, or end the own one."""
        import ray

        ray.shutdown()

    def run(self, batches: Iterable[Batch]) -> Iterator[Outcome]:
        """Yield each batch, or parts of it, with what became of it."""
        return spread(batches, self, ATTEMPTS)

    def cores(self) -> int:
        """Return how many the machines have: they come and go."""
        import ray

        return int(ray.cluster_resources().get("CPU", 0))

    def submit(self, batch: Batch, tries: int) -> Any:
        """Have a batch decoded."""
        from sniffer.fleet.rows import UndoneError

        again = [UndoneError] if tries > 1 else False
        task = self._task.options(max_retries=ATTEMPTS - 1, retry_exceptions=again)
        return task.remote(batch)

    def first(self, handles: Collection[Any]) -> Any:
        """Wait until one is over."""
        import ray

        return ray.wait(list(handles), num_returns=1, fetch_local=False)[0][0]

    def rows(self, handle: Any) -> Sequence[CaptureRow]:
        """Return what became of a batch."""
        import ray
        from ray.exceptions import NodeDiedError, OutOfMemoryError, RayTaskError, WorkerCrashedError

        try:
            rows: Sequence[CaptureRow] = ray.get(handle)
        except (WorkerCrashedError, NodeDiedError, OutOfMemoryError):
            raise WorkerDiedError(f"its worker died {ATTEMPTS} times") from None
        except RayTaskError as error:
            raise error.cause from None
        return rows

    def cancel(self, handles: Collection[Any]) -> None:
        """Have those that wait forgotten, those that run broken off."""
        import ray

        for handle in handles:
            ray.cancel(handle, recursive=False)
