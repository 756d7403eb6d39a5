"""Joints that do not do what they should: limp, held, hot, overloaded, measured wrongly."""

from __future__ import annotations

import dataclasses
import functools
from typing import TYPE_CHECKING, Final

from bench.diagnosis.played.cases import EVERY, Cases
from bench.diagnosis.played.draft import ALL, SELDOM, TURN
from bench.diagnosis.played.lines import ALL_WORDS
from bench.diagnosis.played.presence import suffers
from sniffer.ground.model import NS
from sniffer.simulation import faults as f
from sniffer.simulation.rs30x_servo import LIMIT_DEGC

if TYPE_CHECKING:
    from bench.diagnosis.played.draft import Draft, Play

CASES: Final = Cases()

LIMITS_DEGC: Final = {"mightyzap": 80, "rs30x": LIMIT_DEGC, "lss": 85}
"""Where servos save themselves. Source: the register tables; LSS protocol page, Command List 25."""

NO_SHUTDOWN, SHUTDOWN = 0x04, 0x24
"""Alarm Shutdown of a mightyZAP: at overheating only, or as shipped also at overload."""

Span = tuple[float, float]


def _mute(play: Play, whom: list[int]) -> None:
    play.robot.nature.mute.update(whom)


def _off(play: Play, whom: list[int]) -> None:
    for who in whom:
        play.tell(play.tongue.switch(who, on=False))


def _restart(play: Play, whom: list[int], boot_s: float) -> None:
    for who in whom:
        play.tell(play.tongue.restart(who))
        servo = play.servo(who)
        servo.deaf_until_ns = play.stage.now_ns + int(boot_s * NS)


def goes_limp(draft: Draft) -> None:
    """Take the torque from a servo that is sent goals on and on."""
    rng = draft.rng
    whom = sorted({draft.pick() for _ in range(rng.choice((1, 1, 1, 2)))})
    draft.habit = dataclasses.replace(draft.habit, revives=False)
    first_s = draft.onset()
    if draft.protocol in ("lss", "wck"):  # a goal would switch it on: its motor is gone
        for who in whom:
            draft.at(first_s, functools.partial(suffers, kind=f.LIMP, who=who))
    else:
        how = rng.choice(("never", "off", "restart"))
        if how == "never":
            first_s = 0.0
            draft.start(functools.partial(_mute, whom=whom))
        elif how == "off":
            draft.cue(first_s, functools.partial(_off, whom=whom))
        else:
            boot_s = rng.uniform(0.08, 0.3)
            draft.cue(first_s, functools.partial(_restart, whom=whom, boot_s=boot_s))
    draft.truth("torque-off", whom, first_s, draft.seconds)


@CASES(*EVERY, polls=(ALL, TURN, SELDOM), seconds=(10, 25))
def torque_off(draft: Draft) -> None:
    """Never switched on, switched off, lost by a restart, or its motor is gone."""
    goes_limp(draft)


def _shut(play: Play, bits: int) -> None:
    if play.stage.bus.name == "mightyzap":
        for servo in play.stage.bus.servos.values():
            servo.memory.raw["alarm_shutdown"] = bits  # type: ignore[attr-defined]


def is_held(draft: Draft) -> None:
    """Hold a joint fast, for some seconds or to the end."""
    rng, who = draft.rng, draft.pick()
    draft.habit = dataclasses.replace(draft.habit, revives=False)
    bits = rng.choice((NO_SHUTDOWN, SHUTDOWN))
    draft.start(functools.partial(_shut, bits=bits))
    spans: list[Span] = draft.episodes(3, 5)
    if rng.random() < 0.4:
        spans = [(draft.onset(), draft.seconds)]
    if draft.protocol == "lss" or bits == SHUTDOWN:
        del spans[1:]  # it saves itself the first time, and is limp from then on
    for first_s, last_s in spans:
        draft.at(first_s, functools.partial(suffers, kind=f.STALL, who=who, until_s=last_s))
    saves = draft.protocol == "lss" or (draft.protocol == "mightyzap" and bits == SHUTDOWN)
    draft.truth("stall", who, spans[0][0], draft.seconds if saves else spans[-1][1] + 0.3)


