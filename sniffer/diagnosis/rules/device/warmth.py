"""Heat and strain: temperatures at or on the way to their limit, loads that are borne too long."""

from __future__ import annotations

import itertools
from typing import TYPE_CHECKING, Final

import numpy as np

from sniffer.diagnosis.case import runs
from sniffer.diagnosis.catalogue import FindingCode
from sniffer.diagnosis.evidence.efforts import Effort, effort
from sniffer.diagnosis.evidence.limits import Limit, limit_told
from sniffer.diagnosis.evidence.tracks import LOOKS, track
from sniffer.diagnosis.model import Finding, Place
from sniffer.ground.medians import median
from sniffer.ground.model import NS
from sniffer.protocols.base import RESTARTS

if TYPE_CHECKING:
    from collections.abc import Iterable, Iterator, Sequence

    from sniffer.diagnosis.case import Case, Series
    from sniffer.diagnosis.rules import Rule
    from sniffer.ground.model import I64, Mask

FINDINGS: Final = (
    FindingCode(
        "temperature-high",
        "A servo's temperature is at its limit, or close to it.",
        "Twice or longer within 5 degrees of the limit register (as seen, or as shipped); of 75 degrees where there is none.",
    ),
    FindingCode(
        "temperature-rising",
        "A servo grows hot faster than work makes it.",
        "At least 15 degrees more than at the beginning, by a degree a second or faster by a clock, still rising at the end or up to the highest.",
    ),
    FindingCode(
        "hotter-than-others",
        "A servo is far hotter than every other one of its bus, and not yet at its limit.",
        "For ten seconds at a stretch or longer at 60 degrees or more, and 25 more than the hottest of three others or more ever was.",
    ),
    FindingCode(
        "saved-while-cool",
        "A servo goes into safe mode far below its limit of temperature: it is something else.",
        "The last temperature before it, at most five seconds old, is 20 degrees or more below the limit.",
    ),
    FindingCode(
        "saved-briefly",
        "A servo leaves safe mode within seconds, and nobody restarted it: no motor cools so fast.",
        "Every safe mode whose end is seen lasts ten seconds at most, twice at least or with a silence in it, without a command that restarts; and no temperature near its limit is measured.",
    ),
    FindingCode(
        "load-high-and-still",
        "A servo bears nearly all that it can, for long, and does not move while its goals do.",
        "As `load-high`; meanwhile the goals range over more than half of what counts as far, and the positions over less than a fifth of that.",
    ),
    FindingCode(
        "load-high",
        "A servo bears nearly all that it can, for long.",
        "For one and a half seconds or longer (one, and looked at seldomer, where the servo puts an end to it by an alarm), looked at twice a second and three times at least, a load of 80 % (for two seconds 60 %, for three 50 %, if that is four times what the servos of the bus usually have), or a current twice that of a motor that pushes.",
    ),
)

NEAR_DEGC: Final = 5.0

HOT_DEGC: Final = 75.0
"""Small servos are shipped with limits of 70 to 85 degrees."""

COOL_DEGC: Final = 20.0
FRESH_NS: Final = 5 * NS
"""So far below its limit, and measured so shortly before, heat is no reason to protect itself."""

TWICE: Final = 2
COOLS_NS: Final = 10 * NS
"""A motor that was at its limit takes minutes to cool by more than its thermometer flutters."""

WARM_DEGC: Final = 60.0
"""What is less hot is far from its limit, whatever the others are: some are shipped with 70."""

ABOVE_DEGC: Final = 25.0
OTHERS: Final = 3
ABOVE_NS: Final = 10 * NS
"""How much hotter than so many others a servo must be, and for how long: joints that do the same in
pairs are hot in pairs, and a value that is misread passes."""

RISE_DEGC: Final = 15.0

RATE_DEGC_S: Final = 1.0
"""Motors in use warm by some degrees a minute, under load by tens."""

BEARS: Final = 0.8
MUCH: Final = 0.6
HALF: Final = 0.5
"""Parts of the greatest load; the less, the longer, and the more beside the others'."""

TIMES: Final = 4.0

