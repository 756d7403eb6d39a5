"""What a recording showed of its servos, gathered for servos that are to be like them."""

from __future__ import annotations

from collections import Counter
from typing import TYPE_CHECKING, Final

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
from sniffer.simulation.likeness import ServoLikeness

if TYPE_CHECKING:
    from collections.abc import Sequence

    from sniffer.decoding.pacing import Pace
    from sniffer.ground.model import Batch, Chunk
    from sniffer.protocols.base import BusProtocol

DELAYS: Final = 1024
"""Delays that stand for all of a servo's answers to a command, evenly taken from them in order."""

EXPECTED: Final = (OK, NO_RESPONSE, DAMAGED, MISMATCHED)
"""Outcomes of requests that an answer was due to."""


class SeenServos:
    """What is known of the servos of one bus."""

    def __init__(self, protocol: BusProtocol) -> None:
        self.protocol = protocol
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
    """A sink that keeps what is known of the servos of every bus, and at what rate they speak."""

    def __init__(self) -> None:
        self.buses: dict[str, SeenServos] = {}
        self.bauds: dict[str, int] = {}

    def raw(self, bus: str, chunks: Sequence[Chunk]) -> None:
        """Take nothing."""

    def pace(self, bus: str, told: Pace) -> None:
        """Keep the rate of a bus."""
        self.bauds[bus] = told.baud

    def write(self, bus: str, protocol: BusProtocol, batch: Batch) -> None:
        """Take what one pass decided."""
        name = f"{bus}.{protocol.name}" if batch.is_shared else bus
        self.buses.setdefault(name, SeenServos(protocol)).add(batch)

    def close(self) -> None:
        """Do nothing."""


def _sample(delays_ns: list[int]) -> tuple[int, ...]:
    """Return as many delays as are kept: the same distribution, so that it can be drawn from."""
    ordered = sorted(delays_ns)
    step = max(len(ordered) / DELAYS, 1.0)
    count = min(len(ordered), DELAYS)
    return tuple(ordered[int((nth + 0.5) * step)] for nth in range(count))
