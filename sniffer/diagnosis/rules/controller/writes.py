"""What the controller writes that it should not: limits, access, parts, memory that wears out."""

from __future__ import annotations

from typing import TYPE_CHECKING, Final

import numpy as np

from sniffer.diagnosis.catalogue import FindingCode
from sniffer.diagnosis.evidence.chances import OFTEN, may_be_torn
from sniffer.diagnosis.evidence.misaddressed import misaddressed
from sniffer.diagnosis.evidence.placed import single
from sniffer.diagnosis.model import Finding, Place
from sniffer.ground.codes import COMMANDED
from sniffer.ground.model import NS, UNUSUAL
from sniffer.ground.register import unseen_scale
from sniffer.ground.wording import counted

if TYPE_CHECKING:
    from collections.abc import Iterator

    from sniffer.diagnosis.case import Case, Series
    from sniffer.diagnosis.rules import Rule
    from sniffer.ground.model import I64
    from sniffer.ground.register import Register

FINDINGS: Final = (
    FindingCode(
        "goal-beyond-range",
        "A goal is outside the range that the manual of the model gives.",
        "The raw numbers that requests state, against the register's range.",
    ),
    FindingCode(
        "goal-beyond-limits",
        "A goal is outside the limits that are set in the servo.",
        "Goals against the servo's limit registers, which were read or written in this capture.",
    ),
    FindingCode(
        "writes-read-only",
        "A register is written that can only be read.",
        "Requests that state a register which the table of the model has as read only.",
    ),
    FindingCode(
        "writes-unnamed",
        "An address is written that the table of the model does not name.",
        "Writes whose bytes no register owns, and which the servo did not take: it refused them or "
        "said nothing.",
    ),
    FindingCode(
        "writes-part",
        "A write covers part of a register only: the servo is left with half a number.",
        "Writes that begin or end inside a register of several bytes.",
    ),
    FindingCode(
        "memory-written-often",
        "Memory that wears out is written over and over.",
        "At least eight writes of one setting that is kept without power (or commands to keep "
        "settings), or five at an even pace, or four of one value by the clock, at a pace that reaches "
        "the rated cycles within the servo's life.",
    ),
)

LOOP: Final = 8
"""Writes of one setting that no set-up needs: a person who tunes a gain tries a few."""

LOOP_EVEN: Final = 5
EVEN: Final = 1.3
"""The same where they come at an even pace, none so many times as long as another: nobody tunes so."""

LOOP_CLOCKED: Final = 4
CLOCKED: Final = 1.05
"""The same of one value, which nobody who tunes writes twice, at a pace that no hand keeps."""

RATED: Final = 100_000
"""Cycles of the memory. An assumption: no manual of these servos states it; data sheets of
microcontrollers give 100 000 for EEPROM (ATmega328P, 8.1) and 10 000 for flash."""

LIFE_H: Final = 2000
"""Hours of use within which the memory is worn out at the pace seen: a year of working days."""


def _told(register: Register, raw: int) -> str:
    value = raw * register.scale
    return (
        f"{value:.4g} {register.unit}" if register.unit and register.scale_by is None else str(raw)
    )


def _beyond_range(case: Case) -> Iterator[tuple[int, Register, int]]:
    """Find rows of ``writes`` that exceed their registers' range: each with its worst number."""
    w = case.writes
    for i, number in enumerate(w["register"].tolist()):
        register = case.protocol.registers[number]
        if register.range is not None:
            low, high = int(w["low"][i]), int(w["high"][i])
            if high > register.range[1]:
                yield i, register, high
            elif low < register.range[0]:
                yield i, register, low


def goal_range(case: Case) -> Iterator[Finding]:
    """Goals outside what the manual allows."""
    w = case.writes
    beyond = [] if misaddressed(case) else list(_beyond_range(case))  # what is misread is no goal
    for i, register, worst in beyond:
        if register.role != COMMANDED or register.quantity != "goal_position":
            continue
        assert register.range is not None
        servo = int(w["servo_id"][i])
        events = case.anomalies("value-out-of-range", servo_id=servo)
        count = case.count("value-out-of-range", servo_id=servo)
        if may_be_torn(case, count):
            continue
        # an anomaly does not say of which register it is
        is_alone = all(r is register or w["servo_id"][k] != servo for k, r, _ in beyond)
        count = max(count, 1) if is_alone else 1
        goals = f"{counted(count, 'goal') if is_alone else 'goals'} of servo {servo}"
        are = "is" if is_alone and count == 1 else "are"
        yield Finding(
            "goal-beyond-range",
            single(case, servo),
            int(events.t_ns[0]) if len(events) else int(w["t_first"][i]),
            int(events.t_ns[-1]) if len(events) else int(w["t_last"][i]),
            count,
            f"{goals} {are} out of range: {_told(register, worst)}, and "
            f"the manual of {register.model} has {_told(register, register.range[0])} to "
            f"{_told(register, register.range[1])}",
            case.places(events, "a goal out of range"),
            brief=f"servo {servo} is sent to {_told(register, worst)}",
        )


