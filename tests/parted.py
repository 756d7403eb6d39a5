"""What tests of captures in parts have in common: a crew that works here, recordings to part."""

from __future__ import annotations

import pickle
from typing import TYPE_CHECKING, Any

from sniffer.jobs.crew import TaskEnd as Became
from sniffer.mcapfile.sink import McapSink

if TYPE_CHECKING:
    from collections.abc import Callable, Sequence
    from pathlib import Path

    from sniffer.ground.model import Chunk


class Inline:
    """A crew of one that works here: what it is given and returns is pickled all the same."""

    def __init__(
        self, count: int, do: Callable[[Any], Any], *, preload: Sequence[str] = ()
    ) -> None:
        self._do = do
        self._became: list[Became] = []
        del count, preload

    @property
    def has_room(self) -> bool:
        return not self._became

    def give(self, task: Any) -> None:
        try:
            done = pickle.loads(pickle.dumps(self._do(pickle.loads(pickle.dumps(task)))))
            self._became.append(Became(task, done, None))
        except Exception as error:
            self._became.append(Became(task, None, error))

    def wait(self, seconds: float) -> list[Became]:
        del seconds
        became, self._became = self._became, []
        return became

    def __enter__(self) -> Inline:
        return self

    def __exit__(self, *_: object) -> None:
        """Do nothing."""


def recorded(path: Path, chunks: Sequence[Chunk], each: int = 1) -> Path:
    """Write a recording that has a chunk of its own for every few chunks."""
    sink = McapSink(path, {"tool": "servo-sniffer test"})
    for i in range(0, len(chunks), each):
        sink.raw("bus0", chunks[i : i + each])
        sink.flush()
    sink.close()
    return path
