"""What controllers ask for and should not: goals, registers, forms, memories worn out."""

from __future__ import annotations

from typing import TYPE_CHECKING, Any, Final

from bench.diagnosis.played.cases import EVERY, Cases
from bench.diagnosis.played.draft import ALL, SELDOM, TURN
from sniffer.protocols.lss.grammar import command
from sniffer.protocols.mightyzap.grammar import BROADCAST, LOAD, SYMMETRIC_STORE
from sniffer.protocols.rs30x.grammar import LONG
from sniffer.simulation.memory import pack
from sniffer.simulation.mightyzap_servo import packet
from sniffer.simulation.rs30x import flag_byte, request

if TYPE_CHECKING:
    from collections.abc import Callable, Iterator

    from bench.diagnosis.played.draft import Draft, Play
    from bench.diagnosis.played.tongue import Say

CASES: Final = Cases()

Spans = list[tuple[float, float]]


def _bend(draft: Draft, who: int, bend: Callable[[float, int], int | None]) -> None:
    def start(play: Play) -> None:
        play.robot.nature.bends[who] = bend

    draft.start(start)


RAMP_S: Final = 0.8
"""How long goals take to where they should not be, and back: they do not jump."""


def _leaned(spans: Spans, now_s: float, raw: int, goal: int) -> int:
    """Return a goal that goes to another one during some time."""
    ways = (min(now_s - first_s, last_s - now_s) / RAMP_S for first_s, last_s in spans)
    share = min(max(0.0, *ways), 1.0)
    return round(raw + (goal - raw) * share)


BEYOND: Final = {"mightyzap": (3700, 4000), "rs30x": (1080, 1190), "wck": (215, 250)}
"""Goals outside the limits that are set below."""

FAR_BEYOND: Final = {"mightyzap": (4100, 4400), "rs30x": (1520, 1900)}
"""Goals outside what the manual allows."""


@CASES("mightyzap", "rs30x", "wck", polls=(ALL, TURN))
def goal_out_of_range(draft: Draft) -> None:
    """Goals beyond limits that were read from the servo, or beyond the range of the manual."""
    who = draft.pick()
    spans = draft.episodes(2.4, 5)
    beyond = BEYOND
    if draft.protocol in FAR_BEYOND and draft.rng.random() < 0.3:
        beyond = FAR_BEYOND
    goal = draft.rng.randint(*beyond[draft.protocol])

    def limits(play: Play) -> None:
        for servo in play.stage.bus.servos.values():
            raw = servo.memory.raw  # type: ignore[attr-defined]
            if draft.protocol == "mightyzap":
                raw["short_stroke_limit"], raw["long_stroke_limit"] = 50, 3600
            elif draft.protocol == "rs30x":
                raw["ccw_angle_limit"], raw["cw_angle_limit"] = -1000, 1000
                servo.burn()  # type: ignore[attr-defined]
            elif draft.protocol == "wck":
                raw["lower_boundary"], raw["upper_boundary"] = 4, 205
        play.tongue.reads_limits = True

    draft.start(limits)
    least, most = INSIDE[draft.protocol]
    for other in draft.ids:
        _bend(draft, other, lambda now_s, raw: min(max(raw, least), most))
    _bend(draft, who, lambda now_s, raw: _leaned(spans, now_s, min(max(raw, least), most), goal))
    draft.truth("goal-out-of-range", who, spans[0][0], spans[-1][1])


INSIDE: Final = {"mightyzap": (60, 3500), "rs30x": (-950, 950), "wck": (6, 200)}
"""Goals of the sound servos, and of the sound part of the run, lie between."""


@CASES("lss", polls=(ALL, TURN))
def goal_out_of_range_pulses(draft: Draft) -> None:
    """Pulses beyond what the protocol page allows."""
    who = draft.pick()
    spans = draft.episodes(2.4, 5)
    pulse = draft.rng.choice((draft.rng.randint(2550, 3000), draft.rng.randint(200, 450)))

    def by_pulse(play: Play) -> None:
        play.tongue.by_pulse = True

    draft.start(by_pulse)
    _bend(draft, who, lambda now_s, raw: _leaned(spans, now_s, raw, pulse))
    draft.truth("goal-out-of-range", who, spans[0][0], spans[-1][1])


TRAVEL: Final = {
    "mightyzap": (0, 4095),
    "rs30x": (-1200, 1200),
    "lss": (-900, 900),
    "wck": (0, 254),
}
"""Numbers of both ends of the travel that goals use."""


def goal_jumps(draft: Draft) -> None:
    """Let single goals lie at the other end of the travel."""
    rng, who = draft.rng, draft.pick()
    low, high = TRAVEL[draft.protocol]
    times = sorted(rng.uniform(2.5, draft.seconds - 1) for _ in range(rng.randint(2, 5)))
    goals = rng.randint(1, 3)

    def start(play: Play) -> None:
        due = [t for t in times for _ in range(goals)]

        def jump(now_s: float, raw: int) -> int:
            if not due or now_s < due[0]:
                return raw
            due.pop(0)
            share = (raw - low) / (high - low)
            return round(low + (high - low) * (0.97 if share < 0.5 else 0.03))

        play.robot.nature.bends[who] = jump

    draft.start(start)
    draft.truth("position-jump", who, times[0], times[-1] + 0.5)


@CASES(*EVERY, polls=(ALL,), servos=(1, 4))
def position_jump_of_goals(draft: Draft) -> None:
    """Goals jump by half of the travel and back."""
    goal_jumps(draft)


