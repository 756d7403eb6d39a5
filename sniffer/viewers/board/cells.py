"""What stands in the cells of the live board: numbers with units, in widths that do not change."""

from __future__ import annotations

import math
from dataclasses import dataclass, replace
from typing import TYPE_CHECKING, Final

import numpy as np
from rich.cells import cell_len, set_cell_size

from sniffer.ground.model import NS
from sniffer.ground.units import behind
from sniffer.ground.wording import plain
from sniffer.viewers.board.state import QUANTITIES, RECENT_NS

if TYPE_CHECKING:
    from collections.abc import Sequence

    from sniffer.decoding.called import ServoNames
    from sniffer.decoding.durations import Bounds
    from sniffer.ground.registers import Register
    from sniffer.viewers.board.state import BusTally

Cell = tuple[str, str]
"""A text that cannot steer the terminal, and a style of the board by name."""

LIT_NS: Final = NS // 2
"""A value that was another one before is lit for so long."""

STALE_NS: Final = 2 * NS
"""A value older than this is dimmed."""

DECIMALS: Final = {"position": 2, "goal_position": 2, "load": 1, "voltage": 1}
"""Most decimals that a quantity is shown with."""


@dataclass(frozen=True, slots=True)
class Column:
    """A column of the table of servos.

    ``widths`` are those on a narrow and on a wide terminal, 0 where it is left out. ``drop`` says
    which columns go first where even the narrow ones have no room, 0 for never.
    """

    key: str
    titles: tuple[str, str]
    widths: tuple[int, int]
    drop: int = 0


COLUMNS: Final = (
    Column("id", ("id", "id"), (3, 3)),
    Column("goal_position", ("goal", "goal"), (8, 10), 5),
    Column("position", ("position", "position"), (8, 10)),
    Column("error", ("error", "error"), (6, 8), 9),
    Column("load", ("load", "load"), (7, 9), 4),
    Column("voltage", ("supply", "supply"), (6, 8), 3),
    Column("temperature", ("temp", "temp"), (5, 7), 2),
    Column("rate", ("/s", "answers/s"), (4, 9), 6),
    Column("p50", ("p50 ms", "reply p50 ms"), (6, 13), 7),
    Column("p99", ("p99 ms", "p99 ms"), (6, 7), 1),
    Column("missing", ("missing", "missing"), (9, 12), 8),
    Column("damaged", ("", "damaged"), (0, 7)),
)
"""All but the last one, the alarms, which has what is left."""

TITLES: Final = {column.key: column.titles[1] for column in COLUMNS}

ALARMS: Final = 8
"""The least room for alarms: the longest name of one that is frequent, "overload"."""

WIDE: Final = 120
"""From this width on the columns are wide."""


NAMES: Final = (14, 24)
"""What ids with names may take on a narrow and on a wide terminal: a servo's page has it whole."""


def id_column(names: ServoNames) -> Column:
    """Return the column of ids, with room for names where there are any."""
    first = COLUMNS[0]
    longest = max(map(cell_len, names.known), default=0)
    if not longest:
        return first
    needed = first.widths[0] + 1 + longest
    title = f"{'id':>{first.widths[0]}} servo"
    return replace(
        first, titles=(title, title), widths=(min(needed, NAMES[0]), min(needed, NAMES[1]))
    )


def fitted(text: str, width: int, *, right: bool = False) -> str:
    """Cut or pad to a width in cells of the terminal; what was cut ends in an ellipsis."""
    length = cell_len(text)
    if length > width:
        return set_cell_size(text, width - 1) + "…" if width > 0 else ""
    pad = " " * (width - length)
    return pad + text if right else text + pad


def decimals(register: Register) -> int:
    """Return how many decimals a register's resolution is worth."""
    if not register.unit:
        return 0
    scales = [register.scale, *(register.scale_by[1].values() if register.scale_by else ())]
    step = min(abs(scale) for scale in scales if scale)
    most = DECIMALS.get(register.quantity, 0)
    return min(max(math.ceil(-math.log10(step) - 1e-9), 0), most)


def told_value(register: Register, raw: int, value: float) -> str:
    """Return a value with its unit, always with as many decimals; or the name of a special one."""
    names = register.names(raw)
    if names is not None:
        return plain(",".join(names) or "none" if isinstance(names, list) else names)
    if value != value:  # NaN: nothing in units
        return f"raw {raw}"
    return f"{value:.{decimals(register)}f}{behind(register.unit)}"


def milliseconds(bounds: Bounds | None) -> str:
    """Return a reply time; where the stamps carry no figure, what it is below."""
    if bounds is None:
        return "-"
    ms = (bounds.high if bounds.point is None else bounds.point) / 1e6
    digits = 2 if ms < 9.995 else 1 if ms < 99.95 else 0
    return f"{'<' if bounds.point is None else ''}{ms:.{digits}f}"


def share(count: int, of: int) -> str:
    """Return a share in percent; what happened is never 0 %, what failed to is never 100 %."""
    if not count or not of:
        return ""
    percent = 100 * count / of
    if percent < 1:
        return "<1%"
    return f"{min(percent, 99) if count < of else 100:.0f}%"


def size(count: int) -> str:
    """Return a number of bytes in a unit that leaves it at most four digits."""
    value, unit = float(count), "B"
    for larger in ("kB", "MB", "GB", "TB"):
        if value < 1000:
            break
        value, unit = value / 1000, larger
    return f"{count} B" if unit == "B" else f"{value:.1f} {unit}"


