"""The servos without their controller: bytes of a real one in, what is said on the line out."""

from __future__ import annotations

from types import MappingProxyType
from typing import TYPE_CHECKING, Final

from sniffer.ground.codes import REQUEST as ASKS
from sniffer.protocols import protocol_named
from sniffer.simulation.buses import mischief, put_up
from sniffer.simulation.hearing import Ears
from sniffer.simulation.line import NOBODY, Wire
from sniffer.simulation.listener import LineListener, Uttered
from sniffer.simulation.provenance import AnswerTally
from sniffer.simulation.talk import NOISE, REQUEST, RESPONSE, USUAL, Message

if TYPE_CHECKING:
    from collections.abc import Mapping, Sequence

    from sniffer.simulation.faults import Fault
    from sniffer.simulation.likeness import ServoLikeness


NOBODY_LIKE: Final[Mapping[int, ServoLikeness]] = MappingProxyType({})
"""No servo is like one that was seen before."""


class Responder(LineListener):
    """Servos that hear requests and answer them; see ``buses.simulate`` for the arguments.

    What comes while they answer has its turn when the line is free again: nothing collides.
    ``carried``: bytes that are heard have already taken their time on a wire. ``like``: what was
    seen of them before.
    """

    def __init__(
        self,
        protocol: str,
        *,
        seed: int = 0,
        servo_ids: Sequence[int] | None = None,
        baud: int | None = None,
        faults: Sequence[Fault] = (),
        carried: bool = False,
        models: Mapping[int | None, str] = USUAL,
        like: Mapping[int, ServoLikeness] = NOBODY_LIKE,
    ) -> None:
        self.bus = put_up(protocol, seed=seed, servo_ids=servo_ids, baud=baud, models=models)
        self._line = Wire(self.bus, mischief(protocol, faults, seed), seed)
        for servo_id, seen in like.items():
            for servo in (self.bus.servos[servo_id], self.bus.twins[servo_id]):
                servo.recall(seen.values)
        self._line.delays_ns = {servo_id: seen.delays_ns for servo_id, seen in like.items()}
        self.is_like = bool(like)
        self.tally = AnswerTally(like)
        super().__init__(protocol_named(protocol), self.bus.begins)
        self._ears = Ears(self._protocol, models)
        self._carried = carried
        self._before = b""  # the request before, if that is what was heard last

    def pass_time(self, now_ns: int) -> None:
        """Let the mechanics move on."""
        self._line.pass_time(max(now_ns, self.bus.now_ns))

    def broken(self, data: bytes, behind: int, at: int, now_ns: int) -> tuple[int, list[Uttered]]:
        """Let a servo complain of a broken frame, where its protocol has it do so."""
        broken = self.bus.damaged(data, at)
        if broken is None:
            return at, []
        out = self.noise(data[behind : broken.end], now_ns)
        out += [Uttered(f, True) for f in self._line.complaint(broken.exchange)]
        return broken.end, out

    def _begin(self, size: int, now_ns: int) -> None:
        """Let the line be free when these bytes began."""
        began = now_ns - self._line.wire_ns(size) if self._carried else now_ns
        self._line.free_ns = max(self._line.free_ns, began)

    def noise(self, data: bytes, now_ns: int) -> list[Uttered]:
        """Let bytes of nobody take their time."""
        if not data:
            return []
        self._begin(len(data), now_ns)
        nobody = Message(b"", NOBODY, "")
        return [Uttered(self._line.say(nobody, NOISE, self._line.free_ns, data, None), False)]

    def frame(self, raw: bytes, kind: int, now_ns: int) -> list[Uttered]:
        """Let the servos obey a frame."""
        heard, message = self._ears.read(raw, kind, self._before)
        self._before = raw if heard.kind == ASKS else b""
        self._begin(len(raw), now_ns)
        if heard.kind != ASKS:
            return [
                Uttered(self._line.say(message, RESPONSE, self._line.free_ns, raw, None), False)
            ]
        said = [
            Uttered(f, f.kind != REQUEST)
            for f in self._line.exchange(self.bus.heard(heard, message))
        ]
        self.tally.add(frame for frame, _ in said)
        self.bus.renumber()
        return said
