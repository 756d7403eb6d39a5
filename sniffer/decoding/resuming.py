"""A pipeline that states what its decoders know, and goes on where others have got to."""

from __future__ import annotations

from typing import TYPE_CHECKING, NamedTuple

from sniffer.decoding.mixed import decoder_of
from sniffer.decoding.options import AUTO
from sniffer.decoding.pipeline import Pipeline
from sniffer.decoding.totals import add_totals

if TYPE_CHECKING:
    from collections.abc import Callable, Mapping, Sequence

    from sniffer.decoding.decoder import Decoder
    from sniffer.decoding.mixed import MixedDecoder
    from sniffer.decoding.options import Options
    from sniffer.decoding.pacing import Pace
    from sniffer.decoding.sink import Part, Sink
    from sniffer.decoding.state import DecoderState
    from sniffer.decoding.summary import Summary
    from sniffer.ground.model import Batch, Chunk
    from sniffer.protocols.base import BusProtocol

States = dict[str, "DecoderState"]
"""What is known of each bus."""


class UnheardBusError(Exception):
    """Something is said on a bus that was silent when the plan was made."""


class BusPlan(NamedTuple):
    """By what one bus is decoded, once that was found out: what is spoken, and its times."""

    spoken: str | BusProtocol
    pace: Pace

    def decoder(
        self, options: Options, bus: str, *, base: int = 0, state: DecoderState | None = None
    ) -> Decoder | MixedDecoder:
        """Return a decoder of a bus that begins at an offset, or where a state is of."""
        return decoder_of(
            options.all_spoken(self.spoken),
            baud=self.pace.baud,
            models=options.models,
            latency_ns=self.pace.latency_ns,
            slowest=self.pace.slowest,
            doubtful=self.pace.doubtful,
            alarms=options.alarms_on(bus),
            base=base,
            state=state,
        )


class ResumablePipeline(Pipeline):
    """A pipeline whose decoders can be stated, and replaced by such that know more."""

    @property
    def is_settled(self) -> bool:
        """Whether all that was heard is decoded: no bus waits for its protocol or its rate."""
        return not (self._waiting or self._late or self._tuned) and bool(self._decoders)

    def plans(self) -> dict[str, BusPlan]:
        """Return by what each bus is decoded."""
        out = {}
        for bus, decoder in self._decoders.items():
            named = self._named(bus)
            out[bus] = BusPlan(decoder.name if named == AUTO else named, self.paces[bus])
        return out

    def states(self) -> States:
        """Return what is known of each bus."""
        return {bus: decoder.state() for bus, decoder in self._decoders.items()}

    def heard(self) -> dict[str, int]:
        """Return how far each bus was heard: the offset of the byte that comes next."""
        return {bus: d.position + d.pending for bus, d in self._decoders.items()}

    def resume(self, plans: Mapping[str, BusPlan], states: Mapping[str, DecoderState]) -> None:
        """Go on with the buses where these states are of."""
        for bus, state in states.items():
            self.paces[bus] = plans[bus].pace
            self._decoders[bus] = plans[bus].decoder(self._options, bus, state=state)

    def take(self, told: Summary, what: Callable[[Sink], None]) -> None:
        """Take what was decoded elsewhere, behind all that was decoded here; ``what`` writes it."""
        add_totals(self.summary, told)
        self._each(what)

    def given(self, bus: str, said: Sequence[tuple[str, Batch]]) -> Sequence[Part]:
        """Return batches, by the name of their protocol, as sinks are given them."""
        known = {protocol.name: protocol for protocol in self._decoders[bus].protocols}
        parts = [(known[name], batch) for name, batch in said]
        return parts if self.narrowing is None else self.narrowing.of(bus, parts)


class PartPipeline(ResumablePipeline):
    """A pipeline for a part of a capture: how each bus is decoded is known beforehand.

    ``known`` are the plans, ``guesses`` what servos were set to long before; ``bases`` tells where
    in its stream a bus begins that is heard for the first time.

    Its calls raise UnheardBusError for a bus of which there is no plan.
    """

    def __init__(
        self,
        options: Options,
        known: Mapping[str, BusPlan],
        guesses: Mapping[str, DecoderState],
        bases: Mapping[str, int],
    ) -> None:
        super().__init__(options, [])
        self._known = known
        self._guesses = guesses
        self._bases = bases

    def decode(self, bus: str, chunks: Sequence[Chunk]) -> None:
        """Decode chunks of one bus."""
        if bus not in self._decoders:
            if bus not in self._known:
                raise UnheardBusError(bus)
            plan, state = self._known[bus], self._guesses[bus]
            self.paces[bus] = plan.pace
            self._decoders[bus] = plan.decoder(
                self._options, bus, base=self._bases[bus], state=state.elsewhere()
            )
        super().decode(bus, chunks)
