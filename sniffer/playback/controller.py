"""The controller of a recording: it asks again what it asked, and hears what comes back."""

from __future__ import annotations

import time
from collections import Counter
from typing import TYPE_CHECKING, Final, NamedTuple

import numpy as np

from sniffer.ground.framing import Block
from sniffer.ground.model import Chunk, Clock
from sniffer.playback.line import Lateness
from sniffer.playback.outlets import said
from sniffer.simulation.hearing import NO_BARRIERS
from sniffer.simulation.play.player import LOOK_NS

if TYPE_CHECKING:
    from collections.abc import Callable, Iterable, Sequence

    from sniffer.playback.exchanges import RecordedExchange
    from sniffer.playback.line import Pacing
    from sniffer.protocols.base import BusProtocol
    from sniffer.simulation.play.outlet import FrameWriter
    from sniffer.simulation.play.player import Stop

PATIENCE_NS: Final = 100_000_000
"""How much longer than in the recording an answer is waited for: adapters hold bytes for up to
16 ms, and a host may be busy."""

CATCH_UP: Final = 8
"""Of a pause before a request an eighth is left out while requests are late: a loop whose answers
take 0.4 ms longer each keeps its period so, and servos follow their goals as fast as they did."""

BEHIND_NS: Final = 100_000_000
"""By no more than this requests are late; what is beyond is not caught up with."""

GROUP: Final = 2048
"""Chunks of the talk that are handed on together."""


class _Asked(NamedTuple):
    """A kind of request."""

    servo_id: int
    op: str


class ServosHeard:
    """What became of the requests: by kind how many, and how many got an answer then and now."""

    def __init__(self) -> None:
        self._asked: Counter[_Asked] = Counter()
        self._then: Counter[_Asked] = Counter()
        self._now: Counter[_Asked] = Counter()

    def add(self, one: RecordedExchange, *, answered: bool) -> None:
        """Count a request that something was to come back to, then or now."""
        kind = _Asked(one.key.servo_id, one.op)
        self._asked[kind] += 1
        self._then[kind] += bool(one.replies)
        self._now[kind] += answered

    @property
    def all_answered(self) -> bool:
        """Whether as much was answered of each kind as in the recording."""
        return all(self._now[kind] >= self._then[kind] for kind in self._asked)

    def lines(self) -> list[str]:
        """Return it for people: one line in all, one for each kind that was answered otherwise."""
        asked, now, then = (sum(c.values()) for c in (self._asked, self._now, self._then))
        out = [f"{asked} requests, {now} answered; in the recording {then}"]
        for kind, count in self._asked.items():
            if self._now[kind] != self._then[kind]:
                who = f"servo {kind.servo_id}" if kind.servo_id >= 0 else "all servos"
                told = f"{kind.op} of {who}: {self._now[kind]} of {count} answered, in the "
                out.append(f"{told}recording {self._then[kind]}")
        return out


