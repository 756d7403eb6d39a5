"""What a recording showed of its servos, for servos that are to be like them."""

from __future__ import annotations

from collections import Counter
from dataclasses import dataclass, field
from typing import TYPE_CHECKING, Final

from sniffer.decoding.sink import bus_of
from sniffer.ground.codes import (
    DAMAGED,
    MISMATCHED,
    NO_RESPONSE,
    OK,
    REQUEST,
    RESPONSE,
    WHOLE,
)
from sniffer.ground.model import Clock

if TYPE_CHECKING:
    from collections.abc import Mapping, Sequence

    from sniffer.decoding.pacing import Pace
    from sniffer.ground.model import Batch, Chunk
    from sniffer.protocols.base import BusProtocol

DELAYS: Final = 1024
"""Delays that stand for all of a servo's answers to a command, evenly taken from them in order."""

EXPECTED: Final = (OK, NO_RESPONSE, DAMAGED, MISMATCHED)
"""Outcomes of requests that an answer was due to."""


@dataclass(frozen=True, slots=True)
class ServoLikeness:
    """A servo as it was heard.

    ``values`` are the last ones, raw, by register; ``delays_ns`` by command how long after a
    request its answers began; ``missing`` the share of requests, 0..1, that it left unanswered.
    """

    values: Mapping[str, int] = field(default_factory=dict)
    delays_ns: Mapping[str, Sequence[int]] = field(default_factory=dict)
    missing: float = 0.0


class SeenServos:
    """What is known of the servos of one bus; ``baud`` is the rate at which they speak."""

    def __init__(self, protocol: BusProtocol, baud: int) -> None:
        self.protocol = protocol
        self.baud = baud
        self.models: dict[int, str] = {}
        self._values: dict[int, dict[str, int]] = {}
        self._delays: dict[tuple[int, str], list[int]] = {}
        self._spoke: set[int] = set()
        self._asked: set[int] = set()
        self._expected: Counter[int] = Counter()
        self._missing: Counter[int] = Counter()

    def add(self, batch: Batch) -> None:
        """Take what one pass decided."""
        f, t, v = batch.frames, batch.transactions, batch.samples
        self.models |= {who: model for who, (model, _) in batch.models.items()}
        columns = (v.servo_id, v.register, v.raw, v.part)
        for who, number, raw, part in zip(*(c.tolist() for c in columns), strict=True):
            if part == WHOLE:
                self._values.setdefault(who, {})[self.protocol.registers[number].name] = raw
        self._spoke |= {*f.servo_id[f.kind == RESPONSE].tolist()}
        self._asked |= {*f.servo_id[f.kind == REQUEST].tolist()}
        rows = (t.request != -1).nonzero()[0]
        if not len(rows):
            return
        asked = batch.asked(t.request[rows])
        times = t.response_time_ns[rows].tolist()
        who = (asked.servo_id.tolist(), asked.op.tolist(), t.outcome[rows].tolist(), times)
        for servo, op, outcome, took in zip(*who, strict=True):
            self._expected[servo] += outcome in EXPECTED
            self._missing[servo] += outcome == NO_RESPONSE
            if outcome == OK and took >= 0 and batch.clock != Clock.NONE:
                name = self.protocol.op_name(op)
                self._delays.setdefault((servo, name), []).append(took)

    def spoke(self, servo: int) -> bool:
        """Tell whether this servo answered; an id that was only told something may be everybody."""
        return servo in self._spoke

    def likenesses(self) -> dict[int, ServoLikeness]:
        """Return what each servo was like; who was asked and never answered was not there."""
        out = {}
        for servo in sorted(self._spoke | self._asked):
            missing, expected = self._missing[servo], self._expected[servo]
            if servo >= 0 and (servo in self._spoke or not missing):
                delays = {op: _sample(d) for (who, op), d in self._delays.items() if who == servo}
                share = missing / expected if expected else 0.0
                out[servo] = ServoLikeness(self._values.get(servo, {}), delays, share)
        return out


class SeenSink:
    """A sink that keeps what is known of the servos of every bus."""

    def __init__(self) -> None:
        self.buses: dict[str, SeenServos] = {}
        self._bauds: dict[str, int] = {}

    def raw(self, bus: str, chunks: Sequence[Chunk]) -> None:
        """Take nothing."""

    def pace(self, bus: str, told: Pace) -> None:
        """Keep the rate of a bus."""
        self._bauds[bus] = told.baud

    def write(self, bus: str, protocol: BusProtocol, batch: Batch) -> None:
        """Take what one pass decided."""
        name = bus_of(bus, protocol, batch)
        self.buses.setdefault(name, SeenServos(protocol, self._bauds[bus])).add(batch)

    def close(self) -> None:
        """Do nothing."""


def _sample(delays_ns: list[int]) -> tuple[int, ...]:
    """Return as many delays as are kept: the same distribution, so that it can be drawn from."""
    ordered = sorted(delays_ns)
    step = max(len(ordered) / DELAYS, 1.0)
    count = min(len(ordered), DELAYS)
    return tuple(ordered[int((nth + 0.5) * step)] for nth in range(count))
