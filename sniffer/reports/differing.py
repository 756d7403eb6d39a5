"""Two runs compared: by servo, each difference with its test, the surest first."""

from __future__ import annotations

from collections import Counter
from dataclasses import dataclass
from typing import TYPE_CHECKING, Any, Final

import numpy as np

from sniffer.decoding.called import ServoNames
from sniffer.diagnosis.causes import CAUSES, CONTROLLER, SERVO
from sniffer.diagnosis.model import percent_sure
from sniffer.ground.model import NS, Severity
from sniffer.ground.wording import counted
from sniffer.reports.content import happened
from sniffer.reports.runs import FIRST_MOTION, LAG, Who
from sniffer.reports.significance import (
    ALPHA,
    NEGLIGIBLE,
    TestVerdict,
    holm,
    mann_whitney,
    rates,
    shares,
)

if TYPE_CHECKING:
    from collections.abc import Iterator, Mapping

    from sniffer.diagnosis.model import Incident
    from sniffer.reports.runs import RunFigures
    from sniffer.statistics.thinned import Thinned

_EFFECTS: Final = {"missing": "share", "command": "share", "error": "log2 of the ratio"}

_LATE: Final = {
    FIRST_MOTION: "from a goal to the first motion it takes",
    LAG: "it is behind goals that move by",
}

LIKELY: Final = 0.5
"""How sure the cause of an incident is at least that one run has alone."""

_OF_THE_ROBOT: Final = frozenset({SERVO, CONTROLLER})

EXACT: Final = "exact"
"""In place of a test: there is nothing by chance in it."""

DIAGNOSED: Final = "diagnosis"
"""In place of a test: the cause of an incident was weighed."""


@dataclass(frozen=True, slots=True)
class RunDifference:
    """One thing in which two runs differ.

    ``about`` is ``response_time``, ``motion``, ``period``, ``value``, ``goal``, ``missing``,
    ``error``, ``command``, ``setting``, ``servo``, ``incident`` or ``protocol``; ``name`` the
    command, quantity, code, register, cause, ``first_motion`` or ``lag``. ``a`` and ``b`` hold the
    numbers of each run, ``p`` the chance corrected for all that was compared.
    """

    about: str
    bus: str
    servo_id: int | None
    name: str
    a: Mapping[str, Any]
    b: Mapping[str, Any]
    test: str
    p: float
    effect: float | None
    sentence: str

    def lines(self, names: ServoNames | None = None) -> list[str]:
        """Return it for people: what differs, then by which test."""
        names = names or ServoNames()
        who = "all servos" if self.servo_id is None else names.servo(self.bus, self.servo_id)
        sure = f"p {_chance(self.p)}, {self.test}"
        if self.test == EXACT:
            sure = "certain"
        if self.test == DIAGNOSED:
            sure = f"{self.name}, {percent_sure(1 - self.p)} % sure; `sniffer diagnose` weighs it"
        if "n" in self.a and self.test != EXACT:
            sure += f", n {self.a['n']} and {self.b['n']}"
        if self.effect is not None:
            sure += f", {_EFFECTS.get(self.about, 'delta')} {self.effect:+g}"
        told = names.sentence(self.bus, self.sentence)
        return [f"{self.bus} {who}: {told}", f"    {sure}"]

    def as_dict(self) -> dict[str, Any]:
        """Return it as ``schemas/diff.schema.json`` has it."""
        return {
            "about": self.about,
            "bus": self.bus,
            "servo_id": self.servo_id,
            "name": self.name,
            "a": dict(self.a),
            "b": dict(self.b),
            "test": self.test,
            "p": self.p,
            "effect": self.effect,
            "sentence": self.sentence,
        }


def _chance(p: float) -> str:
    return "< 1e-12" if p < 1e-12 else f"{p:.2g}"


