"""The scenarios of servos and controllers at fault: what is built in can be seen on the line."""

from __future__ import annotations

import itertools
import re
import statistics
from collections import defaultdict
from typing import TYPE_CHECKING, Final

from bench.diagnosis import controllers, devices
from tests.lists import each_in_turn
from tests.scenes import Seen, seen

if TYPE_CHECKING:
    from collections.abc import Callable, Mapping

    from bench.diagnosis.scenario import Scenario, Truth

DRAW: Final = 0
SCENARIOS: Final = (*devices.scenarios(DRAW), *controllers.scenarios(DRAW))

TRAVEL: Final = {"mightyzap": 4095, "rs30x": 2400, "lss": 1800, "wck": 254}
"""Numbers between the ends of what goals use."""

READ_ONLY: Final = (0x8C, 0x92, 0x00, 0x6A, 0x2A, 0x34, 0x02, 0x38)
GOALS: Final = (0x86, 0x87, 0x1E, 0x1F)
KEPT: Final = ("store_data", "flash_write", "CLED", "pd_gain_set")
HOT: Final = {"device-overheating", "device-temperature-alarm", "device-temperature-limit"}
REFUSED: Final = {
    "device-range",
    "device-instruction",
    "device-nack",
    "device-packet-not-processable",
}


def named(name: str) -> Scenario:
    return next(scenario for scenario in SCENARIOS if scenario.name == name)


def by_cause() -> list[Scenario]:
    """Return a scenario of each cause alone, each in another protocol than the one before."""
    kinds: dict[str, list[Scenario]] = defaultdict(list)
    for scenario in SCENARIOS:
        if len(scenario.truths) == 1:
            kinds[scenario.truths[0].cause].append(scenario)
    return [same[n % len(same)] for n, same in enumerate(kinds.values())]


def asked_of(it: Seen, truth: Truth, after_s: float = 0) -> list[tuple[float, float | None]]:
    first_s = truth.first_s + after_s
    return [
        (a.t_s, a.took_s)
        for a in it.asked
        if a.servo_id in truth.servo_ids and first_s <= a.t_s <= truth.last_s
    ]


def is_silent(it: Seen, truth: Truth, after_s: float) -> bool:
    """Tell whether servos are asked, and never answer, from then on."""
    asked = asked_of(it, truth, after_s)
    return len(asked) > 2 and not any(took for _, took in asked)


def is_away_once(it: Seen, truth: Truth) -> bool:
    """Tell whether a servo answers nothing for a while, and answers before and behind it."""
    told = [took is not None for _, took in asked_of(it, truth, -1e9)]
    whole = "".join("x" if is_there else "." for is_there in told)
    return re.search(r"x\.{2,}(x|$)", whole) is not None


def span(values: list[int]) -> int:
    return max(values) - min(values) if values else 0


def is_limp(it: Seen, truth: Truth) -> bool:
    """Tell whether goals move, and joints do not: once they have fallen."""
    first_s = truth.first_s + 3
    return all(
        span(it.of(who, "position", first_s)) < span(it.of(who, "goal_position", first_s)) / 2
        for who in truth.servo_ids
    )


def is_held(it: Seen, truth: Truth) -> bool:
    """Tell whether for two seconds goals move, and the joint does not."""
    (who,) = truth.servo_ids
    stretches = [truth.first_s + n / 4 for n in range(int((truth.last_s - truth.first_s) * 4))]
    return any(
        span(it.of(who, "position", t, t + 2)) <= 1
        and span(it.of(who, "goal_position", t, t + 2)) > 2
        for t in stretches
    )


def is_slow(it: Seen, truth: Truth) -> bool:
    took: dict[bool, list[float]] = {True: [], False: []}
    for a in it.asked:
        if a.took_s is not None and a.t_s > truth.first_s and a.took_s < 0.1:
            took[a.servo_id in truth.servo_ids].append(a.took_s)
    others = statistics.median(took[False]) if took[False] else 0.0008
    return statistics.median(took[True]) > others + 0.0008


def restarts(it: Seen, truth: Truth) -> bool:
    """Tell whether it was away three times at least, and back."""
    asked = asked_of(it, truth)
    runs = [key for key, _ in itertools.groupby(took is not None for _, took in asked)]
    return runs.count(False) >= 3


