"""Controllers and servos on one half-duplex line, as it happens: who speaks into whose words.

Nobody here listens before talking but a controller to the answer it waits for. Where nothing
overlaps and nothing disturbs, bytes pass as they are; everywhere else the bits decide
(``uart``), for the tap, for servos and for controllers alike.
"""

from __future__ import annotations

import heapq
import random
from bisect import bisect_left, insort
from collections.abc import Generator, Iterable, Sequence
from dataclasses import dataclass, field
from typing import TYPE_CHECKING, Final, NamedTuple

from bench.diagnosis.bodies import Body, Path, Supply, sway
from bench.diagnosis.dialect import US, Asked, Dialect
from bench.diagnosis.dialects import DIALECTS, MightyZap
from bench.diagnosis.uart import BITS, Burst, Clash, Pulse, Receiver, line
from sniffer.ground.model import NS

if TYPE_CHECKING:
    from collections.abc import Callable, Iterator, Mapping

CONTROLLER: Final = -1
"""The sender of a controller's first one; further ones count down."""

SHADOW: Final = BITS + 1
"""For so many bits behind a false start a receiver is busy with a byte that is none."""


SERVED: Final = 9
"""So many servos hang on the wires of one bus at most; for more of them they are thicker: sixteen
that start at once would take the supply down by a third, which is a fault."""

LONGEST: Final = 30
"""Bytes of the longest answer here."""


class Pause(NamedTuple):
    """A controller says nothing for so long, or until a time, whichever is later."""

    ns: int = 0
    until_ns: int = 0


Step = Asked | Pause
Pattern = Generator[Step, bytes, None]
"""What a controller does; it is sent the answer to each request, nothing where none came."""


@dataclass(slots=True)
class Said:
    """Bytes that somebody put on the line; ``data`` as it was meant."""

    t_ns: float
    data: bytes
    sender: int
    bit_ns: float
    rise_ns: Callable[[int, int], float] | None = None
    muted: tuple[tuple[float, float], ...] = ()
    plain: bool = True
    """Its bits are as they should be."""

    @property
    def end_ns(self) -> float:
        """When it is over."""
        return self.t_ns + len(self.data) * BITS * self.bit_ns

    @property
    def burst(self) -> Burst:
        """Its bits."""
        return Burst(self.t_ns, self.data, self.bit_ns, self.rise_ns, self.muted)


class Trouble:
    """Something that is wrong with a line; this one is nothing at all."""

    def on(self, bench: Bench, said: Said) -> Said:
        """Return what becomes of bytes that somebody is about to say."""
        del bench
        return said

    def reaches(self, bench: Bench, servo_id: int, said: Said) -> bool:
        """Tell whether a servo understands what is said."""
        del bench, servo_id, said
        return True

    def pulses(self, bench: Bench, since_ns: float, until_ns: float) -> Iterable[Pulse]:
        """Return what the outside does to the line in a stretch of time; asked in order."""
        del bench, since_ns, until_ns
        return ()


@dataclass(slots=True)
class Master:
    """A controller: what it does, when it begins, and what it needs between two requests."""

    pattern: Pattern
    gap_ns: tuple[int, int]
    begin_ns: int = 0
    sender: int = CONTROLLER
    waits_for: int = -1
    """Number of the request whose answer it waits for."""


