"""What the controller writes that it should not: limits, access, parts, memory that wears out."""

from __future__ import annotations

import re
from typing import TYPE_CHECKING, Final

import numpy as np

from sniffer.diagnosis.catalogue import FindingCode
from sniffer.diagnosis.model import Finding, Place
from sniffer.ground.codes import COMMANDED
from sniffer.ground.model import MALFORMED, NS, UNKNOWN, UNUSUAL

if TYPE_CHECKING:
    from collections.abc import Iterator

    from sniffer.diagnosis.case import Case
    from sniffer.diagnosis.rules import Rule
    from sniffer.ground.register import Register

FINDINGS: Final = (
    FindingCode(
        "goal-beyond-range",
        "controller",
        "A goal is outside the range that the manual of the model gives.",
        "The raw numbers that requests state, against the register's range.",
    ),
    FindingCode(
        "goal-beyond-limits",
        "controller",
        "A goal is outside the limits that are set in the servo.",
        "Goals against the servo's limit registers, which were read or written in this capture.",
    ),
    FindingCode(
        "writes-read-only",
        "controller",
        "A register is written that can only be read.",
        "Requests that state a register which the table of the model has as read only.",
    ),
    FindingCode(
        "writes-unnamed",
        "controller",
        "An address is written that the table of the model does not name.",
        "Writes whose bytes no register owns, and which the servo did not take: it refused them or "
        "said nothing.",
    ),
    FindingCode(
        "writes-part",
        "controller",
        "A write covers part of a register only: the servo is left with half a number.",
        "Writes that begin or end inside a register of several bytes.",
    ),
    FindingCode(
        "memory-written-often",
        "controller",
        "Memory that wears out is written over and over.",
        "At least eight writes of one setting that is kept without power (or commands to keep "
        "settings), at a pace that reaches the rated cycles within the servo's life.",
    ),
    FindingCode(
        "gain-read-sets-id",
        "controller",
        "wCK servos are given the id 0 by a command that client libraries take for a gain read.",
        "`id_set` (0C) to the id 0, sent to a servo of another id: the appendix of the manual has "
        "the codes of gain read (0A) and id set exchanged.",
    ),
    FindingCode(
        "modifier-misused",
        "controller",
        "A modifier stands behind a command that has none, or behind another than its own.",
        "LSS lines that hold, with modifiers the page does not allow with that command.",
    ),
    FindingCode(
        "odd-commands",
        "controller",
        "Requests that hold and are not as the manual has them, time and again from the same code.",
        "Kinds of requests with a body they cannot have, or that stand in no manual, and how often "
        "each was sent.",
    ),
)

LIMITS: Final = (
    ("short_stroke_limit", "long_stroke_limit"),
    ("ccw_angle_limit", "cw_angle_limit"),
    ("lower_boundary", "upper_boundary"),
)
"""Registers that bound a goal, by their names in the tables (mightyZAP, RS30x, wCK). LSS has none
for angles: its angular range is for pulses and RC mode."""

ID_SET: Final = "id_set"
"""The command whose code the appendix of the wCK manual (1.07, A-4) gives for reading gains."""

LOOP: Final = 8
"""Writes of one setting that no set-up needs: a person who tunes a gain tries a few."""

RATED: Final = 100_000
"""Cycles of the memory. An assumption: no manual of these servos states it; data sheets of
microcontrollers give 100 000 for EEPROM (ATmega328P, 8.1) and 10 000 for flash."""

LIFE_H: Final = 2000
"""Hours of use within which the memory is worn out at the pace seen: a year of working days."""

OFTEN: Final = 3
"""A frame that holds by chance does not come again; a mistake in a program does."""


def _told(register: Register, raw: int) -> str:
    value = raw * register.scale
    return (
        f"{value:.4g} {register.unit}" if register.unit and register.scale_by is None else str(raw)
    )


