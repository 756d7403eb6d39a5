"""All that a decoder knows at one place of its stream: what another one goes on with."""

from __future__ import annotations

from dataclasses import dataclass, field
from typing import TYPE_CHECKING

from sniffer.ground.model import SnifferError

if TYPE_CHECKING:
    from sniffer.ground.memory import Memorised, Observed


@dataclass(frozen=True, slots=True)
class DecoderState:
    """What a decoder of ``protocol`` (``a+b``: two of them) knew; it can be pickled.

    It is for a decoder that is made with the same arguments as the one it is of.
    """

    protocol: str
    memory: Memorised
    _observed: Observed | None = field(repr=False)

    def observable(self) -> Observed:
        """Return what of it can still be told from outside.

        Where two decoders state the same here, both say the same of whatever bytes follow.

        Raises:
            SnifferError: it is of no place in a stream, or a guess.
        """
        if self._observed is None:
            raise SnifferError("this state is of no place: feed a decoder that begins with it")
        return self._observed

    def elsewhere(self) -> DecoderState:
        """Return what of it is true of the servos and the wire at any place of the stream."""
        return DecoderState(self.protocol, self.memory.elsewhere(), None)

    def instead(self, before: DecoderState, guess: DecoderState) -> DecoderState:
        """Return what this would probably be had it begun as ``guess``, not as ``before``."""
        told = self.memory.instead(before.memory, guess.memory)
        return DecoderState(self.protocol, told, None)

    def of(self, protocol: str) -> Memorised:
        """Return the memory, for a decoder of a protocol.

        Raises:
            SnifferError: it is that of another one.
        """
        if protocol != self.protocol:
            raise SnifferError(f"a state of {self.protocol} is none of {protocol}")
        return self.memory