def _often(
    draft: Draft,
    say: Callable[[Play, int], Iterator[Say] | list[Say]],
    first_s: float,
    last_s: float,
) -> None:
    """Let the controller say something every so many cycles."""
    every = draft.rng.choice((1, 1, 4, 10))

    def start(play: Play) -> None:
        def extra(cycle: int) -> None:
            if cycle % every == 0 and first_s <= play.stage.now_s < last_s:
                play.tell(say(play, cycle))

        play.robot.nature.extras.append(extra)

    draft.start(start)


READ_ONLY: Final = {
    "mightyzap": ((0x8C, 2), (0x92, 1), (0x00, 2)),
    "rs30x": ((0x2A, 2), (0x34, 2), (0x02, 1)),
}
"""Address and length of registers that are measured, or made: position, voltage, model."""

NOT_THERE: Final = {"mightyzap": (0x6A, 2), "rs30x": (0x38, 2)}
"""Between two areas of the map, where its manual has nothing."""


@CASES("mightyzap", "rs30x", polls=(ALL, TURN, SELDOM))
def read_only_write(draft: Draft) -> None:
    """Writes to what can only be read, or to what is not there."""
    rng, who, first_s = draft.rng, draft.pick(), draft.onset()
    spots = (*READ_ONLY[draft.protocol], NOT_THERE[draft.protocol])
    address, length = rng.choice(spots)
    data = bytes(rng.randrange(1, 200) for _ in range(length))
    _often(draft, lambda play, cycle: [_write(play, who, address, data)], first_s, draft.seconds)
    draft.truth("read-only-write", who, first_s, draft.seconds)


def _write(play: Play, who: int, address: int, data: bytes) -> Say:
    tongue: Any = play.tongue
    told: Say = (tongue.store if play.stage.bus.name == "mightyzap" else tongue.write)(
        who, address, data
    )
    return told


GOAL: Final = {"mightyzap": (0x86, "u16le"), "rs30x": (0x1E, "i16le")}


@CASES("mightyzap", "rs30x", polls=(ALL, TURN, SELDOM))
def partial_write(draft: Draft) -> None:
    """One of its goals goes out byte by byte, or only the low half of it."""
    rng, who = draft.rng, draft.pick()
    first_s = rng.choice((0.0, draft.onset()))
    address, kind = GOAL[draft.protocol]
    halves = rng.choice(((0,), (1,), (0, 1)))

    def say(play: Play, cycle: int) -> list[Say]:
        del cycle
        goal = play.tongue.raw(who, play.stage.bus.goals[who](play.stage.now_s))
        data = pack(kind, goal)
        return [_write(play, who, address + n, data[n : n + 1]) for n in halves]

    _bend(draft, who, lambda now_s, raw: raw if now_s < first_s else None)
    _often(draft, say, first_s, draft.seconds)
    draft.truth("partial-write", who, first_s, draft.seconds)


def _malformed(draft: Draft) -> tuple[Callable[[int], bytes], bool]:
    """Return what builds a wrong form, by servo; and whether it is for all."""
    ids = draft.ids
    if draft.protocol == "mightyzap":
        # the last servo's data is a byte short; a read without a length; a ping with a parameter
        torn = b"".join(bytes([i]) + b"\x00\x08" for i in ids)[:-1]
        return draft.rng.choice(
            (
                (lambda who: packet(BROADCAST, SYMMETRIC_STORE, bytes([0x86, 2]) + torn), True),
                (lambda who: packet(who, LOAD, b"\x8c"), False),
            )
        )
    if draft.protocol == "rs30x":
        # blocks of an id and no data
        return (lambda who: request(LONG, flag_byte(), 0x1E, 1, len(ids), bytes(ids)), True)
    return draft.rng.choice(
        (
            (lambda who: command(who, "D"), False),
            (lambda who: b"#%dD12T\r" % who, False),
            (lambda who: b"#%dD1 5\r" % who, False),
        )
    )


@CASES("mightyzap", "rs30x", "lss", polls=(ALL, TURN))
def malformed_command(draft: Draft) -> None:
    """A client that builds one of its commands wrongly."""
    who, first_s = draft.pick(), draft.onset()
    form, is_for_all = _malformed(draft)
    raw = form(who)
    every = draft.rng.choice((2, 5, 11))

    def start(play: Play) -> None:
        def extra(cycle: int) -> None:
            if cycle % every == 0 and play.stage.now_s >= first_s:
                play.stage.post(raw, understood=False)
                play.stage.wait(play.stage.now_ns + 2_000_000)

        play.robot.nature.extras.append(extra)

    draft.start(start)
    draft.truth("malformed-command", () if is_for_all else who, first_s, draft.seconds)


def wears(draft: Draft) -> None:
    """Let a controller write memories that wear, in its loop."""
    rng = draft.rng
    whom = list(draft.ids) if rng.random() < 0.4 else [draft.pick()]
    first_s = rng.choice((0.0, draft.onset()))

    def say(play: Play, cycle: int) -> list[Say]:
        return [play.tongue.keep(who, cycle) for who in whom]

    _often(draft, say, first_s, draft.seconds)
    draft.truth("nv-wear", whom, first_s, draft.seconds)


@CASES(*EVERY, polls=(ALL, TURN, SELDOM))
def nv_wear(draft: Draft) -> None:
    """Settings that are kept without power are written in every cycle, or every few."""
    wears(draft)
