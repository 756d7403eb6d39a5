"""A simulated bus on a wire: timed frames whose truth is known. Bytes and times, no I/O.

``simulate`` is an endless iterator (or one of ``duration_s``); who plays it on a port keeps the
time. The line is half-duplex: nothing overlaps, and every byte takes ten bits at the baud rate.
"""

from __future__ import annotations

import random
from types import MappingProxyType
from typing import TYPE_CHECKING, Final

from sniffer.model import NS, SnifferError
from sniffer.simulation import faults as f
from sniffer.simulation.faults import Fault, Mischief
from sniffer.simulation.lss import LssBus
from sniffer.simulation.mightyzap import MightyZapBus
from sniffer.simulation.rs30x import Rs30xBus
from sniffer.simulation.talk import (
    NOISE,
    REQUEST,
    RESPONSE,
    US,
    Bus,
    Exchange,
    Message,
    Servo,
    TrueFrame,
    Wait,
)
from sniffer.simulation.wck import WckBus

if TYPE_CHECKING:
    from collections.abc import Generator, Iterator, Mapping, Sequence

BUSES: Final[Mapping[str, type[Bus]]] = MappingProxyType(
    {b.name: b for b in (MightyZapBus, LssBus, WckBus, Rs30xBus)}
)
"""The simulated protocols by name."""

NOBODY: Final = -2
"""Stands for the servo of frames that address all, and of noise."""

JITTER_NS: Final = 30 * US
"""How much a servo's turnaround varies, a figure of the simulation."""


def simulate(
    protocol: str,
    *,
    seed: int = 0,
    servo_ids: Sequence[int] | None = None,
    baud: int | None = None,
    rate_hz: int | None = None,
    faults: Sequence[Fault] = (),
    start_ns: int = 0,
    duration_s: float | None = None,
) -> Iterator[TrueFrame]:
    """Yield the frames of a bus in wire order.

    Args:
        protocol: a name of ``BUSES``.
        seed: the same seed gives the same frames.
        servo_ids: who is on the bus; the protocol's usual ids where None.
        baud: bits per second; the protocol's usual rate where None.
        rate_hz: cycles of the controller per second; it skips what the line has no time for.
        faults: what goes wrong.
        start_ns: the time of the first frame.
        duration_s: bus time after which nothing new is asked; None for ever.

    Raises:
        SnifferError: no such protocol.
    """
    if protocol not in BUSES:
        raise SnifferError(f"no simulation of {protocol!r}: one of {', '.join(BUSES)}")
    kind = BUSES[protocol]
    bus = kind(
        seed,
        baud=baud or kind.baud,
        rate_hz=rate_hz or kind.rate_hz,
        servo_ids=servo_ids or kind.servo_ids,
    )
    line = _Line(bus, Mischief(faults, random.Random(f"{protocol} faults {seed}")), start_ns, seed)
    return line.run(None if duration_s is None else int(duration_s * NS))