@dataclass(frozen=True, slots=True)
class _Found:
    """What may be a difference, before it is known how much was compared."""

    about: str
    who: Who
    name: str
    a: Mapping[str, Any]
    b: Mapping[str, Any]
    verdict: TestVerdict | None
    sentence: str
    is_enough: bool = True
    sure: float = 1.0
    """Of what no test is made of."""

    @property
    def is_apart(self) -> bool:
        """Whether these are values of which all of one run lie beyond all of the other."""
        return self.about == "value" and self.verdict is not None and abs(self.verdict.effect) == 1


@dataclass(frozen=True, slots=True)
class RunDifferences:
    """In what two runs differ, the surest first; ``tests`` is how much was compared by a test.

    ``unproven`` are values of which all of one run lie beyond all of the other, though there are
    too few independent ones to be sure: of what changes slowly, each follows from its neighbour.
    """

    told: list[RunDifference]
    unproven: list[RunDifference]
    tests: int


def differences(a: RunFigures, b: RunFigures) -> RunDifferences:
    """Return in what two runs differ.

    Runs that differ by chance only are told to differ in ``ALPHA`` of all cases.
    """
    found = [
        *_incidents(a, b),
        *_series(a, b),
        *_shares(a, b),
        *_rates(a, b),
        *_settings(a, b),
        *_servos(a, b),
        *_protocols(a, b),
    ]
    tested = [one for one in found if one.verdict is not None]
    chances = holm([one.verdict.p for one in tested if one.verdict is not None])
    corrected = dict(zip(map(id, tested), chances, strict=True))
    out, unproven = [], []
    for one in found:
        v = one.verdict
        p = round(1 - one.sure, 4) if v is None else corrected[id(one)]
        if (v is None or p <= ALPHA) and one.is_enough:
            out.append(_told(one, p))
        elif one.is_apart:
            unproven.append(_told(one, p))
    for each in (out, unproven):
        each.sort(
            key=lambda d: (
                *(d.about != "protocol", d.p, -abs(d.effect or 0.0), d.about, d.bus),
                *(d.servo_id or -1, d.name),
            )
        )
    return RunDifferences(out, unproven, len(tested))


def _told(one: _Found, p: float) -> RunDifference:
    exact = DIAGNOSED if one.about == "incident" else EXACT
    v = one.verdict
    test, effect = (exact, None) if v is None else (v.test, round(v.effect, 4))
    who = one.who
    return RunDifference(
        one.about, who.bus, who.servo_id, one.name, one.a, one.b, test, p, effect, one.sentence
    )


def _incidents(a: RunFigures, b: RunFigures) -> Iterator[_Found]:
    """Yield the incidents of servos and of the controller that one run has alone.

    There is no test of them: a joint hangs limp or does not. What a line or a tap does is chance in
    each single case; it shows in the shares of answers that fail, and in the rates of anomalies.
    """
    for k, (run, other) in enumerate(((a, b), (b, a))):
        for one in run.incidents:
            if not (run.frames[one.bus] and other.frames[one.bus]):  # nothing is compared there
                continue
            sure = one.causes[0].confidence
            if CAUSES[one.cause].of not in _OF_THE_ROBOT or one.severity < Severity.WARN:
                continue
            if sure < LIKELY or _is_known(one, other):
                continue
            alone = one.servo_ids[0] if len(one.servo_ids) == 1 else None
            told = [{"count": one.count}, {"count": 0}]
            sentence = (
                f"{happened(one)}, in {'AB'[k]} alone "
                f"({one.first_ns / NS:.1f} to {one.last_ns / NS:.1f} s)"
            )
            who = Who(one.bus, alone)
            yield _Found(
                "incident", who, one.cause, told[k], told[1 - k], None, sentence, sure=sure
            )


def _is_known(one: Incident, other: RunFigures) -> bool:
    """Tell whether a run has an incident of the same servos that may have the same cause."""
    return any(
        incident.bus == one.bus
        and any(c.cause == one.cause for c in incident.causes)
        and (incident.servo_ids == one.servo_ids or set(incident.servo_ids) & set(one.servo_ids))
        for incident in other.incidents
    )


