"""What an input is to whoever reads it: one, several in a row, or one that is made of another."""

from __future__ import annotations

import abc
from typing import TYPE_CHECKING

if TYPE_CHECKING:
    from collections.abc import Iterator, Mapping, Sequence
    from pathlib import Path
    from typing import Self

    from sniffer.ground.model import Chunk
    from sniffer.ground.registers import RegisterMap


class Source(abc.ABC):
    """An input: iterate it for groups of chunks, in order.

    ``name`` is what it is called in sentences, ``format`` what it is written in. ``notes`` holds,
    after iterating, what a person should know although nothing is wrong (dumps joined, a last line
    cut off).
    """

    def __init__(self, name: str, input_format: str) -> None:
        self.name = name
        self.format = input_format
        self.notes: list[str] = []

    @abc.abstractmethod
    def __iter__(self) -> Iterator[Sequence[Chunk]]:
        """Yield its groups.

        Raises:
            DamagedInputError: it breaks off; what came before has been yielded.
        """

    @property
    @abc.abstractmethod
    def label(self) -> str:
        """What kind of input it is, in words."""

    @abc.abstractmethod
    def facts(self) -> Mapping[str, str]:
        """Return what it knows about itself: protocol and baud by bus, models."""

    @abc.abstractmethod
    def tables(self) -> list[RegisterMap]:
        """Return the register tables that it brings."""

    @abc.abstractmethod
    def hasten(self, payload: int, chunks: int) -> None:
        """Let the first group have no more than so many bytes and chunks: somebody waits for it."""

    @abc.abstractmethod
    def close(self) -> None:
        """Release it, read to its end or not."""

    @property
    def is_mixed(self) -> bool:
        """Whether lines of two taps may be mixed in it."""
        return False

    @property
    def path(self) -> Path | None:
        """The file that it is read from; None where it is none, or several."""
        return None

    @property
    def size(self) -> int | None:
        """Bytes of its files; None where it has none."""
        return None

    def origin(self, path: str) -> str | None:
        """Return what a recording of it is to name as its source: the path it was opened by.

        None: it is to name nobody, and no day.
        """
        return path

    def describe(self) -> str:
        """Return one line that says what the input is."""
        return f"{self.name}: {self.label}"

    def __enter__(self) -> Self:
        return self

    def __exit__(self, *_: object) -> None:
        self.close()
