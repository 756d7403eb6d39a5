"""One line, the simulator's servos on it, and whoever asks them: everything at its own time.

Nobody waits for anybody here. A request that begins while a servo answers mixes with the answer bit
by bit, and is understood by none. Times are nanoseconds since the first byte of the capture.
"""

from __future__ import annotations

import heapq
import itertools
import random
from typing import TYPE_CHECKING, Any, Final, NamedTuple

from bench.diagnosis.scenario import Heard
from sniffer.ground.model import NS
from sniffer.protocols import protocol_named
from sniffer.simulation.ailments import Ailments
from sniffer.simulation.buses import mischief, put_up
from sniffer.simulation.hearing import Ears
from sniffer.simulation.overlap import overheard
from sniffer.simulation.talk import US, USUAL, Delivery, HeardFrame, Message, Servo

if TYPE_CHECKING:
    from collections.abc import Callable, Mapping, Sequence

    from sniffer.simulation.motion import Trajectory

JITTER_NS: Final = 25 * US
"""How much a servo's turnaround varies."""


PACES: Final = (0.4, 0.65)
"""How fast joints move, by the simulator's motion: at less than what strains a motor."""


def _slower(goal: Trajectory, pace: float) -> Trajectory:
    return lambda t: goal(t * pace)


class Voice(NamedTuple):
    """Bytes that somebody sends, from a time on."""

    t_start_ns: int
    t_end_ns: int
    data: bytes
    tx: bool


