"""Rules held against a capture. A rule passes, fails, or cannot be decided; each has its figure.

A figure that is known within bounds passes if both keep the rule, fails if neither keeps one of its
limits, and else decides nothing. Nor does what was never heard: a rule on a supply that nobody
asked for is no rule that holds.
"""

from __future__ import annotations

import enum
import math
import operator
from collections import Counter
from dataclasses import dataclass
from types import MappingProxyType
from typing import TYPE_CHECKING, Any, Final

from sniffer.anomalies.catalogue import CATALOGUE
from sniffer.decoding.durations import FIGURES
from sniffer.ground.amounts import number
from sniffer.ground.model import MS, Clock
from sniffer.ground.wording import and_, counted
from sniffer.reports import rules as r
from sniffer.reports import words
from sniffer.reports.moving import following, lag, settling, starting, unreached
from sniffer.reports.subject import Figure, name_of, servos_of

if TYPE_CHECKING:
    from collections.abc import Callable, Iterable, Iterator, Mapping, Sequence

    from sniffer.decoding.summary import BusTotals
    from sniffer.reports.subject import Subject
    from sniffer.statistics.figures import ServoFigures

TOTALS: Final = frozenset({r.INCIDENTS, r.ANOMALIES, r.FRAMES, r.SECONDS})
"""Rules on what grows with the capture: a short part has less of it than the whole."""

TOLD: Final = 3
"""Incidents that a failed rule names."""


class Decision(enum.IntEnum):
    """What becomes of a rule; the higher one counts where servos differ."""

    PASSED = 0
    UNDECIDED = 1
    FAILED = 2


@dataclass(frozen=True, slots=True)
class Judged:
    """A rule with what came of it; ``figure`` is the sentence with the number that decided.

    ``decided`` is that number, within bounds; None: nothing of it was heard.
    """

    rule: r.Rule
    verdict: Decision
    figure: str
    decided: Figure | None = None

    @property
    def holds(self) -> bool:
        """Whether the rule is kept, or may stay undecided."""
        lenient = self.rule.is_lenient and self.verdict == Decision.UNDECIDED
        return self.verdict == Decision.PASSED or lenient

    @property
    def word(self) -> str:
        """The verdict in a word; what breaks the check is written large."""
        word = self.verdict.name
        return word.lower() if self.holds else word

    def as_dict(self) -> dict[str, Any]:
        """Return it as a line of ``schemas/check.schema.json`` has it."""
        number = self.decided
        servo = -1 if number is None else number.servo
        return {
            "type": "rule",
            "rule": self.rule.name,
            "what": self.rule.what,
            "verdict": self.verdict.name.lower(),
            "holds": self.holds,
            "bounds": dict(self.rule.bounds),
            "low": None if number is None else number.low,
            "high": None if number is None else number.high,
            "servo_id": servo if servo >= 0 else None,
            "figure": self.figure,
        }


def judge(rules: Sequence[r.Rule], heard: Subject) -> list[Judged]:
    """Hold rules against a capture, each by itself."""
    out = []
    for rule in rules:
        figures = list(_FIGURES[rule.what](rule, heard))
        if not figures:
            out.append(Judged(rule, Decision.UNDECIDED, _nothing(rule, heard)))
            continue
        found = [(_verdict(rule, f), _distance(rule, f), f) for f in figures]
        verdict = max(v for v, _, _ in found)
        worst = min((f for f in found if f[0] == verdict), key=lambda f: f[1])[2]
        told = f"{worst.told}; wanted: {rule.asked}"
        silent = set(rule.servos) - {f.servo for f in figures} if rule.what in r.OF_EACH else set()
        if silent and verdict == Decision.PASSED:
            ids = _ids(rule, heard, sorted(silent))
            verdict, told = Decision.UNDECIDED, f"{told}; nothing of it was heard of servo {ids}"
        if verdict == Decision.FAILED and _is_too_little(rule, worst):
            told += _of_a_part(heard)
        out.append(Judged(rule, verdict, told, worst))
    return out


def tally(verdicts: Sequence[Judged]) -> str:
    """Return how many rules there are, and what became of them."""
    counts = Counter(judged.verdict for judged in verdicts)
    told = ", ".join(f"{counts[v]} {v.name.lower()}" for v in Decision if counts[v])
    return f"{counted(len(verdicts), 'rule')}: {told}"


_KEEPS: Final[Mapping[str, Callable[[float, float], bool]]] = MappingProxyType(
    {"below": operator.lt, "at_most": operator.le, "above": operator.gt, "at_least": operator.ge}
)
"""Whether a value keeps a bound, by the word for it."""


def _verdict(rule: r.Rule, figure: Figure) -> Decision:
    """Return what a figure between two values tells: failed is what breaks a bound at both ends."""
    kept = [
        [_KEEPS[name](value, bound) for value in (figure.low, figure.high)]
        for name, bound in rule.bounds.items()
    ]
    if all(map(all, kept)):
        return Decision.PASSED
    return Decision.UNDECIDED if all(map(any, kept)) else Decision.FAILED


