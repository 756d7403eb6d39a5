"""What was known of the servos at a moment: the last value of each quantity."""

from __future__ import annotations

import math
from dataclasses import dataclass, replace
from typing import TYPE_CHECKING, Final

import numpy as np

from sniffer.ground.codes import WHOLE
from sniffer.ground.model import NS
from sniffer.ground.units import word_of
from sniffer.inside.pages import LastValue
from sniffer.sinks.words import short_value

if TYPE_CHECKING:
    from sniffer.ground.registers import Register
    from sniffer.inside.index import CaptureIndex
    from sniffer.inside.pages import Board

GOAL: Final = "goal_position"

SHOWN: Final = (
    "position",
    GOAL,
    "speed",
    "load",
    "current",
    "voltage",
    "temperature",
)
"""Quantities that have a column, as ``Register.quantity`` names them; others are left out."""

NEAR: Final = 1 << 12
"""Lines in which a bus is looked for first."""

TITLES: Final = {GOAL: "goal", "temperature": "temp"}


@dataclass(frozen=True, slots=True)
class MomentRow:
    """A servo: its cells by title, and how long ago its latest value was told, in seconds.

    ``who`` is its id with its name.
    """

    bus: str
    servo: int
    who: str
    cells: dict[str, str]
    age_s: float


def moment_of(index: CaptureIndex, number: int) -> list[MomentRow]:
    """Return the servos of all buses as they were known when a line was heard."""
    one = index.lines[number]
    now = int(one["t"])
    out: list[MomentRow] = []
    for bus, name in enumerate(index.buses):
        page = _page(index, bus, number)
        if page < 0:
            continue
        board = _board(index, page, now)
        rows = _rows(name, index.protocols[bus].registers, board, now)
        out += [replace(row, who=index.names.label(name, row.servo)) for row in rows]
    return out


def _page(index: CaptureIndex, bus: int, number: int) -> int:
    """Return the page of a bus's last line up to a line, -1 where there is none.

    Pages of several buses overlap in time: one that is later may begin before this line.
    """
    for first in (max(number + 1 - NEAR, 0), 0):
        lines = index.lines[first : number + 1]
        mine = np.flatnonzero(lines["bus"] == bus)
        if len(mine):
            return int(lines["page"][mine[-1]])
    return -1


def _board(index: CaptureIndex, number: int, now: int) -> Board:
    """Return what a page begins with, and what it tells up to a moment."""
    page = index.pages.get(number)
    v = page.batch.samples
    out = dict(page.before)
    # in order of the wire, which is nearly that of time
    for k in range(int(np.searchsorted(v.t_ns, now, "right"))):
        servo, register = int(v.servo_id[k]), int(v.register[k])
        out[servo, register] = LastValue(
            int(v.t_ns[k]), int(v.raw[k]), float(v.value[k]), int(v.part[k])
        )
    return out


def _rows(bus: str, registers: tuple[Register, ...], board: Board, now: int) -> list[MomentRow]:
    servos: dict[int, dict[str, tuple[Register, LastValue]]] = {}
    for (servo, number), told in board.items():
        register = registers[number]
        if register.quantity in SHOWN and told.part == WHOLE:
            known = servos.setdefault(servo, {})
            if register.quantity not in known or known[register.quantity][1].t_ns <= told.t_ns:
                known[register.quantity] = register, told
    out = []
    for servo, known in sorted(servos.items()):
        cells = {
            TITLES.get(q, q): short_value(known[q][0], known[q][1].raw, known[q][1].value)
            for q in SHOWN
            if q in known
        }
        if (error := _error(known)) is not None:
            cells["error"] = error
        # a servo that is silent is told its goals all the same
        said = [told.t_ns for q, (_, told) in known.items() if q != GOAL]
        latest = max(said or [known[GOAL][1].t_ns])
        out.append(MomentRow(bus, servo, str(servo), cells, (now - latest) / NS))
    return out


def _error(known: dict[str, tuple[Register, LastValue]]) -> str | None:
    """Return by how much the goal lies beyond the position, where both have one unit."""
    if "position" not in known or GOAL not in known:
        return None
    (here, is_at), (goal, to) = known["position"], known[GOAL]
    if here.unit != goal.unit or math.isnan(is_at.value) or math.isnan(to.value):
        return None
    return f"{to.value - is_at.value:+.4g} {word_of(here.unit)}".rstrip()
