"""Engines: who decodes batches of captures, and where."""

from __future__ import annotations

import contextlib
import importlib
import os
from collections.abc import Callable, Iterable, Iterator, Mapping, Sequence
from types import MappingProxyType
from typing import TYPE_CHECKING, Final, Protocol, Self

from sniffer.fleet.rows import CaptureRow, CaptureTask
from sniffer.ground.model import SnifferError
from sniffer.ground.wording import Sentence, offered

if TYPE_CHECKING:
    from types import TracebackType

Batch = Sequence[CaptureTask]

Outcome = tuple[Batch, Sequence[CaptureRow] | BaseException]
"""A batch, and its rows, or why it was not done: ``UndoneError``, ``WorkerDiedError``."""


class Engine(Protocol):
    """Decodes batches of captures, in whatever order; used with ``with``, once."""

    def run(self, batches: Iterable[Batch]) -> Iterator[Outcome]:
        """Yield each batch, or parts of it, with what became of it.

        Batches are taken when there is somebody for them.
        """
        ...

    def __enter__(self) -> Self:
        """Begin."""
        ...

    def __exit__(
        self,
        kind: type[BaseException] | None,
        error: BaseException | None,
        trace: TracebackType | None,
        /,
    ) -> None:
        """End the workers, at once where an exception is under way."""
        ...


def cores() -> int:
    """Return how many processors this process may use."""
    return len(os.sched_getaffinity(0)) if hasattr(os, "sched_getaffinity") else os.cpu_count() or 1


def _local(workers: int | None, scheduler: str | None) -> Engine:
    from sniffer.fleet.engines.local import LocalEngine

    if scheduler is not None:
        raise SnifferError(Sentence("{scheduler} is for an engine of many machines: {engine}"))
    return LocalEngine(workers or cores())


def _dask(workers: int | None, scheduler: str | None) -> Engine:
    from sniffer.fleet.engines.dask import DaskEngine

    return DaskEngine(workers or cores(), scheduler)


def _ray(workers: int | None, scheduler: str | None) -> Engine:
    from sniffer.fleet.engines.ray import RayEngine

    return RayEngine(workers or cores(), scheduler)


ENGINES: Final[Mapping[str, Callable[[int | None, str | None], Engine]]] = MappingProxyType(
    {"local": _local, "dask": _dask, "ray": _ray}
)
"""Makers of engines by name; they take the number of workers and the address of a scheduler."""

_LOADED: Final[Mapping[str, Sequence[str]]] = MappingProxyType(
    {"dask": ("dask", "distributed"), "ray": ("ray",)}
)
"""What engines are made of, beside what each run takes."""


def load_for(name: str) -> None:
    """Load what a run takes, before it begins: what is missing the run tells itself.

    Libraries that are being loaded make of an interruption whatever they like.
    """
    with contextlib.suppress(ImportError):
        for library in ("pyarrow.parquet", "sniffer.fleet.task", *_LOADED.get(name, ())):
            importlib.import_module(library)


def engine_named(name: str, workers: int | None, scheduler: str | None) -> Engine:
    """Return an engine.

    Raises:
        SnifferError: there is no such one, or it takes no scheduler.
        OutputError: its library is not installed.
    """
    if name not in ENGINES:
        told = "{engine}: there is no {name}: {known}"
        raise SnifferError(Sentence(told, name=repr(name[:40]), known=offered(name, ENGINES)))
    return ENGINES[name](workers, scheduler)
