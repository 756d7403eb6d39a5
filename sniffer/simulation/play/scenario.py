"""What is to be played: which bus, who is on it, what goes wrong."""

from __future__ import annotations

import math
from dataclasses import dataclass, field
from typing import TYPE_CHECKING, Any

from sniffer import __version__
from sniffer.ground.limits import BAUDS, whole
from sniffer.ground.model import SnifferError
from sniffer.ground.wording import Sentence
from sniffer.simulation.buses import BUSES
from sniffer.simulation.faults import CONTROLLER_FAULTS, spelled

if TYPE_CHECKING:
    from collections.abc import Mapping, Sequence

    from sniffer.simulation.faults import Fault
    from sniffer.simulation.likeness import ServoLikeness


@dataclass(frozen=True, slots=True)
class Scenario:
    """A bus to be played; what is None is as usual for its protocol.

    Args:
        protocol: a name of ``sniffer.simulation.BUSES``.
        servos: who is on the bus: ids, or how many.
        baud: bits per second.
        rate_hz: cycles of the controller per second.
        full: cycle after cycle, so that the line is loaded as far as it goes.
        seed: the same seed plays the same.
        duration_ns: when it is over; None: never.
        faults: what goes wrong.
        respond: only the servos are played; they answer a controller.
        models: servo id (None: all) -> model.
        like: servos that are as they were seen before, by their ids.

    Raises:
        SnifferError: the protocol has no such bus; the sentence says what there is.
    """

    protocol: str
    servos: int | Sequence[int] | None = None
    baud: int | None = None
    rate_hz: int | None = None
    full: bool = False
    seed: int = 0
    duration_ns: int | None = None
    faults: Sequence[Fault] = ()
    respond: bool = False
    models: Mapping[int | None, str] = field(default_factory=dict)
    like: Mapping[int, ServoLikeness] = field(default_factory=dict)

    def __post_init__(self) -> None:
        if self.respond and (self.full or self.rate_hz is not None):
            raise SnifferError(
                Sentence("{respond} plays no controller: {rate_hz} and {full} say nothing")
            )
        if self.like and not self.respond:
            raise SnifferError(Sentence("{like} is about servos: it needs {respond}"))
        if self.protocol not in BUSES:
            known = ", ".join(BUSES)
            raise SnifferError(f"{self.protocol} has no simulator: there is one of {known}")
        if self.baud is not None:
            whole("baud", self.baud, *BAUDS)
        if self.servos is not None:
            asked = self.servos if isinstance(self.servos, int) else len({*self.servos})
            _check_count(self.protocol, asked)
            _check_ids(self.protocol, self.servo_ids)
        self._check_models()
        for fault in self.faults:
            if fault.servo_id not in (None, *self.servo_ids):
                raise self._absent("faults", f"{spelled(fault.kind)}:{fault.servo_id}")
            if self.respond and fault.kind in CONTROLLER_FAULTS:
                told = "{respond} plays no controller: {faults:%s} says nothing"
                raise SnifferError(Sentence(told % spelled(fault.kind)))
            if fault.kind in BUSES[self.protocol].unknown_faults:
                told = "{faults:%s}: nothing on a {protocol} bus would show that"
                raise SnifferError(Sentence(told % spelled(fault.kind), protocol=self.protocol))

    def _check_models(self) -> None:
        tables = BUSES[self.protocol].tables
        for servo_id, model in self.models.items():
            if model not in tables:
                raise SnifferError(
                    Sentence(
                        "{models}: {model} is none of the {protocol} models: {known}",
                        model=model,
                        protocol=self.protocol,
                        known=", ".join(tables),
                    )
                )
            if servo_id not in (None, *self.servo_ids):
                raise self._absent("models", f"{servo_id}={model}")

    def _absent(self, argument: str, named: str) -> SnifferError:
        here = ", ".join(map(str, self.servo_ids))
        told = f"{{{argument}}}: {{named}}: that servo is not on the bus, only {{here}}"
        return SnifferError(Sentence(told, named=named, here=here))

    @property
    def servo_ids(self) -> tuple[int, ...]:
        """Who is on the bus."""
        kind = BUSES[self.protocol]
        if self.servos is None:
            return kind.servo_ids
        if isinstance(self.servos, int):
            first = max(kind.ids.start, min(kind.servo_ids))
            return tuple(range(first, first + self.servos))
        return tuple(sorted({*self.servos}))

    @property
    def line_baud(self) -> int:
        """Bits per second."""
        return self.baud or BUSES[self.protocol].baud

    @property
    def cycles_hz(self) -> int | None:
        """Cycles of the controller per second; None where the line sets them, or nobody asks."""
        if self.full or self.respond:
            return None
        return self.rate_hz or BUSES[self.protocol].rate_hz

    def facts(self) -> dict[str, Any]:
        """Return the first line of the truth."""
        struck = [
            {
                "kind": f.kind,
                "rate": f.rate,
                "servo_id": f.servo_id,
                "first_s": f.first_s,
                "last_s": None if math.isinf(f.last_s) else f.last_s,
            }
            for f in self.faults
        ]
        seen = {str(who): [*one.values] for who, one in self.like.items()}
        return {
            "version": __version__,
            "protocol": self.protocol,
            "baud": self.line_baud,
            "seed": self.seed,
            "servos": list(self.servo_ids),
            "models": {"all" if who is None else str(who): m for who, m in self.models.items()},
            "faults": struck,
            "rate_hz": self.cycles_hz,
            "full": self.full,
            "respond": self.respond,
            **({"recorded_registers": seen} if seen else {}),
        }


def _check_count(protocol: str, count: int) -> None:
    most = BUSES[protocol].most
    if not 1 <= count <= most:
        told = "{servos}: {protocol} has room for {room}"
        raise SnifferError(Sentence(told, protocol=protocol, room=f"1..{most}"))


def _check_ids(protocol: str, ids: Sequence[int]) -> None:
    there = BUSES[protocol].ids
    if any(servo_id not in there for servo_id in ids):
        told = "{servos}: {protocol} has the ids {known}"
        known = f"{there.start}..{there.stop - 1}"
        raise SnifferError(Sentence(told, protocol=protocol, known=known))