def goal_range(case: Case) -> Iterator[Finding]:
    """Goals outside what the manual allows."""
    w = case.writes
    for i in range(len(w["register"])):
        register, servo = case.protocol.registers[int(w["register"][i])], int(w["servo_id"][i])
        if register.role != COMMANDED or register.quantity != "goal_position":
            continue
        if register.range is None:
            continue
        low, high = int(w["low"][i]), int(w["high"][i])
        if register.range[0] <= low and high <= register.range[1]:
            continue
        worst = high if high > register.range[1] else low
        events = case.anomalies("value-out-of-range", servo_id=servo)
        count = case.count("value-out-of-range", servo_id=servo)
        yield Finding(
            "goal-beyond-range",
            _single(case, servo),
            int(events.t_ns[0]) if len(events) else int(w["t_first"][i]),
            int(events.t_ns[-1]) if len(events) else int(w["t_last"][i]),
            max(count, 1),
            f"{max(count, 1)} goals of servo {servo} are out of range: {_told(register, worst)}, and "
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
        low, high = limits
        spare = abs(goals.register.scale) * 1.01
        rows = np.flatnonzero((goals.low < low - spare) | (goals.high > high + spare))
        if not len(rows):
            continue
        over, under = float(goals.high[rows].max()), float(goals.low[rows].min())
        worst = over if over > high + spare else under
        yield Finding(
            "goal-beyond-limits",
            servo,
            int(goals.t_first[rows[0]]),
            int(goals.t[rows[-1]]),
            int(goals.n[rows].sum()),
            f"servo {servo} is sent to {goals.told(worst)}, and its limits are {goals.told(low)} and "
            f"{goals.told(high)}",
            tuple(
                Place(int(goals.at[r]), 1, int(goals.t_first[r]), "a goal beyond the limits")
                for r in rows[:3]
            ),
            brief=f"servo {servo} is sent to {goals.told(worst)}, beyond its limit",
        )


def _limits(case: Case, servo: int, goal: Register) -> tuple[float, float] | None:
    """Return the widest limits that the servo had, in the goal's unit; None: not both are known."""
    for names in LIMITS:
        found = [case.settings(name, servo_id=servo) for name in names]
        if not all(len(rows) for rows in found):
            continue
        values = []
        for rows in found:
            for number, raw in zip(rows.what.tolist(), rows.after.tolist(), strict=True):
                register = case.protocol.registers[number]
                if register.unit == goal.unit and register.model == goal.model:
                    values.append(raw * register.scale)
        if len(values) >= 2 and min(values) < max(values):
            return min(values), max(values)
    return None


def writes(case: Case) -> Iterator[Finding]:
    """Writes to what is read only, and of parts of registers."""
    w = case.writes
    for i in range(len(w["register"])):
        register, servo = case.protocol.registers[int(w["register"][i])], int(w["servo_id"][i])
        n, parts, refused = int(w["n"][i]), int(w["parts"][i]), int(w["refused"][i])
        span = int(w["t_first"][i]), int(w["t_last"][i])
        place = Place(int(w["at"][i]), int(w["length"][i]), span[0], f"writes {register.name}")
        who = _single(case, servo)
        sure = 1.0 if refused or n >= OFTEN else 0.7
        said = f", and it refused {refused} of them" if refused else ""
        if "w" not in register.access:
            yield Finding(
                "writes-read-only",
                who,
                *span,
                n,
                f"{n} writes to {register.name} of servo {servo}, which can only be read "
                f"({register.model}){said}",
                (place,),
                strength=sure,
                brief=f"{register.name} of servo {servo} is written",
            )
        elif parts:
            yield Finding(
                "writes-part",
                who,
                *span,
                parts,
                f"{parts} writes to servo {servo} state part of {register.name}, which has "
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
        if u["acknowledged"][i]:
            continue  # another model, most likely: its servo knows the address
        yield Finding(
            "writes-unnamed",
            _single(case, servo),
            int(u["t_first"][i]),
            int(u["t_last"][i]),
            n,
            f"{n} writes to address 0x{int(u['address'][i]):02X} of servo {servo}, which its table "
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
    for servo, (what, n, span, place) in sorted(_kept(case).items()):
        if n < LOOP:
            continue
        seconds = (span[1] - span[0]) / NS
        hours = RATED / (n - 1) * seconds / 3600
        if case.has_clock and hours > LIFE_H:
            continue
        pace = f", which last {hours:.3g} hours at this pace" if case.has_clock else ""
        yield Finding(
            "memory-written-often",
            _single(case, servo),
            *span,
            n,
            f"{n} times {what} of servo {servo}, which keeps it without power: {n / RATED:.2%} of the "
            f"{RATED} cycles that such memory is usually rated for{pace}",
            (place,),
            strength=min(0.5 + n / (4 * LOOP), 1.0),
            brief=f"{what} of servo {servo} written to memory {n} times",
            values=(("writes", n), ("rated", RATED)),
        )


_Kept = tuple[str, int, tuple[int, int], Place]


def _kept(case: Case) -> dict[int, _Kept]:
    """Return for each servo what was written oftenest to memory: what, how often, when, where."""
    out: dict[int, _Kept] = {}
    kinds, w = case.ledger.exchanges.kinds, case.writes
    keeps = getattr(case.protocol, "keeps", "")
    if keeps:  # only then are settings written to memory
        for k, op in enumerate(kinds.op):
            if case.protocol.op_name(op) == keeps and not kinds.odd[k] & ~UNUSUAL:
                span = kinds.t_first[k], int(kinds.t_last[k])
                place = Place(kinds.at[k], len(kinds.example[k]), span[0], keeps)
                out[kinds.servo_id[k]] = keeps, int(kinds.n[k]), span, place
        return out
    for i in range(len(w["register"])):
        register, servo = case.protocol.registers[int(w["register"][i])], int(w["servo_id"][i])
        n = int(w["n"][i]) - int(w["refused"][i])
        if register.volatile or "w" not in register.access or n <= out.get(servo, ("", 0))[1]:
            continue
        span = int(w["t_first"][i]), int(w["t_last"][i])
        place = Place(int(w["at"][i]), int(w["length"][i]), span[0], f"writes {register.name}")
        out[servo] = register.name, n, span, place
    return out


def gain_read(case: Case) -> Iterator[Finding]:
    """Ids that a client sets to 0 because it thinks that it reads gains."""
    if ID_SET not in map(case.protocol.op_name, case.ledger.exchanges.kinds.op):
        return
    rows = case.settings("servo_id")
    given = rows.take((rows.written == 1) & (rows.after == 0) & (rows.servo_id > 0))
    for servo in np.unique(given.servo_id).tolist():
        mine = given.take(given.servo_id == servo)
        yield Finding(
            "gain-read-sets-id",
            servo,
            int(mine.t_ns[0]),
            int(mine.t_ns[-1]),
            len(mine),
            f"servo {servo} is told the id 0 by id_set (0C): clients send this where they mean a gain "
            "read (0A)",
            case.places(mine, "id_set to 0"),
            brief=f"servo {servo} is given the id 0",
        )


_WORDS: Final = re.compile(r"([A-Z]+)(-?\d*)")


def _misused(case: Case, line: bytes) -> str:
    """Return the first modifier of a line that its command does not have; empty: there is none."""
    known: dict[str, set[str]] = {}
    for r in case.protocol.registers:
        if r.kind == "modifier":
            known.setdefault(r.word, set()).update(r.modifies)
    action, *modifiers = (word for word, _ in _WORDS.findall(line.decode("latin-1").upper()))
    # of some the page says nothing: they may stand anywhere
    wrong = (m for m in modifiers if m not in known or (known[m] and action not in known[m]))
    return next(wrong, "")


def odd_commands(case: Case) -> Iterator[Finding]:
    """Requests that are not as the manual has them, and modifiers where they mean nothing."""
    kinds = case.ledger.exchanges.kinds
    torn = case.count("bad-checksum", "damaged-frame", "truncated-frame", "noise", "idle-tail")
    has_modifiers = any(r.kind == "modifier" for r in case.protocol.registers)
    for k, odd in enumerate(kinds.odd):
        n, servo = int(kinds.n[k]), kinds.servo_id[k]
        name = case.protocol.op_name(kinds.op[k])
        shown = kinds.example[k][:24].hex(" ").upper()
        span = kinds.t_first[k], int(kinds.t_last[k])
        wrong = _misused(case, kinds.example[k]) if has_modifiers and odd & UNUSUAL else ""
        if wrong:
            text = kinds.example[k].decode("latin-1").strip()
            code, what = "modifier-misused", f"{n} x {text}: {name} has no modifier {wrong}"
        elif odd & (MALFORMED | UNKNOWN) and (n >= OFTEN or not torn):
            how = "with a body it cannot have" if odd & MALFORMED else "which stands in no manual"
            code, what = "odd-commands", f"{n} x {name} {how}: {shown}"
        else:
            continue
        yield Finding(
            code,
            _single(case, servo),
            *span,
            n,
            what,
            (Place(kinds.at[k], len(kinds.example[k]), span[0], name),),
            strength=min(0.5 + n / 10, 1.0),
            brief=f"{name} is not as the manual has it",
        )


def _single(case: Case, servo: int) -> int | None:
    """Return a servo, None where all or several are meant."""
    known = servo in case.answering or bool((case.writes["servo_id"] == servo).any())
    return servo if known and servo not in case.protocol.everyone else None


RULES: Final[tuple[Rule, ...]] = (
    goal_range,
    goal_limits,
    writes,
    unnamed_writes,
    memory_wear,
    gain_read,
    odd_commands,
)
"""The rules of this area."""