class _Line:
    def __init__(self, bus: Bus, mischief: Mischief, start_ns: int, seed: int) -> None:
        self._bus = bus
        self._mischief = mischief
        self._start_ns = start_ns
        self._rng = random.Random(f"{bus.name} timing {seed}")
        self._free_ns = 0  # the line is free from then on

    def run(self, duration_ns: int | None) -> Iterator[TrueFrame]:
        talk = self._bus.talk()
        step = next(talk)
        while duration_ns is None or self._free_ns < duration_ns:
            heard = True
            if isinstance(step, Wait):
                self._free_ns = max(self._free_ns, step.until_ns)
            else:
                heard = yield from self._exchange(step)
                self._free_ns += self._rng.randint(*self._bus.pause_ns)
            self._pass_time(self._free_ns)
            step = talk.send(heard)

    def _pass_time(self, now_ns: int) -> None:
        """Move the mechanics on; power comes and goes."""
        bus = self._bus
        bus.now_ns = now_ns
        bus.rig.advance(now_ns / NS)
        for servo in bus.servos.values():
            if servo.low_until_ns and now_ns >= servo.low_until_ns:
                servo.low_until_ns = 0
                servo.power_on()

    def _say(
        self, message: Message, kind: str, at_ns: int, wire: bytes, fault: str | None
    ) -> TrueFrame:
        """Put a frame on the line; the next one cannot begin before it ends."""
        start = max(at_ns, self._free_ns)
        end = start + -(-len(wire) * 10 * NS // self._bus.bits_per_s)
        self._free_ns = end
        return TrueFrame(
            self._start_ns + start,
            self._start_ns + end,
            message.data,
            wire,
            kind,
            message.servo_id,
            message.op,
            fault,
            message.values,
        )

    def _exchange(self, exchange: Exchange) -> Generator[TrueFrame, None, bool]:
        """Say a request and what comes back; return whether the controller is content."""
        request, mischief = exchange.request, self._mischief
        who = exchange.to[0] if len(exchange.to) == 1 else NOBODY
        if mischief.strikes(f.NOISE, who):
            yield self._noise()
        if mischief.strikes(f.BROWNOUT, who):
            self._brown_out(who)
        wire, fault = request.data, None
        if mischief.strikes(f.FLIP, who):
            wire, fault = mischief.flip(wire), f.FLIP
        yield self._say(request, REQUEST, self._free_ns, wire, fault)
        asked_ns = self._free_ns
        self._pass_time(asked_ns)
        heard = False
        if fault is None:
            answers = self._act(exchange)
            if who not in answers and not exchange.patience_ns:
                return True
            heard = yield from self._answers(exchange, who, answers, asked_ns)
        if not heard:
            self._free_ns = max(self._free_ns, asked_ns + exchange.patience_ns)
        return heard

    def _act(self, exchange: Exchange) -> dict[int, Message]:
        """Let the servos obey; return the answers, that of a twin under its id's complement."""
        out: dict[int, Message] = {}
        for servo_id in exchange.to:
            for key, servo in (
                (servo_id, self._bus.servos[servo_id]),
                (~servo_id, self._bus.twins[servo_id]),
            ):
                if self._free_ns >= servo.deaf_until_ns or servo.low:
                    answer = exchange.act(servo)
                    if answer is not None:
                        out[key] = answer
        return out

    def _answers(
        self, exchange: Exchange, who: int, answers: Mapping[int, Message], asked_ns: int
    ) -> Generator[TrueFrame, None, bool]:
        mischief = self._mischief
        due = asked_ns + exchange.turnaround_ns + self._rng.randrange(JITTER_NS)
        if who not in answers:
            nothing = Message(b"", who, exchange.request.op)
            yield self._say(nothing, RESPONSE, due, b"", f.BROWNOUT)
            return False
        answer = answers[who]
        wire, fault = answer.data, f.BROWNOUT if self._bus.servos[who].low else None
        if mischief.strikes(f.DROP, who):
            wire, fault = b"", f.DROP
        elif mischief.strikes(f.CUT, who) and len(wire) > 1:
            wire, fault = mischief.cut(wire), f.CUT
        elif mischief.strikes(f.FLIP, who):
            wire, fault = mischief.flip(wire), f.FLIP
        elif exchange.turnaround_ns < self._bus.late_ns[0] and mischief.strikes(f.LATE, who):
            due, fault = asked_ns + self._rng.randint(*self._bus.late_ns), f.LATE
        yield self._say(answer, RESPONSE, due, wire, fault)
        if wire and ~who in answers and mischief.strikes(f.DUPLICATE, who):
            # the second one waits until the line is free
            after = self._free_ns + self._rng.randint(50 * US, 300 * US)
            twin = answers[~who]
            yield self._say(twin, RESPONSE, after, twin.data, f.DUPLICATE)
        return wire == answer.data

    def _noise(self) -> TrueFrame:
        at = self._free_ns + self._rng.randint(20 * US, 200 * US)
        noise = self._say(Message(b"", NOBODY, ""), NOISE, at, self._mischief.noise(), f.NOISE)
        self._free_ns += self._rng.randint(20 * US, 200 * US)
        return noise

    def _brown_out(self, who: int) -> None:
        servo: Servo | None = self._bus.servos.get(who)
        if servo is None or servo.low_until_ns or self._free_ns < servo.deaf_until_ns:
            return
        servo.joint.sag, low_ns, deaf_ns = self._mischief.brownout()
        servo.low_until_ns = self._free_ns + low_ns
        servo.deaf_until_ns = servo.low_until_ns + deaf_ns