LASTS_NS: Final = 3 * NS // 2
LONGER_NS: Final = 2 * NS
LONGEST_NS: Final = 3 * NS
"""How long it must be: a start and a hard stop take tenths of a second, a lift a second, and servos
that save themselves from 80 % are shipped to bear that for two."""

SAVED_NS: Final = NS
SELDOM_NS: Final = 3 * NS // 2
"""It takes less, and looks may be further apart, where the servo itself puts an end to it."""

SAVES: Final = ("device-overload", "device-safe-mode", "device-overheating", "device-blocked")

PLENTY_NS: Final = 5 * NS

APART_NS: Final = NS // 2
"""Looks that are further apart show single moments: who looks behind each goal sees each start."""


def temperature(case: Case) -> Iterator[Finding]:
    """Servos that are hot, or get so."""
    known = {servo: case.series(servo, "temperature") for servo in case.measured_by("temperature")}
    hottest = {servo: float(t.high.max()) for servo, t in known.items() if t is not None}
    for servo, t in known.items():
        if t is None or len(t) < 2:
            continue
        bound, of = _limit(case, servo)
        limit = bound.value
        hot = np.flatnonzero((t.low >= limit - NEAR_DEGC) & (t.t_first >= bound.since_ns))
        if len(hot) > 1:
            most = float(t.high[hot].max())
            yield Finding(
                "temperature-high",
                servo,
                int(t.t_first[hot[0]]),
                int(t.t[hot[-1]]),
                len(hot),
                f"servo {servo} measures {t.told(most)}, {of} {t.told(limit)}{bound.told(case)}",
                _places(t, hot[:2]),
                strength=1.0 if most >= limit else 0.75,
                brief=f"servo {servo} is at {t.told(most)}",
            )
        if not case.has_clock:
            continue  # bytes without times take no seconds
        if len(hot) <= 1:
            yield from _above(case, servo, t, [most for i, most in hottest.items() if i != servo])
        begin, top = float(t.mean[0]), int(np.argmax(t.mean))
        seconds = (int(t.t[top]) - int(t.t[0])) / NS
        rise = float(t.mean[top]) - begin
        if rise < RISE_DEGC or rise < RATE_DEGC_S * seconds or not _climbs(t.mean[: top + 1]):
            continue
        yield Finding(
            "temperature-rising",
            servo,
            int(t.t_first[0]),
            int(t.t[top]),
            1,
            f"servo {servo} rises from {t.told(t.first[0])} to {t.told(t.high[top])} in "
            f"{seconds:.1f} s; {of} {t.told(limit)}",
            _places(t, [top]),
            strength=min(0.4 + rise / 50, 1.0),
            brief=f"servo {servo} heats up by {t.told(round(rise))}",
        )


def _places(t: Series, rows: Iterable[int]) -> tuple[Place, ...]:
    """Return where temperatures were stated."""
    return tuple(
        Place(int(t.at[r]), 1, int(t.t_first[r]), f"temperature {t.told(t.high[r])}") for r in rows
    )


def _above(case: Case, servo: int, t: Series, others: Sequence[float]) -> Iterator[Finding]:
    """Tell of a servo that is far hotter than all others ever were, and not yet at its limit."""
    if len(others) < OTHERS:
        return
    above = t.low >= max(WARM_DEGC, max(others) + ABOVE_DEGC)
    rows = np.flatnonzero(above)
    if not runs(above, t.t, ABOVE_NS):
        return
    most = float(t.high[rows].max())
    (limit, _), of = _limit(case, servo)
    yield Finding(
        "hotter-than-others",
        servo,
        int(t.t_first[rows[0]]),
        int(t.t[rows[-1]]),
        len(rows),
        f"servo {servo} measures {t.told(most)}, and none of the other {len(others)} ever more than "
        f"{t.told(max(others))}; {of} {t.told(limit)}",
        _places(t, rows[:2]),
        brief=f"servo {servo} is at {t.told(most)}, the others at {t.told(max(others))} at most",
    )


