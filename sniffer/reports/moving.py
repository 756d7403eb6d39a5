"""Rules on how servos move: how far from their goals, how late, which they never reach."""

from __future__ import annotations

from typing import TYPE_CHECKING, TypeVar

from sniffer.decoding.durations import FIGURES
from sniffer.ground.milli import MILLI
from sniffer.ground.model import MS, Clock
from sniffer.ground.wording import counted
from sniffer.reports import words
from sniffer.reports.subject import Figure, name_of, servos_of

if TYPE_CHECKING:
    from collections.abc import Callable, Iterator, Mapping

    from sniffer.decoding.durations import Quantiles
    from sniffer.reports import rules as r
    from sniffer.reports.subject import Subject
    from sniffer.statistics.motion import Motion

T = TypeVar("T")


def _moved(
    rule: r.Rule, heard: Subject, figures: Callable[[Motion], Mapping[tuple[int, str], T]]
) -> Iterator[tuple[str, int, str, T]]:
    """Yield figures of how servos move, each with lane, servo and unit."""
    for lane, servo, _ in servos_of(rule, heard):
        for (who, unit), mine in figures(heard.collector.lanes[lane].motion).items():
            if who == servo:
                yield lane, servo, unit, mine


def following(rule: r.Rule, heard: Subject) -> Iterator[Figure]:
    """Yield how far servos are from their goals."""
    for lane, servo, unit, errors in _moved(rule, heard, lambda motion: motion.errors):
        bounds = errors.size.figure(FIGURES[rule.figure])
        if bounds is not None:
            low, high = (bound / MILLI for bound in bounds)
            told = f"{rule.figure} of the following error of {name_of(heard, lane, servo)} is "
            told += f"{words.measured(high, unit)}, {counted(errors.size.count, 'position')}"
            yield Figure(low, high, told, servo)


def lag(rule: r.Rule, heard: Subject) -> Iterator[Figure]:
    """Yield how far servos are behind their goals."""
    for lane, servo, unit, _ in _moved(rule, heard, lambda motion: motion.errors):
        lag = heard.collector.lanes[lane].motion.lags.of(servo, unit)
        if lag is not None:
            told = f"{name_of(heard, lane, servo)} is behind its goals by {lag.ms()} ms, "
            told += counted(lag.count, "position")
            yield Figure(lag.low_ns / MS, lag.high_ns / MS, told, servo)


def settling(rule: r.Rule, heard: Subject) -> Iterator[Figure]:
    """Yield how long servos take to settle."""
    for lane, servo, _, steps in _moved(rule, heard, lambda motion: motion.steps.figures()):
        yield from _until(rule, heard, lane, servo, "settles", steps.settle, steps.steps)


def starting(rule: r.Rule, heard: Subject) -> Iterator[Figure]:
    """Yield how long servos take to begin to move."""
    for lane, servo, _, starts in _moved(rule, heard, lambda motion: motion.starts.figures()):
        yield from _until(rule, heard, lane, servo, "moves", starts.times, starts.told)


def _until(
    rule: r.Rule, heard: Subject, lane: str, servo: int, does: str, times: Quantiles, goals: int
) -> Iterator[Figure]:
    """Yield how long a servo takes until it does something, of so many goals."""
    bounds = times.figure(FIGURES[rule.figure])
    if bounds is not None:
        told = f"{rule.figure} until {name_of(heard, lane, servo)} {does} is {bounds.ms()} ms"
        told += f", {counted(times.count, 'goal')} of {goals}"
        yield Figure(bounds.low / MS, bounds.high / MS, told, servo)


def unreached(rule: r.Rule, heard: Subject) -> Iterator[Figure]:
    """Yield how many goals servos did not reach."""
    for lane, servo, unit, steps in _moved(rule, heard, lambda motion: motion.steps.figures()):
        clock = heard.collector.wires[heard.collector.lanes[lane].bus].clock
        if clock == Clock.NONE:  # nobody knows how long a goal held
            continue
        n = steps.unreached_count
        told = f"{counted(n, 'goal')} of {name_of(heard, lane, servo)} not reached"
        for goal in steps.unreached[:1]:
            aim, left = (words.measured(end.value, unit) for end in (goal.goal, goal.left))
            when = words.moment(goal.goal.t_ns, clock)
            told += f", first {aim} at {when} (byte {goal.goal.offset}): it was left at {left}"
        yield Figure(n, n, told, servo)
