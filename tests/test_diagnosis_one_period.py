"""Two controllers of one period, whose clocks wander: what they tear is no second answer."""

from __future__ import annotations

import heapq
import itertools
import random
from typing import TYPE_CHECKING, Final

import pytest

from sniffer.diagnosis.physics.uart import both, received, sent
from sniffer.ground.model import NS, Chunk, Clock
from tests.conversations import T0, TONGUES
from tests.diagnosed import codes, diagnosed, verdicts

if TYPE_CHECKING:
    from collections.abc import Callable, Iterator

    from sniffer.diagnosis.physics.uart import Edge

BAUD: Final = 115200
BYTE_S: Final = 10 / BAUD
PERIOD_S: Final = 0.1

Said = list[tuple[float, bytes]]


class Line:
    """Controllers and servos at once, event by event; a servo answers only what it heard whole."""

    def __init__(self, protocol: str, seed: int) -> None:
        self.tongue, self.rng = TONGUES[protocol], random.Random(seed)
        self.said: Said = []
        self.due: list[tuple[float, int, Callable[[float], None]]] = []
        self.order = itertools.count()

    def at(self, t: float, then: Callable[[float], None]) -> None:
        heapq.heappush(self.due, (t, next(self.order), then))

    def is_clean(self, begin: float, until: float) -> bool:
        over = (t < until and t + len(data) * BYTE_S > begin for t, data in self.said[-12:])
        return sum(over) == 1

    def say(self, t: float, data: bytes) -> float:
        self.said.append((t, data))
        return t + len(data) * BYTE_S

    def ask(self, t: float, servo: int, then: Callable[[float], None]) -> None:
        """Ask where a servo is, and go on behind its answer, or after 20 ms."""
        asked = self.say(t, self.tongue.ask(servo))

        def answer(begin: float) -> None:
            over = self.say(begin, self.tongue.answer(servo, 0.2 + t % 10 / 20))
            self.at(
                over, lambda now: then(now + 0.0015 if self.is_clean(begin, now) else asked + 0.02)
            )

        def heard(now: float) -> None:
            if self.is_clean(t, now):
                self.at(now + self.rng.uniform(0.0003, 0.0006), answer)
            else:
                then(now + 0.02)

        self.at(asked, heard)

    def next_cycle(self, begun: float, now: float) -> float:
        return max(now, begun + PERIOD_S * (1 + self.rng.gauss(0, 0.002)))

    def reads(self, begun: float) -> None:
        """Read servo after servo, again and again."""

        def behind(servo: int, now: float) -> None:
            if servo > 3:
                self.at(self.next_cycle(begun, now), self.reads)
            else:
                self.at(now, lambda t: self.ask(t, servo, lambda t: behind(servo + 1, t)))

        behind(1, begun)

    def sends(self, begun: float) -> None:
        """Send servo 2 somewhere, again and again."""
        over = self.say(begun, self.tongue.goal(2, 0.3 + begun % 10 / 25))
        self.at(self.next_cycle(begun, over), self.sends)

    def heard(self, seconds: float) -> list[Chunk]:
        while self.due and self.due[0][0] < seconds:
            now, _, then = heapq.heappop(self.due)
            then(now)
        return [chunk for one in runs(sorted(self.said)) for chunk in chunks(one)]


def runs(said: Said) -> Iterator[Said]:
    """Yield what lies over each other together."""
    run: Said = []
    until = 0.0
    for t, data in said:
        if run and t > until:
            yield run
            run = []
        run.append((t, data))
        until = max(until, t + len(data) * BYTE_S)
    yield run


def chunks(run: Said) -> Iterator[Chunk]:
    edges: list[Edge] = []
    for t, data in run:
        edges = both(edges, sent(data, begin=(t - run[0][0]) * BAUD), min)
    got = received(edges)
    end = T0 + round((run[0][0] + (got[-1].t + 10) / BAUD) * NS)
    yield Chunk(bytes(b.value for b in got), end, Clock.SAMPLE)


@pytest.mark.parametrize(
    ("protocol", "seed", "since"),
    [
        pytest.param("rs30x", 1, 0.0105, id="was duplicate-id"),
        pytest.param("rs30x", 3, 0.0095, id="was impatient-controller"),
        pytest.param("mightyzap", 3, 0.0095, id="was impatient-controller, by its order"),
        pytest.param("lss", 7, 0.0095, id="was duplicate-id, by order"),
        pytest.param("lss", 2, 0.0095, id="was tap-loss"),
    ],
)
def test_two_controllers_of_one_period_that_wander_are_told_as_two(
    protocol: str, seed: int, since: float
) -> None:
    """Goals run into the answers that always stand behind those of the servo that gets them.

    The goals that are due there are missing: a second answer, or a servo that is torn alone, leaves
    them in their place.
    """
    line = Line(protocol, seed)
    line.at(0.0, line.reads)
    line.at(since, line.sends)
    told = diagnosed(line.heard(25), protocol, baud=BAUD)
    assert "rhythms-meet" in codes(told)
    assert verdicts(told.incidents()) == [("two-masters", ())]