@dataclass(slots=True)
class Bench:
    """A line, its servos, and what is wrong with it.

    Args:
        protocol: a name of ``DIALECTS``.
        seed: draws all there is to draw.
        ids: who is on the line.
        baud: rate of controller and servos.
        goals: where each servo is to be; drawn where None.
        twins: ids that two servos have.
        clash: what is on the line where two drive it.
        troubles: what is wrong with it.
        deaf: servos that hear nothing: they are set to another rate, or there is no way to them.
    """

    protocol: str
    seed: int
    ids: Sequence[int]
    baud: int
    goals: Mapping[int, Path] | None = None
    twins: Sequence[int] = ()
    clash: Clash = Clash.MIX
    troubles: Sequence[Trouble] = ()
    deaf: frozenset[int] = frozenset()
    also: Sequence[Bench] = ()
    """Servos of other protocols on the same line."""
    now_ns: float = 0.0
    rng: random.Random = field(init=False)
    dialect: Dialect = field(init=False)
    bodies: dict[int, Body] = field(init=False)
    shadows: dict[int, Body] = field(init=False)
    """The second servo of each id in ``twins``."""
    delays: dict[Body, tuple[int, int]] = field(init=False, default_factory=dict)
    said: list[Said] = field(init=False, default_factory=list)
    _pulses: list[Pulse] = field(init=False, default_factory=list)
    _pulsed_ns: float = field(init=False, default=0.0)
    _longest_ns: float = field(init=False, default=0.0)

    def __post_init__(self) -> None:
        self.dialect = dialect = DIALECTS[self.protocol]
        self.rng = rng = random.Random(f"{self.protocol} {self.seed}")
        ohm = rng.uniform(0.08, 0.25) * min(1.0, SERVED / max(len(self.ids), 1))
        supply = Supply(dialect.volt * rng.uniform(0.98, 1.03), ohm)
        self.bodies = {i: Body(i, rng, supply) for i in self.ids}
        self.shadows = {i: Body(i, rng, supply) for i in self.twins}
        if self.goals is None:
            self.goals = {i: sway(rng) for i in self.ids}
        for body in (*self.bodies.values(), *self.shadows.values()):
            dialect.fit(body, rng)
            own = rng.randint(*dialect.delay_ns)
            self.delays[body] = (own, own + rng.randint(2 * US, 30 * US))
        for servo_id, shadow in self.shadows.items():
            shadow.settings = dict(self.bodies[servo_id].settings)

    @property
    def bit_ns(self) -> float:
        """How long a bit is."""
        return NS / self.baud

    def goal(self, servo_id: int) -> float:
        """Return where a servo is to be now."""
        assert self.goals is not None
        return min(max(self.goals[servo_id](self.now_ns / NS), 0.0), 1.0)

    def run(self, masters: Sequence[Master], seconds: float) -> None:
        """Let them talk for so long; ``said`` holds what was said."""
        end_ns = seconds * NS
        events: list[tuple[float, int, int, Master, Said | None]] = []
        count = 0

        def push(t: float, what: int, master: Master, said: Said | None = None) -> None:
            nonlocal count
            count += 1
            heapq.heappush(events, (t, count, what, master, said))

        asked: dict[int, Asked] = {}
        for master in masters:
            push(master.begin_ns, _WAKE, master)
        started: set[int] = set()
        answers: dict[int, bytes] = {}
        while events:
            t, number, what, master, said = heapq.heappop(events)
            self.now_ns = t
            for bench in self.also:
                bench.now_ns = t
            key = id(master)
            if what == _WAKE:
                if t >= end_ns:
                    continue
                try:
                    if key in started:
                        step = master.pattern.send(answers.pop(key, b""))
                    else:
                        started.add(key)
                        step = next(master.pattern)
                except StopIteration:
                    continue
                if isinstance(step, Pause):
                    push(max(t + step.ns, step.until_ns), _WAKE, master)
                    continue
                out = self._say(Said(t, step.data, master.sender, self.bit_ns))
                asked[key] = step
                push(out.end_ns, _ASKED, master, out)
            elif what == _ASKED:
                assert said is not None
                patience = asked[key].patience_ns
                for reply in self._answers(said, t):
                    push(reply.end_ns, _ANSWERED, master, reply)
                if patience:
                    master.waits_for = count + 1
                    # it gives up when a whole answer should have come, however slow the line is
                    push(t + patience + LONGEST * BITS * self.bit_ns, _TIMEOUT, master)
                else:
                    push(t + self.rng.randint(*master.gap_ns), _WAKE, master)
            elif what == _ANSWERED:
                assert said is not None
                if master.waits_for >= 0 and self._heard(said) == said.data:
                    master.waits_for = -1
                    answers[key] = said.data
                    push(t + self.rng.randint(*master.gap_ns), _WAKE, master)
            elif master.waits_for == number:
                master.waits_for = -1
                push(t, _WAKE, master)

    def pulsed(self, until_ns: float) -> Sequence[Pulse]:
        """Return all that the outside does to the line up to a time, in order."""
        self._pulse_until(until_ns)
        return self._pulses

    def _say(self, said: Said) -> Said:
        for trouble in self.troubles:
            said = trouble.on(self, said)
        insort(self.said, said, key=begin_of)
        return said

    def _answers(self, asked: Said, t: float) -> Iterator[Said]:
        request = self._heard(asked)
        for bench in (self, *self.also):
            for body, answer in bench._obeyed(request, asked, t):
                after = self.rng.randint(*bench.delays[body])
                yield self._say(Said(t + after, answer, body.servo_id, self.bit_ns))

    def _obeyed(self, request: bytes, asked: Said, t: float) -> Iterator[tuple[Body, bytes]]:
        """Yield who answers a request, and what."""
        dialect = self.dialect
        whom = dialect.whom(request)
        if whom == -1 and isinstance(dialect, MightyZap):
            whom = dialect.complains_of(request)
        if whom == -1:
            return
        mine = (self.bodies, self.shadows)
        to = [b[i] for b in mine for i in b if whom is None or i == whom]
        for body in to:
            who = body.servo_id
            if who not in self.deaf and all(x.reaches(self, who, asked) for x in self.troubles):
                body.look(int(t))
                if answer := dialect.answer(body, request):
                    yield body, answer

    def _heard(self, said: Said) -> bytes:
        """Return what others on the line hear of bytes that are just over."""
        if not self.troubles and len(self.said) and self.said[-1] is said and said.plain:
            k = len(self.said) - 1
            if k == 0 or self.said[k - 1].end_ns <= said.t_ns:
                return said.data
        self._pulse_until(said.end_ns)
        begin = said.t_ns - SHADOW * self.bit_ns
        pulses = [p for p in self._near(begin) if p.t_ns < said.end_ns and p.end_ns > begin]
        k = bisect_left(self.said, said.t_ns, key=begin_of)
        beside = [
            s
            for s in self.said[max(k - 8, 0) : k + 9]
            if s is not said and s.t_ns < said.end_ns and s.end_ns > said.t_ns
        ]
        if said.plain and not pulses and not beside:
            return said.data
        edges = line(
            [said.burst, *(s.burst for s in beside)], pulses, clash=self.clash, rng=self.rng
        )
        heard = bytes(b.value for b in Receiver(self.baud).hear(edges, self.rng))
        # who waits for a header does not mind what stood before it
        return said.data if said.data in heard else heard

    def _pulse_until(self, t: float) -> None:
        if self.troubles and t > self._pulsed_ns:
            for trouble in self.troubles:
                for pulse in trouble.pulses(self, self._pulsed_ns, t):
                    insort(self._pulses, pulse)
                    self._longest_ns = max(self._longest_ns, pulse.end_ns - pulse.t_ns)
            self._pulsed_ns = t

    def _near(self, t: float) -> list[Pulse]:
        k = bisect_left(self._pulses, t - self._longest_ns, key=begin_of)
        return self._pulses[k:]


_WAKE, _ASKED, _ANSWERED, _TIMEOUT = range(4)


def begin_of(thing: Said | Pulse) -> float:
    """Return when it begins."""
    return thing.t_ns
