"""The servos without their controller: bytes of a real one in, what is said on the line out.

Requests are found and read with the protocol's own grammar, frame by frame. Pure: whoever owns the
port tells the time, in nanoseconds since the bus was switched on, and says what is due.
"""

from __future__ import annotations

from typing import TYPE_CHECKING, NamedTuple

import numpy as np

from sniffer.ground.codes import REQUEST as ASKS
from sniffer.ground.framing import Block
from sniffer.protocols import protocol_named
from sniffer.simulation.buses import mischief, put_up
from sniffer.simulation.hearing import NO_BARRIERS, Ears
from sniffer.simulation.line import NOBODY, Wire
from sniffer.simulation.talk import NOISE, REQUEST, RESPONSE, USUAL, Message, TrueFrame

if TYPE_CHECKING:
    from collections.abc import Mapping, Sequence

    from sniffer.simulation.faults import Fault


class Uttered(NamedTuple):
    """A frame on the line, and whether it is one of ours: the others have been heard."""

    frame: TrueFrame
    ours: bool


class Responder:
    """Servos that hear requests and answer them; see ``buses.simulate`` for the arguments.

    What comes while they answer has its turn when the line is free again: nothing collides.
    ``carried``: bytes that are heard have already taken their time on a wire.
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
    ) -> None:
        self.bus = put_up(protocol, seed=seed, servo_ids=servo_ids, baud=baud, models=models)
        self._line = Wire(self.bus, mischief(protocol, faults, seed), seed)
        self._protocol = protocol_named(protocol)
        self._ears = Ears(self._protocol, models)
        self._carried = carried
        self._held = bytearray()
        self._heard_ns = 0
        self._before = b""  # the request before, if that is what was heard last

    def hear(self, data: bytes, now_ns: int) -> list[Uttered]:
        """Take bytes that arrived just now; return all that is said because of them, in order.

        Times of what is said lie ahead; requests that are not complete yet are waited for.
        """
        out = self.idle(now_ns)
        self._held += data
        self._heard_ns = now_ns
        return out + self._take(now_ns, final=False)

    def idle(self, now_ns: int) -> list[Uttered]:
        """Let time pass; a beginning that is not continued for long is nobody's."""
        self._line.pass_time(max(now_ns, self.bus.now_ns))
        if self._held and now_ns - self._heard_ns > self._protocol.tail_ns:
            return self._take(now_ns, final=True)
        return []

    def _take(self, now_ns: int, *, final: bool) -> list[Uttered]:
        out: list[Uttered] = []
        data = bytes(self._held)
        at = behind = 0
        found: tuple[int, int, int] | None = (-1, -1, 0)  # the next frame from ``at`` on
        while at < len(data):
            if found is not None and found[0] < at:
                found = self._next(data, at)
            here = found is not None and found[0] == at
            if not here and (broken := self.bus.damaged(data, at)) is not None:
                out += self._noise(data[behind : broken.end], now_ns)
                out += [Uttered(f, True) for f in self._line.complaint(broken.exchange)]
                at = behind = broken.end
                continue
            if found is None or not here:
                skipped = 1 if final else self._hopeless(data, at)
                if self.bus.begins and (begin := data.find(self.bus.begins, at + 1)) >= 0:
                    skipped = min(skipped, begin - at)  # there may be what a servo complains of
                if not skipped:
                    break
                at += skipped
                continue
            # what may be its reply as well is judged on its own: servos answer here, not there
            start, end, kind = found
            out += self._noise(data[behind:start], now_ns)
            out += self._frame(data[start:end], kind, now_ns)
            at = behind = end
        out += self._noise(data[behind:at], now_ns)
        del self._held[:at]
        return out

    def _next(self, data: bytes, at: int) -> tuple[int, int, int] | None:
        """Return start, end and kind of the first frame from ``at`` on, as if no more came."""
        for stop in (at + 2 * self._protocol.longest, len(data)):
            block = Block(np.frombuffer(data[at:stop], np.uint8), NO_BARRIERS, stop >= len(data))
            spans, _ = self._protocol.frame(block)
            if len(spans):
                return at + int(spans.start[0]), at + int(spans.end[0]), int(spans.kind[0])
            if stop >= len(data):
                break
        return None

    def _hopeless(self, data: bytes, at: int) -> int:
        """Return how many bytes from ``at`` on can be no frame's, whatever follows."""
        block = Block(np.frombuffer(data, np.uint8)[at:], NO_BARRIERS, False)
        spans, decided = self._protocol.frame(block)
        return min(int(spans.start[0]), decided) if len(spans) else decided

    def _begin(self, size: int, now_ns: int) -> None:
        """Let the line be free when these bytes began."""
        began = now_ns - self._line.wire_ns(size) if self._carried else now_ns
        self._line.free_ns = max(self._line.free_ns, began)

    def _noise(self, data: bytes, now_ns: int) -> list[Uttered]:
        if not data:
            return []
        self._begin(len(data), now_ns)
        nobody = Message(b"", NOBODY, "")
        return [Uttered(self._line.say(nobody, NOISE, self._line.free_ns, data, None), False)]

    def _frame(self, raw: bytes, kind: int, now_ns: int) -> list[Uttered]:
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
        self.bus.renumber()
        return said