def goal_limits(case: Case) -> Iterator[Finding]:
    """Goals outside the limits that are set in a servo."""
    for servo in case.measured_by("goal_position"):
        goals = case.series(servo, "goal_position")
        limits = _limits(case, servo, goals.register) if goals is not None else None
        if goals is None or limits is None:
            continue
        low, high, since_ns = limits
        spare = abs(unseen_scale(goals.register)) * 1.01
        beyond = (goals.low < low - spare) | (goals.high > high + spare)
        rows = np.flatnonzero(beyond & (goals.t_first >= since_ns))
        if not len(rows) or may_be_torn(case, len(rows)):
            continue
        over, under = float(goals.high[rows].max()), float(goals.low[rows].min())
        worst = over if over > high + spare else under
        yield Finding(
            "goal-beyond-limits",
            servo,
            int(goals.t_first[rows[0]]),
            int(goals.t[rows[-1]]),
            _surely_beyond(goals, rows, low - spare, high + spare),
            f"servo {servo} is sent to {goals.told(worst)}, and its limits are {goals.told(low)} and "
            f"{goals.told(high)}",
            tuple(
                Place(int(goals.at[r]), 1, int(goals.t_first[r]), "a goal beyond the limits")
                for r in rows[:3]
            ),
            brief=f"servo {servo} is sent to {goals.told(worst)}, beyond its limit",
        )


def _surely_beyond(goals: Series, rows: I64, low: float, high: float) -> int:
    """Return how many goals are beyond limits at least: of a bucket all, or one at each end."""
    over, under = goals.high[rows] > high, goals.low[rows] < low
    whole = (goals.low[rows] > high) | (goals.high[rows] < low)
    ends = over.astype(np.int64) + under
    return int(np.where(whole, goals.n[rows], ends).sum())


def _limits(case: Case, servo: int, goal: Register) -> tuple[float, float, int] | None:
    """Return the widest limits that the servo had, in the goal's unit; None: they are not known.

    And since when they are known: what was read was so before, what was written only since then.
    Of two the one that was never said is as shipped.
    """
    registers = case.protocol.registers
    named = {r.name: r for r in registers if r.bounds == goal.quantity and r.model == goal.model}
    told = {name: case.settings(name, servo_id=servo) for name in sorted(named)}
    found = [rows for rows in told.values() if len(rows)]
    unsaid = [named[name] for name, rows in told.items() if not len(rows)]
    shipped = [r.default * r.scale for r in unsaid if r.default is not None]
    if not found or len(shipped) < len(unsaid):
        return None
    if unsaid and may_be_torn(case, sum(map(len, found))):
        return None  # who sets limits sets both, or reads them
    written = {at for rows in found for at in rows.at[rows.written == 1].tolist()}
    if written and may_be_torn(case, len(written)):
        return None  # an answer is to the question; a write may be any frame, torn and held
    said = [
        raw * registers[number].scale
        for rows in found
        for number, raw in zip(rows.what.tolist(), rows.after.tolist(), strict=True)
        if registers[number].model == goal.model
    ]
    values = said + shipped
    if not said or min(values) == max(values):
        return None
    firsts = [(int(rows.t_ns[0]), bool(rows.written[0])) for rows in found]
    since_ns = max((t_ns for t_ns, is_written in firsts if is_written), default=0)
    return min(values), max(values), since_ns


def writes(case: Case) -> Iterator[Finding]:
    """Writes to what is read only, and of parts of registers."""
    w = case.writes
    for i in range(len(w["register"])):
        register, servo = case.protocol.registers[int(w["register"][i])], int(w["servo_id"][i])
        n, parts, refused = int(w["n"][i]), int(w["parts"][i]), int(w["refused"][i])
        span = int(w["t_first"][i]), int(w["t_last"][i])
        place = Place(int(w["at"][i]), int(w["length"][i]), span[0], f"writes {register.name}")
        who = single(case, servo)
        if may_be_torn(case, n):
            continue
        sure = 1.0 if refused or n >= OFTEN else 0.7
        said = f", and it refused {refused} of them" if refused else ""
        if "w" not in register.access:
            yield Finding(
                "writes-read-only",
                who,
                *span,
                n,
                f"{counted(n, 'write')} to {register.name} of servo {servo}, which can only be read "
                f"({register.model}){said}",
                (place,),
                strength=sure,
                brief=f"{register.name} of servo {servo} is written",
            )
        elif parts:
            span = int(w["part_first"][i]), int(w["part_last"][i])
            place = Place(int(w["part_at"][i]), 1, span[0], f"writes half of {register.name}")
            yield Finding(
                "writes-part",
                who,
                *span,
                parts,
                f"{counted(parts, 'write')} to servo {servo} with part of {register.name}, which has "
                f"{register.width} bytes ({register.model}){said}",
                (place,),
                strength=sure,
                brief=f"half of {register.name} of servo {servo} is written",
            )


