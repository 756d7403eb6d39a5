"""Rules of the user's own: ``temperature > 70 for 2s``, ``3.voltage < 9``, ``position_error > 5``.

    [SERVO.]QUANTITY OPERATOR NUMBER [UNIT] [for TIME]

A servo is an id, one of a bus (``arm:3``), or what it is called: whose ids these are is asked of
who knows the names. A quantity is one that the register tables have (``Register.quantity``), the
name of a register, or ``<quantity>_error``: how far what is measured is from the last goal
(``goal_<quantity>``), on whichever side. The number is in the unit of the table. How a rule is
judged, ``thresholds.py`` has.
"""

from __future__ import annotations

import difflib
import operator
import re
from collections import Counter
from dataclasses import dataclass, replace
from types import MappingProxyType
from typing import TYPE_CHECKING, Final, NamedTuple

from sniffer.ground.amounts import time_as, time_in
from sniffer.ground.codes import COMMANDED, MEASURED
from sniffer.ground.limits import IDS, OF_BUS, number_in
from sniffer.ground.model import InputError, Severity
from sniffer.ground.units import SIGNS

if TYPE_CHECKING:
    from collections.abc import Callable, Iterable, Mapping, Sequence

    from sniffer.ground.registers import Register
    from sniffer.protocols.base import BusProtocol

OPERATORS: Final[Mapping[str, Callable[..., object]]] = MappingProxyType(
    {
        ">": operator.gt,
        ">=": operator.ge,
        "<": operator.lt,
        "<=": operator.le,
        "==": operator.eq,
        "!=": operator.ne,
    }
)

ERROR: Final = "_error"
"""What turns a quantity that is measured and has a goal into the distance of the two."""

GOAL: Final = "goal_"

_UNITS: Final[Mapping[str, str]] = MappingProxyType(
    {"C": "degC", **{sign: unit for unit, sign in SIGNS.items()}}
)
"""What people write, as the tables have it."""

_FORM: Final = re.compile(
    r"(?:(?P<servo>[^<>=!]*[^<>=!\s])\s*\.\s*)?(?P<name>[A-Za-z_]\w*)\s*(?P<op>[<>=!]=?)\s*"
    r"(?P<limit>[-+]?(?:\d+\.?\d*|\.\d+)(?:[eE][-+]?\d+)?)\s*(?P<unit>(?!for\b)[A-Za-z°%][A-Za-z/%]*)?"
    r"(?:\s*\bfor\s+(?P<time>\S.*))?"
)

ALARM_CODES: Final[dict[str, tuple[str, Severity, str, str, str]]] = {
    "alarm": (
        "yours",
        Severity.WARN,
        "A rule of your own (`--alarm`) is met: what is said begins with the rule.",
        "What you wrote it for.",
        "Look at what was commanded before it, and at the same servo's other values.",
    ),
    "alarm-over": (
        "yours",
        Severity.NOTE,
        "A rule of your own that was met no longer is.",
        "The value has come back.",
        "Nothing to do.",
    ),
}
"""Group, severity, meaning, causes, remedy of each code, as ``tap.TAP_CODES``."""

WRITE: Final = (
    "write it like 'temperature > 70', '3.voltage < 9', 'arm:3.voltage < 9' or "
    "'position_error > 5 for 2s'"
)


@dataclass(frozen=True, slots=True)
class Alarm:
    """One rule: what must be so of a servo (None: of any), and for how long, in ns.

    ``unit`` is empty where none was written: it is then what the tables of a protocol have.
    ``called`` is a servo that was told otherwise than by an id alone: by its name, or with its bus.
    """

    quantity: str
    op: str
    limit: float
    servo_id: int | None = None
    unit: str = ""
    for_ns: int = 0
    called: str = ""

    def on(self, bus: str, ids: Callable[[str, str], Iterable[int]]) -> tuple[Alarm, ...]:
        """Return the rule on the servos of a bus that it is about, each by its id.

        Args:
            bus: what the bus is called.
            ids: tells which servos of a bus are called so.
        """
        if not self.called:
            return (self,)
        return tuple(replace(self, servo_id=servo) for servo in ids(bus, self.called))

    def __str__(self) -> str:
        who = self.called or ("" if self.servo_id is None else str(self.servo_id))
        who = f"{who}." if who else ""
        unit = f" {self.unit}" if self.unit else ""
        long = f" for {time_as(self.for_ns)}" if self.for_ns else ""
        return f"{who}{self.quantity} {self.op} {self.limit:.12g}{unit}{long}"


def is_alarm(text: str) -> bool:
    """Tell whether somebody meant to write a rule: there is an operator in it."""
    return any(sign in text for sign in "<>=!")