def _series(a: RunFigures, b: RunFigures) -> Iterator[_Found]:
    kinds: tuple[
        tuple[str, dict[tuple[Who, str], Thinned], dict[tuple[Who, str], Thinned]], ...
    ] = (
        ("response_time", a.response_ms, b.response_ms),
        ("motion", a.motion_ms, b.motion_ms),
        ("period", a.period_ms, b.period_ms),
        ("value", a.measured, b.measured),
        ("goal", a.commanded, b.commanded),
    )
    for about, of_a, of_b in kinds:
        for key in sorted(of_a.keys() & of_b.keys(), key=_order):
            x, y = of_a[key].values(), of_b[key].values()
            verdict = mann_whitney(x, y, lasts=about == "value")
            if verdict is None:
                continue
            verdict = verdict._replace(n_a=of_a[key].count, n_b=of_b[key].count)
            who, name = key
            within = False
            if about in ("response_time", "motion"):
                spreads = [
                    r.doubt_ms if about == "response_time" else r.motion_doubt_ms for r in (a, b)
                ]
                doubt = max(float(np.median(spread[key].values())) for spread in spreads)
                within = abs(float(np.median(y)) - float(np.median(x))) <= doubt
            unit = " ms" if about in ("response_time", "motion", "period") else ""
            words = {
                "response_time": f"answers to {name} take",
                "motion": _LATE.get(name, ""),
                "period": f"{name} comes every",
                "value": f"{name} is",
                "goal": f"{name} is told",
            }[about]
            told_a, told_b = _figures(x, verdict.n_a), _figures(y, verdict.n_b)
            sentence = (
                f"{words} {told_a['median']:g}{unit} in A, {told_b['median']:g}{unit} in B "
                f"(medians)"
            )
            # what the stamps cannot carry is no difference of the servo's: two taps may do that
            enough = abs(verdict.effect) >= NEGLIGIBLE and not within
            yield _Found(about, who, name, told_a, told_b, verdict, sentence, enough)


def _figures(values: np.ndarray[Any, Any], n: int) -> dict[str, Any]:
    low, median, high = (float(f"{q:.4g}") for q in np.quantile(values, (0.05, 0.5, 0.95)))
    return {"n": n, "p5": low, "median": median, "p95": high}


def _shares(a: RunFigures, b: RunFigures) -> Iterator[_Found]:
    both = [(_of_all(run.expected), _of_all(run.missing)) for run in (a, b)]
    for who in sorted(both[0][0].keys() & both[1][0].keys(), key=_servo):
        hits = both[0][1][who], both[1][1][who]
        n = both[0][0][who], both[1][0][who]
        verdict = shares(hits[0], n[0], hits[1], n[1])
        if sum(hits):
            told = [
                {"n": m, "missing": k, "share": round(k / m, 6)}
                for k, m in zip(hits, n, strict=True)
            ]
            sentence = (
                f"{_percent(hits[0], n[0])} of the answers failed in A, "
                f"{_percent(hits[1], n[1])} in B"
            )
            yield _Found("missing", who, "", told[0], told[1], verdict, sentence)
    # how often a command is sent among all that is sent on its bus
    for key in sorted(a.commands.keys() | b.commands.keys(), key=_order):
        who, name = key
        n = _asked(a, who.bus), _asked(b, who.bus)
        hits = a.commands[key], b.commands[key]
        verdict = shares(hits[0], n[0], hits[1], n[1])
        told = [
            {"n": m, "count": k, "share": round(k / m, 6) if m else 0.0}
            for k, m in zip(hits, n, strict=True)
        ]
        sentence = (
            f"{name} is {_percent(hits[0], n[0])} of all requests in A, "
            f"{_percent(hits[1], n[1])} in B"
        )
        if verdict is not None:
            yield _Found("command", who, name, told[0], told[1], verdict, sentence)