def saved_while_cool(case: Case) -> Iterator[Finding]:
    """Servos that protect themselves, and not for heat."""
    for servo in case.measured_by("temperature"):
        t = case.series(servo, "temperature")
        told = case.anomalies("device-safe-mode", servo_id=servo)
        if t is None or not len(told):
            continue
        row = int(np.searchsorted(t.t_first, told.t_ns[0], "right")) - 1
        (limit, _), of = _limit(case, servo)
        if row < 0 or told.t_ns[0] - t.t[row] > FRESH_NS or t.high[row] > limit - COOL_DEGC:
            continue
        yield Finding(
            "saved-while-cool",
            servo,
            int(told.t_ns[0]),
            int(told.t_ns[-1]),
            len(told),
            f"servo {servo} measures {t.told(float(t.high[row]))} when it goes into safe mode; {of} "
            f"{t.told(limit)}",
            case.places(told, f"servo {servo}: safe mode", 2),
            brief=f"servo {servo} is not hot",
        )


def saved_briefly(case: Case) -> Iterator[Finding]:
    """Servos whose safe mode ends by itself, and far too soon for heat."""
    for servo in case.servos:
        told = case.anomalies("device-safe-mode", servo_id=servo)
        back = case.anomalies("device-recovered", servo_id=servo).t_ns
        if not len(told) or not len(back) or len(hot_times(case, servo)):
            continue
        row = np.searchsorted(back, told.t_ns, "right")
        seen = row < len(back)
        began, ended = told.t_ns[seen], back[row[seen]]
        restarts = case.order_times(servo, RESTARTS)
        spells = list(zip(began.tolist(), ended.tolist(), strict=True))
        silent = [s.first_ns for s in case.ledger.silences.runs(servo)]
        if len(spells) < TWICE and not any(a <= t <= b for a, b in spells for t in silent):
            continue
        longest = max(b - a for a, b in spells) if spells else 0
        if longest > COOLS_NS or any(((restarts >= a) & (restarts <= b)).any() for a, b in spells):
            continue
        yield Finding(
            "saved-briefly",
            servo,
            spells[0][0],
            spells[-1][1],
            len(spells),
            f"servo {servo} is out of safe mode after {longest / NS:.1f} s at most, and nobody "
            "restarted it",
            case.places(told, f"servo {servo}: safe mode", 2),
            brief=f"servo {servo} is out of safe mode by itself",
        )


def hot_times(case: Case, servo: int) -> I64:
    """Return when a servo was at its limit of temperature, or close to it."""
    t = case.series(servo, "temperature")
    if t is None:
        return np.empty(0, np.int64)
    (limit, since_ns), _ = _limit(case, servo)
    return t.t[(t.low >= limit - NEAR_DEGC) & (t.t_first >= since_ns)]


def _climbs(mean: np.ndarray) -> bool:
    """Tell whether a rise goes step by step: a value that jumps is no temperature."""
    steps = np.diff(mean)
    return len(steps) > 2 and float(steps.max()) < 0.6 * float(mean[-1] - mean[0])


def _limit(case: Case, servo: int) -> tuple[Limit, str]:
    """Return the limit, and what is said of it."""
    model, _ = case.ledger.models.get(servo, ("", 0))
    limits = [
        (index, register)
        for index, register in enumerate(case.protocol.registers)
        if register.most_of == "temperature"
    ]
    for index, register in sorted(limits, key=lambda one: one[1].model != model):
        told = limit_told(case, servo, index)
        if told is not None and told.value > 0:
            return told, "its limit is"
        if register.default is not None:
            return Limit(register.default * register.scale, 0), "the limit as shipped is"
    return Limit(HOT_DEGC, 0), "most servos' limit is about"