def sags(it: Seen, truth: Truth) -> bool:
    """Tell whether its voltage falls, or it is away for a while."""
    low = False
    for who in truth.servo_ids:
        volts = it.of(who, "voltage")
        low |= bool(volts) and min(volts) < 0.8 * statistics.median(volts)
    return low or any(took is None for _, took in asked_of(it, truth))


def hangs(it: Seen, truth: Truth) -> bool:
    starts = [a.t_s for a in it.asked if truth.first_s - 0.1 < a.t_s < truth.last_s + 0.1]
    pauses = [b - a for a, b in itertools.pairwise(starts)]
    return max(pauses) > 0.1 > statistics.median(pauses)


def trembles(it: Seen, truth: Truth) -> bool:
    """Tell whether what is said in every cycle comes at uneven times."""
    said: dict[tuple[int, str], list[float]] = defaultdict(list)
    for a in it.asked:
        if a.t_s > max(truth.first_s, 1):
            said[a.servo_id, a.op].append(a.t_s)
    often = max(said.values(), key=len)
    periods = [b - a for a, b in itertools.pairwise(often)]
    return statistics.stdev(periods) > 0.08 * statistics.mean(periods)


def is_full(it: Seen, truth: Truth) -> bool:
    first, last = it.heard[0], it.heard[-1]
    busy = sum(x.t_end_ns - x.t_start_ns for x in it.heard)
    del truth
    return busy > 0.9 * (last.t_end_ns - first.t_start_ns)


def insists(it: Seen, truth: Truth) -> bool:
    same = [
        len(list(run))
        for (_, lost), run in itertools.groupby(it.asked, lambda a: (a.raw, a.took_s is None))
        if lost
    ]
    del truth
    return max(same, default=0) >= 10


def is_beyond(it: Seen, truth: Truth) -> bool:
    """Tell whether goals go where they do not go before and behind."""
    (who,) = truth.servo_ids
    goals = [s for s in it.stated if s.servo_id == who and s.quantity == "goal_position"]
    inside = [s.raw for s in goals if not truth.first_s <= s.t_s <= truth.last_s + 0.2]
    struck = [s.raw for s in goals if truth.first_s <= s.t_s <= truth.last_s]
    return max(struck) > max(inside) or min(struck) < min(inside)


def jumps(it: Seen, truth: Truth, protocol: str) -> bool:
    (who,) = truth.servo_ids
    return any(
        abs(b - a) > TRAVEL[protocol] / 5
        for quantity in ("position", "goal_position")
        for a, b in itertools.pairwise(it.of(who, quantity, truth.first_s - 1, truth.last_s + 1))
    )


def writes(it: Seen, truth: Truth, places: tuple[int, ...]) -> bool:
    """Tell whether a servo is written to at one of these addresses."""
    at = {"store_data": 6, "write": 4}
    found = [a for a in it.asked if a.op in at and a.servo_id in truth.servo_ids]
    return sum(a.raw[at[a.op]] in places for a in found) > 3


def collides(it: Seen, truth: Truth) -> bool:
    """Tell whether the controller goes on before an answer has ended, or has begun."""
    torn = {"noise", "truncated-frame", "damaged-frame", "bad-checksum", "duplicate-response"}
    pairs = itertools.pairwise(sorted(it.asked))
    early = sum(a.took_s is not None and a.t_s + a.took_s > b.t_s for a, b in pairs)
    return early > 3 or any(code in torn for t, code, _ in it.codes if t >= truth.first_s)