def _of_all(counts: Counter[Who]) -> Counter[Who]:
    """Return counts by servo, with those of all servos of a bus where it has several."""
    out = Counter(counts)
    for bus in {who.bus for who in counts}:
        mine = [n for who, n in counts.items() if who.bus == bus]
        if len(mine) > 1:
            out[Who(bus, None)] = sum(mine)
    return out


def _asked(run: RunFigures, bus: str) -> int:
    return sum(n for who, n in run.requests.items() if who.bus == bus)


def _percent(k: int, n: int) -> str:
    return f"{100 * k / n:.2f} %" if n else "none"


def _rates(a: RunFigures, b: RunFigures) -> Iterator[_Found]:
    told_of: dict[str, tuple[Counter[Who], Counter[Who]]] = {}
    for k, run in enumerate((a, b)):
        for (who, code), n in run.errors.items():
            told_of.setdefault(code, (Counter(), Counter()))[k][who] += n
    for code, both in sorted(told_of.items()):
        for who in both[0].keys() | both[1].keys():  # of whom none is told has a count, too
            both[0][who] += 0
            both[1][who] += 0
        yield from _errors(a, b, code, _of_all(both[0]), _of_all(both[1]))


def _errors(
    a: RunFigures, b: RunFigures, code: str, of_a: Counter[Who], of_b: Counter[Who]
) -> Iterator[_Found]:
    for who in sorted(of_a, key=_servo):
        times = float(a.heard[who.bus]), float(b.heard[who.bus])
        counts = of_a[who], of_b[who]
        verdict = rates(counts[0], times[0], counts[1], times[1])
        told = [{"n": int(m), "count": k} for k, m in zip(counts, times, strict=True)]
        sentence = (
            f"{code} is told {counted(counts[0], 'time')} in {times[0]:.0f} frames of A, "
            f"{counted(counts[1], 'time')} in {times[1]:.0f} of B"
        )
        if verdict is not None:
            yield _Found("error", who, code, told[0], told[1], verdict, sentence)


def _settings(a: RunFigures, b: RunFigures) -> Iterator[_Found]:
    for key in sorted(a.settings.keys() & b.settings.keys(), key=_order):
        who, name = key
        x, y = a.settings[key], b.settings[key]
        if x != y and a.protocols[who.bus] == b.protocols[who.bus]:
            told = [{"raw": sorted(values)} for values in (x, y)]
            sentence = f"{name} is {_listed(x)} in A, {_listed(y)} in B (raw)"
            yield _Found("setting", who, name, told[0], told[1], None, sentence)


def _listed(values: set[int]) -> str:
    return " or ".join(map(str, sorted(values)))


def _servos(a: RunFigures, b: RunFigures) -> Iterator[_Found]:
    """Tell of servos that are asked in one run only."""
    in_a, in_b = ({w for w in run.expected if w.servo_id is not None} for run in (a, b))
    for who in sorted(in_a ^ in_b, key=_servo):
        told = [{"n": run.expected[who]} for run in (a, b)]
        only = "A" if who in in_a else "B"
        sentence = f"it is asked in {only} only"
        yield _Found("servo", who, "", told[0], told[1], None, sentence)


def _servo(who: Who) -> tuple[str, int]:
    return who.bus, -1 if who.servo_id is None else who.servo_id


def _order(key: tuple[Who, str]) -> tuple[str, int, str]:
    return (*_servo(key[0]), key[1])


def _protocols(a: RunFigures, b: RunFigures) -> Iterator[_Found]:
    """Tell of buses that speak two protocols: registers of one name are two things there."""
    for bus in sorted(a.protocols.keys() & b.protocols.keys()):
        x, y = a.protocols[bus], b.protocols[bus]
        if x != y:
            told = [{"n": run.frames[bus], "protocol": name} for run, name in ((a, x), (b, y))]
            sentence = f"{x} is spoken in A, {y} in B: other robots, or other servos"
            yield _Found("protocol", Who(bus, None), "", told[0], told[1], None, sentence)