def _distance(rule: r.Rule, figure: Figure) -> float:
    """Return by how much a figure keeps a rule; the least of all is the one that is told."""
    out = []
    for name, bound in rule.bounds.items():
        is_upper = name in ("below", "at_most")
        out.append(bound - figure.high if is_upper else figure.low - bound)
    return min(out)


def _is_too_little(rule: r.Rule, figure: Figure) -> bool:
    """Tell whether a total fails for being small, as that of a short part may."""
    bounds, n = rule.bounds, figure.high
    is_less = n <= bounds.get("above", -math.inf) or n < bounds.get("at_least", -math.inf)
    return rule.what in TOTALS and is_less


def _of_a_part(heard: Subject) -> str:
    """Say that not all of the capture was judged, where that is so."""
    part = heard.summary.narrowed.get("part")
    return f"; a part of the capture alone was judged, {part}" if part is not None else ""


def _ids(rule: r.Rule, heard: Subject, servos: Iterable[int]) -> str:
    """Return ids of a rule with the names that they have where it is about one bus."""
    buses = [rule.bus] if rule.bus else list(heard.summary.buses)
    of = buses[0] if len(buses) == 1 else ""
    return ", ".join(heard.summary.names.label(of, servo) for servo in servos)


def _buses(rule: r.Rule, heard: Subject) -> Iterator[tuple[str, BusTotals]]:
    for bus, totals in heard.summary.buses.items():
        if rule.bus in ("", bus, *heard.collector.lanes_of(bus)):
            yield bus, totals


def _has_frames(rule: r.Rule, heard: Subject) -> bool:
    """Tell whether there was a frame on any bus that a rule is about."""
    return any(totals.bytes_in_frames for _, totals in _buses(rule, heard))


def _incidents(rule: r.Rule, heard: Subject) -> Iterator[Figure]:
    buses = {name for name, _ in _buses(rule, heard)}
    if not buses:
        return
    lanes = heard.collector.lanes
    mine = [
        i
        for i in heard.incidents
        if (i.bus in buses or (i.bus in lanes and lanes[i.bus].bus in buses))
        and i.severity >= rule.least
        and i.causes[0].confidence >= rule.sure
        and (not rule.named or i.cause in rule.named)
        and (not rule.servos or not i.servo_ids or set(i.servo_ids) & set(rule.servos))
    ]
    if not mine and not _has_frames(rule, heard):
        return  # who reads no frame finds no fault
    told = counted(len(mine), "incident") if mine else "no incident"
    if mine:
        several = len(heard.summary.buses) > 1
        first = "; ".join(
            f"{i.cause}{f' on {i.bus}' if several else ''}: {i.story}" for i in mine[:TOLD]
        )
        told += f" ({first}{'; ...' if len(mine) > TOLD else ''})"
    yield Figure(len(mine), len(mine), told)


def _anomalies(rule: r.Rule, heard: Subject) -> Iterator[Figure]:
    found: dict[str, int] = {}
    buses = list(_buses(rule, heard))
    for _, totals in buses:
        for part in totals.parts.values() or (totals,):
            for code, n in part.codes.items():
                if CATALOGUE[code].severity < rule.least or (rule.named and code not in rule.named):
                    continue
                blamed = part.by_servo.get(code, Counter())
                others = blamed.total() - sum(blamed[servo] for servo in rule.servos)
                mine = n - others if rule.servos else n  # what is nobody's counts for all
                found[code] = found.get(code, 0) + mine
    total = sum(found.values())
    named = ", ".join(f"{n} {code}" for code, n in sorted(found.items()) if n)
    if buses:
        noun = "anomaly" if total == 1 else "anomalies"
        yield Figure(total, total, f"{total} {noun} ({named})" if total else "no anomaly")


def _response_time(rule: r.Rule, heard: Subject) -> Iterator[Figure]:
    for lane, servo, _ in servos_of(rule, heard):
        known = heard.collector.lanes[lane]
        totals = heard.summary.buses[known.bus]
        times = totals.parts.get(known.protocol.name, totals).times.get(servo)
        bounds = times.figure(FIGURES[rule.figure]) if times is not None else None
        if times is not None and bounds is not None:
            told = f"{rule.figure} of {name_of(heard, lane, servo)} is {bounds.ms()} ms"
            told += f" (between {bounds.low / MS:.2f} and {bounds.high / MS:.2f})"
            told += f", {counted(times.count, 'answer')}"
            yield Figure(bounds.low / MS, bounds.high / MS, told, servo)


def _value(rule: r.Rule, heard: Subject) -> Iterator[Figure]:
    for lane, servo, mine in servos_of(rule, heard):
        clock = heard.collector.wires[heard.collector.lanes[lane].bus].clock
        for (quantity, unit), values in mine.values.items():
            if quantity != rule.quantity:
                continue
            for end in (values.least, values.most):
                shown = words.measured(end.value, unit)
                when = words.moment(end.t_ns, clock)
                told = f"{quantity} of {name_of(heard, lane, servo)} is {shown} at {when}"
                yield Figure(end.value, end.value, f"{told} (byte {end.offset})", servo)


