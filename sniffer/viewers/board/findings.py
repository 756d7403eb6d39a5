"""Lines of the board about what is wrong: incidents with their causes, and anomalies."""

from __future__ import annotations

from typing import TYPE_CHECKING, NamedTuple

from rich.cells import cell_len

from sniffer.decoding.called import ServoNames
from sniffer.ground.moments import of_day
from sniffer.ground.wording import plain
from sniffer.viewers.board.cells import WIDE, Cell, fitted
from sniffer.viewers.board.state import RECENT_NS
from sniffer.viewers.board.troubles import latest

if TYPE_CHECKING:
    from collections.abc import Iterable, Sequence

    from sniffer.diagnosis.tracking import Tracked
    from sniffer.ground.model import Severity
    from sniffer.viewers.board.troubles import Trouble

Line = list[Cell]


def length(line: Line) -> int:
    """Return how many cells of a terminal a line takes."""
    return sum(cell_len(text) for text, _ in line)


class _Words(NamedTuple):
    """What a line says, from left to right."""

    who: str
    t_ns: int
    severity: Severity
    bus: str
    code: str
    times: str
    text: str


class FindingLines:
    """Writes them in a width; ``name`` is how wide the name of a bus is, 0 where there is one.

    ``names`` are what servos are called.
    """

    def __init__(
        self, now_ns: int, width: int, name: int = 0, names: ServoNames | None = None
    ) -> None:
        self._now_ns = now_ns
        self._width = width
        self._wide = width >= WIDE
        self._name = name
        self._names = names or ServoNames()

    def incident(self, one: Tracked) -> Line:
        """Say what is wrong, why and how often: dim once it is over."""
        i = one.incident
        ids = ",".join(map(str, i.servo_ids))
        sure = f"{i.causes[0].percent} % "
        told = _Words(
            ids if len(ids) <= 3 else "all",
            i.first_ns,
            i.severity,
            i.bus,
            i.cause,
            f"×{i.count}",
            sure + (i.story if self._wide else f"{i.cause}: {i.story}"),
        )
        style = "dim" if one.is_over else ""
        return self._line(told, style, style, style or "id")

    def anomalies(
        self, troubles: Iterable[Trouble], incidents: Sequence[Tracked], room: int
    ) -> list[Line]:
        """Return the latest anomalies; those that an incident explains come where room is left."""
        held = [*troubles]
        every = [one.incident for one in incidents]
        told = {(i.bus, f.code) for i in every for f in i.findings}
        free = [e for e in held if (e.bus, e.last.code) not in told]
        rest = [e for e in held if (e.bus, e.last.code) in told]
        kept = [*latest(rest, room - len(free)), *latest(free, room)]
        return [self.anomaly(e) for e in held if e in kept]

    def anomaly(self, trouble: Trouble) -> Line:
        """Say what was wrong last, and how often it was."""
        a = trouble.last
        told = _Words(
            "" if a.servo_id is None else str(a.servo_id),
            a.t_ns,
            a.severity,
            trouble.bus,
            a.code,
            f"×{trouble.count}" if trouble.count > 1 else "",
            a.detail,
        )
        style = "" if self._now_ns - a.t_ns < RECENT_NS else "dim"
        return self._line(told, style, "", style)

    def _line(self, told: _Words, style: str, named: str, text: str) -> Line:
        """Return a line; ``named`` is the style of bus and code, empty for their own."""
        level = told.severity.name.lower()
        out: Line = [
            (f"{told.who:>3}  ", style or "id"),
            (f"{of_day(told.t_ns)}  ", style),
            (f"{level:5}  ", named or level),
        ]
        if self._name:
            out.append((fitted(plain(told.bus), self._name) + "  ", named or "bus"))
        if self._wide:
            out.append((fitted(told.code, 20) + "  ", named or level))
        out.append((f"{told.times:>6}  ", style))
        text_told = self._names.sentence(told.bus, told.text)
        return [*out, (fitted(plain(text_told), self._width - length(out)).rstrip(), text)]