class ControllerPlayer:
    """Says requests at their recorded times, and waits for answers where there were some.

    Moments are absolute, counted from the first request. Where an answer comes later than it did,
    what is behind it comes later, too, and catches up in the pauses; a request that is not late
    never comes sooner behind the one before than in the recording. ``heard`` takes the talk in
    chunks, the requests among them, with the times of a tap.
    """

    def __init__(
        self,
        outlet: FrameWriter,
        protocol: BusProtocol,
        byte_ns: int,
        *,
        bus: str,
        stop: Stop,
        heard: Callable[[Sequence[Chunk]], None],
        now: Callable[[], int] = time.monotonic_ns,
    ) -> None:
        self.hearing = ServosHeard()
        self._outlet = outlet
        self._protocol = protocol
        self._byte_ns = byte_ns
        self._bus = bus
        self._stop = stop
        self._take = heard
        self._talk: list[Chunk] = []
        self._asked = b""
        self._since = b""  # the last request, and what has come since
        self._said_at = 0  # when the last request was handed to the port
        self._said_ns = 0  # and when its last byte was out
        self._now = now
        self._late = Lateness()
        self._base_ns = time.time_ns() - now()

    def play(self, exchanges: Iterable[RecordedExchange], speed: float = 1.0) -> None:
        """Play exchanges, in order; ``speed`` 0: each as soon as the one before is answered."""
        shift: int | None = None
        before: RecordedExchange | None = None
        soonest = 0
        for one in exchanges:
            at = self._moment(one, speed)
            if shift is None:
                shift = self._now() - at
            if before is not None:
                gap = at - self._moment(before, speed)
                soonest = self._said_at + gap - self._pause(before, gap) // CATCH_UP
                shift = max(shift, soonest - at - BEHIND_NS)
                self._await_answer(before, max(at + shift, soonest))
            self._listen(max(at + shift, soonest))
            if self._stop.asked:
                break
            self._said_at = self._now()
            if speed:
                self._late.note(max(self._said_at - at - shift, 0))
            self._say(one.raw)
            before = one
        if before is not None and not self._stop.asked:
            self._await_answer(before, 0)
        self._hand_on()

    @property
    def pacing(self) -> Pacing:
        """How well the moments of the requests were met."""
        return self._late.pacing

    def _moment(self, one: RecordedExchange, speed: float) -> int:
        """Return when a request is handed to the port, on the recording's clock."""
        at = one.start_ns if self._outlet.port.carries else one.end_ns
        return int(at / speed) if speed else 0

    def _pause(self, before: RecordedExchange, gap: int) -> int:
        """Return what of a gap between two requests is left behind the answer to the first."""
        busy = before.end_ns - before.start_ns if self._outlet.port.carries else 0
        if before.replies:
            size = sum(len(reply.data) for reply in before.replies)
            busy += before.replies[-1].delay_ns + size * self._byte_ns
        return max(gap - busy, 0)

    def _say(self, raw: bytes) -> None:
        self._outlet.say([said(raw)])
        while self._outlet.waits and not self._stop.asked:
            self._stop.sleep(LOOK_NS)
            self._outlet.flush()
        now = self._now()
        if self._outlet.port.carries:
            now += len(raw) * self._byte_ns
        self._note(raw, now)
        self._asked = self._since = raw
        self._said_ns = now

    def _await_answer(self, before: RecordedExchange, due: int) -> None:
        """Wait for an answer, if there was one then.

        Without one in the recording it is waited until the next request is due, and no longer.
        """
        if not before.waits and not before.replies:
            return
        size = sum(len(reply.data) for reply in before.replies)
        took = before.replies[-1].delay_ns if before.replies else 0
        until = self._said_ns + took + size * self._byte_ns + PATIENCE_NS
        if not before.replies:
            until = due
        while not self._answered() and not self._stop.asked:
            if self._now() >= until:
                break
            self._listen(until, once=True)
        self.hearing.add(before, answered=self._answered())

    def _answered(self) -> bool:
        """Tell whether a frame stands behind the last request, as the protocol frames both.

        What repeats the request is the echo of an adapter.
        """
        block = Block(np.frombuffer(self._since, np.uint8), NO_BARRIERS, True)
        spans, _ = self._protocol.frame(block)
        both = zip(spans.start.tolist(), spans.end.tolist(), strict=True)
        behind = (self._since[a:b] for a, b in both if a >= len(self._asked))
        return any(frame != self._asked for frame in behind)

    def _listen(self, until: int, *, once: bool = False) -> None:
        """Take what is said until then; ``once``: or until something is."""
        port = self._outlet.port
        while not self._stop.asked:
            left = until - self._now()
            if left <= 0 and not once:
                return
            if port.listened():
                self._stop.sleep(left, port.fileno())
            else:
                self._stop.sleep(min(left, LOOK_NS))
            if data := port.read():
                self._since += data
                self._note(data, self._now())
            if once:
                return

    def _note(self, data: bytes, t_ns: int) -> None:
        self._talk.append(Chunk(data, self._base_ns + t_ns, Clock.READ, self._bus))
        if len(self._talk) >= GROUP:
            self._hand_on()

    def _hand_on(self) -> None:
        if self._talk:
            self._take(self._talk)
            self._talk = []
