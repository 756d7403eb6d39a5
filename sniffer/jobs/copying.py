"""Bytes copied into files as they are read, beside what is decoded of them or alone."""

from __future__ import annotations

import contextlib
from typing import TYPE_CHECKING, TypeVar

from sniffer.ground.model import DamagedInputError, InputError, OutputError
from sniffer.ground.wording import Sentence, and_
from sniffer.jobs.session import Ending, Patience

if TYPE_CHECKING:
    from collections.abc import Iterable, Iterator, Mapping, Sequence

    from sniffer.ground.model import Chunk
    from sniffer.jobs.telling import Teller
    from sniffer.sinks.raw import RawFile
    from sniffer.sources import Source

    _Group = TypeVar("_Group", bound=Sequence[Chunk])


class Copies:
    """Hands what is read to files of bytes; one that fails is given up, the others go on.

    ``rates`` are those that the source tells of its buses: files of bytes do not.
    """

    def __init__(self, files: Sequence[RawFile], rates: Mapping[str, int] | None = None) -> None:
        self._files = list(files)
        self._rates = rates or {}
        self._failure: OutputError | None = None

    def of(self, groups: Iterable[_Group]) -> Iterator[_Group]:
        """Pass groups on, each once it is written."""
        for group in groups:
            for file in list(self._files):
                try:
                    file.take(group)
                except OutputError as error:
                    self._failed(file, error)
            yield group

    def _failed(self, file: RawFile, error: OutputError) -> None:
        self._failure = self._failure or error
        self._files.remove(file)
        with contextlib.suppress(OutputError):
            file.close()

    def finish(self, tell: Teller) -> None:
        """Close the files; say what they have no room for.

        Raises:
            OutputError: one of them could not be written.
        """
        for file in list(self._files):
            try:
                file.close()
            except OutputError as error:
                self._failure = self._failure or error
                self._files.remove(file)
        for file in self._files:
            if told := file.lost():
                tell.talk(told)
        if self._files and self._rates:
            tell.talk(_untold(self._rates))
        self._files = []
        if self._failure is not None:
            raise self._failure


def _untold(rates: Mapping[str, int]) -> str:
    """Return that bytes alone do not tell their rates, and what does."""
    if len({*rates.values()}) == 1:
        told = "the bytes do not tell their rate: decode them with {baud} {rate}"
        return Sentence(told, rate=next(iter(rates.values())))
    each = and_([f"{rate} on {bus}" for bus, rate in rates.items()])
    return f"the bytes do not tell their rates ({each}): a recording does"


def copy_source(
    source: Source, copies: Copies, *, name: str, tell: Teller, patience: Patience | None
) -> Ending:
    """Copy all bytes of a source without decoding them; return how it ended.

    Raises:
        InputError: there is nothing in it.
        OutputError: a file failed; the others are whole.
    """
    patience = patience or Patience()
    ending, told, any_bytes = Ending.DONE, "", False
    try:
        with patience.decoding():
            try:
                for group in copies.of(patience.groups(source)):
                    any_bytes = any_bytes or any(chunk.data for chunk in group)
            except DamagedInputError as error:
                usable = source.format == "mcap" and any_bytes
                ending = Ending.DONE if usable else Ending.DAMAGED
                told = f"{error}: read as far as it goes" if usable else str(error)
            except KeyboardInterrupt:
                ending, told = Ending.INTERRUPTED, "interrupted: what was read is kept"
    finally:
        copies.finish(tell)
    if not any_bytes and ending == Ending.DONE:
        raise InputError(f"{name} is empty: nothing to convert")
    if told:
        tell.warn(told)
    else:
        for note in source.notes:
            tell.talk(f"{name}: {note}")
    return ending