@CASES(*EVERY, seconds=(14, 28), servos=(2, 4))
def stall(draft: Draft) -> None:
    """A joint is held fast while its goal moves on."""
    is_held(draft)


def grows_hot(draft: Draft) -> None:
    """Warm a motor up to where its servo saves it."""
    rng, who = draft.rng, draft.pick()
    draft.habit = dataclasses.replace(draft.habit, revives=False)
    limit = LIMITS_DEGC[draft.protocol]
    below = rng.uniform(14, 24)
    first_s = draft.onset()
    rate = below / ((draft.seconds - first_s) * rng.uniform(0.3, 0.6))

    def warm(play: Play) -> None:
        play.servo(who).joint.temperature = limit - below
        if draft.protocol == "lss":  # else it says that it saved itself, and not from what
            play.tongue.turn = ALL_WORDS

    def heat(play: Play) -> None:
        joint = play.servo(who).joint
        cooling = (limit - 26) / 240  # what the joint loses to the air meanwhile
        joint.heater = rate + cooling

    draft.start(warm)
    draft.at(first_s, heat)
    draft.truth("overheat", who, first_s, draft.seconds)


@CASES("mightyzap", "rs30x", "lss", seconds=(20, 50), polls=(ALL, TURN), servos=(1, 4))
def overheat(draft: Draft) -> None:
    """A motor grows hot until its servo saves it."""
    grows_hot(draft)


@CASES("mightyzap", "lss", seconds=(12, 24), polls=(ALL, TURN), servos=(2, 4))
def overload(draft: Draft) -> None:
    """A joint bears more than its motor can for long, and moves."""
    rng, who = draft.rng, draft.pick()
    draft.habit = dataclasses.replace(draft.habit, revives=False)
    bits = rng.choice((NO_SHUTDOWN, SHUTDOWN))
    draft.start(functools.partial(_shut, bits=bits))
    first_s = draft.onset()
    last_s = first_s + rng.uniform(3, 6)
    draft.at(first_s, functools.partial(suffers, kind=f.OVERLOAD, who=who, until_s=last_s))
    saves = draft.protocol == "lss" or bits == SHUTDOWN
    draft.truth("overload", who, first_s, draft.seconds if saves else last_s + 0.3)


def _shifted(play: Play, who: int, shift: float, times: int) -> None:
    """Let a servo measure its position wrongly, so often."""
    servo = play.servo(who)
    top = 1.0 if servo.joint.position < 0.5 else -1.0
    usual, left = servo.measure, [True] * times

    def measure() -> None:
        if not left:  # another one lay over it, and gives it back when it was over itself
            usual()
            return
        joint = servo.joint
        true = joint.position
        joint.position = min(max(true + top * shift, 0.0), 1.0)
        usual()
        joint.position = true
        left.pop()
        if not left:
            servo.measure = usual

    servo.measure = measure


@CASES("mightyzap", "rs30x", polls=(ALL,), servos=(1, 4))
def position_jump_measured(draft: Draft) -> None:
    """A worn potentiometer: single values that no joint could have reached, and back."""
    rng, who = draft.rng, draft.pick()
    draft.habit = dataclasses.replace(draft.habit, rate_hz=max(draft.habit.rate_hz, 25))
    times = sorted(rng.uniform(2, draft.seconds - 1) for _ in range(rng.randint(2, 6)))
    for t in times:
        shift = rng.uniform(0.25, 0.45)
        # a client that reads one register after the other measures anew for each
        wrong = functools.partial(_shifted, who=who, shift=shift, times=rng.randint(2, 4))
        draft.at(t, wrong)
    draft.truth("position-jump", who, times[0], times[-1] + 0.2)