def unnamed_writes(case: Case) -> Iterator[Finding]:
    """Writes of addresses that nobody knows, and that the servo did not take."""
    u = case.ledger.unnamed.table()
    for i in range(len(u["n"])):
        n, refused, servo = int(u["n"][i]), int(u["refused"][i]), int(u["servo_id"][i])
        if u["acknowledged"][i] or may_be_torn(case, n):
            continue  # another model, most likely: its servo knows the address
        yield Finding(
            "writes-unnamed",
            single(case, servo),
            int(u["t_first"][i]),
            int(u["t_last"][i]),
            n,
            f"{counted(n, 'write')} to address 0x{int(u['address'][i]):02X} of servo {servo}, which its table "
            f"does not name" + (f"; it refused {refused}" if refused else ""),
            (
                Place(
                    int(u["at"][i]), int(u["length"][i]), int(u["t_first"][i]), "an unknown address"
                ),
            ),
            strength=1.0 if refused else 0.5,
            brief=f"address 0x{int(u['address'][i]):02X} of servo {servo} is written",
        )


def memory_wear(case: Case) -> Iterator[Finding]:
    """Settings that are kept without power, written in a loop."""
    loops = {
        servo: one
        for servo, one in sorted(_kept(case).items())
        if one[1] >= LOOP or _in_a_loop(case, one[1], one[3].offset, one[4])
    }
    if case.answering and all(i in case.servos and i not in case.answering for i in loops):
        return  # who is not there keeps nothing
    for servo, (what, n, span, place, _) in loops.items():
        seconds = (span[1] - span[0]) / NS
        hours = RATED / (n - 1) * seconds / 3600
        if case.has_clock and hours > LIFE_H:
            continue
        pace = f", which last {hours:.3g} hours at this pace" if case.has_clock else ""
        yield Finding(
            "memory-written-often",
            single(case, servo),
            *span,
            n,
            f"{n} times {what} of servo {servo}, which keeps it without power: {n / RATED:.2%} of the "
            f"{RATED} cycles that such memory is usually rated for{pace}",
            (place,),
            strength=min(0.5 + n / (4 * LOOP), 1.0),
            brief=f"{what} of servo {servo} written to memory {n} times",
            values=(("writes", n), ("rated", RATED)),
        )


def _in_a_loop(case: Case, n: int, at: int, is_one: bool) -> bool:
    """Tell whether the few requests of the kind whose first one stands at a place are of a loop."""
    least, pace = (LOOP_CLOCKED, CLOCKED) if is_one and n < LOOP_EVEN else (LOOP_EVEN, EVEN)
    kinds = case.ledger.exchanges.kinds
    if n < least or not case.has_clock or at not in kinds.at:
        return False
    t, kind = case.ledger.exchanges.moments.stretches()[0]
    between = np.diff(t[kind == kinds.at.index(at)])
    return len(between) >= least - 1 and bool(between.max() <= pace * between.min())


_Kept = tuple[str, int, tuple[int, int], Place, bool]


def _kept(case: Case) -> dict[int, _Kept]:
    """Return for each servo what was written oftenest to memory.

    What, how often, when, where, and whether it was one value each time.
    """
    out: dict[int, _Kept] = {}
    kinds, w = case.ledger.exchanges.kinds, case.writes
    keeps = getattr(case.protocol, "keeps", "")
    if keeps:  # only then are settings written to memory
        for k, op in enumerate(kinds.op):
            if case.protocol.op_name(op) == keeps and not kinds.odd[k] & ~UNUSUAL:
                span = kinds.t_first[k], int(kinds.t_last[k])
                place = Place(kinds.at[k], len(kinds.example[k]), span[0], keeps)
                out[kinds.servo_id[k]] = keeps, int(kinds.n[k]), span, place, False
        return out
    for i in range(len(w["register"])):
        register, servo = case.protocol.registers[int(w["register"][i])], int(w["servo_id"][i])
        n = int(w["n"][i]) - int(w["refused"][i])
        is_one = bool(w["low"][i] == w["high"][i])
        # who is given another id is another servo
        is_moved = register.effect == "servo_id" and not (is_one and w["low"][i] == servo)
        if (
            register.volatile
            or is_moved
            or "w" not in register.access
            or n <= (out[servo][1] if servo in out else 0)
        ):
            continue
        span = int(w["t_first"][i]), int(w["t_last"][i])
        place = Place(int(w["at"][i]), int(w["length"][i]), span[0], f"writes {register.name}")
        out[servo] = register.name, n, span, place, is_one
    return out


RULES: Final[tuple[Rule, ...]] = (
    goal_range,
    goal_limits,
    writes,
    unnamed_writes,
    memory_wear,
)
"""The rules of this area."""
