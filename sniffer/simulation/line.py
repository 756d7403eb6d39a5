"""The wire of a simulated bus: one exchange after the other gets its times, faults and answers.

The line is half-duplex: nothing overlaps, and every byte takes ten bits at the baud rate. Times
count from when the bus was switched on.
"""

from __future__ import annotations

import random
from typing import TYPE_CHECKING, Final

from sniffer.ground.model import NS
from sniffer.simulation import faults as f
from sniffer.simulation.ailments import Ailments
from sniffer.simulation.overlap import overheard
from sniffer.simulation.talk import (
    NOISE,
    REQUEST,
    RESPONSE,
    US,
    Bus,
    Delivery,
    Message,
    Servo,
    TrueFrame,
)

if TYPE_CHECKING:
    from collections.abc import Generator, Iterator, Mapping, Sequence

    from sniffer.simulation.faults import Mischief

Answers = dict[int, list[Message]]
"""What servos say to a request, by id: where several share one, more than one message."""

NOBODY: Final = -2
"""Stands for the servo of frames that address all, and of noise."""

JITTER_NS: Final = 30 * US
"""How much a servo's turnaround varies, a figure of the simulation."""


class Wire:
    """Puts a bus on a wire; ``start_ns`` is added to the times of all frames.

    ``packed``: servos and controller leave one bit between two frames instead of the times that the
    protocol gives them.
    """

    def __init__(
        self, bus: Bus, mischief: Mischief, seed: int, *, start_ns: int = 0, packed: bool = False
    ) -> None:
        self._bus = bus
        self._mischief = mischief
        self._start_ns = start_ns
        self._rng = random.Random(f"{bus.name} timing {seed}")
        self._bit_ns = -(-NS // bus.bits_per_s)
        self._packed = packed
        self._sagging: list[Servo] = []
        self.ailments = Ailments(bus, mischief)
        self._heard_of: dict[int, Message] = {}  # what each servo said last
        self._under_way: tuple[Message, int] | None = None  # an answer nobody waits for
        self.delays_ns: Mapping[int, Mapping[str, Sequence[int]]] = {}
        """By servo and command, from what turnarounds are drawn where they are known."""
        self.free_ns = 0
        """The line is free from then on."""

    def wire_ns(self, size: int) -> int:
        """Return how long so many bytes take."""
        return -(-size * 10 * NS // self._bus.bits_per_s)

    def pause(self) -> None:
        """Let pass what the controller leaves between two exchanges."""
        if self._under_way is not None:
            return
        if self._packed:
            self.free_ns += self._bit_ns
        else:
            self.free_ns += self._rng.randint(*self._bus.pause_ns)

    def pass_time(self, now_ns: int) -> None:
        """Move the mechanics on; power comes and goes."""
        self._bus.now_ns = now_ns
        self._bus.rig.advance(now_ns / NS)
        for servo in list(self._sagging):
            if now_ns >= servo.low_until_ns:
                servo.low_until_ns = 0
                servo.power_on()
                self._sagging.remove(servo)
        self.ailments.pass_time(now_ns)
        for servo in self._bus.servos.values():
            servo.guard()

    def exchange(self, exchange: Delivery) -> Generator[TrueFrame, None, bool]:
        """Say a request and what comes back; return whether the controller is content."""
        request, mischief = exchange.request, self._mischief
        who = exchange.to[0] if len(exchange.to) == 1 else NOBODY
        if self._under_way is not None:
            yield from self._collide(request)
            self.free_ns += exchange.patience_ns
            self.pass_time(self.free_ns)
            return False
        if mischief.strikes(f.NOISE, who, self.free_ns):
            yield self._noise()
        if who in self._heard_of and mischief.strikes(f.CHATTY, who, self.free_ns):
            yield self._chat(who)
        if mischief.strikes(f.BROWNOUT, who, self.free_ns):
            self._brown_out(who)
        self.ailments.strike(who, self.free_ns)
        wire, fault = request.data, None
        if mischief.strikes(f.FLIP, who, self.free_ns):
            wire, fault = mischief.flip(wire), f.FLIP
        yield self.say(request, REQUEST, self.free_ns, wire, fault)
        asked_ns = self.free_ns
        self.pass_time(asked_ns)
        exchange = self._refused(exchange, who)
        heard = False
        if fault is None:
            answers = self._act(exchange)
            if exchange.chorus:
                return (yield from self._chorus(exchange, answers))
            if who not in answers and not exchange.patience_ns:
                return True
            heard = yield from self._answers(exchange, who, answers, asked_ns)
        if not heard and self._under_way is None:
            self.free_ns = max(self.free_ns, asked_ns + exchange.patience_ns)
        return heard

    def settle(self) -> Iterator[TrueFrame]:
        """Say an answer that nobody waits for, and that nobody has talked over."""
        if self._under_way is not None:
            answer, due = self._under_way
            self._under_way = None
            yield self.say(answer, RESPONSE, due, answer.data, None)

    def complaint(self, exchange: Delivery) -> Iterator[TrueFrame]:
        """Say what a servo answers to a broken request, which is on the line already."""
        asked_ns = self.free_ns
        self.pass_time(asked_ns)
        answers = self._act(exchange)
        if answers:
            yield from self._answers(exchange, exchange.to[0], answers, asked_ns)

    def say(
        self, message: Message, kind: str, at_ns: int, wire: bytes, fault: str | None
    ) -> TrueFrame:
        """Put a frame on the line; the next one cannot begin before it ends."""
        start = max(at_ns, self.free_ns)
        end = start + self.wire_ns(len(wire))
        self.free_ns = end
        return self._true(message, kind, (start, end), wire, fault)

    def _true(
        self, message: Message, kind: str, times: tuple[int, int], wire: bytes, fault: str | None
    ) -> TrueFrame:
        start, end = (self._start_ns + t_ns for t_ns in times)
        data, servo_id, op, values = message
        return TrueFrame(start, end, data, wire, kind, servo_id, op, fault, values)

    def _act(self, exchange: Delivery) -> Answers:
        """Let the servos obey; return the answers, those of twins under their id's complement."""
        out: Answers = {}
        bus, now_ns, act = self._bus, self.free_ns, exchange.act
        for servo_id in exchange.to:
            pairs = [(bus.servos[servo_id], bus.twins[servo_id]), *bus.guests.get(servo_id, ())]
            for pair in pairs:
                for key, servo in zip((servo_id, ~servo_id), pair, strict=True):
                    if now_ns >= servo.deaf_until_ns or servo.low:
                        answer = act(servo)
                        if answer is not None:
                            out.setdefault(key, []).append(answer)
        return out

    def _chorus(self, exchange: Delivery, answers: Answers) -> Generator[TrueFrame, None, bool]:
        """Let each servo answer behind the other."""
        heard = False
        for servo_id in exchange.to:
            if servo_id in answers:
                good = yield from self._answers(exchange, servo_id, answers, self.free_ns)
                heard = heard or good
        return heard

    def _turnaround(self, exchange: Delivery, who: int) -> int:
        if self._packed:
            return self._bit_ns
        if known := self.delays_ns.get(who, {}).get(exchange.request.op):
            return self._rng.choice(known)
        return exchange.turnaround_ns + self._rng.randrange(JITTER_NS)

    def _answers(
        self, exchange: Delivery, who: int, answers: Answers, asked_ns: int
    ) -> Generator[TrueFrame, None, bool]:
        mischief = self._mischief
        due = asked_ns + self._turnaround(exchange, who)
        servo = self._bus.servos[who]
        if who not in answers:
            nothing = Message(b"", who, exchange.request.op)
            yield self.say(nothing, RESPONSE, due, b"", self.ailments.of(servo) or f.BROWNOUT)
            return False
        due += servo.lag_ns
        answer, *others = answers[who]
        wire, fault = answer.data, f.BROWNOUT if servo.low else self.ailments.of(servo)
        if mischief.strikes(f.DROP, who, asked_ns):
            wire, fault = b"", f.DROP
        elif mischief.strikes(f.CUT, who, asked_ns) and len(wire) > 1:
            wire, fault = mischief.cut(wire), f.CUT
        elif mischief.strikes(f.FLIP, who, asked_ns):
            wire, fault = mischief.flip(wire), f.FLIP
        elif exchange.turnaround_ns < self._bus.late_ns[0] and mischief.strikes(
            f.LATE, who, asked_ns
        ):
            due, fault = asked_ns + self._rng.randint(*self._bus.late_ns), f.LATE
        elif len(wire) > 1 and mischief.strikes(f.IMPATIENT, who, asked_ns):
            self._under_way = answer, due
            self.free_ns = mischief.rng.randint(asked_ns + 1, due + self.wire_ns(len(wire)) - 1)
            return False
        elif exchange.is_refused:
            fault = f.REFUSE
        yield self.say(answer, RESPONSE, due, wire, fault)
        self._heard_of[who] = answer
        if wire and ~who in answers and mischief.strikes(f.DUPLICATE, who, asked_ns):
            others = [*others, answers[~who][0]]
        for other in others:
            # a second one of the same id waits until the line is free
            after = self.free_ns + self._rng.randint(50 * US, 300 * US)
            yield self.say(other, RESPONSE, after, other.data, f.DUPLICATE)
        return wire == answer.data

    def _refused(self, exchange: Delivery, who: int) -> Delivery:
        """Let a servo refuse what it would else obey."""
        if not exchange.patience_ns or who == NOBODY:
            return exchange
        if not self._mischief.strikes(f.REFUSE, who, self.free_ns):
            return exchange
        bus, request = self._bus, exchange.request
        if bus.refused(bus.servos[who], request) is None:
            return exchange
        return exchange._replace(act=lambda servo: bus.refused(servo, request), is_refused=True)

    def _collide(self, request: Message) -> Iterator[TrueFrame]:
        """Say a request into the answer that is under way: nobody understands either."""
        assert self._under_way is not None
        answer, due = self._under_way
        self._under_way = None
        begins = self.free_ns
        mixed = overheard([(due, answer.data), (begins, request.data)], self._bus.bits_per_s)
        before = [b for b in mixed if b.t_end_ns <= begins]
        behind = mixed[len(before) :]
        for message, kind, heard, at in (
            (answer, RESPONSE, before, min(due, begins)),
            (request, REQUEST, behind, begins),
        ):
            start = heard[0].t_start_ns if heard else at
            end = heard[-1].t_end_ns if heard else at
            wire = bytes(b.value for b in heard)
            yield self._true(message, kind, (start, end), wire, f.IMPATIENT)
            self.free_ns = max(self.free_ns, end)

    def _chat(self, who: int) -> TrueFrame:
        at = self.free_ns + self._rng.randint(20 * US, 200 * US)
        said = self._heard_of[who]
        chat = self.say(said, RESPONSE, at, said.data, f.CHATTY)
        self.free_ns += self._rng.randint(20 * US, 200 * US)
        return chat

    def _noise(self) -> TrueFrame:
        at = self.free_ns + self._rng.randint(20 * US, 200 * US)
        noise = self.say(Message(b"", NOBODY, ""), NOISE, at, self._mischief.noise(), f.NOISE)
        self.free_ns += self._rng.randint(20 * US, 200 * US)
        return noise

    def _brown_out(self, who: int) -> None:
        servo: Servo | None = self._bus.servos.get(who)
        if servo is None or servo.low_until_ns or self.free_ns < servo.deaf_until_ns:
            return
        servo.joint.sag, low_ns, deaf_ns = self._mischief.brownout()
        servo.low_until_ns = self.free_ns + low_ns
        servo.deaf_until_ns = servo.low_until_ns + deaf_ns
        self._sagging.append(servo)
