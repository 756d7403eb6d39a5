"""Servos that are there, or not, or not in time: power, silence, other ids and other rates."""

from __future__ import annotations

import dataclasses
import functools
from typing import TYPE_CHECKING, Final

from bench.diagnosis.played.cases import EVERY, Cases
from bench.diagnosis.played.draft import ALL, BAUDS, IDS, PIPED, SELDOM, TURN
from sniffer.simulation import faults as f
from sniffer.simulation.ailments import FOREVER_NS

if TYPE_CHECKING:
    from bench.diagnosis.played.draft import Draft, Play

CASES: Final = Cases()

LIMP_BEHIND: Final = ("mightyzap", "rs30x")
"""Protocols whose servos stay limp behind a restart until they are switched on: others are by the
next goal."""

AGAIN_S: Final = 0.5
"""Until when, at the latest, a servo that is switched on again stands where it should."""


FOR_EVER_S: Final = 1e6


def suffers(play: Play, kind: str, who: int, until_s: float = FOR_EVER_S) -> None:
    """Let a lasting fault of the simulator begin."""
    play.suffer(kind, who, until_s)


def _sag(play: Play, who: int, part: float) -> None:
    play.servo(who).joint.sag = part


def _gone(play: Play, who: int) -> None:
    play.servo(who).deaf_until_ns = FOREVER_NS


def _back(play: Play, who: int, boot_s: float) -> None:
    servo = play.servo(who)
    servo.power_on()
    servo.deaf_until_ns = play.stage.bus.now_ns + int(boot_s * 1e9)


def sags(draft: Draft, whom: list[int]) -> None:
    """Let the supply of some servos sag now and then, until they restart."""
    rng = draft.rng
    stretches = draft.episodes(0.3, 0.9)
    if draft.protocol == "wck":
        del stretches[1:]  # more would be a module that restarts time and again: nothing tells
    depth = rng.uniform(0.33, 0.48)
    for first_s, last_s in stretches:
        for who in whom:
            boot_s = rng.uniform(0.065, 0.09) if draft.protocol == "wck" else rng.uniform(0.1, 0.35)
            if draft.protocol == "wck":  # it tells of no voltage: it is away, and that is all
                draft.at(first_s, functools.partial(_gone, who=who))
                draft.at(last_s, functools.partial(_back, who=who, boot_s=boot_s))
                continue
            draft.at(first_s, functools.partial(_sag, who=who, part=depth * 0.8))
            middle = first_s + 0.4 * (last_s - first_s)
            draft.at(middle, functools.partial(_sag, who=who, part=depth))
            draft.at(last_s, functools.partial(_back, who=who, boot_s=boot_s))
    stays_limp = draft.protocol in LIMP_BEHIND and not draft.habit.revives
    last_s = draft.seconds if stays_limp else stretches[-1][1] + AGAIN_S
    draft.truth("brownout", whom, stretches[0][0], last_s)


@CASES(*EVERY)
def brownout(draft: Draft) -> None:
    """One servo's wire is thin, or all hang on one supply."""
    sags(draft, list(draft.ids) if draft.rng.random() < 0.3 else [draft.pick()])


def _soon_gives_up(play: Play) -> None:
    play.tongue.patience = play.tongue.patience_ns[0]


@CASES(*EVERY, seconds=(12, 25), polls=(ALL,), servos=(2, 4))
def servo_reset_loop(draft: Draft) -> None:
    """A servo restarts again and again, for a while or to the end."""
    who = draft.pick()
    first_s = draft.onset()
    ends = draft.rng.random() < 0.4
    last_s = first_s + draft.rng.uniform(5, 7) if ends else draft.seconds
    least_hz = 25
    if draft.protocol == "wck":  # it is away for 65 ms only: who waits so long would not notice
        least_hz = 66
        draft.start(_soon_gives_up)
    draft.habit = dataclasses.replace(draft.habit, rate_hz=max(draft.habit.rate_hz, least_hz))
    draft.at(first_s, functools.partial(suffers, kind=f.RESETS, who=who, until_s=last_s))
    draft.truth("servo-reset-loop", who, first_s, last_s)