SYMPTOMS: Final[Mapping[str, Callable[[Seen, Truth, str], bool]]] = {
    "brownout": lambda it, truth, name: sags(it, truth),
    "servo-reset-loop": lambda it, truth, name: restarts(it, truth),
    "servo-dead": lambda it, truth, name: is_silent(it, truth, 0.3),
    "servo-outage": lambda it, truth, name: is_away_once(it, truth),
    "servo-absent": lambda it, truth, name: is_silent(it, truth, 0),
    "slow-servo": lambda it, truth, name: is_slow(it, truth),
    "id-changed": lambda it, truth, name: is_silent(it, truth, 0.6),
    "baud-changed": lambda it, truth, name: is_silent(it, truth, 0.6),
    "torque-off": lambda it, truth, name: is_limp(it, truth),
    "stall": lambda it, truth, name: is_held(it, truth),
    "overheat": lambda it, truth, name: bool(
        it.told(truth.first_s, 1e9, *truth.servo_ids) & (HOT | {"device-safe-mode"})
    ),
    "overload": lambda it, truth, name: bool(
        it.told(truth.first_s, 1e9, *truth.servo_ids) & {"device-overload", "device-safe-mode"}
    ),
    "servo-refuses": lambda it, truth, name: bool(
        it.told(truth.first_s, 1e9, *truth.servo_ids) & REFUSED
    ),
    "chatty-device": lambda it, truth, name: len(it.codes) > 2,
    "impatient-controller": lambda it, truth, name: collides(it, truth),
    "controller-stall": lambda it, truth, name: hangs(it, truth),
    "controller-jitter": lambda it, truth, name: trembles(it, truth),
    "bus-saturated": lambda it, truth, name: is_full(it, truth),
    "goal-out-of-range": lambda it, truth, name: is_beyond(it, truth),
    "position-jump": jumps,
    "read-only-write": lambda it, truth, name: writes(it, truth, READ_ONLY),
    "partial-write": lambda it, truth, name: (
        writes(it, truth, GOALS) and any(not s.is_whole for s in it.stated)
    ),
    "malformed-command": lambda it, truth, name: len(it.codes) > 2,
    "nv-wear": lambda it, truth, name: sum(a.op in KEPT for a in it.asked) > 10,
    "retry-storm": lambda it, truth, name: insists(it, truth),
}
"""By cause, what must be seen of it."""


def test_every_cause_of_servos_and_controllers_is_shown_in_two_protocols_at_least() -> None:
    shown: dict[str, set[str]] = defaultdict(set)
    for scenario in SCENARIOS:
        for truth in scenario.truths:
            shown[truth.cause].add(scenario.protocol)
    assert set(shown) == set(SYMPTOMS)
    assert {cause for cause, protocols in shown.items() if len(protocols) < 2} == set()
    assert len({s.name for s in SCENARIOS}) == len(SCENARIOS) > 60


def test_each_draw_is_another_setting_and_the_same_draw_the_same() -> None:
    drawn = [{s.name: (s.truths, s.baud) for s in devices.scenarios(draw)} for draw in (0, 0, 1)]
    assert drawn[0] == drawn[1]
    differ = [name for name in drawn[0] if drawn[0][name] != drawn[2][name]]
    assert len(differ) == len(drawn[0])


@each_in_turn(6, "scenario", by_cause(), ids=lambda s: s.name)
def test_what_is_built_in_is_seen(scenario: Scenario) -> None:
    it = seen(scenario, 1)
    end_s = it.heard[-1].t_end_ns / 1e9
    assert 5 <= end_s <= 62
    assert it.heard[0].t_start_ns == 0
    for before, behind in itertools.pairwise(it.heard):
        assert before.t_end_ns <= behind.t_start_ns
        assert before.wire
    for truth in scenario.truths:
        assert 0 <= truth.first_s < truth.last_s <= end_s + 0.6
        assert SYMPTOMS[truth.cause](it, truth, scenario.protocol), truth


@each_in_turn(2, "name", ["impatient-controller-wck", "servo-absent-mightyzap"])
def test_one_seed_gives_the_same_bytes_and_another_one_others(name: str) -> None:
    scenario = named(name)
    assert list(scenario.make(3)) == list(scenario.make(3))
    assert scenario.make(3) != scenario.make(4)


def test_a_restart_is_seen_in_the_registers() -> None:
    scenario = named("mixed-limp-and-brownout-mightyzap")
    brownout = next(t for t in scenario.truths if t.cause == "brownout")
    it = seen(scenario, 2)
    (who,) = brownout.servo_ids
    assert span(it.of(who, "position", brownout.last_s - 2)) <= 1  # its force is off again
    assert "device-input-voltage" in it.told(brownout.first_s, brownout.last_s, who)


def test_bytes_of_two_who_speak_at_once_are_damaged_and_some_lack_their_stop_bit() -> None:
    heard = named("impatient-controller-rs30x").make(5)
    assert sum(len(x.line_errors) for x in heard) > 0
