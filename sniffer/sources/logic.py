"""Captures of levels as a source: read once, with what is found of their channels known early.

What a recording says of itself (its rates) must be known before the first chunk is decoded. Here it
is found from the edges, so a capture is read on until all channels are known, and what came by then
is handed on first.
"""

from __future__ import annotations

import math
import time
from types import MappingProxyType
from typing import TYPE_CHECKING, Final

from sniffer.ground.limits import is_time
from sniffer.ground.model import DamagedInputError, InputError
from sniffer.ground.runs import joined
from sniffer.ground.wiring import Wiring
from sniffer.ground.wording import Sentence
from sniffer.signals.channels import Channels
from sniffer.sources.dsview import read_dsl
from sniffer.sources.saleae_binary import read_saleae_binary
from sniffer.sources.signal_csv import read_signal_csv
from sniffer.sources.sigrok import read_sr
from sniffer.sources.vcd import read_vcd

if TYPE_CHECKING:
    from collections.abc import Callable, Generator, Iterator, Mapping, Sequence
    from contextlib import AbstractContextManager

    from sniffer.ground.model import Chunk
    from sniffer.signals.stretch import LogicInput
    from sniffer.sources.text import Opened

FORMS: Final[Mapping[str, Callable[[Opened], LogicInput]]] = MappingProxyType(
    {
        "sr": read_sr,
        "dsl": read_dsl,
        "vcd": read_vcd,
        "saleae-bin": read_saleae_binary,
        "logic-csv": read_signal_csv,
    }
)
"""Readers by the name of their form."""

GROUP_MOST: Final = 1 << 14
"""Chunks of a group, of 16 bytes at most."""

AHEAD_MOST: Final = 1 << 15
"""Chunks that are held while a channel is waited for that says nothing yet."""

NO_DATE: Final = "the capture has no date: its times count from its begin or its trigger"


class LogicCapture:
    """A capture of levels.

    Args:
        opening: opens it, from its first byte on; what can be read only once is opened once.
        form: one of ``FORMS``.
        wiring: what was said of its wires.
    """

    def __init__(
        self,
        opening: Callable[[], AbstractContextManager[Opened]],
        form: str,
        wiring: Wiring | None = None,
    ) -> None:
        self._opening, self._form, self._wiring = opening, form, wiring or Wiring()
        self._facts: dict[str, str] = {}
        self._ahead: list[Sequence[Chunk]] = []
        self._going: Generator[Sequence[Chunk]] | None = None
        self._damage: DamagedInputError | None = None
        self._channels: Channels | None = None

    @property
    def is_ahead(self) -> bool:
        """Whether its beginning was read and is still to be handed on."""
        return self._going is not None

    def settle(self) -> None:
        """Read on until it is known what the channels are.

        Raises:
            InputError: none of them can be read.
        """
        self._going = self._lists()
        try:
            held = 0
            for chunks in self._going:
                if chunks:
                    self._ahead.append(chunks)
                held += len(chunks)
                if self._is_settled or held > AHEAD_MOST:
                    break
        except DamagedInputError as error:
            self._damage = error  # it is told behind what comes before
        if self._channels is not None:
            self._facts = self._channels.facts()

    def facts(self) -> Mapping[str, str]:
        """Return what is known of the buses: their rates, and how exact the times are."""
        return self._facts

    def chunks(self) -> Iterator[Chunk]:
        """Yield the chunks of all buses, as ``groups`` does."""
        for group in self.groups():
            yield from group

    def groups(self, lag_s: float = math.inf) -> Iterator[Sequence[Chunk]]:
        """Yield the chunks of all buses in groups; a slow input is handed on after ``lag_s``.

        Raises:
            DamagedInputError: the capture is damaged from there on.
        """
        going, self._going = self._going, None
        group, self._ahead = self._ahead, []
        held = sum(map(len, group))
        damage, self._damage = self._damage, None
        due = time.monotonic() + lag_s
        try:
            if damage is not None:
                raise damage
            for chunks in going or self._lists():
                if chunks:
                    group.append(chunks)
                held += len(chunks)
                if held >= GROUP_MOST or time.monotonic() > due:
                    yield joined(group)
                    group, held, due = [], 0, time.monotonic() + lag_s
        except (DamagedInputError, KeyboardInterrupt):
            if group:
                yield joined(group)  # what came before it is decoded
            raise
        if group:
            yield joined(group)

    def close(self) -> None:
        """Let go of a capture whose beginning only was read."""
        if self._going is not None:
            self._going.close()

    @property
    def _is_settled(self) -> bool:
        return self._channels is not None and self._channels.is_settled

    def _lists(self) -> Generator[Sequence[Chunk]]:
        with self._opening() as opened:
            name = opened.name
            try:
                given = FORMS[self._form](opened)
                self._channels = channels = Channels(given, self._wiring)
                try:
                    for stretch in given.stretches:
                        end_ns = given.zero_ns + stretch.until * given.tick_ns
                        if not is_time(int(end_ns)):
                            raise DamagedInputError(f"{name}: its times are beyond all bounds")
                        yield channels.take(stretch)
                except DamagedInputError:
                    yield self._rest(channels)
                    raise
                yield channels.end()
            except InputError as error:
                named = str(error).startswith(f"{name}: ")
                told = Sentence("{name}: {error}", name=name, error=error)
                raise InputError(error if named else told) from None
            opened.notes.extend(channels.notes())
            if not given.is_dated:
                opened.notes.append(NO_DATE)

    def _rest(self, channels: Channels) -> Sequence[Chunk]:
        """Return what a damaged capture holds up to its damage, if it can be read at all."""
        try:
            return channels.end()
        except InputError:
            return []
