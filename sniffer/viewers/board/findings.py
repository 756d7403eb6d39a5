"""Lines of the board about what is wrong: incidents with their causes, and anomalies."""

from __future__ import annotations

import datetime
from typing import TYPE_CHECKING

from rich.cells import cell_len

from sniffer.ground.model import NS
from sniffer.ground.wording import plain
from sniffer.viewers.board.cells import WIDE, Cell, fitted
from sniffer.viewers.board.state import RECENT_NS
from sniffer.viewers.board.troubles import latest

if TYPE_CHECKING:
    from collections.abc import Sequence

    from sniffer.diagnosis.tracking import Tracked
    from sniffer.viewers.board.troubles import Trouble, Troubles

Line = list[Cell]


def length(line: Line) -> int:
    """Return how many cells of a terminal a line takes."""
    return sum(cell_len(text) for text, _ in line)


class FindingLines:
    """Writes them in a width; ``name`` is how wide the name of a bus is, 0 where there is one."""

    def __init__(self, now_ns: int, width: int, name: int = 0) -> None:
        self._now_ns = now_ns
        self._width = width
        self._wide = width >= WIDE
        self._name = name

    def incident(self, one: Tracked) -> Line:
        """Say what is wrong, why and how often: dim once it is over."""
        i = one.incident
        moment = datetime.datetime.fromtimestamp(i.first_ns // NS, datetime.UTC)
        level = i.severity.name.lower()
        who = ",".join(map(str, i.servo_ids))
        style = "dim" if one.is_over else ""
        out: Line = [
            (f"{who if len(who) <= 3 else 'all':>3}  ", style or "id"),
            (f"{moment:%H:%M:%S}.{i.first_ns % NS // 1_000_000:03d}  ", style),
            (f"{level:5}  ", style or level),
        ]
        if self._name:
            out.append((fitted(plain(i.bus), self._name) + "  ", style or "bus"))
        if self._wide:
            out.append((fitted(i.cause, 20) + "  ", style or level))
        out.append((f"{f'×{i.count}':>6}  ", style))
        sure = f"{100 * i.causes[0].confidence:.0f} % "
        room = self._width - length(out)
        told = f"{sure}{plain(i.story)}" if self._wide else f"{sure}{i.cause}: {plain(i.story)}"
        return [*out, (fitted(told, room).rstrip(), style or "id")]

    def anomalies(self, troubles: Troubles, incidents: Sequence[Tracked], room: int) -> list[Line]:
        """Return the latest anomalies; those that an incident explains come where room is left."""
        held = troubles.latest(len(troubles))
        every = [one.incident for one in incidents]
        told = {(i.bus, f.code) for i in every for f in i.findings}
        free = [e for e in held if (e.bus, e.last.code) not in told]
        rest = [e for e in held if (e.bus, e.last.code) in told]
        kept = [*latest(rest, room - len(free)), *latest(free, room)]
        return [self.anomaly(e) for e in held if e in kept]

    def anomaly(self, trouble: Trouble) -> Line:
        """Say what was wrong last, and how often it was."""
        a = trouble.last
        moment = datetime.datetime.fromtimestamp(a.t_ns // NS, datetime.UTC)
        level = a.severity.name.lower()
        now = self._now_ns - a.t_ns < RECENT_NS
        who = "" if a.servo_id is None else str(a.servo_id)
        times = f"×{trouble.count}" if trouble.count > 1 else ""
        out: Line = [
            (f"{who:>3}  ", "id" if now else "dim"),
            (f"{moment:%H:%M:%S}.{a.t_ns % NS // 1_000_000:03d}  ", "" if now else "dim"),
            (f"{level:5}  ", level),
        ]
        if self._name:
            out.append((fitted(plain(trouble.bus), self._name) + "  ", "bus"))
        if self._wide:
            out.append((fitted(a.code, 20) + "  ", level))
        out.append((f"{times:>6}  ", "" if now else "dim"))
        return [
            *out,
            (fitted(plain(a.detail), self._width - length(out)).rstrip(), "" if now else "dim"),
        ]