def _goals(rule: r.Rule, heard: Subject) -> Iterator[Figure]:
    for lane, servo, mine in servos_of(rule, heard):
        goals = mine.goals
        wanted = goals["acknowledged"] + goals["refused"] + goals["failed"]
        if wanted:
            told = f"{goals['acknowledged']} of {counted(wanted, 'goal')} acknowledged by "
            told += name_of(heard, lane, servo)
            beside = {"refused": goals["refused"], "without acknowledgement": goals["failed"]}
            told += "".join(f", {n} {what}" for what, n in beside.items() if n)
            share = goals["acknowledged"] / wanted
            yield Figure(share, share, told, servo)


def _missing(rule: r.Rule, heard: Subject) -> Iterator[Figure]:
    return _answers(rule, heard, lambda mine: mine.missing, "did not come")


def _damaged(rule: r.Rule, heard: Subject) -> Iterator[Figure]:
    return _answers(rule, heard, lambda mine: mine.damaged, "came damaged")


def _answers(
    rule: r.Rule, heard: Subject, count: Callable[[ServoFigures], int], what: str
) -> Iterator[Figure]:
    for lane, servo, mine in servos_of(rule, heard):
        if mine.wanted:
            n = count(mine)
            share = n / mine.wanted
            told = (
                f"{n} of {counted(mine.wanted, 'answer')} of {name_of(heard, lane, servo)} {what}"
            )
            yield Figure(share, share, f"{told} ({number(100 * share, 3)} %)", servo)


def _in_frames(rule: r.Rule, heard: Subject) -> Iterator[Figure]:
    for bus, totals in _buses(rule, heard):
        if totals.bytes:
            share = totals.bytes_in_frames / totals.bytes
            told = f"{totals.bytes_in_frames} of {totals.bytes} bytes of {bus} are in frames"
            yield Figure(share, share, told)


def _frames(rule: r.Rule, heard: Subject) -> Iterator[Figure]:
    for bus, totals in _buses(rule, heard):
        n = sum(totals.kinds.values())
        yield Figure(n, n, f"{counted(n, 'frame')} on {bus}")


def _seconds(rule: r.Rule, heard: Subject) -> Iterator[Figure]:
    for bus, totals in _buses(rule, heard):
        if totals.seconds is not None:
            yield Figure(totals.seconds, totals.seconds, f"{totals.seconds:.3f} s of {bus}")


_FIGURES: Final[Mapping[str, Callable[[r.Rule, Subject], Iterator[Figure]]]] = {
    r.INCIDENTS: _incidents,
    r.ANOMALIES: _anomalies,
    r.RESPONSE_TIME: _response_time,
    r.VALUE: _value,
    r.FOLLOWING: following,
    r.LAG: lag,
    r.SETTLING: settling,
    r.STARTING: starting,
    r.UNREACHED: unreached,
    r.GOALS: _goals,
    r.MISSING: _missing,
    r.DAMAGED: _damaged,
    r.IN_FRAMES: _in_frames,
    r.FRAMES: _frames,
    r.SECONDS: _seconds,
}


def _nothing(rule: r.Rule, heard: Subject) -> str:
    """Say why there is no figure."""
    if rule.bus and not list(_buses(rule, heard)):
        there = and_([*heard.summary.buses])
        are = "is" if len(heard.summary.buses) == 1 else "are"
        return f"there is no bus {rule.bus}: {there} {are} there"
    if not _has_frames(rule, heard):
        return "not one frame was read, so nothing could be judged"
    if rule.servos and not list(servos_of(rule, heard)):
        ids = _ids(rule, heard, rule.servos)
        return f"no servo of the id {ids} was asked or heard"
    if rule.what in (r.RESPONSE_TIME, r.SECONDS, r.LAG, r.SETTLING, r.STARTING, r.UNREACHED):
        clocks = {wire.clock for wire in heard.collector.wires.values()}
        if clocks <= {Clock.NONE}:
            return "the input has no clock, so no time is known"
        if rule.what == r.LAG:
            return "no goal moved so that a lag would show"
        if rule.what == r.SETTLING:
            return "no goal was reached before the next one"
        if rule.what == r.STARTING:
            return "no servo that stood still was seen to move behind a goal"
        if rule.what == r.UNREACHED:
            return "no goal was a step that could be seen"
        return "no response time is known"
    if rule.what == r.VALUE:
        heard_of = {q for _, _, mine in servos_of(rule, heard) for q, _ in mine.values}
        known = f" ({', '.join(sorted(heard_of))} were)" if heard_of else ""
        return f"no {rule.quantity} was heard{known}"
    if rule.what == r.FOLLOWING:
        return "no position was heard while a goal in its unit was known"
    if rule.what == r.GOALS:
        return "no goal was told in a request that is acknowledged"
    return "nothing of it was heard"
