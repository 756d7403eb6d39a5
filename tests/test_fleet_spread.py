"""Batches on a cluster: each capture has one outcome, and only those that kill are blamed."""

# Not beside the tests of Dask: its threads draw random numbers, which Hypothesis takes for its own.

from __future__ import annotations

from typing import TYPE_CHECKING, Any

from hypothesis import given
from hypothesis import strategies as st

from sniffer.fleet.engines.spread import spread
from sniffer.fleet.rows import CaptureTask, UndoneError, WorkerDiedError

if TYPE_CHECKING:
    from collections.abc import Collection

    from sniffer.fleet.engines import Batch


def task(name: str) -> CaptureTask:
    return CaptureTask(name, 1, 0, "r", "data", "{}", "0", name)


class Blaming:
    """A cluster that blames every batch it has when a capture ends its worker."""

    def __init__(self, deadly: Collection[str], faulty: Collection[str], cores: int) -> None:
        self._deadly, self._faulty, self._cores = deadly, faulty, cores
        self._blamed: set[int] = set()
        self._batches: list[Batch] = []
        self.open: set[int] = set()

    def cores(self) -> int:
        return self._cores

    def submit(self, batch: Batch, tries: int) -> Any:
        self._batches.append(batch)
        self.open.add(len(self._batches) - 1)
        return len(self._batches) - 1

    def first(self, handles: Collection[Any]) -> Any:
        handle = min(handles)
        if any(t.uri in self._deadly for t in self._batches[handle]):
            self._blamed |= set(handles)
        return handle

    def rows(self, handle: Any) -> Any:
        self.open.remove(handle)
        if handle in self._blamed:
            raise WorkerDiedError("it died")
        if any(t.uri in self._faulty for t in self._batches[handle]):
            raise UndoneError("no room")
        return [t.uri for t in self._batches[handle]]

    def cancel(self, handles: Collection[Any]) -> None:
        self.open -= set(handles)


@given(
    st.lists(st.sampled_from(["fine", "fine", "deadly", "faulty"]), max_size=20),
    st.integers(1, 5),
    st.integers(0, 3),
)
def test_each_capture_has_one_outcome_and_only_those_that_kill_are_blamed(
    kinds: list[str], size: int, cores: int
) -> None:
    names = {str(n): kind for n, kind in enumerate(kinds)}
    tasks = [task(name) for name in names]
    batches = [tuple(tasks[at : at + size]) for at in range(0, len(tasks), size)]
    deadly, faulty = ({n for n in names if names[n] == kind} for kind in ("deadly", "faulty"))
    cluster = Blaming(deadly, faulty, cores)
    became = [
        (t.uri, "deadly" if isinstance(got, WorkerDiedError) else
                "faulty" if isinstance(got, UndoneError) else "fine")
        for batch, got in spread(batches, cluster, 3)
        for t in batch
    ]  # fmt: skip
    assert sorted(became) == sorted(names.items())
    assert not cluster.open


def test_batches_that_nobody_waits_for_any_more_are_cancelled() -> None:
    cluster = Blaming((), (), cores=4)
    outcomes = spread([(task(str(n)),) for n in range(20)], cluster, 3)
    next(outcomes)
    assert cluster.open
    outcomes.close()
    assert not cluster.open