def clock(seconds: float) -> str:
    """Return a duration as hours, minutes and seconds."""
    whole = int(seconds)
    return f"{whole // 3600}:{whole // 60 % 60:02d}:{whole % 60:02d}"


def age_style(now_ns: int, seen_ns: int, changed_ns: int) -> str:
    """Return how a value is shown: lit where it has just changed, dim where it is old."""
    if now_ns - seen_ns > STALE_NS:
        return "dim"
    return "lit" if changed_ns and now_ns - changed_ns < LIT_NS else ""


class ServoCells:
    """The servos of one bus as cells, computed for one moment."""

    def __init__(self, tally: BusTally, now_ns: int, end_ns: int) -> None:
        self._tally = tally
        self._now_ns = now_ns
        sums, seconds = tally.answers.until(end_ns)
        self._rates = sums / seconds
        self._p50, self._p99 = tally.times(end_ns)
        self._alarmed = tally.alarmed()
        self._errors = tally.errors()
        trouble = tally.servos.trouble_ns
        self._recent = (trouble > 0) & (now_ns - trouble < RECENT_NS)
        self.order = np.argsort(tally.servos.servo_id).tolist()
        """Rows by id."""

    def __len__(self) -> int:
        return len(self.order)

    def id(self, row: int) -> int:
        """Return the servo of a row."""
        return int(self._tally.servos.servo_id[row])

    def troubled(self, row: int) -> bool:
        """Tell whether a servo has an alarm on or had trouble in the last moments."""
        return bool(self._alarmed[row] or self._recent[row])

    def heard(self, row: int) -> bool:
        """Tell whether a servo has answered lately."""
        return self._now_ns - int(self._tally.servos.heard_ns[row]) < RECENT_NS

    def cells(self, row: int, keys: Sequence[str]) -> list[Cell]:
        """Return the cells of a servo, the alarms last."""
        return [self._cell(row, key) for key in keys] + [self._alarms(row)]

    def _cell(self, row: int, key: str) -> Cell:
        s = self._tally.servos
        if key == "id":
            style = "alarm" if self._alarmed[row] else "doubt" if self._recent[row] else "id"
            return str(int(s.servo_id[row])), style
        if key == "rate":
            rate = float(self._rates[row])
            return f"{rate:.1f}" if rate < 99.95 else f"{rate:.0f}", "" if rate else "dim"
        if key in ("p50", "p99"):
            bounds = (self._p50 if key == "p50" else self._p99)[row]
            return milliseconds(bounds), "dim" if bounds is None else ""
        if key in ("missing", "damaged"):
            count = int((s.missing if key == "missing" else s.damaged)[row])
            style = "dim" if not count else "bad" if self._recent[row] else "doubt"
            if key == "damaged":
                return str(count), style
            return f"{count} {share(count, int(s.asked[row])):>4}", style
        if key == "error":
            return self._error(row)
        return self._value(row, key)

    def measure(self, row: int, key: str) -> float:
        """Return the number by which servos are sorted in a column; NaN: there is none."""
        s, t = self._tally.servos, self._tally
        if key in ("missing", "damaged"):
            return int((s.missing if key == "missing" else s.damaged)[row])
        if key in ("p50", "p99"):
            bounds = (self._p50 if key == "p50" else self._p99)[row]
            return math.nan if bounds is None else bounds.high
        if key == "rate":
            return float(self._rates[row])
        if key == "error":
            return abs(float(self._errors[row]))
        if key == "id":
            return int(s.servo_id[row])
        k = self._column(row, key)
        return abs(float(t.value[row, k])) if t.seen_ns[row, k] >= 0 else math.nan

    def sorted(self, key: str, *, falls: bool) -> list[int]:
        """Return the rows by a column; what has no number there stands last."""
        told = [(self.measure(row, key), row) for row in self.order]
        known = sorted((e for e in told if e[0] == e[0]), key=lambda e: e[0], reverse=falls)
        return [row for _, row in known] + [row for number, row in told if number != number]

    def _error(self, row: int) -> Cell:
        """Say how far the position is off the goal; it is as old as the position."""
        error, t = float(self._errors[row]), self._tally
        if error != error:
            return "-", "dim"
        k = QUANTITIES.index("position")
        digits = decimals(t.protocol.registers[int(t.register[row, k])])
        old = self._now_ns - int(t.seen_ns[row, k]) > STALE_NS
        return f"{error:+.{digits}f}", "dim" if old else ""

    def _column(self, row: int, key: str) -> int:
        """Return where a quantity stands; a servo that states its current has that as load."""
        k = QUANTITIES.index(key)
        if key == "load" and self._tally.seen_ns[row, k] < 0:
            return QUANTITIES.index("current")
        return k

    def _value(self, row: int, key: str) -> Cell:
        t = self._tally
        k = self._column(row, key)
        seen = int(t.seen_ns[row, k])
        if seen < 0:
            return "-", "dim"
        register = t.protocol.registers[int(t.register[row, k])]
        text = told_value(register, int(t.raw[row, k]), float(t.value[row, k]))
        changed = int(t.memory.changed_ns[row, int(t.register[row, k])])
        return text, age_style(self._now_ns, seen, changed)

    def _alarms(self, row: int) -> Cell:
        if not self._alarmed[row]:
            return "", ""
        stale = self._now_ns - int(self._tally.servos.heard_ns[row]) > STALE_NS
        return plain(", ".join(self._tally.alarms(row))), "dim alarm" if stale else "alarm"
