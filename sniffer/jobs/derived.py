"""A source made of others: the same ways to read it, other chunks and other facts."""

from __future__ import annotations

from typing import TYPE_CHECKING

from sniffer.sources.source import Source

if TYPE_CHECKING:
    from collections.abc import Callable, Iterable, Iterator, Mapping, Sequence

    from sniffer.ground.model import Chunk
    from sniffer.ground.registers import RegisterMap


class Derived(Source):
    """What ``made`` makes of the groups of a source, each time it is read.

    Args:
        of: the source; closed with this one.
        made: takes its groups, returns others.
        facts: what it says of itself, in place of what the source said.
        is_mixed: whether lines of two taps may be mixed in it; as in the source where None.
        origin: what a recording of it names as its source; the path where None.
        tables: the register tables that it brings; the source's where None.
    """

    def __init__(
        self,
        of: Source,
        made: Callable[[Iterable[Sequence[Chunk]]], Iterator[Sequence[Chunk]]],
        facts: Mapping[str, str],
        *,
        origin: str | None = None,
        is_mixed: bool | None = None,
        tables: Callable[[], Sequence[RegisterMap]] | None = None,
    ) -> None:
        super().__init__(of.name, of.format)
        self._of = of
        self._made = made
        self._facts = facts
        self._from = origin
        self._is_mixed = of.is_mixed if is_mixed is None else is_mixed
        self._tables = tables

    def __iter__(self) -> Iterator[Sequence[Chunk]]:
        yield from self._made(self._of)
        self.notes[:] = self._of.notes

    @property
    def label(self) -> str:
        """What kind of input it is made of, in words."""
        return self._of.label

    @property
    def is_mixed(self) -> bool:
        """Whether lines of two taps may be mixed in it."""
        return self._is_mixed

    def facts(self) -> Mapping[str, str]:
        """Return what it says of itself."""
        return self._facts

    def tables(self) -> list[RegisterMap]:
        """Return the register tables that are attached."""
        return self._of.tables() if self._tables is None else list(self._tables())

    def origin(self, path: str) -> str | None:
        """Return what a recording of it is to name as its source."""
        return path if self._from is None else self._from

    def hasten(self, payload: int, chunks: int) -> None:
        """Let the first group of what it is made of have no more."""
        self._of.hasten(payload, chunks)

    def close(self) -> None:
        """Release the source."""
        self._of.close()