def alarm_in(text: str) -> Alarm:
    """Read a rule.

    Raises:
        InputError: it is none; the message says how one is written.
    """
    match = _FORM.fullmatch(text.strip())
    if match is None or match["op"] not in OPERATORS:
        raise InputError(f"{text[:60]!r} is no rule: {WRITE}")
    who = match["servo"] or ""
    servo = number_in(who, 0, IDS - 1)
    number = who.rpartition(OF_BUS)[2]
    if number.isdecimal() and number_in(number, 0, IDS - 1) is None:
        raise InputError(f"{text[:60]!r}: an id is 0..{IDS - 1}")
    for_ns = 0
    if match["time"] is not None:
        told = time_in(match["time"], bare=False)
        if told is None:
            raise InputError(f"{text[:60]!r}: {match['time'][:20]!r} is no time: write 2s or 500ms")
        for_ns = told
    unit = match["unit"] or ""
    unit = _UNITS.get(unit, unit)
    called = "" if servo is not None else who
    return Alarm(match["name"], match["op"], float(match["limit"]), servo, unit, for_ns, called)


def on_bus(
    alarms: Iterable[Alarm], bus: str, ids: Callable[[str, str], Iterable[int]]
) -> tuple[Alarm, ...]:
    """Return the rules that servos of a bus can meet, as ``Alarm.on`` does."""
    return tuple(mine for alarm in alarms for mine in alarm.on(bus, ids))


class Meant(NamedTuple):
    """The registers that a rule is about: what is measured, and where it is a distance, its goal.

    Rows of a protocol's registers; ``others`` are goals in another unit: where one of them was
    written, nobody knows the distance.
    """

    unit: str
    measured: tuple[int, ...]
    goals: tuple[int, ...] = ()
    others: tuple[int, ...] = ()


def meant(alarm: Alarm, registers: Sequence[Register]) -> Meant | None:
    """Return what a rule is about among some registers; None: nothing of theirs."""
    error = alarm.quantity.removesuffix(ERROR)
    if error != alarm.quantity and (found := _distance(error, alarm.unit, registers)):
        return found
    rows = [i for i, r in enumerate(registers) if r.quantity == alarm.quantity]
    rows = rows or [i for i, r in enumerate(registers) if r.name == alarm.quantity]
    rows = [i for i in rows if registers[i].type not in ("text", "none")]
    unit = alarm.unit or _usual_unit(alarm.quantity, rows, registers)
    rows = [i for i in rows if registers[i].unit == unit]
    return Meant(unit, tuple(rows)) if rows else None


def _distance(quantity: str, unit: str, registers: Sequence[Register]) -> Meant | None:
    measured = _of(quantity, MEASURED, registers)
    goals = _of(GOAL + quantity, COMMANDED, registers)
    unit = unit or _usual_unit(quantity, measured, registers)
    mine = tuple(i for i in measured if registers[i].unit == unit)
    aims = tuple(i for i in goals if registers[i].unit == unit)
    others = tuple(i for i in goals if registers[i].unit != unit)
    return Meant(unit, mine, aims, others) if mine and aims else None


def _of(quantity: str, role: int, registers: Sequence[Register]) -> list[int]:
    return [i for i, r in enumerate(registers) if r.quantity == quantity and r.role == role]


def _usual_unit(quantity: str, rows: Sequence[int], registers: Sequence[Register]) -> str:
    """Return the unit that most registers of a quantity have, those of its goal counted in.

    LSS states a position in degrees and in pulses, and has more words for goals in degrees.
    """
    goals = {quantity.removeprefix(GOAL), GOAL + quantity}
    beside = [r.unit for r in registers if r.quantity in goals]
    here = dict.fromkeys(registers[i].unit for i in rows)
    counts = Counter([*(registers[i].unit for i in rows), *beside])
    return max(here, key=lambda unit: counts[unit], default="")


def refusal(alarm: Alarm, protocols: Iterable[BusProtocol]) -> str | None:
    """Return in a sentence why no servo of some protocols can meet a rule; None: one can."""
    every = list(protocols)
    if any(meant(alarm, p.registers) for p in every):
        return None
    who = every[0].name if len(every) == 1 else "no protocol here"
    bare = Alarm(alarm.quantity, alarm.op, alarm.limit)
    units = {m.unit: None for p in every if (m := meant(bare, p.registers))}
    if units:
        shown = " or ".join(unit or "a number without unit" for unit in units)
        return f"{alarm.quantity} is in {shown}, not in {alarm.unit}"
    known = quantities(every)
    names = {r.name: None for p in every for r in p.registers if r.type not in ("text", "none")}
    near = difflib.get_close_matches(alarm.quantity, [*known, *names], 1)
    verb = "has no" if len(every) == 1 else "has a"
    advice = f"did you mean {near[0]}?" if near else f"one of {', '.join(known)}"
    return f"{who} {verb} quantity {alarm.quantity[:40]!r}: {advice}"


def quantities(protocols: Iterable[BusProtocol]) -> list[str]:
    """Return what rules can be about in some protocols, beside single registers."""
    every = [p.registers for p in protocols]
    names = dict.fromkeys(r.quantity for table in every for r in table if r.quantity)
    errors = [name + ERROR for name in names if any(_distance(name, "", table) for table in every)]
    return sorted([*names, *errors])