def load(case: Case) -> Iterator[Finding]:
    """Servos that bear too much for long."""
    usual_of: dict[str, float] = {}
    for servo in case.servos:
        motor = effort(case, servo)
        if motor is None:
            continue
        quantity = motor.series.register.quantity
        if quantity not in usual_of:
            usual_of[quantity] = _usual(case, quantity)
        usual = usual_of[quantity]
        m = motor.steady
        levels: tuple[tuple[float, int], ...]
        if motor.full:
            levels = (
                (BEARS * motor.full, LASTS_NS),
                (max(MUCH * motor.full, TIMES * usual), LONGER_NS),
                (max(HALF * motor.full, TIMES * usual), LONGEST_NS),
            )
        else:
            levels = ((max(2 * motor.pushes_from, TIMES * usual), LASTS_NS),)
        stretches = next(filter(None, (_long(motor, m >= x, lasts) for x, lasts in levels)), [])
        s = motor.series
        if not stretches:
            short = _long(motor, m >= levels[0][0], SAVED_NS, SELDOM_NS)
            stretches = [x for x in short if _is_saved(case, servo, int(s.t[x[1] - 1]))]
        stretches = [x for x in stretches if not _sees_starts(case, servo, s, *x)]
        if not stretches:
            continue
        longest_ns = max(int(s.t[b - 1] - s.t_first[a]) for a, b in stretches)
        # where it begins and ends a quarter second has the rest as well
        most = float(max(median(motor.steady[a:b]) for a, b in stretches))
        still = _stands(case, servo, [(int(s.t_first[a]), int(s.t[b - 1])) for a, b in stretches])
        yield Finding(
            "load-high-and-still" if still else "load-high",
            servo,
            int(s.t_first[stretches[0][0]]),
            int(s.t[stretches[-1][1] - 1]),
            len(stretches),
            f"servo {servo} has {motor.told(most)} for {longest_ns / NS:.1f} s, usually "
            f"{motor.told(usual)}" + (", and does not move with its goals" if still else ""),
            tuple(
                Place(int(s.at[k]), 1, int(s.t_first[k]), motor.told(abs(s.first[k])))
                for k in (min(a + 1, b - 1) for a, b in stretches[:3])
            ),
            strength=min(0.7 + 0.3 * longest_ns / PLENTY_NS, 1.0),
            brief=f"servo {servo} at {motor.told(most)}",
            episodes=tuple((int(s.t_first[a]), int(s.t[b - 1])) for a, b in stretches),
        )


def _sees_starts(case: Case, servo: int, s: Series, first: int, behind: int) -> bool:
    """Tell whether a goal jumped before nearly each look of a stretch: these show starts alone."""
    joint = track(case, servo)
    if joint is None:
        return False
    goal = joint.goal
    then = (goal.t >= s.t_first[first] - APART_NS) & (goal.t_first <= s.t[behind - 1])
    return int((goal.step[then] > joint.far).sum()) >= int(s.n[first:behind].sum()) - 1


def _is_saved(case: Case, servo: int, end_ns: int) -> bool:
    """Tell whether a servo complained when its load ended: it saved itself before it was enough."""
    told = case.anomalies(*SAVES, servo_id=servo).t_ns
    return bool((np.abs(told - end_ns) <= NS).any())


def _long(
    motor: Effort, heavy: Mask, least_ns: int, apart_ns: int = APART_NS
) -> list[tuple[int, int]]:
    """Return the stretches that last, and were looked at often enough."""
    s = motor.series
    edges = [0, *(np.flatnonzero(s.t_first[1:] - s.t[:-1] > apart_ns) + 1).tolist(), len(s)]
    return [
        (first + a, first + b)
        for first, behind in itertools.pairwise(edges)
        for a, b in runs(heavy[first:behind], s.t[first:behind], least_ns)
        if s.n[first + a : first + b].sum() >= LOOKS - 1
    ]


def _stands(case: Case, servo: int, stretches: Sequence[tuple[int, int]]) -> bool:
    """Tell whether a joint does not move while its goals do."""
    joint = track(case, servo)
    if joint is None:
        return False
    asked = went = 0.0
    for first, last in stretches:
        g = (joint.goal.t >= first) & (joint.goal.t_first <= last)
        p = (joint.position.t_first >= first) & (joint.position.t <= last)
        if g.any() and p.any():
            asked += float(joint.goal.high[g].max() - joint.goal.low[g].min())
            went += float(joint.position.high[p].max() - joint.position.low[p].min())
    return asked > joint.far / 2 and went < asked / 5


def _usual(case: Case, quantity: str) -> float:
    """Return what the servos of the bus usually have, each as much as the other."""
    known = (case.series(i, quantity) for i in case.measured_by(quantity))
    medians = [float(median(np.abs(s.mean))) for s in known if s is not None]
    return float(median(medians)) if medians else 0.0


RULES: Final[tuple[Rule, ...]] = (temperature, saved_while_cool, saved_briefly, load)
"""The rules of this file."""