class Stage:
    """A bus, its servos, and what was said so far."""

    def __init__(
        self,
        protocol: str,
        seed: int | str,
        servo_ids: Sequence[int],
        baud: int,
        models: Mapping[int | None, str] = USUAL,
    ) -> None:
        self.rng = random.Random(f"{protocol} stage {seed}")
        number = self.rng.randrange(1 << 30)
        self.bus = put_up(protocol, seed=number, servo_ids=servo_ids, baud=baud, models=models)
        # no two of one id here: their twins would only draw current
        self.bus.rig.joints = [servo.joint for servo in self.bus.servos.values()]
        for servo_id, goal in list(self.bus.goals.items()):
            self.bus.goals[servo_id] = _slower(goal, self.rng.uniform(*PACES))
        self.ailments = Ailments(self.bus, mischief(protocol, (), number))
        self.now_ns = 0
        """When the controller is free to speak."""
        self.busy_until_ns = 0
        """When the last one who speaks so far is done."""
        self.refusals: dict[int, Callable[[Any, Message], Message | None]] = {}
        """What a servo says to a request instead of obeying; nothing where None."""
        self.ignored: set[bytes] = set()
        """Requests that servos hear, and do not answer for now."""
        self.baud = baud
        self._named = dict(self.bus.servos)
        self._ears = Ears(protocol_named(protocol), models)
        self._read: dict[bytes, tuple[HeardFrame, Message]] = {}
        self._voices: list[Voice] = []
        self._plans: list[tuple[int, int, Callable[[], None]]] = []
        self._count = itertools.count()

    @property
    def now_s(self) -> float:
        """The controller's time in seconds."""
        return self.now_ns / NS

    def servo(self, servo_id: int) -> Servo:
        """Return the servo that had this id when the capture began, whatever it has now."""
        return self._named[servo_id]

    def wire_ns(self, size: int) -> int:
        """Return how long so many bytes take."""
        return -(-size * 10 * NS // self.baud)

    def at(self, seconds: float, act: Callable[[], None]) -> None:
        """Let something happen at a time, whatever the controller does."""
        heapq.heappush(self._plans, (int(seconds * NS), next(self._count), act))

    def pass_time(self, until_ns: int) -> None:
        """Let servos move, and what is planned happen."""
        while self._plans and self._plans[0][0] <= until_ns:
            t_ns, _, act = heapq.heappop(self._plans)
            self._move(t_ns)
            act()
        self._move(until_ns)

    def _move(self, t_ns: int) -> None:
        bus = self.bus
        bus.now_ns = max(bus.now_ns, t_ns)
        bus.rig.advance(bus.now_ns / NS)
        self.ailments.pass_time(bus.now_ns)
        for servo in bus.servos.values():
            servo.guard()

    def wait(self, until_ns: int) -> None:
        """Let the controller do nothing until then."""
        self.now_ns = max(self.now_ns, until_ns)
        self.pass_time(self.now_ns)

    def speak(self, t_ns: int, data: bytes, *, tx: bool = False) -> Voice:
        """Put bytes on the line, whoever else speaks."""
        voice = Voice(t_ns, t_ns + self.wire_ns(len(data)), data, tx)
        self._voices.append(voice)
        self.busy_until_ns = max(self.busy_until_ns, voice.t_end_ns)
        return voice

    def post(self, raw: bytes, *, understood: bool = True) -> list[Voice]:
        """Send a request now and go on; return the answers that will come.

        ``understood``: servos can read it; else they are silent.
        """
        start = self.now_ns
        request = self.speak(start, raw, tx=True)
        self.now_ns = request.t_end_ns
        self.pass_time(self.now_ns)
        if not understood or not self.is_clear(request):
            return []
        return self._answers(self._delivery(raw), request.t_end_ns)

    def ask(self, raw: bytes, patience_ns: int, *, pause_ns: int = 0) -> bytes:
        """Send a request and wait for the answer at most so long; return it, or nothing."""
        answers = self.post(raw)
        asked_ns = self.now_ns
        if not patience_ns:
            self.now_ns += pause_ns
            return b""
        heard = b""
        until_ns = asked_ns + patience_ns
        if answers and answers[0].t_end_ns <= until_ns:
            self.pass_time(answers[0].t_end_ns)
            if self.is_clear(answers[0]):
                heard, until_ns = answers[0].data, answers[0].t_end_ns
        self.wait(until_ns + pause_ns)
        return heard

    def is_clear(self, voice: Voice) -> bool:
        """Tell whether nobody speaks at the same time, as far as it is known."""
        return not any(
            other is not voice
            and other.t_start_ns < voice.t_end_ns
            and voice.t_start_ns < other.t_end_ns
            for other in self._voices[-64:]
        )

    def _delivery(self, raw: bytes) -> Delivery:
        known = self._read.get(raw)
        if known is None:
            known = self._read[raw] = self._ears.read(raw)
        return self.bus.heard(*known)

    def _answers(self, delivery: Delivery, asked_ns: int) -> list[Voice]:
        out: list[Voice] = []
        free_ns = asked_ns
        for servo_id in delivery.to:
            servo = self.bus.servos[servo_id]
            is_deaf = asked_ns < servo.deaf_until_ns and not servo.low
            if is_deaf or delivery.request.data in self.ignored:
                continue
            refusal = self.refusals.get(servo_id)
            answer = refusal(servo, delivery.request) if refusal is not None else None
            if answer is None:
                answer = delivery.act(servo)
            if answer is not None and (len(delivery.to) == 1 or delivery.chorus):
                due = free_ns + delivery.turnaround_ns + servo.lag_ns
                out.append(self.speak(due + self.rng.randrange(JITTER_NS), answer.data))
                free_ns = out[-1].t_end_ns
        self.bus.renumber()
        return out

    def heard(self) -> list[Heard]:
        """Return what a tap hears of it all."""
        out: list[Heard] = []
        voices = sorted(self._voices)
        at = 0
        while at < len(voices):
            first = voices[at]
            end, behind = first.t_end_ns, at + 1
            while behind < len(voices) and voices[behind].t_start_ns < end:
                end = max(end, voices[behind].t_end_ns)
                behind += 1
            if behind == at + 1:
                out.append(Heard(*first))
            else:
                out.append(self._mixed(voices[at:behind]))
            at = behind
        return out

    def _mixed(self, voices: Sequence[Voice]) -> Heard:
        read = overheard([(v.t_start_ns, v.data) for v in voices], self.baud)
        broken = tuple(n for n, byte in enumerate(read) if not byte.has_stop)
        data = bytes(byte.value for byte in read)
        return Heard(read[0].t_start_ns, read[-1].t_end_ns, data, voices[0].tx, broken)