def dies(draft: Draft) -> None:
    """Let a servo fall silent for ever."""
    who, first_s = draft.pick(), draft.onset()
    draft.at(first_s, functools.partial(suffers, kind=f.DEAD, who=who))
    draft.truth("servo-dead", who, first_s, draft.seconds)


@CASES(*EVERY, polls=(ALL, TURN, SELDOM, PIPED), seconds=(10, 30))
def servo_dead(draft: Draft) -> None:
    """A servo falls silent for ever, and is asked on and on."""
    dies(draft)


def _hears(play: Play, who: int) -> None:
    play.servo(who).deaf_until_ns = play.stage.bus.now_ns


@CASES(*EVERY, polls=(ALL, TURN), seconds=(10, 30), servos=(3, 6))
def servo_outage(draft: Draft) -> None:
    """One is away once, for a moment, and has its power all the time."""
    who, first_s = draft.pick(), draft.onset()
    last_s = first_s + draft.rng.uniform(0.3, 0.9)
    draft.at(first_s, functools.partial(_gone, who=who))
    draft.at(last_s, functools.partial(_hears, who=who))
    draft.truth("servo-outage", who, first_s, last_s)


def is_missing(draft: Draft) -> None:
    """Let a servo be asked that is not there."""
    who = draft.pick()

    def unplug(play: Play) -> None:
        play.servo(who).deaf_until_ns = FOREVER_NS

    draft.start(unplug)
    draft.truth("servo-absent", who, 0, draft.seconds)


@CASES(*EVERY, polls=(ALL, TURN, SELDOM), seconds=(6, 20))
def servo_absent(draft: Draft) -> None:
    """One that the controller's list has, and the bus has not."""
    is_missing(draft)


def lags(draft: Draft, first_s: float) -> None:
    """Let a servo take its time."""
    who = draft.pick()
    lag = functools.partial(suffers, kind=f.SLOW, who=who)
    draft.at(first_s, lag) if first_s else draft.start(lag)
    draft.truth("slow-servo", who, first_s, draft.seconds)


@CASES(*EVERY, servos=(3, 6))
def slow_servo(draft: Draft) -> None:
    """One is slower than its peers, always or from some time on."""
    lags(draft, draft.rng.choice((0, draft.onset())))


@CASES("mightyzap", "rs30x", servos=(1, 1))
def slower_than_its_register(draft: Draft) -> None:
    """It has no peers, but a delay register that was read."""

    def reads(play: Play) -> None:
        play.tongue.reads_limits = True

    draft.start(reads)
    lags(draft, 0)


def is_renamed(draft: Draft) -> None:
    """Give a servo another id, and go on polling the old one."""
    who, first_s = draft.pick(), draft.onset()
    free = [i for i in IDS[draft.protocol] if i not in draft.ids]
    new = draft.rng.choice(free)

    def rename(play: Play) -> None:
        play.tell(play.tongue.rename(who, new))

    draft.cue(first_s, rename)
    draft.truth("id-changed", who, first_s, draft.seconds)


@CASES(*EVERY)
def id_changed(draft: Draft) -> None:
    """Somebody gives a servo another id in mid run."""
    is_renamed(draft)


@CASES(*EVERY)
def baud_changed(draft: Draft) -> None:
    """Somebody tells a servo another rate, and does not hear of it again."""
    who, first_s = draft.pick(), draft.onset()
    other = draft.rng.choice([b for b in sorted(set(BAUDS[draft.protocol])) if b != draft.baud])

    def retune(play: Play) -> None:
        play.tell(play.tongue.retune(who, other))
        play.servo(who).deaf_until_ns = FOREVER_NS

    draft.cue(first_s, retune)
    draft.truth("baud-changed", who, first_s, draft.seconds)
