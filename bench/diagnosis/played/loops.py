"""Controllers whose loop is at fault: it does not wait, hangs, trembles, overflows or hammers."""

from __future__ import annotations

import dataclasses
import functools
from typing import TYPE_CHECKING, Final

from bench.diagnosis.played.cases import EVERY, Cases
from bench.diagnosis.played.draft import ALL, PIPED, SELDOM, TURN
from bench.diagnosis.played.robot import LONGEST
from sniffer.ground.model import MS, NS
from sniffer.simulation.talk import US

if TYPE_CHECKING:
    from bench.diagnosis.played.draft import Draft, Play

CASES: Final = Cases()

SHORTEST: Final = {
    "mightyzap": (0, 9),
    "lss": (1 * MS, 7),
    "rs30x": (100 * US, 10),
    "wck": (312 * US, 2),
}
"""How long a servo takes at least, and the bytes of its shortest answer to a look."""


def does_not_wait(draft: Draft) -> None:
    """Let a controller speak into answers: of all servos, or of one; for some time or always."""
    rng = draft.rng
    # behind the last one of a cycle it rests, and speaks into nothing
    whom = set(draft.ids) if rng.random() < 0.5 else {rng.choice(draft.ids[:-1])}
    share = rng.uniform(0.15, 0.85)
    often = rng.choice((1.0, 0.3, 0.1))
    spans = [(0.0, draft.seconds)] if rng.random() < 0.3 else draft.episodes(2, 5)
    turnaround, size = SHORTEST[draft.protocol]

    def start(play: Play) -> None:
        stage = play.stage
        haste = int(turnaround + stage.wire_ns(size) * share)

        def of(servo_id: int) -> int | None:
            now = any(a <= stage.now_s <= b for a, b in spans)
            struck = now and servo_id in whom and stage.rng.random() < often
            return haste if struck else None

        play.robot.nature.haste = of

    draft.start(start)
    draft.truth("impatient-controller", (), spans[0][0], spans[-1][1])


@CASES(*EVERY, polls=(ALL,), servos=(2, 5), seconds=(10, 25))
def impatient_controller(draft: Draft) -> None:
    """The next request begins in the answer to the one before."""
    does_not_wait(draft)


@CASES("rs30x", polls=(ALL,), servos=(2, 4))
def impatient_with_a_slow_setting(draft: Draft) -> None:
    """All servos are set to a long return delay, and the controller gives up before it is over."""
    steps = draft.rng.randint(60, 120)  # 3.1 to 6.1 ms

    def start(play: Play) -> None:
        for servo in play.stage.bus.servos.values():
            servo.memory.raw["return_delay"] = steps  # type: ignore[attr-defined]
            servo.burn()  # type: ignore[attr-defined]
        haste = int((0.1 + 0.05 * steps) * MS * 0.6)
        play.robot.nature.haste = lambda servo_id: haste
        play.tongue.acks = False

    draft.start(start)
    draft.truth("impatient-controller", (), 0, draft.seconds)


def hangs(draft: Draft) -> None:
    """Let the loop stop now and then."""
    rng = draft.rng
    draft.habit = dataclasses.replace(draft.habit, rate_hz=max(draft.habit.rate_hz, 25))
    times = sorted(rng.uniform(2, draft.seconds - 1) for _ in range(rng.randint(3, 9)))
    longest = 0.0
    for t in times:
        hang_ns = int(rng.uniform(0.12, 0.5) * NS)
        longest = hang_ns / NS
        draft.cue(t, functools.partial(_hang, hang_ns=hang_ns))
    draft.truth("controller-stall", (), times[0], times[-1] + longest)


def _hang(play: Play, hang_ns: int) -> None:
    play.robot.nature.hang_ns = hang_ns


@CASES(*EVERY, polls=(ALL, TURN, SELDOM, PIPED), seconds=(10, 30))
def controller_stall(draft: Draft) -> None:
    """The loop stops for 120 to 500 ms now and then."""
    hangs(draft)


@CASES(*EVERY, polls=(ALL, TURN, SELDOM), seconds=(10, 25))
def controller_jitter(draft: Draft) -> None:
    """Cycles begin too early or too late, always or from some time on."""
    first_s = draft.rng.choice((0.0, draft.onset()))
    jitter = draft.rng.uniform(0.3, 0.45)
    draft.habit = dataclasses.replace(draft.habit, spare=2.2)

    def tremble(play: Play) -> None:
        play.robot.nature.jitter = jitter

    draft.at(first_s, tremble)
    draft.truth("controller-jitter", (), first_s, draft.seconds)


FULL_BAUDS: Final = {"mightyzap": 57600, "rs30x": 57600, "lss": 9600}


@CASES("mightyzap", "rs30x", "lss", polls=(ALL,), servos=(5, 9), seconds=(8, 16))
def bus_saturated(draft: Draft) -> None:
    """More is to be said in a cycle than the line has time for."""
    draft.baud = FULL_BAUDS[draft.protocol]
    draft.habit = dataclasses.replace(
        draft.habit, rate_hz=100, spare=0, pause_ns=draft.rng.choice((20, 40, 60)) * US, tries=1
    )

    def start(play: Play) -> None:
        for servo in play.stage.bus.servos.values():
            memory = getattr(servo, "memory", None)
            for name in ("return_delay_time", "return_delay"):
                if memory is not None and memory.has(name):
                    memory.raw[name] = 0

    draft.start(start)
    draft.truth("bus-saturated", (), 0, draft.seconds)


@CASES(*EVERY, polls=(ALL, TURN), servos=(2, 4))
def retry_storm(draft: Draft) -> None:
    """A servo does not answer one of many questions for now, and is asked again without a pause."""
    rng, who = draft.rng, draft.pick()
    spans = draft.episodes(0.4, 1.5)
    period_s = rng.choice((0.1, 0.25))
    draft.habit = dataclasses.replace(draft.habit, tries=1)
    nags = rng.randint(10, 25)

    def stubborn(play: Play) -> None:
        question = play.tongue.identify(who)

        def ask() -> None:
            play.robot.nature.stubborn = nags
            play.tell([question])
            play.robot.nature.stubborn = 0

        def extra(cycle: int) -> None:
            del cycle
            if play.stage.now_s >= play.robot.nature.next_s:
                play.robot.nature.next_s = play.stage.now_s + period_s
                ask()

        play.robot.nature.extras.append(extra)
        play.tongue.patience = play.stage.wire_ns(LONGEST) + 4 * MS
        for first_s, last_s in spans:
            play.stage.at(first_s, lambda: play.stage.ignored.add(question.raw))
            play.stage.at(last_s, play.stage.ignored.clear)

    draft.start(stubborn)
    draft.truth("retry-storm", who, spans[0][0], spans[-1][1] + 0.3)
