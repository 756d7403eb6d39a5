"""Real time: a simulated bus, or the servos of one, by the monotonic clock.

A frame is written when its last byte would have arrived. On a fast line those due within a
millisecond go together: no reader could tell them apart by time, and each writing has its price.
"""

from __future__ import annotations

import collections
import os
import select
import time
from typing import TYPE_CHECKING, Final

from sniffer.ground.model import NS

if TYPE_CHECKING:
    from collections.abc import Callable, Iterator

    from sniffer.simulation.listener import LineListener, Uttered
    from sniffer.simulation.play.outlet import FrameWriter
    from sniffer.simulation.play.ports import PlayPort
    from sniffer.simulation.talk import TrueFrame

GROUP_NS: Final = NS // 1000
GROUPED_FROM: Final = 250_000
"""Baud rate above which frames due within ``GROUP_NS`` go together."""

BEHIND_NS: Final = 50_000_000
"""A bus that was held up for longer goes on later: what it says is never faster than its wire."""

LOOK_NS: Final = 5_000_000
"""How often a port is looked at that cannot be waited for: full, or open to nobody."""

IDLE_NS: Final = 20_000_000
"""How often servos that nobody asks move on."""


class SimulatedClock:
    """Nanoseconds since the bus was switched on; it can lose time, never win any."""

    def __init__(self) -> None:
        self._monotonic_ns = time.monotonic_ns()
        self._unix_ns = time.time_ns()
        self.lost_ns = 0

    def now(self) -> int:
        """Return the time on the bus."""
        return time.monotonic_ns() - self._monotonic_ns - self.lost_ns

    @property
    def base_ns(self) -> int:
        """What makes Unix time of the time on the bus, as of when it was switched on."""
        return self._unix_ns + self.lost_ns

    def keep(self, planned_ns: int) -> None:
        """Go back to ``planned_ns`` if that was missed by far."""
        late = self.now() - planned_ns
        if late > BEHIND_NS:
            self.lost_ns += late


class Stop:
    """Ends the playing from elsewhere, a signal handler for instance; wakes up who sleeps."""

    def __init__(self) -> None:
        self.asked = False
        self._ear, self._mouth = os.pipe()
        if hasattr(os, "set_blocking"):  # not where there are no pseudo-terminals either
            os.set_blocking(self._mouth, False)

    def ask(self) -> None:
        """Let it end soon."""
        if not self.asked:
            self.asked = True
            os.write(self._mouth, b".")

    def sleep(self, ns: int, *others: int) -> None:
        """Sleep until asked, until one of ``others`` can be read, or for so long."""
        select.select([self._ear, *others], [], [], max(ns, 0) / NS)

    def close(self) -> None:
        """Give the descriptors back."""
        os.close(self._ear)
        os.close(self._mouth)


class Player:
    """Plays on ports until it is over or asked to stop.

    ``told`` is called behind all that is written at one moment.
    """

    def __init__(self, clock: SimulatedClock, stop: Stop, told: Callable[[], None]) -> None:
        self.clock = clock
        self._stop = stop
        self._told = told

    def play(
        self,
        frames: Iterator[TrueFrame],
        outlet: FrameWriter,
        *,
        group_ns: int,
        duration_ns: int | None = None,
    ) -> None:
        """Play frames whose times count from when the bus was switched on."""
        port = outlet.port
        frame, last_ns = next(frames, None), -group_ns
        while frame is not None:
            wake = max(_due_ns(frame, port), last_ns + group_ns)
            group = []
            while frame is not None and _due_ns(frame, port) <= wake:
                group.append(frame)
                frame = next(frames, None)
            self._rest(wake, outlet)
            if self._stop.asked:
                return
            self.clock.keep(wake)
            port.read()  # nobody's business here, but it must not pile up
            outlet.say(group)
            self._told()
            last_ns = wake
        if duration_ns is not None:
            self._rest(duration_ns, outlet)

    def _rest(self, until_ns: int, outlet: FrameWriter) -> None:
        while not self._stop.asked:
            left = until_ns - self.clock.now()
            if left <= 0:
                return
            if outlet.waits:
                outlet.flush()
                self._told()
                left = min(left, LOOK_NS)
            self._stop.sleep(left)

    def respond(
        self,
        responder: LineListener,
        bus: FrameWriter,
        tap: FrameWriter | None,
        note: Callable[[TrueFrame, int | None], None],
        *,
        duration_ns: int | None = None,
        echo: bool = False,
    ) -> None:
        """Let servos answer what is said on ``bus``; ``tap`` repeats both sides of the talk.

        Without one, ``note`` is told of what was heard; outlets tell of what they say. ``echo``:
        who speaks hears it again, as with an adapter that does not mute itself.
        """
        port, clock = bus.port, self.clock
        due: collections.deque[Uttered] = collections.deque()
        while not self._stop.asked and (duration_ns is None or clock.now() < duration_ns):
            planned = clock.now() + IDLE_NS
            if due:
                planned = min(planned, _due_ns(due[0].frame, port))
            if duration_ns is not None:
                planned = min(planned, duration_ns)
            others = [port.fileno()] if port.listened() else []
            if not others or bus.waits or (tap is not None and tap.waits):
                planned = min(planned, clock.now() + LOOK_NS)
            self._stop.sleep(planned - clock.now(), *others)
            clock.keep(planned)
            now, data = clock.now(), port.read()
            due += responder.hear(data, now) if data else responder.idle(now)
            said: list[Uttered] = []
            while due and _due_ns(due[0].frame, port) <= now:
                said.append(due.popleft())
            bus.flush()
            if tap is not None:
                tap.flush()
                bus.say([s.frame for s in said if s.ours or echo])
                tap.say([s.frame for s in said])
            for frame, ours in said if tap is None else ():
                if ours or echo:
                    bus.say([frame])
                else:
                    note(frame, None)
            self._told()


def _due_ns(frame: TrueFrame, port: PlayPort) -> int:
    """Return when to write a frame: a device takes the time of the bytes itself."""
    return frame.t_start_ns if port.carries else frame.t_end_ns
